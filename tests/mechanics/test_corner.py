"""A point that falls into the corner of two walls strikes them in turn, infinitely often in a finite time, and rests;
then its load moves it on. Against the same impacts in many digits."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

ANGLE = np.deg2rad(33.0)
WALLS = np.array([[0.0, 1.0], [np.sin(ANGLE), -np.cos(ANGLE)]])
ALONG_FLOOR, ALONG_ROOF, NOWHERE = np.array([1.0, 0.0]), np.array([np.cos(ANGLE), np.sin(ANGLE)]), np.zeros(2)
START, END = (2.0, 0.5), 2.5


class Corner(hs.AbstractScene):
    """Between a floor, y >= 0, and a roof at an angle of 33 degrees."""

    load: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return self.load

    def gap(self, t, q):
        return jnp.asarray(WALLS) @ q

    def restitution(self):
        return self.e


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


def arrival(height, rate, pull):
    """After which time a gap closes that is 0 only where it was struck."""
    if height == 0:
        return -2 * rate / pull if pull < 0 <= rate else mp.inf
    square = rate**2 - 2 * pull * height
    return 2 * height / (mp.sqrt(square) - rate) if square > 0 and mp.sqrt(square) > rate else mp.inf


def place_at_end(e, load, v, along):
    """By parabolas until it is slower than 1e-30 in the corner, from where it is pushed `along` a direction."""
    walls, q, t, last = [[mp.mpf(x) for x in wall] for wall in WALLS], [mp.mpf(x) for x in START], mp.mpf(0), None
    while max(abs(u) for u in v) > mp.mpf(10) ** -30:
        heights = [mp.mpf(0) if i == last else dot(wall, q) for i, wall in enumerate(walls)]
        arrivals = [
            arrival(height, mp.mpf(0) if i == last and e[i] == 0 else dot(wall, v), dot(wall, load))
            for i, (wall, height) in enumerate(zip(walls, heights, strict=True))
        ]
        step = min(arrivals)
        last = arrivals.index(step)
        q = [x + u * step + f * step**2 / 2 for x, u, f in zip(q, v, load, strict=True)]
        v, t = [u + f * step for u, f in zip(v, load, strict=True)], t + step
        rate = dot(walls[last], v)
        v = [u - (1 + e[last]) * rate * n for u, n in zip(v, walls[last], strict=True)]
    pushed = dot(along, load) * (END - t) ** 2 / 2
    return [x + pushed * mp.mpf(d) for x, d in zip(q, along, strict=True)]


def exact(e, load, v, along):
    """The place, and its derivatives by the load and by the velocity at the start."""
    with mp.workdps(60):
        given, h = [mp.mpf(x) for x in (*load, *v)], mp.mpf(10) ** -25
        at = lambda given: np.array(place_at_end([mp.mpf(float(x)) for x in e], given[:2], given[2:], along))
        moved = lambda k, step: at([x + step * (j == k) for j, x in enumerate(given)])
        slopes = [(moved(k, h) - moved(k, -h)) / (2 * h) for k in range(4)]
        return at(given).astype(float), np.array(slopes).astype(float).T


PUSHED = {
    "along the roof": ((0.0, 0.5), (0.4, 0.43), (-2.6, -0.47), ALONG_ROOF),
    "into the corner": ((0.5, 0.05), (-1.0, -4.0), (-2.0, 0.0), NOWHERE),
    "along the floor": ((0.3, 0.3), (0.16, -1.29), (-2.45, -0.04), ALONG_FLOOR),
}


@pytest.mark.parametrize("pushed", PUSHED)
def test_it_rests_in_the_corner_and_leaves_it_as_it_is_pushed(pushed):
    """One wall was struck while the other, struck just before, was nearer than what counts as closed: both together
    threw it out of the corner at 0.2 m/s, in silence, at every tolerance. And a cascade of several contacts ends for
    all of them at once: where one was captured before, the other threw the point out at 1e-5 m/s.

    Along the floor the load itself makes the cascade last: cutting it at speed w moves the instant of rest by O(w)."""
    e, load, v, along = PUSHED[pushed]

    @jax.jit
    def place(given, capture_speed):
        scene, start = Corner(given[:2], jnp.array(e)), hs.State(jnp.array(START), given[2:])
        return hs.simulate(scene, start, t1=END, max_events=512, capture_speed=capture_speed).final.q

    given = jnp.array([*load, *v])
    expected, slopes = exact(e, load, v, along)
    for speed, error in ((6e-6, 1e-5), (1e-8, 1e-7)) if pushed == "along the floor" else ((6e-6, 1e-10),):
        assert_close(place(given, speed), expected, error, scale=1.0)
        assert_close(jax.jacrev(place)(given, speed), slopes, 10 * error, scale=1.0)
