"""`check_gradient` names the cause of a doubt, each where it is the true one, and none where all is right."""

import importlib
import math
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.check_causes import find_causes
from hybridsens.comparison.check_events import OTHER_EVENTS, EventCheck
from hybridsens.comparison.check_gradient import check_gradient
from hybridsens.comparison.check_grazing import grazes
from hybridsens.comparison.check_motions import Call, value_with_calls
from hybridsens.comparison.check_report import ParameterCheck
from hybridsens.parameters import flatten_parameters
from hybridsens.scenes import BouncingBall, ElasticStop
from hybridsens.scenes.shipped import parameter

check_gradient_module = importlib.import_module("hybridsens.comparison.check_gradient")
ROOM = dict(max_events=8, max_steps=1024)


@pytest.fixture(autouse=True)
def without_events(monkeypatch):
    """The checks of single events, which have tests of their own, are left out: they take most of the time."""
    monkeypatch.setattr(check_gradient_module, "check_events", lambda *call: [])


def kinds(check):
    return {cause.kind for cause in check.causes}


def test_an_event_that_could_not_be_tested_by_itself_blames_no_derivative():
    """Where the parameters agree; where one is in doubt, its derivative may be that of another function."""
    event = EventCheck(0, range(1), 0.9, hs.EventKind.CAPTURE, 0, 0.5, 0.0, 0.0, OTHER_EVENTS)
    right = ParameterCheck("height", 1.0, 1.0, 1.0, 1e-9, 1.0, "")
    (cause,) = find_causes([right], [event], [], {}, {})
    assert cause.kind == "other events" and "rely on the derivatives" in cause.remedy
    check = hs.GradientCheck((right,), (event,), (cause,))
    assert check.ok and "All that could be tested agree." in str(check)
    assert "by the parameters, which agree" in str(check)
    (cause,) = find_causes([right._replace(verdict="differences disagree")], [event], [], {}, {})
    assert cause.kind == "unexplained"


def test_no_steps_are_blamed_where_a_guard_jumps():
    """Its gradient may be nan there, and that of shorter steps is nan too."""
    events = SimpleNamespace(time=np.array([0.7]), count=1)
    call = Call(Ball(), None, 0.0, 2.0, events, hs.Status.guard_jumps, None, None, ())
    doubtful = ParameterCheck("place", math.nan, math.nan, math.nan, math.nan, math.nan, "not decided")
    (cause,) = find_causes([doubtful], [], [call], {"place": False}, {})
    assert cause.kind == "discontinuity" and "guard jumps" in cause.reason


class Ball(BouncingBall):
    """A ball that is never held."""

    sustained_contact = False
    t1 = 0.8


class Bullet(hs.AbstractScene):
    """A point in the plane that flies along x at height y."""

    sustained_contact = False
    y: jnp.ndarray = parameter(0.0)

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.zeros(2)

    def restitution(self):
        return jnp.full(self.gap(0.0, jnp.ones(2)).shape, 0.8)


class Peg(Bullet):
    """A round peg with radius 1 at (2, 0)."""

    def gap(self, t, q):
        return jnp.sum((q - jnp.array([2.0, 0.0])) ** 2, keepdims=True) - 1


class Corner(Bullet):
    """Two walls that meet at (1, 0) at 60 degrees."""

    def gap(self, t, q):
        return (1 - q[0]) / 2 + jnp.array([1.0, -1.0]) * math.sqrt(0.75) * q[1]


def flight(scene, simulate):
    """Where the point has come to."""
    motion = simulate(scene, hs.State(jnp.stack([0 * scene.y, scene.y]), jnp.array([1.0, 0.0])), t1=2.5)
    return motion.final.q[1]


@pytest.mark.slow
def test_a_right_gradient_has_no_causes():
    """One impact, and samples on both sides of it."""

    def cost(scene, simulate):
        motion = simulate(scene, scene.initial_state(), t1=scene.t1, ts=jnp.array([0.3, 0.6]))
        return jnp.sum(motion.q**2)

    check = check_gradient(Ball(), cost, **ROOM)
    assert check.ok and check.causes == () and "Likely" not in str(check), str(check)
    assert all(entry.reference == pytest.approx(entry.adjoint, rel=1e-8, abs=1e-9) for entry in check.parameters)


@pytest.mark.slow
def test_steps_that_do_not_resolve_the_derivative_are_told():
    """At rest steps are as long as they may be, and the derivative by the force is integrated over them."""

    def cost(scene, simulate):
        return simulate(scene, scene.initial_state(), t1=8.0).final.q[0]

    check = check_gradient(ElasticStop(amplitude=0.0), cost, adjoint=hs.Replay(rtol=math.inf), max_events=8)
    assert [(cause.kind, cause.parameters) for cause in check.causes] == [("step control", ("amplitude",))], str(check)
    assert "leave the error control of the derivative on" in " ".join(str(check).split())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsens.DiscontinuityWarning")
