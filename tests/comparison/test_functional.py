"""A cost that does not move its scene as studies ask for is told so."""

import functools

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.comparison.check_gradient import check_gradient
from hybridsens.comparison.compare import compare
from hybridsens.comparison.functional import choose_cost
from hybridsens.comparison.work_precision import work_precision
from tests.problems.hybrid_systems import Decay
from tests.problems.sawtooth import Sawtooth


def final(system, solve, **settings):
    return solve(system, 1.0, t1=1.0, **settings).final


@pytest.mark.parametrize(
    ("study", "given", "message"),
    [
        (check_gradient, dict(tolerance=-1.0), "`tolerance` must be a positive number, but is -1.0"),
        (compare, dict(tolerance=float("nan")), "`tolerance` must be a positive number, but is nan"),
        (compare, dict(steps=0), "`steps` must be an integer >= 1, but is 0"),
        (work_precision, dict(tolerances=[1e-6, 0.0]), "`tolerances` must be a positive number, but is 0.0"),
    ],
)
def test_numbers_that_no_study_can_use_are_refused(study, given, message):
    """Before anything is compiled: a tolerance below 0 took minutes, and ended in words of other packages."""
    with pytest.raises(ValueError, match=message):
        study(Decay(), final, progress=False, **given)


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


@pytest.mark.parametrize("study", [check_gradient, compare, hs.work_precision])
def test_a_motion_of_the_costs_own_is_told_of(study):
    """Assert that `solve` in place of the function that is given is named: every row would be the same method."""
    cost = lambda system, solve: final(system, hs.solve)
    with pytest.raises(TypeError, match="`cost` must move its scene by the function that it is given"):
        study(Decay(), cost, progress=False, **ROOM)


@jax.custom_vjp
def _same(x):
    return x


_same.defvjp(lambda x: (x, None), lambda _, cotangent: (cotangent,))


@pytest.mark.slow
def test_a_cost_of_reverse_mode_alone_is_told_of():
    """Assert that a `custom_vjp` is answered by what serves both modes, and not by JAX's words alone."""
    with pytest.raises(TypeError, match="in forward mode too.* write it as a jax.custom_jvp"):
        check_gradient(Decay(), lambda *asked: _same(final(*asked)), progress=False, **ROOM)


@pytest.mark.parametrize("study", [check_gradient, compare, hs.work_precision])
@pytest.mark.parametrize("own", [dict(rtol=1e-6), dict(throw=False), dict(max_events=4, adjoint=None)])
def test_settings_of_the_costs_own_are_refused_by_name(study, own):
    """Assert that they do not replace the study's in silence."""
    with pytest.raises(TypeError, match=f"must leave the settings .* but gives it {', '.join(own)}. Leave"):
        study(Decay(), functools.partial(final, **own), progress=False)


class Timed(Sawtooth):
    """Where it starts and how long it runs, but no cost."""

    t1 = 0.4


class Whole(Timed):
    def running_cost(self, t, x, mode):
        return x


def test_a_class_of_ones_own_is_run_without_a_cost():
    """Assert that it need not derive from a ready-made one, and has its mode None: int (top - slope t) dt."""
    own = choose_cost(Whole(2.0, 1.0), None)
    assert float(own(Whole(2.0, 1.0), hs.solve)) == pytest.approx(0.4 - 0.4**2)


def test_what_a_class_of_ones_own_lacks_is_named():
    """Assert that the message has the parts that are not there."""
    for scene, missing in ((Timed(2.0, 1.0), "running_cost"), (Decay(), "initial_state, t1, running_cost")):
        with pytest.raises(TypeError, match=f"`cost` must be given for a .*, which has no {missing}: cost"):
            choose_cost(scene, None)
