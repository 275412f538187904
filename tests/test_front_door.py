"""Whatever is handed to `simulate`, the answer is a motion, a Status, or a ValueError or TypeError that names the
argument."""

import importlib
import string
from collections.abc import Callable

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import hybridsens as hs
from hybridsens.scenes import BouncingBall

BALL = BouncingBall()
START = BALL.initial_state()


class Entered:
    """In place of a trajectory: the front door let something in."""

    def come_from(self, *given):
        return self


ENTERED = Entered()

pytestmark = [
    pytest.mark.filterwarnings("ignore:An `rtol` below"),
    pytest.mark.filterwarnings("ignore:Data type alias"),  # NumPy's word on the text "a", which JAX takes for a type
]

dtypes = st.sampled_from(["float64", "float32", "float16", "complex128", "int8", "uint32", "bool", "object", "U1"])
shapes = hnp.array_shapes(min_dims=0, max_dims=2, min_side=0, max_side=2)
arrays = st.tuples(dtypes, shapes).flatmap(lambda kind__shape: hnp.arrays(*kind__shape, elements=None))
jax_arrays = st.sampled_from([jnp.zeros(0), jnp.ones((1, 1)), jnp.array(1j), jnp.array(True), jax.random.key(0)])
scalars = st.one_of(
    st.none(), st.booleans(), st.floats(), st.integers(), st.just(10**400), st.complex_numbers(),
    st.text(string.ascii_letters, max_size=3), st.binary(max_size=2),
)  # fmt: skip
things = st.sampled_from([object(), print, int, slice(1), range(3), {"a": 1}, hs.Replay, diffrax.Euler(), BALL, START])
anything = st.one_of(scalars, arrays, jax_arrays, st.lists(scalars, max_size=3), things)

ARGUMENTS = (
    "state", "t0", "t1", "ts", "running_cost", "solver", "rtol", "atol", "max_events", "max_steps", "capture_speed",
    "adjoint", "throw",
)  # fmt: skip


@pytest.fixture(autouse=True)
def door_alone(monkeypatch, request):
    """No run time checker of annotations (a user has none), and nothing behind the door, where compiling begins."""
    jaxtyping.config.update("jaxtyping_disable", True)
    if "behind" not in request.function.__name__:
        monkeypatch.setattr(importlib.import_module("hybridsens.simulate"), "_simulate", lambda *given: ENTERED)
        monkeypatch.setattr(importlib.import_module("hybridsens.simulate"), "leaving", lambda found, *_: found)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def told(call, name: str) -> bool:
    """Whether a call is refused with a word on the argument; False if it is let in."""
    try:
        assert call() is ENTERED
    except (ValueError, TypeError, hs.SimulationError) as error:  # the last one for times of which no motion can be
        text = "\n".join([str(error), *getattr(error, "__notes__", [])])  # what a traceback ends with
        assert name in text and ("must" in text or "argument" in text), repr(error)
        return True
    return False


@settings(max_examples=300, deadline=None, derandomize=True)
@given(name=st.sampled_from(ARGUMENTS), value=anything)
def test_anything_in_place_of_an_argument_is_let_in_or_refused_by_its_name(name, value):
    """No other error, and no text that does not name the argument."""
    told(lambda: hs.simulate(BALL, **({"state": START, "t1": 1.0} | {name: value})), name)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(q=anything, v=anything)
def test_anything_in_place_of_coordinates_is_let_in_or_refused(q, v):
    """A State is refused where it is made, or by the door for its shape."""
    try:
        state = hs.State(q, v)
    except TypeError as error:
        assert "of a State must hold real numbers" in str(error)
    else:
        told(lambda: hs.simulate(BALL, state, t1=1.0), "")


@pytest.mark.parametrize("name, value", [("t0", "soon"), ("ts", [[0.1]]), ("rtol", 1j), ("throw", 1), ("solver", 3)])
def test_what_cannot_be_meant_is_refused(name, value):
    """The check above can fail: these are refused, and the good call is not."""
    assert told(lambda: hs.simulate(BALL, START, **({"t1": 1.0} | {name: value})), name)
    assert not told(lambda: hs.simulate(BALL, START, t1=1.0), name)


class AnyScene(hs.AbstractScene):
    """A scene whose functions return whatever is given."""

    returned: Callable = eqx.field(static=True)

    def _answer(self, name, usual):
        return self.returned(name, usual)

    def mass_matrix(self, q):
        return self._answer("mass_matrix", jnp.eye(1, dtype=q.dtype))

    def force(self, t, q, v):
        return self._answer("force", -q)

    def gap(self, t, q):
        return self._answer("gap", q)

    def restitution(self):
        return self._answer("restitution", jnp.full(1, 0.5))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(name=st.sampled_from(["mass_matrix", "force", "gap", "restitution"]), value=anything)
def test_anything_that_a_scene_returns_is_let_in_or_refused(name, value):
    """Lists, None, objects, texts, integers, wrong shapes: the text says which function must return what."""
    scene = AnyScene(lambda asked, usual: value if asked == name else usual)
    refused = told(lambda: hs.simulate(scene, START, t1=1.0), "` must return")
    assert refused or isinstance(value, jax.Array | np.ndarray)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(value=st.one_of(anything, st.dictionaries(st.sampled_from("ab"), anything, max_size=2)))
