"""Tables of a motion for pandas."""

from typing import Any

import numpy as np

from .attributes import must_be_one
from .dataset import KINDS
from .libraries import optional
from .names import contact_names, coordinate_names, unit_of_contact


def samples_frame(motion: Any, scene: Any):
    """One row for each sample, indexed by time [s]; columns are coordinates, then velocities.

    Raises: ImportError without pandas; ValueError for a batch, or a motion without samples."""
    must_be_one(motion.events.count, "to_pandas()")
    if motion.ts is None:
        raise ValueError(
            "to_pandas() must have samples to tabulate, but this motion has none: pass `ts=` to `simulate`. Its events "
            "are a table by `.events.to_pandas()`."
        )
    pandas = optional("pandas", "to_pandas()")
    q_names, v_names = coordinate_names(scene, motion.final.q.shape[0])
    index = pandas.Index(np.asarray(motion.ts), name="time [s]")
    return pandas.DataFrame(np.concatenate([motion.q, motion.v], axis=1), index, [*q_names, *v_names])


def events_frame(events: Any, scene: Any):
    """One row for each event that there was, in the order of time.

    Raises: ImportError without pandas; ValueError for a batch."""
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
        columns |= {label + side: np.asarray(values[:n, i]) for i, label in enumerate(labels)}
    columns["order matters"] = np.asarray(events.order_matters[:n])
    return pandas.DataFrame(columns, pandas.RangeIndex(n, name="event"))
