"""Nothing fails silently: bad input raises, and what only the values show becomes a Status."""

import functools

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Ball(hs.AbstractScene):
    """A ball above a floor; p = (mass, weight, e)."""

    p: jax.Array

    def mass_matrix(self, q):
        return self.p[0] * jnp.eye(1)

    def force(self, t, q, v):
        return -self.p[1:2]

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.p[2:3]


class Misshapen(Ball):
    """The same with one function that returns the wrong shape."""

    wrong: str

    def mass_matrix(self, q):
        return jnp.ones((1, 2)) if self.wrong == "mass_matrix" else super().mass_matrix(q)

    def force(self, t, q, v):
        return jnp.zeros(2) if self.wrong == "force" else super().force(t, q, v)

    def gap(self, t, q):
        return q[0] if self.wrong == "gap" else super().gap(t, q)

    def restitution(self):
        return jnp.ones(3) if self.wrong == "restitution" else super().restitution()


GOOD = dict(p=[1.0, 10.0, 0.5], q=[1.0], v=[0.0], t0=0.0, t1=1.0, ts=[0.0, 0.5, 1.0])
BALL = Ball(jnp.array(GOOD["p"]))
START = hs.State(jnp.array([1.0]), jnp.array([0.0]))


@functools.cache
def compiled(max_events=16, max_steps=200, throw=False):
    """Motion of the ball, with every input that can be bad as an argument."""

    def run(p, q, v, t0, t1, ts):
        settings = dict(max_events=max_events, max_steps=max_steps, throw=throw)
        return hs.simulate(Ball(p), hs.State(q, v), t0=t0, t1=t1, ts=ts, **settings)

    return jax.jit(run)


def arrays(**changed):
    """The good motion's inputs with some of them changed."""
    return {name: jnp.asarray(value, float) for name, value in (GOOD | changed).items()}


def status(run=None, **changed):
    return (run or compiled())(**arrays(**changed)).status


BAD = {
    "penetration": dict(q=[-0.1]),
    "bad_restitution": dict(p=[1.0, 10.0, 1.1]),
    "bad_mass_matrix": dict(p=[-1.0, 10.0, 0.5]),
    "non_finite": dict(v=[jnp.nan]),
    "bad_horizon": dict(t1=0.0),
    "unsorted_times": dict(ts=[0.0, 0.7, 0.5]),
}


def test_the_good_motion_succeeds():
    """What is changed below is what is wrong there."""
    assert status() == hs.Status.successful


@pytest.mark.parametrize("name", BAD)
def test_bad_value_is_told_by_its_own_status(name):
    """And the status has a text that tells the remedy."""
    found = status(**BAD[name])
    assert found == getattr(hs.Status, name)
    assert len(hs.Status[found]) > 30


@pytest.mark.parametrize(
    "changed, name",
    [
        (dict(p=[1.0, 10.0, -0.1]), "bad_restitution"),
        (dict(p=[1.0, jnp.inf, 0.5]), "non_finite"),
        (dict(p=[1.0, jnp.nan, 0.5]), "non_finite"),
        (dict(p=[0.0, 10.0, 0.5]), "bad_mass_matrix"),
        (dict(q=[jnp.nan]), "non_finite"),
        (dict(t1=-1.0), "bad_horizon"),
        (dict(t1=jnp.nan), None),
        (dict(ts=[-0.1, 0.5, 1.0]), "unsorted_times"),
        (dict(ts=[0.0, 0.5, 1.1]), "unsorted_times"),
        (dict(ts=[0.0, jnp.nan, 1.0]), "unsorted_times"),
    ],
)
def test_other_bad_values(changed, name):
    """The other side of each range, and values that are no numbers."""
    found = status(**changed)
    assert found != hs.Status.successful
    if name is not None:
        assert found == getattr(hs.Status, name)


def test_force_that_becomes_infinite_on_the_way():
    """A singular force field ends the motion with a status, not with numbers."""

    class Singular(Ball):
        def force(self, t, q, v):
            return self.p[1:2] / (0.5 - t)

    trajectory = hs.simulate(Singular(BALL.p), START, t1=1.0, max_steps=200, throw=False)
    assert trajectory.status != hs.Status.successful
    assert trajectory.status in (hs.Status.non_finite, hs.Status.step_size_underflow, hs.Status.max_steps_reached)


def test_room_for_events_is_used_up():
    """The motion stops at the last event there was room for, and says so."""
    trajectory = compiled(max_events=2)(**arrays(t1=5.0))
    assert trajectory.status == hs.Status.max_events_reached
    assert trajectory.events.count == 2
    assert bool(jnp.all(jnp.isfinite(trajectory.events.time)))


