"""A data set as a netCDF file."""

import os
from pathlib import Path
from typing import Any


def write_netcdf(dataset: Any, path: str | Path) -> None:
    """Write the xarray Dataset in one move, so that a file which was there stays whole until the new one is.

    Raises: ValueError for a path with the ending of another kind of file, for a folder, or in no folder."""
    path = Path(path)
    if path.suffix not in {".nc", ""}:
        raise ValueError(
            f"`path` must end in .nc, or have no ending, since `save` writes netCDF, but is {path.name}: name it "
            "so. The tables of a motion are written by `motion.to_pandas().to_csv(path)` and "
            "`motion.events.to_pandas().to_csv(path)`."
        )
    if path.is_dir() or not path.parent.is_dir():  # netCDF4 speaks of permissions
        what = "is a folder" if path.is_dir() else "is in a folder that does not exist"
        raise ValueError(f"`path` must be that of a file in a folder that exists, but {path} {what}.")
    beside = path.with_name(path.name + ".part")
    try:
        dataset.to_netcdf(beside, engine="netcdf4")
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
