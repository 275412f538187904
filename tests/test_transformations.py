"""jit, vmap and grad in any order; one compiled function for any number of events; second derivatives."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall

T1 = 1.0


def ball(p):
    """Of p = (q0, g, e)."""
    return RestlessBall(p[1], p[2])


def height(p, adjoint=None):
    """Height of the ball at T1."""
    settings = dict(rtol=1e-9, atol=1e-9, max_events=16, max_steps=400, adjoint=adjoint)
    return hs.simulate(ball(p), hs.State(p[:1], jnp.zeros(1)), t1=T1, **settings).final.q[0]


def exact(p):
    """After one bounce."""
    q0, g, e = p
    t = jnp.sqrt(2 * q0 / g)
    return e * jnp.sqrt(2 * g * q0) * (T1 - t) - g * (T1 - t) ** 2 / 2


P = jnp.array([1.0, 9.81, 0.8])
gradient = jax.jit(jax.grad(height))
LANES = jnp.array([[1.0, 9.81, 0.8], [0.4, 9.81, 0.9], [6.0, 9.81, 0.8], [1.2, 8.0, 0.7]])
"""One, two, none, and one event."""


@pytest.mark.parametrize(
    "transformed",
    [
        jax.jit(jax.vmap(jax.grad(height))),
        pytest.param(jax.vmap(jax.jit(jax.grad(height))), marks=pytest.mark.slow),
        pytest.param(
            jax.jit(jax.grad(lambda lanes: jnp.sum(jax.jit(jax.vmap(height))(lanes)))), marks=pytest.mark.slow
        ),
        pytest.param(
            jax.jit(jax.vmap(jax.jacfwd(lambda p: height(p, hs.ForwardSensitivities())))), marks=pytest.mark.slow
        ),
    ],
    ids=["jit vmap grad", "vmap jit grad", "jit grad jit vmap", "jit vmap jacfwd"],
)
def test_transformations_in_any_order(transformed):
    """Every order gives the gradients that each lane has alone, to 1e-12."""
    alone = jnp.stack([gradient(p) for p in LANES])
    assert_close(transformed(LANES), alone, 1e-12)
    assert_close(transformed(LANES)[0], jax.grad(exact)(P), 1e-9)


def test_batched_values_are_unbatched_values():
    """Times, states and counts of a batch with different numbers of events, lane by lane."""

    def run(p):
        ts = jnp.linspace(0.0, T1, 5)
        start = hs.State(p[:1], jnp.zeros(1))
        return hs.simulate(ball(p), start, t1=T1, ts=ts, rtol=1e-9, atol=1e-9, max_events=16, max_steps=400)

    alone, batch = jax.jit(run), jax.jit(jax.vmap(run))(LANES)
    assert batch.events.count.tolist() == [1, 2, 0, 1]
    for lane, p in enumerate(LANES):
        single = alone(p)
        assert_close(batch.q[lane], single.q, 1e-12)
        assert_close(batch.v[lane], single.v, 1e-12)
        count = int(single.events.count)
        assert_close(batch.events.time[lane, :count], single.events.time[:count], 1e-12, scale=T1)
        assert batch.steps.accepted[lane] == single.steps.accepted


@pytest.mark.slow
def test_a_motion_is_compiled_under_disable_jit_too():
    """Where a user looks for a mistake elsewhere, step by step."""
    with jax.disable_jit():
        value, by_p = jax.value_and_grad(height)(P)
    assert_close(value, exact(P), 1e-9)
    assert_close(by_p, jax.grad(exact)(P), 1e-9)


def test_one_compilation_serves_any_number_of_events():
    """Parameters with none, one and two events, and other horizons: traced once, compiled once."""
    traced = []

    def value(p, t1):
        traced.append(1)
        start = hs.State(p[:1], jnp.zeros(1))
        trajectory = hs.simulate(ball(p), start, t1=t1, rtol=1e-9, atol=1e-9, max_events=16, max_steps=400)
        return trajectory.final.q[0], trajectory.events.count

    compiled = jax.jit(value)
    counts = {int(compiled(p, jnp.asarray(t1))[1]) for p in LANES for t1 in (0.3, 1.0, 2.0)}
    assert len(counts) >= 4
    assert len(traced) == 1 and compiled._cache_size() == 1


def test_a_plain_call_compiles_once_too():
    """Without `jit` around it `simulate` keeps its compiled program for new parameter values and horizons."""
    compilations = []

    def count(event, _, **__):
        if "backend_compile" in event:
            compilations.append(event)

    def call(factor, t1):
        return hs.simulate(ball(factor * P), hs.State(jnp.ones(1), jnp.zeros(1)), t1=t1, max_events=16, max_steps=400)

    jax.monitoring.register_event_duration_secs_listener(count)
    call(jnp.array(1.0), 0.4)
    assert compilations
    compilations.clear()
    trajectory = call(jnp.array(1.1), 1.7)
    assert not compilations
    assert trajectory.events.count > 1


def test_other_tolerances_do_not_compile_anew():
    """Python floats as tolerances, longest step and capture speed: one program serves all values, and minds them."""
    compilations = []
    count = lambda event, _, **__: compilations.append(event) if "backend_compile" in event else None
    start, room = hs.State(jnp.ones(1), jnp.zeros(1)), dict(max_events=16, max_steps=400)
    call = lambda **settings: hs.simulate(ball(P), start, t1=1.0, **(dict(max_step=1.0) | settings), **room)
    jax.monitoring.register_event_duration_secs_listener(count)
    coarse = call(rtol=1e-6, atol=1e-6)
    compilations.clear()
    call(rtol=1e-7, atol=1e-9, capture_speed=1e-4)
    fine = call(max_step=0.01)
    assert not compilations
    assert fine.steps.accepted > 90 > coarse.steps.accepted


def test_a_gradient_through_a_condition_in_a_batch():
    """Lanes that JAX lets through both branches: the records of steps that a batch does not keep are not mistaken."""
    chosen = lambda p: jax.lax.cond(p[2] > 0.5, height, lambda p: p[0], p)
    gradients = jax.jit(jax.vmap(jax.grad(chosen)))(jnp.stack([P, P.at[2].set(0.4)]))
    assert_close(gradients, jnp.stack([gradient(P), jnp.array([1.0, 0.0, 0.0])]), 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "hessian",
    [
        jax.jacfwd(jax.grad(height)),
        pytest.param(
            jax.jacfwd(jax.jacfwd(lambda p: height(p, hs.ForwardSensitivities()))), marks=pytest.mark.slow
        ),
    ],
    ids=["forward over reverse", "forward over forward"],
)
def test_second_derivatives(hessian):
    """Through an impact the Hessian is right too, where a term left out would not show in the gradient."""
    assert_close(jax.jit(hessian)(P), jax.hessian(exact)(P), 1e-8)
