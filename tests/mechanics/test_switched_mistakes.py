"""Mistakes in a scene with switches are named, its motion is told of in every form, and other scenes pay nothing."""

from functools import partial
from importlib import import_module

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics.mass import KnownMass
from hybridsens.mechanics.switches import CostInMode, InMode, has_switches, in_mode
from hybridsens.mechanics.wrapped import TypedScene
from hybridsens.scenes import BouncingBall
from tests.problems.switched_scenes import Cart

NUMBERS = [jnp.asarray(number) for number in (2.0, 0.3, 0.7, 1.0, 0.8)]
START = hs.State([0.1], [1.0])


def cart_with(**methods):
    """A cart with some methods of its own."""
    return type("Odd", (Cart,), methods)(*NUMBERS)


MISTAKES = {
    "no vector": (dict(switches=lambda s, t, q, v, mode: q[0]), ValueError, r"`switches` must return .*\(switch,\)"),
    "no reals": (dict(switches=lambda s, t, q, v, mode: q > 0), TypeError, "`switches` must return real numbers"),
    "coarse": (
        dict(switches=lambda s, t, q, v, mode: q.astype(jnp.float32)),
        TypeError,
        "`switches` must return float64.*coarser",
    ),
    "mode alone": (dict(switch=lambda s, event, t, q, v, mode: mode), TypeError, r"`switch` must return \(v, mode\)"),
    "speed": (
        dict(switch=lambda s, event, t, q, v, mode: (v[0], mode)),
        ValueError,
        "`switch` must return the velocities .*shapes",
    ),
    "kind of mode": (
        dict(switch=lambda s, event, t, q, v, mode: (v, mode.astype(float))),
        ValueError,
        "`switch` must return the mode .*float64.*bool",
    ),
    "structure of mode": (
        dict(switch=lambda s, event, t, q, v, mode: (v, (mode, mode))),
        ValueError,
        "`switch` must return the mode as a PyTree",
    ),
    "an if": (
        dict(switch=lambda s, event, t, q, v, mode: (v, ~mode) if event == 0 else (v, mode)),
        TypeError,
        "`switch` must be a function that JAX can trace",
    ),
    "force": (dict(force=lambda s, t, q, v, mode: jnp.zeros(2)), ValueError, r"`force` must return .*\(1,\)"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_function_that_does_not_fit_is_named(name):
    """What a scene's functions return is looked at before anything runs."""
    methods, error, message = MISTAKES[name]
    with pytest.raises(error, match=message):
        hs.simulate(cart_with(**methods), START, True, t1=1.0)


def test_a_flag_that_is_given_as_a_number_is_refused():
    """`~1` counts as true: the motor never turned round, and the motion had four events for six."""
    with pytest.raises(TypeError, match="`switch` must not apply `~` to a whole number of the mode, but that of Cart"):
        hs.simulate(Cart(*NUMBERS), START, 1, t1=1.0)


def test_a_mode_that_a_scene_does_not_have_is_refused():
    """A scene without switches has no mode to begin in, and one with switches may not be left without it."""
    with pytest.raises(TypeError, match="`mode` must be left out for a BouncingBall"):
        hs.simulate(BouncingBall(), BouncingBall().initial_state(), True, t1=1.0)
    with pytest.raises(TypeError) as caught:
        hs.simulate(Cart(*NUMBERS), START, t1=1.0)
    assert any("`mode`" in note for note in caught.value.__notes__)


def test_a_running_cost_is_given_the_mode():
    """One that does not take it is told by Python, with the name of the function."""
    with pytest.raises(TypeError) as caught:
        hs.simulate(Cart(*NUMBERS), START, True, t1=1.0, running_cost=lambda scene, t, q, v: q[0])
    assert any("`running_cost`" in note for note in caught.value.__notes__)


def test_a_scene_without_switches_traces_nothing_of_them(monkeypatch):
    """Only scenes that declare switches pay for them."""

    def refuse(*given):
        raise AssertionError("a scene without switches was asked for them")

    for name in ("check_switches", "switch_rules"):  # without what they return there is nothing to be traced
        monkeypatch.setattr(import_module("hybridsens.simulate"), name, refuse)
    ball = BouncingBall()
    made = jax.eval_shape(lambda: hs.simulate(ball, ball.initial_state(), t1=1.0))
    assert made.scene_mode is None and made.events.mode is None


def test_a_scene_is_put_into_a_mode_within_all_that_is_around_it():
    """Wrappers around a scene keep their place, and its running cost goes into the mode with it."""
    wrapped = KnownMass(TypedScene(InMode(Cart(*NUMBERS), jnp.array(True)), jnp.float64), "identity", None)
    price = CostInMode(lambda scene, t, q, v, mode: jnp.where(mode, scene.push, 0.0), jnp.array(True))
    assert has_switches(wrapped) and not has_switches(BouncingBall())
    for mode in (True, False):
        there, cost = in_mode(wrapped, price, jnp.array(mode))
        assert isinstance(there, KnownMass) and float(there.force(0.0, START.q, START.v)[0]) == (2.0 if mode else -2.0)
        assert float(cost(Cart(*NUMBERS), 0.0, START.q, START.v)) == (2.0 if mode else 0.0)


@pytest.mark.slow
def test_a_motion_with_switches_is_told_of_and_saved(tmp_path):
    """Its text and its table name switches and modes, and a file gives all of it back."""
    named = cart_with(contacts=("left", "right"))
    motion = hs.simulate(named, START, True, t1=0.8, ts=jnp.linspace(0.0, 0.8, 5), max_events=8)
    lines = str(motion).splitlines()
    assert "mode: False" in lines and "state; mode after" in lines[3]
    assert lines[4].split()[2:4] == ["switch", "0"] and lines[4].endswith("; False")
    table = motion.events.to_pandas()
    assert table["kind"].tolist() == ["switch", "impact"] and table["contact"].tolist() == ["0", "right"]
    assert table["impulse [N s]"][0] == 0 and table["impulse [N s]"][1] > 0
    motion.save(tmp_path / "cart.nc")
    again = hs.load(tmp_path / "cart.nc")
    assert all(map(partial(np.array_equal, equal_nan=True), jax.tree.leaves(motion), jax.tree.leaves(again)))
    assert jnp.allclose(motion.evaluate(0.5).q, motion.evaluate([0.3, 0.5]).q[1])


@pytest.mark.slow
def test_values_that_are_closed_over_keep_their_gradient():
    """A threshold that `switches` closes over moves the motion as one that is a field does."""

    def end(far, closed):
        lines = dict(switches=lambda s, t, q, v, mode: jnp.where(mode, far - q[0], q[0] - s.near)[None])
        scene = cart_with(**lines) if closed else Cart(*NUMBERS[:2], far, *NUMBERS[3:])
        cost = lambda scene, t, q, v, mode: jnp.where(mode, far, 1.0) * q[0]
        made = hs.simulate(scene, START, True, t1=1.2, running_cost=cost, max_events=8)
        return made.final.q[0] + made.cost

    both = jax.jit(lambda far: [jax.grad(end)(far, closed) for closed in (True, False)])(jnp.array(0.7))
    np.testing.assert_allclose(both[0], both[1], rtol=1e-10)
