"""A motion that did not reach its end raises, in few lines where it is compiled, or makes its numbers nan."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AxisType, NamedSharding, PartitionSpec

import hybridsens as hs
from hybridsens.outcome import raise_unless_successful
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall
from tests.problems.sawtooth import Sawtooth

W = jnp.array(9.81)
SENTENCE = (
    "The motion did not reach its end (max_events_reached): the motion had more events than `max_events`. Raise "
    "`max_events`"
)


ROOM = dict(max_events=4, max_steps=64)


class Swing(hs.AbstractScene):
    """A mass on a spring, and a stop."""

    stop: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -q

    def gap(self, t, q):
        return self.stop - q

    def restitution(self):
        return jnp.ones(1)


class BrokenSawtooth(Sawtooth):
    """It begins anew at what is no number."""

    def transition(self, event, t, x, mode):
        return x * jnp.nan, mode


def final_from(state):
    """A ball that falls from there."""
    return hs.simulate(RestlessBall(W, jnp.array(0.8)), state, t1=1.0, **ROOM).final


def final(weight, throw=True, t1=5.0):
    """Breaks off at its third impact, at the default time."""
    ball = RestlessBall(weight, jnp.array(0.8))
    motion = hs.simulate(ball, hs.State([1.0], [0.0]), t1=t1, max_events=2, max_steps=100, throw=throw)
    return motion.final.q[0]


@pytest.mark.parametrize(
    "call",
    [
        lambda: final(W),
        lambda: jax.grad(final)(W),
        lambda: jax.vmap(final)(W[None]),
        lambda: jax.vmap(jax.grad(final))(W[None]),
    ],
    ids=["plain", "grad", "vmap", "vmap grad"],
)
def test_a_simulation_error_is_raised_wherever_the_outcome_is_seen(call):
    """Also in a batch, and in the middle of differentiation."""
    with pytest.raises(hs.SimulationError) as caught:
        call()
    assert str(caught.value).startswith(SENTENCE)


@pytest.mark.parametrize("jit", [jax.jit, pytest.param(eqx.filter_jit, marks=pytest.mark.slow)])
@pytest.mark.parametrize("transform", [lambda f: f, jax.vmap, jax.grad], ids=["value", "vmap", "grad"])
def test_a_compiled_program_says_it_in_the_last_line(jit, transform, capfd):
    """XLA's own words come first, from JAX 0.11 on with every call on the way; the sentence is the last line, and
    nothing else is printed. A gradient is checked too, where the value of which it is one is not computed."""
    given = W[None] if transform is jax.vmap else W
    with pytest.raises((RuntimeError, ValueError)) as caught:
        jax.block_until_ready(jit(transform(lambda w: final(w)))(given))
    lines = str(caught.value).splitlines()
    assert len(lines) <= 3 or jax.__version_info__ >= (0, 11)
    assert lines[-1].startswith(f"SimulationError: {SENTENCE}")
    assert capfd.readouterr().err == ""


def test_a_batch_raises_only_if_one_of_its_motions_failed():
    """And then under jit too."""
    run = jax.jit(jax.vmap(final, in_axes=(None, None, 0)), static_argnums=1)
    run(W, True, jnp.array([0.1, 0.2])).block_until_ready()
    with pytest.raises((RuntimeError, ValueError), match="max_events"):
        run(W, True, jnp.array([0.1, 5.0])).block_until_ready()


def test_nan_instead_of_an_exception():
    """Value and gradient of a failed motion are nan, those beside it are as ever; also where nothing began."""
    weights, ends = jnp.array([9.81, 9.81, jnp.nan]), jnp.array([0.1, 5.0, 0.1])
    run = jax.jit(jax.vmap(jax.value_and_grad(final), in_axes=(0, None, 0)), static_argnums=1)
    (values, gradients), plain = run(weights, "nan", ends), run(weights, False, ends)
    assert jnp.isnan(values).tolist() == jnp.isnan(gradients).tolist() == [False, True, True]
    assert values[0] == plain[0][0] and gradients[0] == plain[1][0]
    assert plain[1][2] == 0  # what an optimiser would take for a stationary point


@pytest.mark.slow
def test_blank_rows_do_not_make_the_gradient_of_a_whole_motion_nan():
    """The time of an event that did not happen is inf: chosen away, its cotangent is 0 times inf."""

    def touched(ball):
        motion = hs.simulate(ball, ball.initial_state(), t1=0.2, throw="nan", max_events=4)
        speed = jnp.where(motion.events.count > 0, motion.events.time[0] * motion.events.before.v[0, 0], 0.0)
        return motion.final.q[0] + speed

    assert_close(jax.grad(touched)(hs.scenes.BouncingBall()).weight, np.array(-(0.2**2) / 2), 1e-12)


def test_export():
    """A program that cannot raise is exported; JAX refuses one that can."""
    exported = jax.export.export(jax.jit(lambda w: final(w, "nan", 0.1)))(W)
    assert exported.call(W) == final(W, True, 0.1)
    with pytest.raises(NotImplementedError, match="host_callbacks"):
        jax.export.export(jax.jit(final))(W)


@pytest.mark.slow
def test_shard_map_is_told_what_it_needs():
    """By default it follows what varies over the mesh, which loops inside do not; without that it serves gradients."""
    mesh = jax.make_mesh((1,), ("lane",), axis_types=(AxisType.Auto,))
    lanes = PartitionSpec("lane")
    gradient = jax.vmap(jax.grad(lambda w: final(w, False, 0.1)))
    shard = lambda **given: jax.jit(jax.shard_map(gradient, mesh=mesh, in_specs=lanes, out_specs=lanes, **given))
    with pytest.raises(ValueError, match=r"check_vma=False.*\['lane'\]"):
        shard()(W[None])
    assert jnp.allclose(shard(check_vma=False)(W[None]), -0.005, rtol=1e-9)


@pytest.mark.slow
def test_a_mesh_with_explicit_axes_must_be_the_one_in_use():
    """`jax.make_mesh` makes one by default, on which the constants of a loop do not lie."""
    mesh = jax.make_mesh((1,), ("lane",), axis_types=(AxisType.Explicit,))
    height = jax.jit(lambda w: final(w, False, 0.1))
    placed = jax.device_put(W, NamedSharding(mesh, PartitionSpec()))
    with pytest.raises(ValueError, match=r"explicit axes \['lane'\].*AxisType.Auto"):
        height(placed)
    with jax.set_mesh(mesh):
        assert height(placed) == final(W, False, 0.1)


def test_a_motion_that_grazes_is_not_said_to_have_broken_off():
    motion = hs.simulate(RestlessBall(W, W / 12), hs.State([1.0], [0.0]), t1=0.1)
    doubtful = eqx.tree_at(lambda motion: motion.status, motion, hs.Status.grazing)
    with pytest.raises(hs.SimulationError, match=r"^The motion is whole, but in doubt \(grazing\): the motion reached"):
        raise_unless_successful(doubtful)


@pytest.mark.slow
def test_a_touch_that_may_be_a_miss_is_told_with_its_time():
    """sin(t) and a stop that it misses by 1e-12, at pi / 2: the tolerances cannot tell whether it does."""
    swing = lambda **given: hs.simulate(Swing(jnp.array(1 + 1e-12)), hs.State([0.0], [1.0]), t1=3.0, **given)
    motion = swing(throw=False)
    assert motion.status == hs.Status.grazing and abs(motion.doubt_time - jnp.pi / 2) < 1e-3
    told = f"That was at t = {float(motion.doubt_time):.9g}."
    assert told in str(motion)
    with pytest.raises(hs.SimulationError, match=re.escape(told)):
        swing()
    assert jnp.isnan(swing(throw=False, max_steps=24).doubt_time)  # it broke off later


@pytest.mark.slow
def test_what_a_motion_of_a_system_could_not_begin_with_is_nan():
    """Also what the running cost holds, and the times that are declared: an optimiser takes a 0 for the end."""

    def J(weight, time, t1):
        running = lambda system, t, x, mode: weight * x
        return hs.solve(Sawtooth(W, W), 1.0, t1=t1, jump_ts=time[None], running_cost=running, throw="nan", **ROOM).cost

    assert jnp.isnan(jnp.stack(jax.grad(J, (0, 1))(jnp.array(1.0), jnp.array(0.1), jnp.array(-1.0)))).all()


@pytest.mark.slow
def test_the_error_tells_how_many_of_the_steps_were_kept():
    """Of a batch there is one message for all, without numbers."""
    few = lambda t1: hs.simulate(RestlessBall(W, W / 12), hs.State([1.0], [0.0]), t1=t1, max_steps=4).final.q
    with pytest.raises(hs.SimulationError, match=r"Of 4 steps tried [0-4] were kept"):
        few(2.0)
    with pytest.raises(hs.SimulationError, match="one already"):
        jax.vmap(few)(jnp.array([2.0, 3.0]))


@pytest.mark.parametrize(
    ("run", "named"),
    [
        (lambda: final(jnp.nan), "weight of RestlessBall is nan."),
        (lambda: jax.grad(final)(jnp.nan), "weight of RestlessBall is nan."),
        (lambda: final_from(hs.State([1.0], [jnp.nan])), "v[0] of the initial state is nan."),
        (lambda: hs.solve(Sawtooth(W, jnp.array(jnp.nan)), 1.0, t1=1.0, **ROOM), "top of Sawtooth is nan."),
        (lambda: hs.solve(Sawtooth(W, W), jnp.nan, t1=1.0, **ROOM), "value of the initial state is nan."),
        (lambda: final_from(hs.State([1.0], [-jnp.inf])), "v[0] of the initial state is -inf."),
        (lambda: hs.solve(Sawtooth(W, W), jnp.inf, t1=1.0, **ROOM), "value of the initial state is inf."),
    ],
)
def test_a_nan_that_was_given_is_named(run, named):
    """A cell that is missing in somebody's table: the message says where it went in, and not where it came out."""
    with pytest.raises(hs.SimulationError, match="non_finite") as caught:
        run()
    assert str(caught.value).endswith(f" {named}")


