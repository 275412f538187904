"""A data set as a netCDF file."""

from pathlib import Path
from typing import Any


def write_netcdf(dataset: Any, path: str | Path) -> None:
    """Write the xarray Dataset. Raises: ValueError for a path with the ending of another kind of file."""
    if Path(path).suffix not in {".nc", ""}:
        raise ValueError(
            f"`path` must end in .nc, or have no ending, since `save` writes netCDF, but is {Path(path).name}: name it "
            "so. The tables of a motion are written by `motion.to_pandas().to_csv(path)` and "
            "`motion.events.to_pandas().to_csv(path)`."
        )
    dataset.to_netcdf(path, engine="netcdf4")
