"""The adjoint of a step whose stages run in a loop is that which JAX makes of the same stages written out."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from hybridsens.adjoint.step import RecordedStep
from hybridsens.adjoint.step_adjoint import differentiated_in_a_loop
from hybridsens.forward.explicit import ExplicitRungeKutta
from tests.closeness import assert_close

SOLVERS = [diffrax.Heun(), diffrax.Midpoint(), diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri8()]


class Network(eqx.Module):
    """A flow with parameters of several shapes."""

    weights: jax.Array
    shift: jax.Array

    def flow(self, t, x, mode):
        return jnp.tanh(self.weights @ x + mode * self.shift * t) - 0.3 * x**2


@pytest.mark.parametrize("controlled", [False, True])
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
def test_a_loop_carries_back_what_jax_does(solver, controlled):
    """By the state and by every parameter, of the new state and of the error estimate."""
    network = Network(jnp.array([[0.3, -1.2], [0.8, 0.5]]), jnp.array(0.7))
    t0, t1, x0 = jnp.array(0.2), jnp.array(0.5), jnp.array([0.4, -0.6])
    parameters, static = eqx.partition(network, eqx.is_inexact_array)
    step = RecordedStep(parameters, static, jnp.array(2.0), t0, t1, x0, solver, controlled)
    psi = jnp.array([[0.9, -0.4], [1.5, 2.0]])
    epsilon = jnp.array([[30.0, 0.0], [-7.0, 11.0]]) if controlled else None

    written_out = ExplicitRungeKutta(solver, True)
    advance = lambda p, x: written_out.advance_with_error(step.system(p), step.mode, t0, t1, x)
    (truth, error), vjp = jax.vjp(advance, parameters, x0)
    of_error = jnp.zeros_like(psi) if epsilon is None else epsilon
    expected = [vjp((of_x1, of_e)) for of_x1, of_e in zip(psi, of_error, strict=True)]

    x1, of_step = differentiated_in_a_loop(step, ExplicitRungeKutta(solver, False), step.system)
    assert_close(x1, truth, 1e-14)
    total, of_x0 = of_step(psi, epsilon)
    for row, (by_parameters, by_state) in enumerate(expected):
        assert_close(of_x0[row], by_state, 1e-12)
        assert_close(total.weights[row], by_parameters.weights, 1e-12)
        assert_close(total.shift[row], by_parameters.shift, 1e-12)
