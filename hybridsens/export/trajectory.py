"""A motion of a scene as an xarray Dataset that holds all of it, without padding, and as tables for pandas."""

from typing import Any

import numpy as np

from .datasets import attributes, must_be_one, must_have_samples, of_each_run, optional
from .names import contact_names, coordinate_names, must_differ, unit_of_contact
from .trees import named_leaves, variables

KINDS = "impact capture release switch"
"""Meanings of 0, 1, 2, 3 in `event_kind`."""


def motion_dataset(motion: Any, scene: Any):
    """As `Trajectory.to_xarray`: samples over `time`, events over `event`, the final state, the cost."""
    must_be_one(motion.events.count, "to_xarray()")
    xarray = optional("xarray", "to_xarray()")
    q_names, v_names = coordinate_names(scene, motion.final.q.shape[0])
    contacts = contact_names(scene, motion.mode.shape[0])
    coords = {"coordinate": ("coordinate", q_names), "velocity": ("velocity", v_names), "contact": contacts}
    columns = {
        "final_q": ("coordinate", motion.final.q, {"long_name": "configuration at the end"}),
        "final_v": ("velocity", motion.final.v, {"long_name": "velocity at the end"}),
        "closed": ("contact", motion.mode, {"long_name": "contacts held closed at the end"}),
        **_events(motion.events, scene),
        **variables("cost", motion.cost),
        **variables("scene_mode", motion.scene_mode),
    }
    if motion.ts is not None:
        coords["time"] = ("time", np.asarray(motion.ts), {"units": "s"})
        columns["q"] = (("time", "coordinate"), motion.q)
        columns["v"] = (("time", "velocity"), motion.v)
    n = int(motion.events.count)
    for name, value in named_leaves("event_mode", motion.events.mode).items():
        columns[name] = (["event", *(f"{name}_{axis}" for axis in range(value.ndim - 1))], value[:n])
    arrays = {name: (dims, np.asarray(value), *more) for name, (dims, value, *more) in columns.items()}
    return xarray.Dataset(arrays, coords, attributes("trajectory", motion))


def _events(events, scene) -> dict[str, tuple]:
    """Rows of the events that there were."""
    n = int(events.count)
    in_unit = lambda unit: {"units": unit} if unit_of_contact(scene, unit) else {}
    kinds = {"flag_values": np.arange(4), "flag_meanings": KINDS}
    return {
        "event_time": ("event", events.time[:n], {"units": "s"}),
        "event_kind": ("event", events.kind[:n], kinds),
        "event_contact": ("event", events.contact[:n], {"long_name": "number of the gap, or of the switch"}),
        "event_q_before": (("event", "coordinate"), events.before.q[:n]),
        "event_v_before": (("event", "velocity"), events.before.v[:n]),
        "event_q_after": (("event", "coordinate"), events.after.q[:n]),
        "event_v_after": (("event", "velocity"), events.after.v[:n]),
        "impulse": (("event", "contact"), events.impulse[:n], in_unit("N s")),
        "closing_speed": ("event", events.closing_speed[:n], in_unit("m/s")),
        "order_matters": ("event", events.order_matters[:n]),
    }


def samples_frame(motion: Any, scene: Any):
    """As `Trajectory.to_pandas`: one row for each sample; columns are coordinates, then velocities."""
    must_be_one(motion.events.count, "to_pandas()")
    must_have_samples(motion, "simulate")
    pandas = optional("pandas", "to_pandas()")
    q_names, v_names = coordinate_names(scene, motion.final.q.shape[0])
    index = pandas.Index(np.asarray(motion.ts), name="time [s]")
    return pandas.DataFrame(np.concatenate([motion.q, motion.v], axis=1), index, [*q_names, *v_names])


def events_frame(events: Any, scene: Any):
    """As `Events.to_pandas`: one row for each event that there was.

    Raises: ValueError for a coordinate with the name of a column, such as kind."""
    if np.ndim(events.count) == 1:
        return of_each_run(events, lambda one: events_frame(one, scene))
    must_be_one(events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    n = int(events.count)
    contact = np.asarray(events.contact[:n])
    names = contact_names(scene, events.impulse.shape[1])
    kind, switched = np.asarray(events.kind[:n]), np.asarray(events.kind[:n]) == KINDS.split().index("switch")
    of_contact = np.where(switched, 0, contact)
    impulses = np.asarray(events.impulse[:n])
    impulse = impulses[np.arange(n), of_contact] if impulses.shape[1] else 0.0
    columns: dict[str, Any] = {
        "time [s]": np.asarray(events.time[:n]),
        "kind": np.array(KINDS.split())[kind] if n else np.array([], str),
        "contact": np.array([str(i) if s else names[i] for i, s in zip(contact, switched, strict=True)], str),
        "closing speed" + unit_of_contact(scene, "m/s"): np.asarray(events.closing_speed[:n]),
        "impulse" + unit_of_contact(scene, "N s"): np.where(switched, 0.0, impulse),
    }
    q_names, v_names = coordinate_names(scene, events.before.q.shape[1])
    sides = ((q_names, events.before.q, ""), (v_names, events.before.v, " before"), (v_names, events.after.v, " after"))
    for labels, values, side in sides:  # the place is the same on both sides
        must_differ([*columns, *(label + side for label in labels)], "Columns of a table of events", "`coordinates`")
        columns |= {label + side: np.asarray(values[:n, i]) for i, label in enumerate(labels)}
    columns["order matters"] = np.asarray(events.order_matters[:n])
    return pandas.DataFrame(columns, pandas.RangeIndex(n, name="event"))
