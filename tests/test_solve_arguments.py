"""What goes into `solve`: transformations of JAX, closures, and arguments that do not fit."""

import re

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall
from tests.problems.hybrid_systems import Ball, Oscillator

POINTS = jnp.array([[9.81, 0.8], [9.0, 0.7]])
"""Weight and restitution."""


def height(p):
    """Of a ball after its first impact."""
    return hs.solve(Ball(p[0], p[1]), jnp.array([1.0, 0.0]), t1=1.0, max_events=4).final[0]


def exact_height(p):
    fall = jnp.sqrt(2 / p[0])
    return p[1] * p[0] * fall * (1 - fall) - p[0] * (1 - fall) ** 2 / 2


@pytest.mark.slow
def test_second_derivatives():
    assert_close(jax.hessian(height)(POINTS[0]), jax.hessian(exact_height)(POINTS[0]), 1e-6)


@pytest.mark.slow
def test_transformations():
    """jit, vmap, and states between events."""
    assert_close(jax.jit(jax.vmap(jax.grad(height)))(POINTS), jax.vmap(jax.grad(exact_height))(POINTS), 1e-7)
    made = hs.solve(Ball(*POINTS[0]), jnp.array([1.0, 0.0]), t1=1.0)
    assert_close(made.evaluate(0.2)[0], 1 - 9.81 * 0.02, 1e-9)
    assert_close(made.evaluate(jnp.array([0.1, 0.2]))[:, 1], -9.81 * jnp.array([0.1, 0.2]), 1e-9)

    bounce = (1 + POINTS[0, 1]) * 9.81 * jnp.sqrt(2 / 9.81)  # what the impact adds to the velocity
    assert made.evaluate([]).shape == (0, 2)
    mixed = made.evaluate([[0.5, 0.1], [0.3, 0.2]])
    assert_close(mixed[..., 1], -9.81 * jnp.array([[0.5, 0.1], [0.3, 0.2]]) + jnp.array([[bounce, 0], [0, 0]]), 1e-8)
    for outside in (-0.1, 1.2, [0.2, 1.2], jnp.nan):
        with pytest.raises(ValueError, match=r"within \[t0, t1\] = \[0, 1\], but (-0.1|1.2|nan) does not"):
            made.evaluate(outside)


def test_states_of_a_batch_are_asked_of_one_motion():
    made = jax.vmap(lambda rate: hs.solve(Oscillator(rate), jnp.array([1.0, 0.0]), 0, t1=1.0))(jnp.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="on one motion, but this is a batch of"):
        made.evaluate(0.5)


@pytest.mark.slow
def test_the_ends_of_a_motion_in_single_precision_lie_within_it():
    """0.1 is larger there than in double precision."""
    ball = Ball(*jnp.float32([9.81, 0.8]))
    made = hs.solve(ball, jnp.float32([1.0, 0.0]), t0=0.1, t1=0.7, max_events=4, rtol=1e-5, atol=1e-5)
    assert_close(made.evaluate([0.1, 0.7])[0, 0], 1.0, 1e-6)
    start = hs.State(jnp.float32([1.0]), jnp.float32([0.0]))
    motion = hs.simulate(RestlessBall(ball.g, ball.e), start, t0=0.1, t1=0.7, max_events=4, rtol=1e-5, atol=1e-5)
    assert_close(motion.evaluate(jnp.float32([0.1, 0.7])).q[0], jnp.ones(1), 1e-6)


@pytest.mark.parametrize(("times", "message"), [(0.5, r"\(jump,\)"), ([0.2, jnp.nan], "number 1 of them is nan")])
def test_jump_times_that_are_none_are_refused(times, message, unchecked):
    with pytest.raises(ValueError, match=message):
        hs.solve(Oscillator(jnp.array(1.0)), jnp.array([1.0, 0.0]), 0, t1=1.0, jump_ts=times)


def test_whole_numbers_of_a_state_are_told_where_they_belong():
    """An array of them is a counter, or was meant as floats; a plain number of Python is one."""
    with pytest.raises(TypeError, match="`x0` .* of type int32: what counts belongs into the mode.* 1.0 in place of 1"):
        hs.solve(Oscillator(jnp.array(1.0)), np.array([1, 0], np.int32), 0, t1=1.0)


def test_closed_over_values_are_differentiated():
    """A weight that only the transition and the running cost close over."""

    def total(w):
        class Counter(Oscillator):
            def transition(self, event, t, x, mode):
                return x * w, mode

        cost = lambda system, t, x, mode: w * system.w
        made = hs.solve(Counter(jnp.array(1.0)), jnp.array([1.0, 0.0]), 0, t1=3.0, running_cost=cost, max_events=4)
        return made.final[0] + made.cost

    assert_close(jax.grad(total)(jnp.array(0.9)), jnp.cos(3.0) + 3.0, 1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(flow=lambda self, t, x, mode: x[0]), "`flow` must return the state"),
        (dict(guards=lambda self, t, x, mode: x[0]), r"`guards` must return an array of shape \(guard,\)"),
        (dict(transition=lambda self, event, t, x, mode: x), r"`transition` must return \(x, mode\)"),
        (dict(transition=lambda self, event, t, x, mode: (x[:1], mode)), "`transition` must return the state"),
        (dict(transition=lambda self, event, t, x, mode: (x, mode + 0.5)), "`transition` must return the mode"),
        (dict(flow=lambda self, t, x, mode: x if mode > 0 else -x), "`flow` must be a function that JAX can trace"),
    ],
)
def test_what_does_not_fit_is_told(change, message):
    """Every function by its name, before anything runs."""
    system = type("Wrong", (Oscillator,), change)(jnp.array(1.0))
    with pytest.raises((TypeError, ValueError), match=message):
        hs.solve(system, jnp.array([1.0, 0.0]), 0, t1=1.0)


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        (dict(flow=lambda self, t, x, mode: -x * mode), "initial mode as the argument `mode`"),
        (dict(guards=lambda self, t, x, mode: x[:1] + mode), "`guards`.*\nIts `mode` is None, as none was given"),
        (dict(transition=lambda self, event, t, x, mode: (x, mode + 1)), "initial mode as the argument `mode`"),
    ],
)
def test_a_mode_that_was_not_given_is_told(change, remedy):
    """In a note to what a function of the system raises, which has no `initial_mode` that would tell of it before."""
    with pytest.raises(TypeError, match="None") as raised:
        hs.solve(type("Modal", (Ball,), change)(9.81, 0.8), jnp.array([1.0, 0.0]), t1=1.0)
    assert re.search(remedy, "\n".join(raised.value.__notes__))


