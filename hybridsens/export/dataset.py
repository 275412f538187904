"""A motion as an xarray Dataset that holds all of it, without padding."""

import json
from typing import Any

import jax
import jax.core
import numpy as np

from .libraries import optional
from .names import contact_names, coordinate_names
from .trees import named_leaves, structure

KINDS = "impact capture release switch"
"""Meanings of 0, 1, 2, 3 in `event_kind`."""


def motion_dataset(motion: Any, scene: Any):
    """Samples over `time`, events over `event` (as many rows as there were), the final state, the cost.

    Raises: ImportError without xarray; ValueError for a batch or inside of a JAX transformation."""
    must_be_one(motion.events.count, "to_xarray()")
    xarray = optional("xarray", "to_xarray()")
    q_names, v_names = coordinate_names(scene, motion.final.q.shape[0])
    contacts = contact_names(scene, motion.closed.shape[0])
    coords = {"coordinate": ("coordinate", q_names), "velocity": ("velocity", v_names), "contact": contacts}
    variables = {
        "final_q": ("coordinate", motion.final.q, {"long_name": "configuration at the end"}),
        "final_v": ("velocity", motion.final.v, {"long_name": "velocity at the end"}),
        "closed": ("contact", motion.closed, {"long_name": "contacts held closed at the end"}),
        **_events(motion.events),
    }
    if motion.ts is not None:
        coords["time"] = ("time", np.asarray(motion.ts), {"units": "s"})
        variables["q"] = (("time", "coordinate"), motion.q)
        variables["v"] = (("time", "velocity"), motion.v)
    for name, value in (named_leaves("cost", motion.cost) | named_leaves("mode", motion.mode)).items():
        variables[name] = ([f"{name}_{axis}" for axis in range(value.ndim)], value)
    n = int(motion.events.count)
    for name, value in named_leaves("event_mode", motion.events.mode).items():
        variables[name] = (["event", *(f"{name}_{axis}" for axis in range(value.ndim - 1))], value[:n])
    arrays = {name: (dims, np.asarray(value), *more) for name, (dims, value, *more) in variables.items()}
    return xarray.Dataset(arrays, coords, _attributes(motion))


def _events(events) -> dict[str, tuple]:
    """Rows of the events that there were."""
    n = int(events.count)
    kinds = {"flag_values": np.arange(4), "flag_meanings": KINDS}
    return {
        "event_time": ("event", events.time[:n], {"units": "s"}),
        "event_kind": ("event", events.kind[:n], kinds),
        "event_contact": ("event", events.contact[:n], {"long_name": "number of the gap, or of the switch"}),
        "event_q_before": (("event", "coordinate"), events.before.q[:n]),
        "event_v_before": (("event", "velocity"), events.before.v[:n]),
        "event_q_after": (("event", "coordinate"), events.after.q[:n]),
        "event_v_after": (("event", "velocity"), events.after.v[:n]),
        "impulse": (("event", "contact"), events.impulse[:n], {"units": "N s"}),
        "closing_speed": ("event", events.closing_speed[:n], {"units": "m/s"}),
        "order_matters": ("event", events.order_matters[:n]),
    }


def _attributes(motion) -> dict[str, Any]:
    return {
        "hybridsens": "trajectory",
        "status": motion.status.message or "successful",
        "status_code": status_code(motion.status),
        "steps_accepted": int(motion.steps.accepted),
        "steps_rejected": int(motion.steps.rejected),
        "max_events": motion.events.time.shape[0],
    }


def with_structures(dataset, motion):
    """The dataset with the outlines of the cost and of the modes, from which a file is read back."""
    trees = {"cost": motion.cost, "mode": motion.mode, "event_mode": motion.events.mode}
    return dataset.assign_attrs({f"{name}_structure": json.dumps(structure(name, t)) for name, t in trees.items()})


def status_code(status) -> int:
    """The number of a status."""
    (code,) = jax.tree.leaves(status)
    return int(code)


def must_be_one(count, wanted_by: str) -> None:
    """Raise ValueError for a batch of motions, or one whose numbers are not known yet."""
    if isinstance(count, jax.core.Tracer):
        raise ValueError(f"{wanted_by} must be called outside of jax.jit, jax.grad and jax.vmap, on what they return.")
    if np.ndim(count) > 0:
        raise ValueError(
            f"{wanted_by} must be called on one motion, but this is a batch of {np.shape(count)}: take one of it by "
            "jax.tree.map(lambda leaf: leaf[i], batch)."
        )