def test_a_nan_of_the_motion_itself_is_not_taken_for_one_that_was_given():
    """A tooth that begins at nan."""
    with pytest.raises(hs.SimulationError, match=r"non_finite.*last events: t = 0\.5, event 0\.$"):
        hs.solve(BrokenSawtooth(jnp.array(2.0), jnp.array(1.0)), 1.0, t1=2.0, **ROOM)


def test_the_time_at_which_a_motion_broke_off_is_told():
    """Where there is no room for its third event; by a number that derivatives hold fixed. Where all is made nan it is
    too, for it may be what a motion that ends with an event is asked for."""
    tooth = Sawtooth(jnp.array(2.0), jnp.array(1.0))
    run = lambda t1, throw=False: hs.solve(tooth, 1.0, t1=t1, throw=throw, max_events=2, max_steps=64)
    broken, whole = run(2.0), run(1.25)
    assert_close(broken.end_time, np.array(1.5), 1e-12)
    assert whole.end_time == 1.25 and "broke off" not in str(whole)
    assert jnp.isnan(run(2.0, "nan").end_time)
    assert jax.vmap(run)(jnp.array([2.0, 1.25])).end_time.tolist() == [float(broken.end_time), 1.25]
    assert [jax.grad(lambda t1: run(t1).end_time)(t1) for t1 in (1.25, 2.0)] == [1, 0]
    with pytest.raises(hs.SimulationError, match="It broke off at t = 1.5. The last events: "):
        run(2.0, True)
    assert "It broke off at t = 1.5." in str(broken)
