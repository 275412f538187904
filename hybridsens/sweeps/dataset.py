"""A sweep as an xarray Dataset: its variables, whose dimensions, shape, type and attributes are known before the first
point is run, and what is made of them when all are."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from ..export.datasets import optional
from ..export.names import coordinate_names
from ..mechanics.mode import EventKind
from ..parameters import parameters
from ..status import Status
from .designs import Design
from .point import NOT_COMPUTED

if TYPE_CHECKING:
    import xarray as xr

_MEANING = {
    "J": "cost",
    "status": "outcome of the motion",
    "event_count": "number of events",
    "event_sequence": "number shared by motions that have the same events in the same order",
    "grazing_margin": "smallest closing speed of impacts, but for ends of cascades: 0 is a border of event sequences",
    "steps": "steps tried",
    "event_time": "times of the first events",
    "event_kind": "kinds of the first events",
    "event_contact": "contacts of the first events",
    "event_guard": "guards of the first events",
    "sample_time": "times asked for",
    "q": "configurations at the times asked for",
    "v": "velocities at the times asked for",
}
_INNER = {
    "event_time": ("event",),
    "event_kind": ("event",),
    "event_contact": ("event",),
    "event_guard": ("event",),
    "sample_time": ("sample",),
    "q": ("sample", "dof"),
    "v": ("sample", "dof"),
}


class Variable(NamedTuple):
    """One array of the Dataset."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype
    attributes: dict[str, Any]

    @property
    def fill(self):
        """Value of a point that was not reached."""
        return np.nan if self.dtype.kind == "f" else self.dtype.type(NOT_COMPUTED)


def variables(design: Design, point: dict[str, jax.ShapeDtypeStruct], units: Mapping[str, str]) -> dict[str, Variable]:
    """The results, in the order in which a reader wants to see them.

    Raises ValueError for units of what is not there, and for a parameter that has the name of a result.
    """
    derivatives = [f"dJ_d{name}" for name in parameters(design.scene)]
    states = sorted(name for name in point if _is_state(name))
    names = [name for name in dict.fromkeys(("J", *derivatives, *_MEANING, *states)) if name in point]
    clash = set(design.columns) & {*names, *(dim for name in names for dim in _INNER.get(name, ()))}
    if clash:
        raise ValueError(f"The parameters must not have the names of results, but {', '.join(sorted(clash))} has.")
    unknown = set(units) - set(names) - set(design.columns) - set(parameters(design.scene))
    if unknown:
        raise ValueError(f"`units` must be of parameters or results, but has {', '.join(sorted(unknown))}.")
    return {name: _variable(name, point[name], design, units) for name in names}


def coordinates(
    design: Design, units: Mapping[str, str]
) -> dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, Any]]]:
    """The varied parameters: dimensions, values and attributes (units, and the box they were drawn from)."""
    found = {}
    for name, column in design.columns.items():
        inner = _inner_dims(name, column.shape[len(design.dims[name]) :])
        attributes = _units(name, units)
        if name in design.bounds:
            # Two numbers, and not `bounds`: by that name the CF conventions mean a variable of the file.
            attributes["lowest"], attributes["highest"] = design.bounds[name]
        found[name] = ((*design.dims[name], *inner), column, attributes)
    return found


def _variable(name, struct, design: Design, units) -> Variable:
    inner = _INNER.get(name) or _inner_dims(name.removeprefix("dJ_d"), struct.shape)
    meaning = _MEANING.get(name, f"derivative of J by {name.removeprefix('dJ_d')}")
    if _is_state(name):
        inner = ("sample", *_inner_dims(name, struct.shape[1:]))
        meaning = "states at the times asked for"
    dims = (*design.shape, *inner)
    attributes = {"long_name": meaning} | _units(name, units)
    if name in ("q", "v"):
        attributes["columns"] = coordinate_names(design.scene, struct.shape[-1])[name == "v"]
    if name == "status":
        attributes |= _flags(Status.names())
    if name == "event_kind":
        attributes |= _flags([kind.name.lower() for kind in EventKind])
    return Variable(dims, (*design.shape.values(), *struct.shape), np.dtype(struct.dtype), attributes)


def _is_state(name: str) -> bool:
    """Whether a result is a leaf of a hybrid system's x: `x`, `x.v`."""
    return name == "x" or name.startswith("x.")


def _units(name, units: Mapping[str, str]) -> dict[str, Any]:
    """Units as given; those of a derivative follow from J's and the parameter's."""
    parameter = name.removeprefix("dJ_d")
    if name in units:
        return {"units": units[name]}
    if name != parameter and "J" in units and parameter in units:
        return {"units": _quotient(units["J"], units[parameter])}
    return {}


def _quotient(of: str, by: str) -> str:
    """m/(N/m) for "m" by "N/m"; a number has the unit ""."""
    of, by = (unit if re.fullmatch(r"\w*", unit) else f"({unit})" for unit in (of, by))
    return f"{of or 1}/{by}" if by else of


def _flags(meanings) -> dict[str, Any]:
    """The CF conventions' way to name the values of an integer variable."""
    return {"flag_values": [NOT_COMPUTED, *range(len(meanings))], "flag_meanings": " ".join(["none", *meanings])}


def _inner_dims(name, shape) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}" for axis in range(len(shape)))


def from_memory(
    arrays: Mapping[str, np.ndarray], layout: Mapping[str, Variable], coordinates, attributes
) -> "xr.Dataset":
    """A Dataset of arrays in memory."""
    data = {name: (v.dims, arrays[name], v.attributes) for name, v in layout.items()}
    return xarray().Dataset(data, coordinates, attributes)


def from_store(location: Any, layout: Mapping[str, Variable], coordinates, attributes) -> "xr.Dataset":
    """A Dataset that reads a store when its values are asked for."""
    stored = xarray().open_zarr(location, chunks=None)
    # The points are known, whatever has become of them on disk; and xarray reads one named `mass[0, 1]` as a result.
    found = stored[list(layout)].assign_coords(coordinates)
    for name, variable in layout.items():  # units may be given to a store that was made without
        found[name].attrs.update(variable.attributes)
    return found.drop_attrs(deep=False).assign_attrs(attributes)


def status_counts(dataset: "xr.Dataset") -> dict[str, int]:
    """How many points ended with each status: `{"successful": 9998, "max_events_reached": 2}`."""
    about = dataset.status.attrs
    names = dict(zip(np.asarray(about["flag_values"]).tolist(), about["flag_meanings"].split(), strict=True))
    codes, counts = np.unique(dataset.status.values, return_counts=True)
    return {names[int(code)]: int(count) for code, count in zip(codes, counts, strict=True)}


def gradients(dataset: "xr.Dataset") -> dict[str, "xr.DataArray"]:
    """The derivatives of J by the name of the parameter."""
    return {str(name).removeprefix("dJ_d"): dataset[name] for name in dataset.data_vars if str(name).startswith("dJ_d")}


def xarray() -> Any:
    """The package, or a word about how to get it."""
    return optional("xarray", "A sweep", "sweep")