def test_a_vector_that_is_given_as_a_list_is_told():
    """Assert that it is so where the flow raises, and where it returns an array."""
    times = type("Times", (Ball,), dict(flow=lambda self, t, x, mode: self.g * x))
    for x0 in ([1.0, 0.0], {"height": (1.0, 0.0)}):
        with pytest.raises(TypeError, match="unsupported operand") as raised:
            hs.solve(times(9.81, 0.8), x0, t1=1.0)
        assert "as in `x0`, and no array: give a vector as `jnp.array([...])`." in raised.value.__notes__[-1]
    modal = type("Modal", (Ball,), dict(flow=lambda self, t, x, mode: mode * x))
    with pytest.raises(TypeError) as raised:
        hs.solve(modal(9.81, 0.8), jnp.array([1.0, 0.0]), [1.0, 0.0], t1=1.0)
    assert "In its `mode` there is a list, as in `mode`, and no array" in raised.value.__notes__[-1]
    with pytest.raises(ValueError, match=r"but that of Ball returns .*: a vector is no list, give `x0` as `jnp.array"):
        hs.solve(Ball(9.81, 0.8), [1.0, 0.0], t1=1.0)


def test_a_number_of_times_is_told_how_to_make_them(unchecked):
    with pytest.raises(ValueError, match=r"shape \(\): give the times themselves, as `jnp.linspace\(t0, t1, 100\)`"):
        hs.solve(Ball(9.81, 0.8), jnp.array([1.0, 0.0]), t1=1.0, ts=100)


def test_arguments_that_do_not_fit_are_told():
    """State, mode, and a scene in place of a system."""
    system, x0 = Oscillator(jnp.array(1.0)), jnp.array([1.0, 0.0])
    for arguments, message in (
        ((system, "start", 0), "`x0` must hold real numbers"),
        ((system, jnp.zeros(0), 0), "`x0` must hold real numbers, but its arrays are empty"),
        ((system, x0, "on"), "`mode` must hold numbers"),
        ((system, x0, jax.random.key(0)), "`mode` must hold numbers or arrays, but has a random key"),
        ((hs.scenes.BouncingBall(), x0, 0), "system.*AbstractHybridSystem"),
    ):
        with pytest.raises(TypeError, match=message):
            hs.solve(*arguments, t1=1.0)
    with pytest.raises(ValueError, match="max_events"):
        hs.solve(system, x0, 0, t1=1.0, max_events=0)


@pytest.mark.parametrize(
    "solver", [diffrax.KenCarp4(), diffrax.Euler(), diffrax.HalfSolver(diffrax.SemiImplicitEuler())]
)
def test_a_solver_that_does_not_serve_is_refused(solver):
    """It splits the flow into parts, or has no estimate of its error."""
    with pytest.raises(TypeError, match="`solver` must be a Diffrax solver of ordinary differential equations"):
        hs.solve(Oscillator(jnp.array(1.0)), jnp.array([1.0, 0.0]), 0, t1=1.0, solver=solver)


@pytest.mark.slow
@pytest.mark.parametrize("inner", [diffrax.Bosh3(), diffrax.Kvaerno3()])
def test_a_solver_around_another_serves(inner):
    """Its error estimate is that of two half steps."""
    solver = diffrax.HalfSolver(inner)
    final = lambda g: hs.solve(Ball(g, 0.8), jnp.array([1.0, 0.0]), t1=0.3, solver=solver, rtol=1e-6).final[0]
    assert_close(jax.value_and_grad(final)(9.81), (1 - 9.81 * 0.045, -0.045), 1e-9)


@pytest.mark.slow
def test_jump_times_that_are_known_may_be_given_while_a_program_is_compiled():
    """They are numbers, though what JAX computes of them there is traced."""
    known = jnp.array([0.25, 0.5])
    final = lambda rate: hs.solve(Oscillator(rate), jnp.array([1.0, 0.0]), 0, t1=1.0, jump_ts=known).final
    assert_close(jax.jit(final)(jnp.array(1.0)), final(jnp.array(1.0)), 1e-12)


@pytest.mark.parametrize("name", ["max_events", "max_steps"])
def test_room_that_no_memory_has_is_refused(name):
    """Before anything is allocated."""
    with pytest.raises(ValueError, match=f"`max_events` and `max_steps` must leave .* of {10**12} {name[4:]} "):
        hs.solve(Ball(9.81, 0.8), jnp.array([1.0, 0.0]), t1=1.0, **{name: 10**12})
