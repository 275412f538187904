"""The jump adjoint, forward sensitivities and central differences agree on everything that is reported of a motion."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.scenes import SCENES, ElasticStop
from tests.closeness import assert_close, worst
from tests.problems import shipped_motions as motions

TOLERANCE = 1e-12
# The quick ones show every kind of event without them.
SLOW = ("bouncing-ball", "cylinder-slide", "double-pendulum-wall", "pendulum-wall", "stacked-balls")
NAMES = [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in SCENES]
# These start in contact: another initial state would penetrate, or fall.
START_CLOSED = {"cylinder-slide", "vibrating-table"}
E = "restitution_coefficient"
# Parameters that an event's time depends on through one ingredient alone. The table's amplitude is the exception: it
# moves the initial state along with the gap, so that the ball starts on the table. A ball that falls onto the table
# stands in for it below.
THROUGH = {
    "elastic-stop": {"gap": "distance", "mass": "mass", "force": "stiffness", "restitution": E},
    "bouncing-ball": {"gap": "floor", "mass": "mass", "force": "weight", "restitution": E},
    "cylinder-slide": {"gap": "depth", "mass": "mass", "force": "weight", "restitution": E},
    "stacked-balls": {
        "gap": "clearance", "mass": "mass_low", "force": "weight_low", "restitution": "restitution_balls",
    },
    "vibrating-table": {"gap": "amplitude", "mass": "mass", "force": "weight", "restitution": E},
    "pendulum-wall": {"gap": "wall", "mass": "rotor_inertia", "force": "damping", "restitution": E},
    "double-pendulum-wall": {"gap": "wall", "mass": "rotor_inertia", "force": "gravity", "restitution": E},
}  # fmt: skip


def scene(name):
    """A shipped scene; the elastic stop with losses, so that its restitution can be moved both ways."""
    return ElasticStop(restitution_coefficient=0.8) if name == "elastic-stop" else SCENES[name]()


@functools.cache
def solved(name):
    return motions.solve(scene(name), TOLERANCE)


@functools.cache
def differences(name, field, index):
    """Fourth-order central differences of everything observed, by one entry of the inputs."""
    x = motions.inputs(scene(name))
    value = getattr(x, field)
    h = 2.5e-4 * max(abs(float(value[index])), 0.1)

    def at(steps):
        moved = x._replace(**{field: value.at[index].add(steps * h)})
        return motions.reverse(SCENES[name])(moved, jnp.asarray(TOLERANCE))[1][0]

    parts = zip(at(-2), at(-1), at(1), at(2), strict=True)
    return motions.Observed(*((8 * (c - b) - (d - a)) / (12 * h) for a, b, c, d in parts))


@pytest.mark.parametrize("name", NAMES)
def test_reverse_agrees_with_forward(name):
    """Both are derivatives of the same computed motion, so they agree to rounding.

    Times of gentle impacts are worse conditioned: rounding in a gap counts by how slowly it closes (the table's last
    impact before capture is at 1e-4 of its first)."""
    _, reverse, _ = solved(name)
    forward = motions.forward(SCENES[name])(motions.inputs(scene(name)), jnp.asarray(TOLERANCE))
    for what, found, expected in zip(motions.Observed._fields, reverse, forward, strict=True):
        within = 1e-12 if what in ("cost", "final") else 3e-11
        within = 1e-9 if name == "vibrating-table" else within  # held, it has steps that either way cuts for itself
        for by, of in zip(found, expected, strict=True):
            assert_close(by, of, within, scale=max(float(jnp.max(jnp.abs(expected.parameters))), 1e-3))


@pytest.mark.parametrize("name", NAMES)
def test_reverse_agrees_with_differences(name):
    """Cost, final state, event times, states on both sides, impulses and closing speeds, by everything."""
    _, jacobian, _ = solved(name)
    entries = [("parameters", i) for i in range(len(motions.names(SCENES[name])))] + [("t1", ())]
    if name not in START_CLOSED:
        entries += [("shift", i) for i in range(jacobian.cost.shift.shape[0])]
    for field, index in entries:
        by_differences = differences(name, field, index)
        for what, found, expected in zip(motions.Observed._fields, jacobian, by_differences, strict=True):
            column = getattr(found, field)[..., index] if index != () else found.t1
            size = float(jnp.max(jnp.abs(found.parameters)))
            error = worst(column, expected, size)
            assert error <= 1e-8, f"{what} by {field} {index}: {error:.1e}"


def test_the_shipped_scenes_show_every_kind_of_event():
    """So that impact, capture and release are all among what is compared above."""
    seen = {
        int(kind)
        for name in SCENES
        if name not in SLOW
        for kind in solved(name)[2].events.kind[: motions.REPORTED[SCENES[name]]]
    }
    assert seen - {-1} == {hs.EventKind.IMPACT, hs.EventKind.CAPTURE, hs.EventKind.RELEASE}


@pytest.mark.parametrize("ingredient", ["gap", "mass", "force", "restitution"])
@pytest.mark.parametrize("name", NAMES)
def test_an_event_time_moves_through_each_ingredient_alone(name, ingredient):
    """No term of (T5) is left out: d t_k / d p is there, and right, where p enters in one place only."""
    _, jacobian, _ = solved(name)
    index = motions.names(SCENES[name]).index(THROUGH[name][ingredient])
    by_parameter = jacobian.time.parameters[:, index]
    assert np.max(np.abs(by_parameter)) > 1e-4
    # The last impact of a cascade is hit at 1e-5 m/s, and differences of its time carry 1e-12 s of rounding over h.
    assert_close(by_parameter, differences(name, "parameters", index).time, 1e-6 if name == "vibrating-table" else 1e-7)


def log_determinant(name):
    """log |det d(q, v)(t1) / d(q, v)(t0)|."""
    _, jacobian, _ = solved(name)
    return float(np.linalg.slogdet(np.asarray(jacobian.final.shift))[1])


def test_determinant_of_the_state_is_restitution_squared_per_impact():
    """Free fall keeps areas, and each impact multiplies them by e^2."""
    count = int(solved("bouncing-ball")[2].events.count)
    assert_close(log_determinant("bouncing-ball"), 2 * count * np.log(0.8), 1e-9)


def test_damping_adds_its_trace_to_the_determinant():
    """An oscillator's damping c / m shrinks areas by exp(-c T / m) besides."""
    s = scene("elastic-stop")
    count = int(solved("elastic-stop")[2].events.count)
    assert_close(log_determinant("elastic-stop"), 2 * count * np.log(0.8) - 0.1 * s.t1, 1e-9)


