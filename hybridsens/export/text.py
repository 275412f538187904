"""Results as text: modules with their numbers, tables that fit a terminal of 80 columns, what a notebook shows."""

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from html import escape
from typing import Any

import equinox as eqx
import jax
import jax.core
import numpy as np

TERMINAL = 80
"""Columns."""


def name_and_numbers(name: str, numbers: str, width: int, remark: str = "") -> str:
    """A row: a name and its numbers beside each other, or below each other where both are too long for a line. Where
    `width`, that of all names, is too much, numbers end at the right edge."""
    if width + len(numbers) <= TERMINAL:
        row = f"{name:{width}}{numbers}"
        fits = not remark or len(row) + 2 + len(remark) <= TERMINAL
        return f"{row}  {remark}".rstrip() if fits else f"{row}\n    {remark}"
    if numbers and len(name) + 2 + len(numbers.strip()) <= TERMINAL:
        row = f"{name}{numbers.strip():>{TERMINAL - len(name)}}"
        return f"{row}\n    {remark}" if remark else row
    return f"{name}  {remark}".rstrip() + (f"\n{numbers:>{TERMINAL}}" if numbers else "")


MOST_ROWS = 20
"""How many rows of a long table are shown."""


def rows_shown(count: int, row: Callable[[int], str]) -> Iterator[str]:
    """The rows of a table that are shown: all, or the first and the last with "... (n more)" between them."""
    hidden = range(MOST_ROWS // 2, count - MOST_ROWS // 2 + 1) if count > MOST_ROWS else range(0)
    for j in range(count):
        if j not in hidden:
            yield row(j)
        elif j == hidden.start:
            yield f"{'...':>5} ({len(hidden)} more)"


def wrapped(text: str, indent: int) -> str:
    """A sentence over as many lines as it takes, all but the first indented."""
    return textwrap.fill(text, TERMINAL, subsequent_indent=" " * indent, break_on_hyphens=False)


_CELL = "text-align:right;padding:2px 8px"


def preformatted(result: Any) -> str:
    """The text of a result, in letters of one width."""
    return f"<pre style='line-height:1.25'>{escape(str(result))}</pre>"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of texts."""
    line = lambda cells, tag: "".join(f"<{tag} style='{_CELL}'>{escape(cell)}</{tag}>" for cell in cells)
    body = "".join(f"<tr>{line(row, 'td')}</tr>" for row in rows)
    return f"<table><thead><tr>{line(header, 'th')}</tr></thead><tbody>{body}</tbody></table>"


def paragraph(text: str) -> str:
    """A line of text above a table."""
    return f"<div>{escape(text)}</div>"


SMALL = 12
"""Arrays of up to so many numbers are printed in full; larger ones as their type and shape."""


class Numbers:
    """What stands for an array while a tree is printed."""

    def __init__(self, text: str):
        self.text = text

    def __repr__(self) -> str:
        return self.text


def printed(module: eqx.Module) -> str:
    """A module with its fields, `Ball(weight=9.81, e=0.8)`: a gradient is one too, and its numbers are what matters."""
    return eqx.tree_pformat(jax.tree.map(_with_numbers, module), width=80)


def _with_numbers(leaf: Any) -> Any:
    if isinstance(leaf, jax.core.Tracer) or not isinstance(leaf, jax.Array | np.ndarray) or leaf.size > SMALL:
        return leaf
    text = array_text(leaf, separator=", ", max_line_width=1000)
    return Numbers(" ".join(text.split()))


def array_text(array: Any, **options: Any) -> str:
    """An array with six decimals, each number written by itself: one that is tiny would put all into powers of ten."""
    return np.array2string(np.asarray(array), formatter={"float_kind": _number}, **options)


_NOTHING = 1e-100
"""What is smaller, such as the 2e-229 that a decay leaves, is 0 to all who read."""
_PLAIN = 1e-3, 1e8
"""Numbers between these are written without a power of ten."""


def _number(x: np.floating) -> str:
    if abs(x) < _NOTHING:
        return "0."
    if not np.isfinite(x):
        return str(x)
    if _PLAIN[0] <= abs(x) < _PLAIN[1]:
        return np.format_float_positional(x, precision=6, trim=".")
    return np.format_float_scientific(x, precision=6, trim=".")
