"""`check_gradient` passes what is right, and names the parameter and the event where something is wrong."""

import importlib
import math
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import hybridsens as hs
from hybridsens.comparison.check_events import cascades, split_at_events
from hybridsens.comparison.check_gradient import check_gradient
from hybridsens.comparison.differentiate import QUICKLY, WIDTHS, slopes_nearby, value_and_gradient
from hybridsens.comparison.functional import running_cost_functional
from hybridsens.scenes import BouncingBall
from tests.problems.hybrid_systems import Decay

IMPACT, CAPTURE, RELEASE = hs.EventKind.IMPACT, hs.EventKind.CAPTURE, hs.EventKind.RELEASE
check_gradient_module = importlib.import_module("hybridsens.comparison.check_gradient")


class Ball(BouncingBall):
    """A ball that is never held: its programs are small."""

    sustained_contact = False
    contacts = ("ground",)


@pytest.mark.slow
def test_a_right_gradient_passes_and_each_impact_has_determinant_e_squared():
    """Three impacts of a ball without friction: each piece of its motion contracts the phase space by e^2."""
    check = check_gradient(Ball(restitution_coefficient=0.8), max_events=8, max_steps=1024)
    assert check.ok, str(check)
    assert [entry.determinant for entry in check.events] == pytest.approx([0.64] * 3, abs=1e-9)
    assert [entry.contact_name for entry in check.events] == ["ground"] * 3 and " ground " in str(check)
    assert "All agree." in str(check)


@pytest.mark.slow
def test_a_parameter_that_is_held_constant_by_mistake_is_named():
    """`stop_gradient` on the floor makes adjoint and forward agree on 0; there, and only there, differences do not."""

    def cost(scene, simulate):
        held = eqx.tree_at(lambda s: s.floor, scene, jax.lax.stop_gradient(scene.floor))
        return running_cost_functional(held, simulate)

    check = check_gradient(Ball(), cost, max_events=8, max_steps=1024)
    assert {entry.parameter: entry.verdict for entry in check.parameters if entry.verdict} == {
        "floor": "differences disagree"
    }
    assert not check.ok


@jax.custom_jvp
def _place(floor):
    return floor


_place.defjvp(lambda primals, tangents: (primals[0], 2 * tangents[0]))


class WrongFloor(Ball):
    """A ball whose gap moves twice as fast with the floor as it says."""

    def gap(self, t, q):
        return q - _place(self.floor)


@pytest.mark.slow
def test_a_wrong_derivative_in_a_contact_is_found_at_its_events():
    """Every impact's own check names the parameter that stands wrongly in the gap."""
    check = check_gradient(WrongFloor(), max_events=8, max_steps=1024)
    assert [entry.verdict for entry in check.events] == ["differences disagree in floor"] * 3
    assert [entry.parameter for entry in check.parameters if entry.verdict] == ["floor"]


@pytest.mark.slow
def test_an_adjoint_that_is_off_by_a_millionth_is_named(monkeypatch):
    """Forward sensitivities and differences agree; the adjoint's slope by the weight is wrong in the seventh digit."""
    right = check_gradient_module._gradient

    def wrong(parameters, cost, adjoint, settings):
        gradient, reported = right(parameters, cost, adjoint, settings)
        off = np.array([name == "weight" for name in parameters.names]) * 1e-6
        return gradient * (1 + off if isinstance(adjoint, hs.Replay) else 1), reported

    monkeypatch.setattr(check_gradient_module, "_gradient", wrong)
    monkeypatch.setattr(check_gradient_module, "check_events", lambda *call: [])
    check = check_gradient(Ball(restitution_coefficient=0.8), max_events=8, max_steps=1024)
    (found,) = [entry for entry in check.parameters if entry.verdict]
    assert found.parameter == "weight"
    assert re.fullmatch(r"adjoint and forward sensitivities disagree by \d\.\de-0\d", found.verdict)
    assert "In doubt: parameters weight; events -." in str(check)


def at_end(system, solve):
    return solve(system, 1.0, t1=1.0).final


