"""A state moves on while the clock passes a jump time: many of them at a late clock cost nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Stairs(hs.AbstractScene):
    """A body with drag, pushed in stairs: v' = -v + s_j between times j and j + 1."""

    slopes: jax.Array
    times: jax.Array
    known_discontinuities = True

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return self.slopes[jnp.searchsorted(self.times, t, side="right")] - v

    def gap(self, t, q):
        return q + 100.0

    def restitution(self):
        return jnp.array([0.5])

    def jump_times(self):
        return self.times


METHODS = [hs.Replay(), hs.ForwardSensitivities()]


@pytest.mark.slow
@pytest.mark.parametrize("adjoint", METHODS, ids=["reverse", "forward"])
@pytest.mark.parametrize("t0", [0.0, 1e6, 1.7e9])
def test_a_hundred_jump_times_at_any_clock(t0, adjoint):
    """At 1.7e9 each jump time lost 6e-6 of a second, and the body its way there."""
    slopes = jnp.asarray(1 + 0.5 * np.sin(np.arange(101)))
    times = t0 + jnp.arange(1, 101) / 4

    def end(slopes, times):
        state = hs.simulate(Stairs(slopes, times), hs.State([0.0], [1.0]), t0=t0, t1=t0 + 26.0, adjoint=adjoint).final
        return state.q[0]

    def exact(slopes, since):
        """q(T) = v0 (1 - e^-T) + sum over pieces of s_j ((b - a) - (e^-(T-b) - e^-(T-a)))."""
        grid = jnp.concatenate([jnp.zeros(1), since, jnp.full(1, 26.0)])
        return 1 - jnp.exp(-26.0) + jnp.sum(slopes * (jnp.diff(grid) - jnp.diff(jnp.exp(grid - 26.0))))

    way = jax.jacfwd if adjoint.forward_mode else jax.grad
    found = [end(slopes, times), *way(end, (0, 1))(slopes, times)]
    expected = [exact(slopes, times - t0), *jax.grad(exact, (0, 1))(slopes, times - t0)]
    for one, other in zip(found, expected, strict=True):
        assert_close(one, other, 1e-6)
