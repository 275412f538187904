"""The stages of a Runge-Kutta method: in a loop they are those written out, and so are their derivatives."""

import diffrax
import jax
import jax.numpy as jnp
import pytest

from hybridsens.forward.explicit import _stages_in_a_loop, _stages_written_out
from tests.closeness import assert_close

SOLVERS = [diffrax.Heun(), diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri8()]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize("first_is_known", [False, True])
def test_stages_in_a_loop_are_those_written_out(solver, first_is_known):
    tableau = solver.tableau
    rows = tableau.a_lower[:-1] if tableau.fsal else tableau.a_lower
    y0, h, w = jnp.array([0.1, 0.5]), jnp.array(0.3), jnp.array([1.0, -0.7])

    def stages(way, y0):
        flow = lambda c, y: jnp.sin(3 * y[::-1] + c)
        known = flow(0.0, y0) if first_is_known else None
        first, rises = way(flow, y0, h, known, rows, tableau.c[: len(rows)])
        return jnp.stack([first, *rises])

    in_a_loop = lambda *given: _stages_in_a_loop(*given)[0]
    one, other = stages(in_a_loop, y0), stages(_stages_written_out, y0)
    assert_close(one, other, 1e-13)
    pulled = lambda way: jax.grad(lambda y0: jnp.sum(jnp.cos(stages(way, y0)) @ w))(y0)
    assert_close(pulled(in_a_loop), pulled(_stages_written_out), 1e-12)
