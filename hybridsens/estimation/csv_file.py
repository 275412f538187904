"""Columns of numbers from a CSV file, or a word on what is wrong with it."""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

_EMPTY = {"", "na", "n/a", "null"}
"""What programs write where a number is missing."""
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number that may be a thousand times another."""
_NUMBER = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)?")
"""What may be a number; with two points it is a date."""
_SEPARATORS = ";\t|"
"""What may stand in the place of commas between columns; these may then be those of decimal numbers."""


class CsvColumns(Mapping[str, np.ndarray]):
    """The columns of a CSV file. One becomes numbers when it is asked for: others may hold remarks.

    Asking raises ValueError, naming the file, for a cell that is no number; those that are empty, or NA or null, are
    NaN.
    """

    def __init__(self, path: Path, cells: dict[str, list[str]]):
        self._path, self._cells = path, cells

    def __getitem__(self, name: str) -> np.ndarray:
        return np.array([_number(self._path, n, name, cell) for n, cell in enumerate(self._cells[name])])

    def __contains__(self, name: object) -> bool:
        return name in self._cells  # without a look at the numbers

    def __iter__(self) -> Iterator[str]:
        return iter(self._cells)

    def __len__(self) -> int:
        return len(self._cells)


def read_csv(path: Path) -> CsvColumns:
    """Columns of a CSV file with a header; lines that start with # are comments. Columns are parted by commas,
    semicolons, tabs or bars; where not by commas, numbers may be 1,5 for 1.5.

    Raises: FileNotFoundError if there is none; ValueError, naming the file, if it is a folder, is not UTF-8, has other
    separators, two columns of one name or a column of none, or rows of other lengths.
    """
    lines = [line for line in _text(path).splitlines() if line.strip() and line[0] != "#"]
    if lines and lines[0].startswith("sep="):  # a line for Excel alone
        lines = lines[1:]
    if len(lines) < 2:
        has = f"{len(lines)} line{'' if len(lines) == 1 else 's'}"
        raise ValueError(f"{path} must have a header and at least one row, but has {has}.")
    separator = _separator(path, lines[0])
    header, *rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    header = [name.strip() for name in header]
    _check_named(path, header)
    check_different(header, str(path))
    rows = _full(path, header, rows)
    rows = rows if separator == "," else _with_points(path, rows)
    return CsvColumns(path, {name: list(cells) for name, cells in zip(header, zip(*rows, strict=True), strict=True)})


def check_different(names: Iterable[str], where: str) -> None:
    """Raises ValueError if two columns have one name: a table could keep one of them only."""
    names = list(names)
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"{where} must have columns of different names, but has {names.count(name)} columns {name!r}. Rename "
                "or remove all but one of them."
            )


def _text(path: Path) -> str:
    if path.is_dir():
        raise ValueError(f"`data` must be the path of a CSV file, but {path} is a folder. Name a file in it.")
    if not path.exists():
        raise FileNotFoundError(
            f"`data` must be the path of a CSV file, but there is no file {path}. Give the path of one that is there."
        )
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(_not_utf8(path, raw)) from error
    if "\0" in text:
        raise ValueError(_not_utf8(path, raw))
    return text


def _not_utf8(path: Path, raw: bytes) -> str:
    """What to say of bytes that are not UTF-8, with a guess at what they are."""
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    if b"\0" in raw and not wide:
        return f"{path} must be a text file in UTF-8, but has zero bytes. Save a workbook as CSV first."
    guess = "UTF-16" if wide else "LATIN1"
    return (
        f"{path} must be a text file in UTF-8, but is not; it may be {guess}. Save it anew as UTF-8, or convert it: "
        f"iconv -f {guess} -t UTF-8 {path.name} > utf8.csv"
    )


def _separator(path: Path, header: str) -> str:
    """The comma; where the header has none, what it has instead. Raises: ValueError for spaces."""
    found = next((mark for mark in _SEPARATORS if mark in header), ",")
    if "," not in header and found == "," and " " in header.strip():
        raise ValueError(
            f"{path} must have commas, semicolons or tabs between its columns, but has spaces: {header!r}. Replace "
            f'them, or give the table that pandas.read_csv(path, sep=r"\\s+") reads.'
        )
    return "," if "," in header else found


def _with_points(path: Path, rows: list[list[str]]) -> list[list[str]]:
    """Decimal commas as points. Raises: ValueError where commas may part thousands: there are points too, or three
    digits behind each comma and no 0 before one."""
    numbers = [cell.strip() for row in rows for cell in row if _may_be_number(cell.strip())]
    with_comma, with_point = ([number for number in numbers if mark in number] for mark in ",.")
    if with_comma and with_point:
        raise ValueError(
            f"{path} must have numbers with points or numbers with commas, but has {with_point[0]!r} and "
            f"{with_comma[0]!r}: write all of them with points, and no mark between thousands."
        )
    if with_comma and all(map(_THOUSANDS.fullmatch, with_comma)):
        raise ValueError(
            f"{path} must have numbers of one meaning, but all its commas may be decimal ones or part thousands, as in "
            f"{with_comma[0]!r}: write points for decimal commas, and no mark between thousands."
        )
    return [[cell.replace(",", ".") for cell in row] for row in rows]


def _may_be_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None and cell.count(".") < 2


def _check_named(path: Path, header: list[str]) -> None:
    if "" in header:
        raise ValueError(
            f"{path} must have a name for each column, but has an unnamed column in {','.join(header)!r}: name it, or "
            "remove the separator that is too many, in the rows too."
        )


def _full(path: Path, header: list[str], rows: list[list[str]]) -> list[list[str]]:
    for n, row in enumerate(rows):
        if len(row) != len(header):
            too_many = len(row) > len(header) and not row[-1].strip()
            empty = ", the last one empty: remove the separator at its end" if too_many else ""
            raise ValueError(
                f"{path}: row {n} (counted from 0) must have {len(header)} cells, but has {len(row)}{empty}."
            )
    return rows


def _number(path: Path, row: int, column: str, cell: str) -> float:
    if cell.strip().lower() in _EMPTY:
        return float("nan")
    try:
        if "_" in cell:  # Python reads 1_000 as a number
            raise ValueError("a number has no underscore")
        return float(cell)
    except ValueError as error:
        raise ValueError(
            f"{path}: row {row} (counted from 0), column {column!r} must be a number, but is {cell!r}."
        ) from error
