"""A guard that touches zero and turns there, as 1 - sin t does, has not fallen through it; one that dips below has."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs


class Quantized(hs.AbstractHybridSystem):
    """x' = gain floor(2 sin(w t + phase)): the crest of the sine is a whole number, its trough another."""

    gain: jax.Array
    w: jax.Array
    phase: jax.Array

    located_discontinuities = True

    def flow(self, t, x, mode):
        return self.gain * jnp.floor(2 * jnp.sin(self.w * t + self.phase))

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


class Counted(hs.AbstractHybridSystem):
    """x counts how often height - sin 3 t falls through 0."""

    height: jax.Array

    def flow(self, t, x, mode):
        return jnp.zeros_like(x)

    def guards(self, t, x, mode):
        return (self.height - jnp.sin(3 * t))[None]

    def transition(self, event, t, x, mode):
        return x + 1, mode


END = 3.0


def quantized(gain, w, phase):
    """The same in closed form, from the places where 2 sin passes a whole number."""
    turns = np.arange(-2, 5)[:, None] * 2 * np.pi
    places = (turns + np.pi / 6 * np.array([0, 1, 3, 5, 6, 7, 9, 11])).ravel()
    times = [0.0, *sorted(t for t in (places - phase) / w if 0 < t < END), END]
    pieces = [(b - a) * np.floor(2 * np.sin(w * (a + b) / 2 + phase)) for a, b in zip(times, times[1:], strict=False)]
    return gain * sum(pieces)


@pytest.fixture(scope="module")
def solved():
    """Final x of a `Quantized`, its gradient and its status."""

    def solve(gain, w, phase):
        solution = hs.solve(Quantized(gain, w, phase), 0.0, t1=END, throw=False)
        return solution.final, solution.status

    return jax.jit(jax.value_and_grad(solve, argnums=(0, 1, 2), has_aux=True))


@pytest.mark.slow
@pytest.mark.parametrize("phase", [0.1, 0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("w", [3.0, 2.21])
def test_a_sine_may_touch_a_whole_number(w, phase, solved):
    """At a crest the floor is another number for an instant alone: no event, and the motion goes on."""
    (final, status), slopes = solved(1.3, w, phase)
    assert status == hs.Status.successful
    assert final == pytest.approx(quantized(1.3, w, phase), abs=1e-12)
    for slope, at in zip(slopes, np.eye(3), strict=True):
        beside = [quantized(*(np.array([1.3, w, phase]) + d * at)) for d in (1e-5, -1e-5)]
        assert slope == pytest.approx((beside[0] - beside[1]) / 2e-5, rel=1e-8, abs=1e-8)


@pytest.fixture(scope="module")
def count():
    """Times of the events of a `Counted`, and their number."""

    def solve(height):
        solution = hs.solve(Counted(height), 0.0, t1=2.0, max_events=4)
        return solution.events.time, solution.events.count

    return jax.jit(solve)


def test_a_guard_that_touches_zero_has_not_fallen(count):
    assert count(1.0)[1] == 0


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, 1e-12, 1e-14])
def test_one_that_dips_below_has(depth, count):
    """However thin the dip: sin 3 t = height at pi / 2 - arccos(height), by half an angle free of cancellation."""
    times, number = count(1.0 - depth)
    assert number == 1
    # Rounding of the guard, 8 eps, moves the place where it falls by that over its slope there.
    slope = 3 * np.sqrt(2 * depth)
    falls = (np.pi / 2 - 2 * np.arcsin(np.sqrt(depth / 2))) / 3
    assert times[0] == pytest.approx(falls, abs=2e-15 / slope + 1e-15)