def test_an_undeclared_jump_is_told_with_its_function():
    """A push that ends at tau."""

    class Pushed(Ball):
        tau: jnp.ndarray = parameter(0.2)

        def force(self, t, q, v):
            return super().force(t, q, v) + jnp.where(t < self.tau, 2.0, 0.0)

    def cost(scene, simulate):
        return simulate(scene, scene.initial_state(), t1=scene.t1).final.q[0]

    check = check_gradient(Pushed(), cost, **ROOM)
    assert kinds(check) == {"discontinuity"}, str(check)
    assert "tau" in check.causes[0].parameters
    assert "`force` has jnp.where of t" in str(check) and "jump_ts" in check.causes[0].remedy


class Pulse(hs.AbstractHybridSystem):
    """x' = a - x from tau on, and -x before; x is looked at by a guard with a corner."""

    tau: jax.Array
    declared: bool = False

    def flow(self, t, x, mode):
        return -x + jnp.where(t > self.tau, 2.0, 0.0)

    def guards(self, t, x, mode):
        return jnp.maximum(x, 0.1 * x)[None] + 5

    def transition(self, event, t, x, mode):
        return x, mode

    def jump_times(self):
        return self.tau[None] if self.declared else None


def _pulse(system, solve):
    return solve(system, 1.0, t1=1.0, running_cost=lambda system, t, x, mode: jnp.sign(x)).final


@pytest.mark.filterwarnings("ignore::hybridsens.DiscontinuityWarning")
@pytest.mark.parametrize("declared", [pytest.param(True, marks=pytest.mark.slow), False])
def test_an_undeclared_jump_of_a_system_is_told_with_its_function(declared):
    """A push that begins at tau; each function has a remedy of its own."""
    parameters = flatten_parameters(Pulse(jnp.array(0.5), declared))
    _, calls = value_with_calls(parameters, _pulse, dict(rtol=1e-6, atol=1e-6, **ROOM))(parameters.vector)
    doubt = ParameterCheck("tau", 0.0, 0.0, -1.2, 0.0, 0.0, "differences disagree")
    (cause,) = find_causes([doubt], [], calls, {}, {})
    assert (cause.kind, cause.parameters) == ("discontinuity", ("tau",))
    assert ("`flow` has jnp.where of t" in cause.reason, "jump_ts" in cause.remedy) == (not declared, not declared)
    assert all(words in cause.reason for words in ("`guards` has", "`running_cost` has"))
    assert all(words in cause.remedy for words in ("one guard for each", "jump in x"))


@pytest.mark.slow
def test_a_peg_that_is_barely_struck_is_told():
    check = check_gradient(Peg(1 - 1e-6), flight, **ROOM)
    assert kinds(check) == {"grazing"}, str(check)
    assert "event 0:0 closes at" in check.causes[0].reason


@pytest.mark.slow
def test_a_peg_that_is_barely_missed_is_found():
    """No event tells of it; a peg that is struck well is none."""
    missed, struck = (_grazes(Peg(y)) for y in (1 + 1e-6, 0.5))
    assert [(graze.event, graze.contact, round(graze.time, 2)) for graze in missed] == [(None, 0, 2.0)]
    assert missed[0].speed == pytest.approx(math.sqrt(2 * 2 * 2e-6) / 4, rel=1e-2)
    assert struck == []


def _grazes(scene):
    settings = dict(rtol=1e-10, atol=1e-10, **ROOM)
    parameters = flatten_parameters(scene)
    _, (call,) = value_with_calls(parameters, flight, settings)(parameters.vector)
    return grazes(call, settings)


@pytest.mark.slow
def test_a_corner_that_is_hit_is_told():
    check = check_gradient(Corner(0.0), flight, **ROOM)
    assert kinds(check) == {"simultaneous impacts"}, str(check)
    assert check.causes[0].parameters == ("y",)


@pytest.mark.slow
def test_a_sample_at_an_impact_is_told():
    """The ball comes down at sqrt(2 h / g), where its height has a kink in time."""
    impact = math.sqrt(2 / 9.81)

    def cost(scene, simulate):
        return simulate(scene, scene.initial_state(), t1=scene.t1, ts=jnp.array([0.2, impact])).v[1, 0]

    check = check_gradient(Ball(), cost, **ROOM)
    assert kinds(check) == {"event at a data time"}, str(check)
    assert "(0:0)" in check.causes[0].reason and "0.451524" in check.causes[0].reason


@pytest.mark.slow
def test_a_wrong_derivative_has_none_of_these_causes():
    """The cost holds the height constant by mistake."""

    def cost(scene, simulate):
        state = hs.State(jnp.ones(1), scene.velocity[None])
        motion = simulate(scene, state, t1=scene.t1)
        return motion.final.q[0] + jnp.round(1e9 * scene.height) / 1e9

    check = check_gradient(Ball(), cost, **ROOM)
    assert [(cause.kind, cause.parameters) for cause in check.causes] == [("unexplained", ("height",))], str(check)
