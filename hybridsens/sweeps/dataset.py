"""The result of a sweep as an xarray Dataset."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .layout import Variable, remedy

if TYPE_CHECKING:
    import xarray as xr


def from_memory(
    arrays: Mapping[str, np.ndarray], layout: Mapping[str, Variable], coordinates, attributes
) -> "xr.Dataset":
    """A Dataset of arrays in memory."""
    data = {name: (v.dims, arrays[name], v.attributes) for name, v in layout.items()}
    coords = {name: (dims, values, about) for name, (dims, values, about) in coordinates.items()}
    return xarray().Dataset(data, coords, attributes)


def from_store(location: Any, layout: Mapping[str, Variable], coordinates, attributes) -> "xr.Dataset":
    """A Dataset that reads a store when its values are asked for."""
    stored = xarray().open_zarr(location, chunks=None)
    # By name: `mass[0, 1]` has a space, and xarray reads such a coordinate as a result.
    found = stored[[*layout, *coordinates]].set_coords(list(coordinates))
    told = {name: v.attributes for name, v in layout.items()}
    told |= {name: about for name, (_, _, about) in coordinates.items()}
    for name, about in told.items():  # units may be given to a store that was made without
        found[name].attrs.update(about)
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


def remedies(dataset: "xr.Dataset") -> dict[str, str]:
    """What each status of the Dataset means."""
    names = dataset.status.attrs["flag_meanings"].split()[1:]
    return {name: remedy(code) for code, name in enumerate(names)}


def xarray():
    """The package, or a word about how to get it."""
    try:  # an optional extra
        import xarray
    except ImportError as error:
        raise ImportError("A sweep needs xarray: pip install 'hybridsens[sweep]'.") from error
    return xarray
