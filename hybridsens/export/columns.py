"""Tables of plain text that fit a terminal of 80 columns."""

import textwrap

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


def wrapped(text: str, indent: int) -> str:
    """A sentence over as many lines as it takes, all but the first indented."""
    return textwrap.fill(text, TERMINAL, subsequent_indent=" " * indent, break_on_hyphens=False)
