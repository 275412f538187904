"""What holds of every motion with ideal contacts: how far a trajectory is from it, relative to its own sizes."""

import jax
import numpy as np

import hybridsens as hs
from tests.problems.scenes_at_random import Draw, RandomScene


def energy(scene: RandomScene, q, v):
    """Kinetic and potential energy of states (state, dof)."""
    q, v = np.asarray(q), np.asarray(v)
    mass, stiffness, load = (np.asarray(part) for part in (scene.mass, scene.stiffness, scene.load))
    return np.sum(v @ mass * v, 1) / 2 + np.sum(q @ stiffness * q, 1) / 2 - q @ load


def gaps(scene: RandomScene, t, q):
    """Phi (time, contact), and its gradient (time, contact, dof), without the package's own kinematics."""
    y = np.asarray(q) - np.outer(np.sin(np.asarray(t) * float(scene.pace)), scene.shake)
    bent = np.einsum("kij,tj->tki", np.asarray(scene.curvature), y)
    normals = np.asarray(scene.normals)
    gap = np.asarray(scene.offsets) + y @ normals.T + np.einsum("tki,ti->tk", bent, y) / 2
    return gap, normals + bent


def rates(scene: RandomScene, t, q, v):
    """Phi' (time, contact)."""
    pace = float(scene.pace)
    frame = np.outer(pace * np.cos(np.asarray(t) * pace), scene.shake)
    return np.einsum("tki,ti->tk", gaps(scene, t, q)[1], np.asarray(v) - frame)


def violations(given: Draw, trajectory: hs.Trajectory) -> dict[str, float]:
    """The largest violation of each law; all of them should be of the size of the tolerances."""
    scene, count = given.scene, int(trajectory.events.count)
    events = jax.tree.map(lambda rows: np.asarray(rows)[:count], trajectory.events.__dict__ | {"count": np.zeros(0)})
    reached = np.isfinite(np.asarray(trajectory.q)[:, 0])
    samples = [np.asarray(part)[reached] for part in (trajectory.ts, trajectory.q, trajectory.v)]
    length = 1 + np.max(np.abs(samples[1]), initial=0.0)
    found = {"penetration": max(0.0, -float(np.min(gaps(scene, *samples[:2])[0]))) / length}
    found |= _at_impacts(scene, events, motion_goes_on=bool(trajectory.status == hs.Status.max_events_reached))
    found["order of events"] = float(np.max(-np.diff(events["time"]), initial=0.0))
    if given.passive:
        found |= _energies(given, events, samples)
    return found


def _at_impacts(scene: RandomScene, events, motion_goes_on: bool) -> dict[str, float]:
    t, q = events["time"], events["before"].q
    if len(t) == 0:
        return {}
    before, after = (rates(scene, t, q, events[side].v) for side in ("before", "after"))
    gap, gradient = gaps(scene, t, q)
    impulse, contact = events["impulse"], events["contact"]
    rows = np.arange(len(t))
    speed = 1 + np.max(np.abs(events["before"].v)) + np.max(np.abs(before))
    kick = (events["after"].v - events["before"].v) @ np.asarray(scene.mass) - np.einsum(
        "tk,tki->ti", impulse, gradient
    )
    e = np.asarray(scene.e)
    struck = impulse > 0
    newton = np.where(struck, np.minimum(np.abs(after + e * before), np.abs(after)), 0)
    last = np.append(np.diff(t) > 1e-12, not motion_goes_on)  # of the events at one instant
    closed = struck.any(1)[:, None] & last[:, None] & (np.abs(gap) < 1e-13)
    opens = np.where(closed, np.maximum(-after, 0), 0)
    size = 1 + np.max(np.abs(impulse))
    return {
        "gap at its event": float(np.max(np.abs(gap[rows, contact]) * (events["kind"] < 2))),
        "impulse balance": float(np.max(np.abs(kick))) / size,
        "negative impulse": float(np.max(-impulse)) / size,
        "Newton's law": float(np.max(newton)) / speed,
        "closing after an impact": float(np.max(opens)) / speed,
    }


def _energies(given: Draw, events, samples) -> dict[str, float]:
    """Growth between samples and events in the order of time, and at events."""
    scene, (ts, qs, vs) = given.scene, samples
    before, after = (energy(scene, events[side].q, events[side].v) for side in ("before", "after"))
    sampled = energy(scene, qs, vs)
    size = 1 + np.max(np.abs(sampled))
    at_events = np.stack([before, after], 1).ravel()
    place = np.searchsorted(np.repeat(events["time"], 2), ts, side="right")  # a sample at an event is the state after
    growth = np.diff(np.insert(at_events, place, sampled))
    return {"growth of energy": float(np.max(growth, initial=0.0)) / size}
