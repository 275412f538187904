"""What a notebook shows of a result: the text that `print` gives, or tables."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

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
