"""Hybrid systems at random: values against SciPy, and three ways to a gradient."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.problems import systems_at_random as at_random

FEW = [0, 1, 4, 16, 23, 39, 50, 61]
DOUBTED = {2, 3, 5, 8, 9, *range(10, 16), *range(17, 21), 26, 35, 46, 47, 49, 53, 54, 57, 59}
MORE = set(range(60)) - DOUBTED - set(FEW)
"""Seeds of motions with 2 to 24 events; and of those that `follow` doubts."""
SETTINGS = dict(rtol=1e-9, atol=1e-9, max_events=32, throw=False)


def observed(given, discrete, adjoint=None):
    """Everything that a motion can be differentiated by, in one vector; and the motion."""
    fields, x0, ts, t1 = given
    system, cost = at_random.RandomSystem(**fields), at_random.running_cost
    made = hs.solve(system, x0, discrete, t1=t1, ts=ts, running_cost=cost, adjoint=adjoint, **SETTINGS)
    times = jnp.where(jnp.isfinite(made.events.time), made.events.time, 0)
    return jnp.concatenate([made.final, made.cost[None], made.x.ravel(), times]), made


def expected(drawn):
    """The same by SciPy, and the order of events."""
    made = at_random.follow(drawn)
    times = np.pad(made.times, (0, SETTINGS["max_events"] - len(made.times)))
    return np.concatenate([made.final, [made.cost], made.samples.ravel(), times]), made.sequence


@jax.jit
def both_slopes(given, direction, weights, discrete):
    """The motion, and its derivative along a direction, back and forth."""
    total = lambda given, adjoint: observed(given, discrete, adjoint)[0] @ weights
    gradient, (values, made) = jax.grad(
        lambda given: (total(given, hs.Replay()), observed(given, discrete)), has_aux=True
    )(given)
    forward = jax.jvp(lambda given: total(given, hs.ForwardSensitivities()), (given,), (direction,))[1]
    along = jax.tree.map(lambda slope, way: jnp.sum(slope * way), gradient, direction)
    return values, made, sum(jax.tree.leaves(along)), forward


def moved(drawn, direction, step):
    """A system, its start, its sample times and its end a little further along a direction."""
    shift = lambda value, way: value + step * way
    return at_random.Drawn(*jax.tree.map(shift, tuple(drawn[:4]), direction), drawn.discrete)


@pytest.mark.parametrize("seed", [*FEW, *(pytest.param(seed, marks=pytest.mark.slow) for seed in sorted(MORE))])
def test_a_random_system_moves_as_by_scipy_and_so_do_its_gradients(seed):
    """Samples, cost, final state and event times to 1e-7; both gradients are one to 1e-7, and differences to 1e-5."""
    drawn, g = at_random.draw(seed), np.random.default_rng(seed)
    given = tuple(drawn[:4])
    direction = jax.tree.map(lambda value: g.normal(size=np.shape(value)), given)
    values, sequence = expected(drawn)
    weights = g.normal(size=values.shape)
    found, made, reverse, forward = both_slopes(given, direction, weights, drawn.discrete)
    assert int(made.events.count) == len(sequence) and made.events.guard[: len(sequence)].tolist() == sequence
    assert np.abs(found - values).max() <= 1e-7 * (1 + np.abs(values).max())
    ahead, behind = (expected(moved(drawn, direction, step)) for step in (1e-5, -1e-5))
    assert ahead[1] == behind[1] == sequence
    difference = (ahead[0] - behind[0]) @ weights / 2e-5
    assert abs(reverse - forward) <= 1e-7 * (1 + abs(forward))
    assert abs(reverse - difference) <= 1e-5 * (1 + abs(difference))