def test_anything_that_a_running_cost_returns_is_let_in_or_refused(value):
    """A number, an array or a PyTree of them is a cost; the text says what is none."""
    told(lambda: hs.simulate(BALL, START, t1=1.0, running_cost=lambda *given: value), "`running_cost` must return")


UNTRACEABLE: dict[str, Callable] = {
    "branches": lambda usual: usual if usual.sum() > 0 else -usual,
    "calls NumPy": lambda usual: np.sin(usual),
    "makes a float": lambda usual: jnp.full_like(usual, float(usual.sum())),
}


@pytest.mark.parametrize("function", UNTRACEABLE.values(), ids=UNTRACEABLE)
@pytest.mark.parametrize("name", ["force", "gap", "running_cost"])
def test_a_function_that_cannot_be_traced_is_named(name, function):
    """With the remedy, in a sentence of its own behind the tracer's words."""
    scene = AnyScene(lambda asked, usual: function(usual) if asked == name else usual)
    cost = {"running_cost": lambda scene, t, q, v: function(q)} if name == "running_cost" else {}
    with pytest.raises(TypeError, match=f"`{name}` must be a function that JAX can trace.*[^.][.] Use jax.numpy"):
        hs.simulate(scene, START, t1=1.0, **cost)


@pytest.mark.parametrize("name", ["mass_matrix", "force", "gap", "restitution"])
def test_what_a_function_raises_goes_on_and_names_it(name):
    """The user's own error, with a note of which function it came from."""

    def fail(asked, usual):
        if asked == name:
            raise KeyError("mine")
        return usual

    with pytest.raises(KeyError, match="mine") as caught:
        hs.simulate(AnyScene(fail), START, t1=1.0)
    assert any(f"`{name}`" in note for note in caught.value.__notes__)


@pytest.mark.parametrize("name", ["max_events", "max_steps"])
@pytest.mark.parametrize("room", [10**10, 10**12, 10**400])
def test_room_that_no_memory_has_is_refused(name, room):
    """Before anything is allocated; room for a million of each is let in."""
    assert told(lambda: hs.simulate(BALL, START, t1=1.0, **{name: room}), name)
    assert not told(lambda: hs.simulate(BALL, START, t1=1.0, **{name: 10**6}), name)


def test_room_for_steps_that_are_not_kept_is_not_counted():
    """With recomputation `max_steps` only bounds how long a motion may take."""
    assert not told(lambda: hs.simulate(BALL, START, t1=1.0, max_steps=10**12, adjoint=hs.Replay(recompute=True)), "")


wild = st.one_of(st.floats(), st.sampled_from([0.0, -0.0, 1.0, 5e-324, 1e-300, 1e300, np.inf, -np.inf, np.nan]))


@eqx.filter_jit
def _ball(p, q, v, t0, t1, ts):
    ball = BouncingBall(mass=p[0], weight=p[1], floor=p[2], restitution_coefficient=p[3])
    return hs.simulate(ball, hs.State(q, v), t0=t0, t1=t1, ts=ts, max_events=8, max_steps=100, throw=False)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(place=st.integers(0, 9), value=wild)
def test_any_number_behind_the_door_ends_in_a_status(place, value):
    """One value of the scene, state or times is anything: the run ends, and a successful one is finite and above the
    floor."""
    numbers = np.array([1.0, 9.81, 0.0, 0.5, 1.0, 0.0, 0.0, 1.0, 0.1, 0.9])
    numbers[place] = value
    p, q, v, (t0, t1), ts = np.split(jnp.asarray(numbers), [4, 5, 6, 8])
    trajectory = _ball(p, q, v, t0, t1, ts)
    assert int(trajectory.steps.accepted + trajectory.steps.rejected) <= 100
    if trajectory.status == hs.Status.successful:
        assert np.all(np.isfinite(trajectory.q)) and np.all(np.isfinite(trajectory.final.v))
        assert trajectory.final.q[0] >= p[2] - 1e-8 * (1 + abs(p[2]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (dict(t1=-1.0), r"bad_horizon\): .* Here t0 is 0 and t1 is -1.$"),
        (dict(t1=np.nan), r"bad_horizon\): .* t1 is nan.$"),
        (dict(t1=1.0, ts=[0.5, 0.3]), r"unsorted_times\): .* Here ts\[1\] is 0.3, t0 is 0 and t1 is 1.$"),
        (dict(t1=1.0, ts=[0.5, np.nan]), r"unsorted_times\): .* Here ts\[1\] is nan"),
    ],
)
def test_times_of_which_no_motion_can_be_are_told_before_anything_compiles(given, words):
    """By a scene and by a system; who does not want them raised gets their status."""
    heater = hs.systems.Thermostat()
    for call in (
        lambda **given: hs.simulate(BALL, START, **given),
        lambda **given: hs.solve(heater, heater.initial_state(), heater.initial_mode(), **given),
    ):
        with pytest.raises(hs.SimulationError, match=rf"^The motion could not begin \({words}"):
            call(**given)
    assert hs.simulate(BALL, START, throw=False, **given) is ENTERED