FLAT = [
    pytest.param(lambda system, solve: (at_end(system, solve) - math.exp(-0.7)) ** 2, id="the best fit"),
    pytest.param(lambda system, solve: 1.0 + 0.0 * at_end(system, solve), id="constant", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("cost", FLAT)
def test_a_right_gradient_that_is_0_passes(cost):
    """What is left of it is the error of the motion and the rounding of J, which differ from method to method."""
    check = check_gradient(Decay(), cost, max_events=8, max_steps=1024)
    assert check.ok, str(check)


class Brick(hs.AbstractScene):
    """It falls from 1 m on the floor and stays there."""

    weight: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.zeros(1)


@pytest.mark.slow
def test_what_ends_at_rest_is_not_in_doubt():
    """The state after the capture is 0 but for the rounding of the fall, and so are its slopes by the fall's start."""
    drop = hs.State([1.0], [0.0])
    check = check_gradient(Brick(jnp.array(9.81)), lambda brick, sim: sim(brick, drop, t1=1.0).final.q[0], max_events=8)
    assert check.ok, str(check)


@pytest.mark.slow
def test_a_constant_in_the_cost_does_not_put_a_right_gradient_in_doubt():
    """A parameter of value 0 was moved by what changes J by as much as all of J: by 1e4."""
    check = check_gradient(Decay(0.0), lambda *asked: 1e4 + at_end(*asked), max_events=8, max_steps=1024)
    assert check.ok, str(check)


@pytest.mark.parametrize(
    ("system", "cost", "message"),
    [
        (Decay(), lambda system, solve: at_end(system, solve) * jnp.nan, "a finite number, but returns nan"),
        (Decay(math.nan), lambda system, solve: at_end(Decay(), solve), "All parameters must be finite, but k is not"),
    ],
)
def test_what_is_no_number_is_told(system, cost, message):
    """Its gradient was in doubt, for want of steps or a changed sequence of events."""
    with pytest.raises(ValueError, match=message):
        check_gradient(system, cost, max_events=8, max_steps=1024)


def test_a_gradient_that_is_wrongly_0_is_named():
    """Held constant by mistake, the parameter has a slope of 0 by every method but differences."""
    held = lambda system, solve: at_end(Decay(jax.lax.stop_gradient(system.k)), solve)
    check = check_gradient(Decay(), held, max_events=8, max_steps=1024)
    assert [entry.verdict for entry in check.parameters] == ["differences disagree"], str(check)


def test_slopes_nearby_are_those_of_the_smooth_side():
    """Of 3 x^2 at 0 and of 2 x at 1; a jump on one side, or no value there, does not count."""
    width, one = WIDTHS[0], np.ones(1)
    near = lambda function, x: slopes_nearby(lambda p: function(float(p[0])), x * one, one)[0]
    assert near(lambda x: 3 * x**2, 0.0) == pytest.approx(3 * width)
    assert near(lambda x: 2 * x + (x > 1), 1.0) == pytest.approx(2)
    assert near(lambda x: 2 * x if x <= 1 else math.nan, 1.0) == pytest.approx(2)
    assert near(lambda x: 0.0 if x == 1 else math.nan, 1.0) == 0


def test_a_cascade_stays_together_from_its_fastest_impact_to_its_capture():
    """Of two cascades each is a group; a capture by an inelastic contact, and a release, stand by themselves."""
    kinds = [IMPACT, IMPACT, CAPTURE, RELEASE, IMPACT, IMPACT, CAPTURE, RELEASE, CAPTURE]
    speeds = jnp.array([1.0, 0.1, 0.01, 0.0, 1.0, 0.1, 0.01, 0.0, 2.0])
    contacts = jnp.array([0, 0, 0, 0, 0, 0, 0, 0, 1])
    rows = hs.State(jnp.zeros((9, 2)), jnp.zeros((9, 2)))
    kinds = jnp.array([int(kind) for kind in kinds])
    no = jnp.zeros(9, bool)
    events = hs.Events(jnp.arange(9.0), kinds, contacts, rows, rows, jnp.zeros((9, 2)), speeds, no, jnp.array(9))
    joined = cascades(events, np.array([0.1, 0.0]))
    groups, _ = split_at_events(np.arange(9.0), 9, -1.0, 9.0, joined)
    assert groups == [range(0, 3), range(3, 4), range(4, 7), range(7, 8), range(8, 9)]


def test_events_that_lie_together_stay_together():
    """Pieces begin half way between events, and events within 1e-6 of the horizon share one."""
    groups, times = split_at_events(np.array([1.0, 2.0, 2.0 + 1e-9, 3.0, np.inf]), 4, 0.0, 4.0)
    assert groups == [range(0, 1), range(1, 3), range(3, 4)]
    assert times == pytest.approx([0, 1.5, 2.5, 4])
    assert split_at_events(np.array([jnp.inf]), 0, 0.0, 4.0) == ([], [0.0])


@pytest.mark.parametrize("mode", ["reverse", "forward"])
def test_options_reach_the_compiler(mode):
    """Programs of a check run a few times each, so that they are compiled quickly rather than well."""
    square = lambda vector: (vector @ vector, None)
    x = jnp.arange(3.0)
    gradients = [value_and_gradient(square, mode, options=options)(x)[1] for options in (None, QUICKLY)]
    np.testing.assert_array_equal(*gradients)
    with pytest.raises(jax.errors.JaxRuntimeError, match="no_such_option"):
        value_and_gradient(square, mode, options={"no_such_option": True})(x)
