"""Jumps that no comparison of two moving numbers shows: equality to what stands still, x / |x|, wrapped angles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs

P, END = 0.8, 2.0


class Told(hs.AbstractHybridSystem):
    """Integrals of functions of the time that jump at places which p moves."""

    p: jax.Array
    located_discontinuities = True

    def flow(self, t, x, mode):
        wave, angle = 3 * jnp.sin(3 * t), 4 * t + self.p
        apart = (t - self.p)[None]
        return {
            "open": jnp.where(jax.nn.relu(t - self.p) != 0, 1.0, -1.0),
            "unsaturated": jnp.where(jnp.clip(wave, -self.p, self.p) == wave, 1.0, -1.0),
            "larger": jnp.where(jnp.maximum(t, self.p) == t, 1.0, -1.0),
            "direction": (2 * self.p * apart / jnp.linalg.norm(apart))[0],
            "odd": jnp.where(jnp.floor(t / self.p) % 2 == 1, 1.0, 0.0),
            "angle": jnp.arctan2(jnp.sin(angle), jnp.cos(angle)),
        }

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


UNSATURATED = np.arcsin(P / 3)
"""How long 3 |sin 3 t| is less than p: a third of it after t = 0, and on both sides of 3 t = pi."""
TRUTH = {
    "open": (END - 2 * P, -2.0),
    "unsaturated": (2 * UNSATURATED - END, 2 / np.sqrt(9 - P**2)),
    "larger": (END - 2 * P, -2.0),
    "direction": (2 * P * (END - 2 * P), 2 * END - 8 * P),
    "odd": (P, 1.0),
    "angle": ((wrapped(4 * END + P) ** 2 - P**2) / 8, (wrapped(4 * END + P) - P) / 4),
}
"""Integral and its derivative by p."""


@pytest.fixture(scope="module")
def solved():
    """Integrals and their slopes."""

    def twice(p):
        integrals = hs.solve(Told(p), dict.fromkeys(TRUTH, 0.0), t1=END).final
        return integrals, integrals

    return jax.jit(jax.jacrev(twice, has_aux=True))(P)[::-1]


@pytest.mark.parametrize("name", TRUTH)
def test_its_place_moves_the_integral(name, solved):
    """The gradients of the first four were 0 or that of the smooth part, without a word."""
    value, slope = (part[name] for part in solved)
    assert (value, slope) == pytest.approx(TRUTH[name], abs=1e-8)


class Friction(hs.AbstractScene):
    """A mass that dry friction slows, written for any number of coordinates; a wind blows it back."""

    friction: jax.Array
    located_discontinuities = True

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -1.0 - self.friction * v / jnp.linalg.norm(v)

    def gap(self, t, q):
        return q + 10.0

    def restitution(self):
        return jnp.zeros(1)


@pytest.mark.slow
def test_a_direction_is_that_of_dry_friction():
    """v0 = 1 is slowed by 1 + f and then driven back by 1 - f: v(1) = -(1 - f) (1 - 1 / (1 + f))."""
    final = lambda f: hs.simulate(Friction(f), hs.State([0.0], [1.0]), t1=1.0).final.v[0]
    speed = lambda f: -(1 - f) * (1 - 1 / (1 + f))
    found, expected = jax.value_and_grad(final)(0.5), jax.value_and_grad(speed)(0.5)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