@pytest.mark.slow
@pytest.mark.parametrize("adjoint", [hs.Replay(), hs.ForwardSensitivities()], ids=["reverse", "forward"])
def test_a_sample_that_a_motion_broke_off_before_has_no_derivative(adjoint):
    """Its value is nan, so that nobody takes it for one; a derivative of what is there does not depend on it."""

    def samples(later):
        settings = dict(t1=5.0, max_events=2, throw=False, adjoint=adjoint)
        return hs.simulate(BALL, START, ts=later + jnp.array([0.1, 4.9]), **settings).q[:, 0]

    differentiate = jax.jacfwd if adjoint.forward_mode else jax.jacrev
    assert jnp.isnan(samples(0.0)).tolist() == [False, True]
    assert differentiate(samples)(0.0)[0] < 0 == differentiate(samples)(0.0)[1]


def test_room_for_steps_is_used_up():
    """And no more steps were tried than there was room for."""
    trajectory = compiled(max_steps=4)(**arrays())
    assert trajectory.status == hs.Status.max_steps_reached
    assert trajectory.steps.accepted + trajectory.steps.rejected <= 4


def test_a_contact_that_would_stay_closed_is_told_where_none_may():
    """With `sustained_contact = False` a ball that comes to rest ends its motion with a status that says what to do."""

    class Bouncing(Ball):
        sustained_contact = False

    trajectory = hs.simulate(Bouncing(jnp.array([1.0, 10.0, 0.0])), START, t1=1.0, throw=False, max_events=8)
    assert trajectory.status == hs.Status.event_repeats
    assert "sustained_contact" in hs.Status[trajectory.status]


def test_throw_raises_with_the_remedy():
    """By default a motion that did not reach its end raises, outside `jit` and inside."""
    with pytest.raises(hs.SimulationError, match="max_events"):
        hs.simulate(BALL, START, t1=5.0, max_events=2)
    with pytest.raises(Exception, match="max_events"):
        jax.block_until_ready(status(compiled(max_events=2, throw=True), t1=5.0))


@pytest.mark.parametrize("way", ["value", pytest.param("gradient", marks=pytest.mark.slow)])
def test_a_bad_lane_leaves_the_others_right(way):
    """In a batch each lane has its own status, and good lanes have the values and gradients they have alone."""
    run = compiled()

    def final(p):
        trajectory = run(**arrays(p=p))
        return trajectory.final.q[0], trajectory.status

    function = final if way == "value" else jax.grad(final, has_aux=True)
    lanes = jnp.array([[1.0, 10.0, 0.5], [1.0, 10.0, 2.0], [1.0, jnp.nan, 0.5], [1.0, 9.0, 0.6]])
    batch, statuses = jax.jit(jax.vmap(function))(lanes)
    expected = [hs.Status.successful, hs.Status.bad_restitution, hs.Status.non_finite, hs.Status.successful]
    for lane, name in enumerate(expected):
        assert jax.tree.map(lambda leaf, lane=lane: leaf[lane], statuses) == name
    for lane in (0, 3):
        assert_close(batch[lane], function(lanes[lane])[0], 1e-12)


@pytest.mark.parametrize("wrong", ["mass_matrix", "force", "gap", "restitution"])
def test_wrong_shapes_of_the_scene_raise(wrong):
    """The message names the function, the shape it must have, and the one it has."""
    with pytest.raises(ValueError, match=f"`{wrong}` must return an array of shape"):
        hs.simulate(Misshapen(BALL.p, wrong), START, t1=1.0)


@pytest.mark.parametrize(
    "q, v", [(jnp.zeros(2), jnp.zeros(1)), (jnp.zeros((1, 1)), jnp.zeros((1, 1))), (jnp.zeros(0), jnp.zeros(0))]
)
def test_wrong_shapes_of_the_state_raise(q, v):
    """q and v must have one shape (dof,)."""
    with pytest.raises(ValueError, match="must have q and v of one shape"):
        hs.simulate(BALL, hs.State(q, v), t1=1.0)


@pytest.mark.parametrize(
    "changed, error",
    [
        (dict(max_events=0), ValueError),
        (dict(max_steps=2.5), (ValueError, TypeError)),
        (dict(rtol=0.0), ValueError),
        (dict(atol=-1e-8), ValueError),
        (dict(rtol=float("nan")), ValueError),
        (dict(capture_speed=1.0), ValueError),
        (dict(ts=jnp.zeros((2, 2))), (ValueError, TypeError)),
        (dict(t1=jnp.ones(2)), (ValueError, TypeError)),
        (dict(t1="soon"), TypeError),
        (dict(solver="Tsit5"), TypeError),
        (dict(adjoint="replay"), TypeError),
    ],
)
def test_settings_that_do_not_fit_raise(changed, error):
    """Before anything runs."""
    with pytest.raises(error):
        hs.simulate(BALL, START, **(dict(t1=1.0) | changed))


def test_unknown_keyword_is_refused():
    """A misspelt option never goes by without a word."""
    with pytest.raises(TypeError, match="tolerance"):
        hs.simulate(BALL, START, t1=1.0, tolerance=1e-6)


def test_what_is_no_scene_or_state_is_refused():
    """A tuple in place of a State, a state in place of a scene."""
    with pytest.raises(TypeError):
        hs.simulate(BALL, (jnp.ones(1), jnp.zeros(1)), t1=1.0)
    with pytest.raises(TypeError):
        hs.simulate(START, START, t1=1.0)
