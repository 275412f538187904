"""Replay with recomputed segments: the same gradient from the events alone."""

import dataclasses

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.adjoint import segment_steps
from hybridsens.forward.segment import solve_segment
from hybridsens.scenes import BouncingBall
from tests.closeness import assert_close
from tests.problems import reference_scenes
from tests.problems.references import RECORDS

AGAIN = hs.Replay(recompute=True)


def final_height(p, adjoint, **settings):
    """Where a ball is after impacts, a capture and rest, and what its motion cost."""
    scene = BouncingBall(height=p[0], weight=p[1], restitution_coefficient=p[2])
    motion = hs.simulate(
        scene, scene.initial_state(), t1=p[3], running_cost=lambda s, t, q, v: q @ q, adjoint=adjoint,
        **{"throw": False, **settings},
    )  # fmt: skip
    return motion.final.q[0] + motion.cost, motion


P = jnp.array([1.0, 9.81, 0.3, 1.5])


@pytest.fixture(scope="module")
def gradients():
    """By both ways, compiled: (adjoint) -> function of p."""
    of = lambda adjoint: jax.jit(jax.value_and_grad(lambda p: final_height(p, adjoint), has_aux=True))
    return of(hs.Replay()), of(AGAIN)


def test_the_gradient_is_that_of_the_recorded_steps(gradients):
    """Through impacts that accumulate, the capture and the rest, by height, weight, restitution and horizon."""
    (value, motion), kept = gradients[0](P)
    (value_again, _), again = gradients[1](P)
    assert motion.events.kind[motion.events.count - 1] == hs.EventKind.CAPTURE
    assert value == value_again
    assert_close(again, kept, 1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "room"), [(1e-10, 101), (1e-5, 102)])
def test_a_segment_may_end_elsewhere_by_rounding_alone(gradients, monkeypatch, shift, room):
    """Where a gap closes slowly another program finds another time, and perhaps one step more; a segment that ended at
    another event gives no gradient."""

    def shifted(*given):
        motion, end = solve_segment(*given)
        return dataclasses.replace(motion, t=motion.t + shift), end

    monkeypatch.setattr(segment_steps, "solve_segment", shifted)
    adjoint = hs.Replay(recompute=True, segment_steps=room)  # a program of its own
    again = jax.jit(jax.grad(lambda p: final_height(p, adjoint)[0]))(P)
    if shift == 1e-10:
        assert_close(again, gradients[0](P)[1], 1e-14)
    else:
        assert jnp.all(jnp.isnan(again[:3]))  # that by t1 needs no segment
        with pytest.raises(hs.SimulationError, match=r"the steps that Replay\(recompute=True\) ran again .* different"):
            jax.grad(lambda p: final_height(p, adjoint, throw=True)[0])(P)


@pytest.mark.slow
def test_a_motion_that_ran_out_of_steps_is_recomputed_up_to_there():
    """The gradient is that of the state where it stopped; it was nan by one of the two ways."""
    cut = lambda adjoint: jax.jit(jax.value_and_grad(lambda p: final_height(p, adjoint, max_steps=18), has_aux=True))(P)
    ((value, motion), kept), ((value_again, _), again) = cut(hs.Replay()), cut(AGAIN)
    assert motion.status == hs.Status.max_steps_reached and motion.events.count > 1
    assert value == value_again and jnp.all(kept[:3] != 0)
    assert_close(again, kept, 1e-12)


@pytest.mark.slow
def test_a_release_is_recomputed_too():
    """Sustained contact and release on the cylinder, then the impacts on the floor."""

    def end(p, adjoint):
        scene = reference_scenes.cylinder_slide(*p)
        return hs.simulate(scene, scene.initial_state(), t1=2.5, adjoint=adjoint, max_events=16, throw=False).final.q[0]

    p = jnp.array(RECORDS["P3"]["p"])
    kept, again = (jax.jit(jax.grad(lambda p, a=adjoint: end(p, a)))(p) for adjoint in (hs.Replay(), AGAIN))
    assert_close(again, kept, 1e-14)


@pytest.mark.slow
def test_a_batch_is_right_lane_by_lane(gradients):
    """Under `jax.vmap`, lanes with different numbers of events."""
    points = P * jnp.array([[1.0, 1.0, 1.0, 0.4], [1.0, 1.0, 1.0, 0.8], [0.7, 1.1, 0.5, 1.0]])
    batched = jax.vmap(jax.grad(lambda p: final_height(p, AGAIN)[0]))(points)
    assert_close(batched, jnp.stack([gradients[0](p)[1] for p in points]), 1e-12)


@pytest.mark.slow
def test_a_segment_that_is_too_long_says_so():
    """The room is looked at going forward, before any gradient is asked for."""
    _, motion = final_height(P, hs.Replay(recompute=True, segment_steps=3))
    assert motion.status == hs.Status.max_steps_reached


def test_what_needs_recorded_steps_is_refused():
    """Samples, and second derivatives."""
    with pytest.raises(ValueError, match="needs recorded steps"):
        final_height(P, AGAIN, ts=jnp.array([0.1]))
    with pytest.raises(NotImplementedError, match="need recorded steps"):
        jax.jacfwd(jax.grad(lambda p: final_height(p, AGAIN)[0]))(P)
    with pytest.raises(ValueError, match="segment_steps"):
        hs.Replay(recompute=True, segment_steps=0)
