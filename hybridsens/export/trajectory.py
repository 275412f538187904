"""Motions of a scene as an xarray Dataset that holds all of them, without padding, and as tables for pandas."""

from typing import Any

import numpy as np

from .batches import happened, leading, must_be_known, of_each_run
from .datasets import attributes, how_it_ended, must_have_samples, optional, sample_axes
from .names import contact_names, coordinate_names, must_differ, names_of_events, unit_of_contact
from .trees import variables

KINDS = "impact capture release switch"
"""Meanings of 0, 1, 2, 3 in `event_kind`."""


def motion_dataset(motion: Any, scene: Any):
    """As `Trajectory.to_xarray`: samples over `time`, events over `event`, the final state, the cost."""
    lead = leading(motion.events.count, "to_xarray()")
    xarray = optional("xarray", "to_xarray()")
    q_names, v_names = coordinate_names(scene, motion.final.q.shape[-1])
    contacts = contact_names(scene, motion.mode.shape[-1])
    coords: dict[str, Any] = {"coordinate": q_names, "velocity": v_names, "contact": contacts}
    columns = {
        "final_q": ((*lead, "coordinate"), motion.final.q, {"long_name": "configuration at the end"}),
        "final_v": ((*lead, "velocity"), motion.final.v, {"long_name": "velocity at the end"}),
        "closed": ((*lead, "contact"), motion.mode, {"long_name": "contacts held closed at the end"}),
        **how_it_ended(motion, lead),
        **_events(happened(motion.events), scene, lead),
        **variables("cost", motion.cost, *lead),
        **variables("scene_mode", motion.scene_mode, *lead),
    }
    if motion.ts is not None:
        axes, times = sample_axes(motion.ts, lead)
        coords |= {name: (*time, {"units": "s"}) for name, time in times.items()}
        columns |= {"q": ((*axes, "coordinate"), motion.q), "v": ((*axes, "velocity"), motion.v)}
    arrays = {name: (dims, np.asarray(value), *more) for name, (dims, value, *more) in columns.items()}
    return xarray.Dataset(arrays, coords, attributes("trajectory", motion))


def _events(events, scene, lead: tuple[str, ...]) -> dict[str, tuple]:
    """Rows of the events that there were."""
    row = (*lead, "event")
    in_unit = lambda unit: {"units": unit} if unit_of_contact(scene, unit) else {}
    kinds = {"flag_values": np.arange(4), "flag_meanings": KINDS}
    return {
        "event_time": (row, events.time, {"units": "s"}),
        "event_kind": (row, events.kind, kinds),
        "event_contact": (row, events.contact, {"long_name": "number of the gap, or of the switch"}),
        "event_q_before": ((*row, "coordinate"), events.before.q),
        "event_v_before": ((*row, "velocity"), events.before.v),
        "event_q_after": ((*row, "coordinate"), events.after.q),
        "event_v_after": ((*row, "velocity"), events.after.v),
        "impulse": ((*row, "contact"), events.impulse, in_unit("N s")),
        "closing_speed": (row, events.closing_speed, in_unit("m/s")),
        "order_matters": (row, events.order_matters),
        **variables("event_mode", events.mode, *row),
    }


def samples_frame(motion: Any, scene: Any):
    """As `Trajectory.to_pandas`: one row for each sample; columns are coordinates, then velocities."""
    must_have_samples(motion, "simulate")
    if np.ndim(motion.events.count) > 0:
        return of_each_run(motion, motion.events.count, lambda one: samples_frame(one, scene))
    must_be_known(motion.events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    q_names, v_names = coordinate_names(scene, motion.final.q.shape[0])
    index = pandas.Index(np.asarray(motion.ts), name="time [s]")
    return pandas.DataFrame(np.concatenate([motion.q, motion.v], axis=1), index, [*q_names, *v_names])


def events_frame(events: Any, scene: Any):
    """As `Events.to_pandas`: one row for each event that there was.

    Raises: ValueError for a coordinate with the name of a column, such as kind."""
    if np.ndim(events.count) > 0:
        return of_each_run(events, events.count, lambda one: events_frame(one, scene))
    must_be_known(events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    rows, n = happened(events), int(events.count)
    contacts = rows.impulse.shape[1]
    switched = rows.kind == KINDS.split().index("switch")
    impulse = rows.impulse[np.arange(n), np.where(switched, 0, rows.contact)] if contacts else 0.0
    columns: dict[str, Any] = {
        "time [s]": rows.time,
        "kind": np.array(KINDS.split())[rows.kind],
        "contact": np.array(names_of_events(scene, rows.contact, switched, contacts), str),
        "closing speed" + unit_of_contact(scene, "m/s"): rows.closing_speed,
        "impulse" + unit_of_contact(scene, "N s"): np.where(switched, 0.0, impulse),
    }
    q_names, v_names = coordinate_names(scene, rows.before.q.shape[1])
    sides = ((q_names, rows.before.q, ""), (v_names, rows.before.v, " before"), (v_names, rows.after.v, " after"))
    for labels, values, side in sides:  # the place is the same on both sides
        must_differ([*columns, *(label + side for label in labels)], "Columns of a table of events", "`coordinates`")
        columns |= {label + side: values[:, i] for i, label in enumerate(labels)}
    columns["order matters"] = rows.order_matters
    return pandas.DataFrame(columns, pandas.RangeIndex(n, name="event"))
