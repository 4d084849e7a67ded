"""Tables of strings as aligned text and as HTML; the last column holds text, the other columns hold numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

Row = Sequence[str]
"""Cells of a row, one for each column."""


def text_table(columns: Row, rows: Sequence[Row]) -> Iterator[str]:
    """Yield the heading and each row as a line of text; numbers are aligned to the right."""
    widths = [max(map(len, cells)) for cells in zip(columns, *rows, strict=True)]
    for row in (columns, *rows):
        numbers = (cell.rjust(width) for cell, width in zip(row[:-1], widths[:-1], strict=True))
        yield "  ".join([*numbers, row[-1]])


def html_table(columns: Row, rows: Sequence[Row]) -> str:
    """Return the heading and the rows as an HTML <table>."""
    lines = [(columns, "th"), *((row, "td") for row in rows)]
    cells = ("".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) for row, tag in lines)
    return "<table>" + "".join(f"<tr>{line}</tr>" for line in cells) + "</table>"