@pytest.mark.slow
def test_determinant_of_two_bodies():
    """With several degrees of freedom an impact of one contact still multiplies volumes by e^2."""
    s, (_, _, trajectory) = scene("stacked-balls"), solved("stacked-balls")
    e = np.asarray(s.restitution())[np.asarray(trajectory.events.contact[: int(trajectory.events.count)])]
    assert_close(log_determinant("stacked-balls"), 2 * np.sum(np.log(e)), 1e-9)


@pytest.mark.slow
def test_determinant_where_the_mass_matrix_depends_on_the_configuration():
    """Volumes are kept in (q, M v), so in (q, v) the ratio of det M at both ends comes in."""
    s, (seen, _, trajectory) = scene("double-pendulum-wall"), solved("double-pendulum-wall")
    log_mass = lambda q: np.linalg.slogdet(np.asarray(s.mass_matrix(q)))[1]
    ratio = log_mass(s.initial_state().q) - log_mass(seen.final[:2])
    assert_close(log_determinant("double-pendulum-wall"), 2 * int(trajectory.events.count) * np.log(0.7) + ratio, 1e-8)


@pytest.mark.slow
def test_a_falling_ball_meets_the_shaking_table_by_its_gap_alone():
    """h - g t^2 / 2 = A sin(omega t) at the impact, so dt/dA = -sin(omega t) / (g t + A omega cos(omega t))."""
    height, weight, omega = 0.1, 9.81, 31.41592653589793
    start = hs.State([height], [0.0])

    def first_impact(amplitude):
        table = SCENES["vibrating-table"](amplitude=amplitude)
        return hs.simulate(table, start, t1=0.3, rtol=TOLERANCE, atol=TOLERANCE, throw=False).events.time[0]

    amplitude = 0.02
    t, slope = jax.jit(jax.value_and_grad(first_impact))(jnp.array(amplitude))
    assert_close(height - weight * t**2 / 2, amplitude * jnp.sin(omega * t), 1e-12)
    assert_close(slope, -jnp.sin(omega * t) / (weight * t + amplitude * omega * jnp.cos(omega * t)), 1e-10)
