"""A cost that does not move its scene as studies ask for is told so."""

import functools

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.comparison.check_gradient import check_gradient
from hybridsens.comparison.compare import compare
from tests.problems.hybrid_systems import Decay


def final(system, solve, **settings):
    return solve(system, 1.0, t1=1.0, **settings).final


ROOM = dict(max_events=4, max_steps=256)
INSIDE = {
    "jit": functools.partial(jax.jit, static_argnums=1)(final),
    "vmap": lambda system, solve: jnp.sum(jax.vmap(lambda x: solve(system, x, t1=1.0).final)(jnp.arange(1.0, 3.0))),
}


@pytest.mark.parametrize("study", [check_gradient, compare])
@pytest.mark.parametrize("cost", INSIDE.values(), ids=INSIDE)
def test_a_motion_inside_of_a_transformation_is_told_of(study, cost):
    """Assert that the words are about the cost, and not about tracers that leak."""
    with pytest.raises(TypeError, match="`cost` must call the function that it is given outside of jax.jit, jax.vmap"):
        study(Decay(), cost, progress=False, **ROOM)


def test_a_motion_of_the_costs_own_is_told_of():
    """Assert that `solve` in place of the function that is given is named."""
    cost = lambda system, solve: final(system, hs.solve)
    with pytest.raises(TypeError, match="`cost` must move its scene by the function that it is given"):
        check_gradient(Decay(), cost, progress=False, **ROOM)


@pytest.mark.parametrize("study", [check_gradient, compare, hs.work_precision])
@pytest.mark.parametrize("own", [dict(rtol=1e-6), dict(throw=False), dict(max_events=4, adjoint=None)])
def test_settings_of_the_costs_own_are_refused_by_name(study, own):
    """Assert that they do not replace the study's in silence."""
    with pytest.raises(TypeError, match=f"must leave the settings .* but gives it {', '.join(own)}. Leave"):
        study(Decay(), functools.partial(final, **own), progress=False)
