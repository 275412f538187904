"""A derivative that ran out of steps is raised, in every mode and under every transformation; or nan, where that was
asked for."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs

FORWARD, ANY = hs.ForwardSensitivities(), hs.AnyMode()


class Oscillator(hs.AbstractHybridSystem):
    """At rest: its own steps are as long as can be, and those of a derivative a fraction of a second."""

    stiffness: jax.Array

    def flow(self, t, x, mode):
        return jnp.stack([x[1], -self.stiffness * x[0]])

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


def place(start, adjoint=None, t1=1000.0, sampled=False, **settings):
    """The last place, or the last that was sampled, from a place and a velocity of 0."""
    system, x0 = Oscillator(jnp.array(1.0)), jnp.stack([start, jnp.zeros(())])
    solution = hs.solve(system, x0, t1=t1, max_steps=16, adjoint=adjoint, **settings)
    return (solution.x[-1] if sampled else solution.final)[0]


def each(function):
    return lambda start, **how: jax.vmap(lambda x: function(x, **how))(jnp.stack([start, start]))


DERIVATIVES = {
    "reverse": lambda f: jax.grad(f),
    "of a batch": lambda f: each(jax.grad(f)),
    "through a batch": lambda f: jax.grad(lambda x: jnp.sum(each(f)(x))),
    "through a compiled batch": lambda f: jax.jit(jax.grad(lambda x: jnp.sum(jax.jit(each(f))(x)))),
    "reverse by any mode": lambda f: jax.grad(lambda x: f(x, adjoint=ANY)),
    "forward": lambda f: jax.jacfwd(lambda x: f(x, adjoint=FORWARD)),
    "forward of a batch": lambda f: each(jax.jacfwd(lambda x: f(x, adjoint=FORWARD))),
    "forward by any mode": lambda f: jax.jacfwd(lambda x: f(x, adjoint=ANY)),
    "second": lambda f: jax.hessian(f),
}
"""Names of ways to differentiate -> that."""


QUICK = ("reverse", "through a batch", "forward of a batch", "reverse by any mode", "second")
SLOW = ("of a batch", "forward", "forward by any mode")


@pytest.mark.parametrize("way", [*QUICK, *(pytest.param(way, marks=pytest.mark.slow) for way in SLOW)])
def test_it_is_raised(way):
    with pytest.raises(hs.SimulationError, match=r"^The derivative of the motion is not finished: .*`max_steps`"):
        DERIVATIVES[way](place)(jnp.array(0.0))


@pytest.mark.parametrize("way", ["reverse", "forward"])
def test_a_compiled_program_raises_it(way):
    """JAX hands on what a program raises in exceptions of its own."""
    with pytest.raises(Exception, match=r"SimulationError: The derivative of the motion is not finished"):
        jax.block_until_ready(jax.jit(DERIVATIVES[way](place))(jnp.array(0.0)))


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("way", ["reverse", "forward"])
def test_a_second_derivative_alone_is_raised(way, compiled):
    """Of the square of the last place, whose first derivative at 0 is 0 and takes no steps."""
    square = lambda x, **how: place(x, **how) ** 2
    second = jax.hessian(square) if way == "reverse" else jax.jacfwd(jax.jacfwd(lambda x: square(x, adjoint=FORWARD)))
    with pytest.raises(Exception, match="The derivative of the motion is not finished"):
        jax.block_until_ready((jax.jit(second) if compiled else second)(jnp.array(0.0)))


@pytest.mark.slow
def test_times_at_which_it_is_looked_at_need_no_steps():
    """By t1 and by the times of samples the derivative is the flow there, which is 0 at rest."""
    sampled = lambda ts: place(jnp.array(0.0), t1=1000.0, ts=ts, sampled=True)
    assert jax.grad(lambda t1: place(jnp.array(0.0), t1=t1))(1000.0) == 0
    assert not jnp.any(jax.grad(sampled)(jnp.array([1.0, 900.0])))


@pytest.mark.parametrize("throw", [False, "nan"])
def test_it_is_nan_where_nothing_is_to_be_raised(throw):
    value, slope = jax.value_and_grad(lambda x: place(x, throw=throw))(jnp.array(0.0))
    assert value == 0 and jnp.isnan(slope)


def test_the_motion_alone_has_room_enough():
    assert place(jnp.array(0.0)) == 0


@pytest.mark.parametrize("way", DERIVATIVES)
def test_a_derivative_with_room_is_itself(way):
    """cos(t) is the derivative of the last place by the first one, and 0 is that of this."""
    derivative = DERIVATIVES[way](lambda x, **how: place(x, t1=1.0, **how))(jnp.array(0.0))
    exact = {"second": 0.0, "through a batch": 2 * jnp.cos(1.0), "through a compiled batch": 2 * jnp.cos(1.0)}
    assert jnp.max(jnp.abs(derivative - exact.get(way, jnp.cos(1.0)))) < 1e-7
