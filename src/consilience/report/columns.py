"""Text and tables for a terminal of some width: lines break at blanks, and no word is broken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby, zip_longest
from textwrap import wrap

GAP = "  "
"""Blanks between two columns."""


def wrapped(text: str, width: int) -> str:
    """Wrap each line at blanks; further lines are indented by two more, and a word wider than the width stays whole."""
    return "\n".join("\n".join(_lines(line, width)) for line in text.split("\n"))


def _lines(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    indent = line[: len(line) - len(line.lstrip())] + GAP
    return wrap(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def cut(text: str, width: int) -> str:
    """Cut a text at its last blank within a width, with an ellipsis in place of the rest."""
    if len(text) <= width:
        return text
    return text[: width - 1].rpartition(" ")[0].rstrip(" ,;:") + "\N{HORIZONTAL ELLIPSIS}"


def tables_as_columns(markdown: str, width: int) -> str:
    """Write the tables of a Markdown text for a terminal, and leave its other lines."""
    parts = []
    for is_table, lines in groupby(markdown.splitlines(), key=lambda line: line.startswith("|")):
        if is_table:
            heads, _, *rows = ([cell.strip() for cell in line.strip("| ").split("|")] for line in lines)
            parts.append(columns(heads, rows, width) if rows else "")
        else:
            parts += lines
    return "\n".join(parts)


def columns(heads: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> str:
    """Write a table no wider than the width; cells wrap at blanks.

    Where not even the longest words fit beside one another, each row becomes a list of its cells under the first.
    """
    columns_ = [[" ".join(cell.split()) for cell in column] for column in zip(heads, *rows, strict=True)]
    least = [max(len(word) for cell in column for word in cell.split(" ")) for column in columns_]
    left = width - len(GAP) * (len(heads) - 1) - sum(least)
    if left < 0:
        return "\n".join(_listed(heads, row, width) for row in rows)
    widths = _shared(least, [max(map(len, column)) for column in columns_], left)
    head, *body = ("\n".join(_row(cells, widths)) for cells in zip(*columns_, strict=True))
    return "\n".join([head, GAP.join("\N{BOX DRAWINGS LIGHT HORIZONTAL}" * n for n in widths), *body])


def _shared(least: Sequence[int], most: Sequence[int], left: int) -> list[int]:
    """Share the width that is left among columns, those that need least of it first."""
    widths = list(least)
    order = sorted(range(len(least)), key=lambda n: most[n] - least[n])
    for place, n in enumerate(order):
        more = min(most[n] - least[n], left // (len(order) - place))
        widths[n], left = least[n] + more, left - more
    return widths


def _row(cells: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    parts = [
        wrap(cell, n, break_long_words=False, break_on_hyphens=False) for cell, n in zip(cells, widths, strict=True)
    ]
    for line in zip_longest(*parts, fillvalue=""):
        yield GAP.join(part.ljust(n) for part, n in zip(line, widths, strict=True)).rstrip()


def _listed(heads: Sequence[str], row: Sequence[str], width: int) -> str:
    first, *others = (f"{head}: {cell}" if head else cell for head, cell in zip(heads, row, strict=True) if cell)
    return wrapped("\n".join([first, *(GAP + line for line in others)]), width)
