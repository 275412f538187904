"""Measurements from what people keep them in: CSV files, pandas and xarray tables, dictionaries, tuples of arrays."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..export.names import split_unit
from ..validation.spelling import did_you_mean
from .columns import IN_BRACKETS, SEVERAL, TIMES, as_numbers, check_unit_of_times, time_column, without_unit
from .csv_file import check_different, read_csv
from .data import Measurements, check_values, measurements

_SIGMA = "sigma_"


def read_measurements(
    data: Any,
    *,
    time: str | None = None,
    columns: Sequence[str] | Mapping[str, str] | str | None = None,
    sigma: Any = None,
    missing: str = "raise",
    **events: Any,
) -> Measurements:
    """Measurements from a table.

    Arguments:

    - `data`: the path of a CSV file (UTF-8, a header, columns parted by commas, semicolons or tabs), a pandas
      DataFrame, an xarray Dataset or DataArray along one dimension, a mapping of names to columns, a pair (times,
      values), or Measurements, returned as they are: other arguments are refused with them.
    - `time`: name of the time column, or of the index of a DataFrame; default "t", "time", "t [s]" or "time [s]".
      One that names another unit is refused.
    - `columns`: which columns are observed; default all but the time and those named `sigma_...`. A unit behind a name
      may be left off. Columns with names of their own are mapped: `{"q0": "Weg [mm]"}`.
    - `sigma`: standard deviations; default the columns `sigma_<name>`, where a unit may be left off, if there is one
      for each observed column.
    - `missing`: "raise" on a NaN (an empty cell), or "skip" those entries.
    - `events`: `event_times`, `event_sigma`, `event_contacts` as in `measurements`.

    Raises: ValueError for a file that is no CSV file in UTF-8 with commas, two columns of one name or a column of none,
    unknown columns, sigmas of a column that is not there, cells that are no numbers, and everything that `measurements`
    refuses.
    """
    if isinstance(data, Measurements):
        _must_be_as_they_are(dict(time=time, columns=columns, sigma=sigma, **events))
        return data
    columns = [columns] if isinstance(columns, str) else columns
    called = list(columns) if isinstance(columns, Mapping) else None
    columns = list(columns.values()) if isinstance(columns, Mapping) else columns
    if isinstance(data, tuple) and len(data) == 2 and not hasattr(data[0], "columns"):
        return measurements(*data, sigma=sigma, names=called or columns, missing=missing, **events)
    table = _as_mapping(data, time)
    time = _with_unit(time, table) if time else time_column(table, _index_without_name(data))
    if unit := IN_BRACKETS.search(time):
        check_unit_of_times(time, unit[1])
    names = _observed_columns(table, time, columns and [_with_unit(name, table) for name in columns])
    if not names:
        raise ValueError(f"The table must have at least one observed column beside the time, but has {list(table)}.")
    if sigma is None:
        sigma = _sigma_columns(table, names)
    values = np.stack([_numbers(table, name) for name in names], axis=1)
    check_values(values, names, missing)  # which columns have names of their own from here on
    names = [_in_unit_of(column, name) for column, name in zip(names, called or names, strict=True)]
    return measurements(table[time], values, sigma=sigma, names=names, missing=missing, **events)


def _must_be_as_they_are(arguments: Mapping[str, Any]) -> None:
    """Raises: TypeError for what Measurements, which are made already, have no use for."""
    given = [f"{name}=" for name, value in arguments.items() if value is not None]
    if given:
        raise TypeError(
            f"Measurements must be read without other arguments, but {', '.join(given)} came with them. Say it where "
            "they are made: `measurements(times, values, sigma=...)`, `read_measurements(table, sigma=...)`; of data = "
            "Measurements, others are `measurements(data.times, data.values, names=data.names, sigma=...)`."
        )


def _in_unit_of(column: str, name: str) -> str:
    """The name of what a column is mapped to, with the unit that the column names: a fit looks for degrees there."""
    unit = IN_BRACKETS.search(str(column))
    return f"{name} {unit[0]}" if unit and not IN_BRACKETS.search(name) else name


def _with_unit(name: str, table: Mapping[str, Any]) -> str:
    """The column of this name, whose unit may be left off; the name itself where not one alone is meant."""
    meant = [column for column in table if str(column) == name] or [
        column for column in table if without_unit(column) == name
    ]
    return meant[0] if len(meant) == 1 else name


def _index_without_name(data: Any) -> bool:
    """Whether a DataFrame has an index that may be the times, but no name says so; the rows' numbers are none."""
    index: Any = getattr(data, "index", None)
    return getattr(index, "name", "") is None and type(index).__name__ != "RangeIndex"


def _observed_columns(table: Mapping[str, Any], time: str, columns: Sequence[str] | None) -> list[str]:
    """Names of the observed columns of a table: those asked for, or all but the time and the `sigma_...` columns.

    Raises: ValueError for a column that is not in the table, but is asked for or has a sigma.
    """
    unknown = [name for name in (time, *(columns or ())) if name not in table]
    if unknown:
        raise ValueError(
            f"The table must have the columns {unknown}, but has {list(table)}."
            f"{did_you_mean(unknown, [*table, *map(without_unit, table)])}"
        )
    if columns:
        return list(columns)
    owned = {_sigma_of(name, table) for name in table}
    alone = [name for name in table if name.startswith(_SIGMA) and name not in owned]
    if alone:
        raise ValueError(
            f"The table must have a column <name> for each sigma_<name>, but has none for {alone}: rename or remove "
            "them, or choose with `columns`."
        )
    return [name for name in table if name != time and not name.startswith(_SIGMA)]


def _sigma_of(name: str, table: Mapping[str, Any]) -> str | None:
    """The column with the sigmas of another one, whose unit may be left off; None if there is none."""
    return next((sigma for sigma in (_SIGMA + name, _SIGMA + split_unit(name)[0]) if sigma in table), None)


def _sigma_columns(table: Mapping[str, Any], names: Sequence[str]) -> np.ndarray | None:
    sigmas = {name: sigma for name in names if (sigma := _sigma_of(name, table)) is not None}
    if not sigmas:
        return None
    if len(sigmas) != len(names):
        raise ValueError(
            f"Sigmas must be given for all observed columns {list(names)} or for none, but only for {list(sigmas)}."
        )
    return np.stack([_numbers(table, sigmas[name]) for name in names], axis=1)


def _numbers(table: Mapping[str, Any], name: str) -> np.ndarray:
    """A column. Raises: ValueError with its name for text, and for the NA of pandas among objects."""
    try:
        return as_numbers(table[name])
    except (TypeError, ValueError) as error:
        told = str(error).removesuffix(".")
        raise ValueError(
            f"Column {name!r} must hold numbers, and NaN where one is missing, but does not: {told}. Convert it by "
            '`pandas.to_numeric(column, errors="coerce")`, or leave it out: `read_measurements(data, columns=[...])`, '
            "in a terminal --columns."
        ) from error


def _as_mapping(data: Any, time: str | None) -> Mapping[str, Any]:
    if isinstance(data, str | Path):
        return read_csv(Path(data))
    if hasattr(data, "data_vars") or hasattr(data, "coords"):
        return _from_xarray(data)
    if isinstance(data, Mapping):
        return data
    if hasattr(data, "columns"):
        return _from_pandas(data, time)
    several = f" Several runs are fitted as one system, a column for each: see {SEVERAL}."
    raise TypeError(
        "`data` must be the path of a CSV file, a pandas or xarray table, a mapping of columns, a pair (times, values) "
        f"or Measurements, but is {type(data).__name__}.{several if isinstance(data, list | tuple) else ''}"
    )


def _from_pandas(data: Any, time: str | None) -> dict[str, np.ndarray]:
    """Columns of a DataFrame; first its index, where that is or may be the time and no column is."""
    check_different(map(str, data.columns), "The table")
    columns = {str(name): data[name].to_numpy() for name in data.columns}
    index: Any = getattr(data, "index", None)  # tables of other libraries have none
    name = getattr(index, "name", None)
    wanted = time in (name, without_unit(name)) if time else not any(known in columns for known in TIMES)
    if name is None or not wanted or index.to_numpy().dtype.kind not in "iufmM":
        return columns
    return {str(name): index.to_numpy(), **columns}


def _from_xarray(data: Any) -> dict[str, np.ndarray]:
    """Columns of a Dataset or DataArray; a second dimension becomes columns <name>0, <name>1, ..."""
    dataset = data if hasattr(data, "data_vars") else data.to_dataset(name=data.name or "q")
    along = next(iter(dataset.data_vars.values())).dims[0]
    check_unit_of_times(along, dataset[along].attrs.get("units"))
    columns = [(str(along), dataset[along].to_numpy())]
    for name, variable in dataset.data_vars.items():
        if variable.dims[:1] != (along,) or variable.ndim > 2:
            raise ValueError(
                f"Variable {name!r} must have one or two dimensions, of which the first is the time {along!r}, but has "
                f"{variable.dims}."
            )
        if variable.ndim == 1:
            columns.append((str(name), variable.to_numpy()))
        else:
            columns += [(f"{name}{i}", column) for i, column in enumerate(variable.to_numpy().T)]
    check_different((name for name, _ in columns), "The Dataset")
    return dict(columns)
