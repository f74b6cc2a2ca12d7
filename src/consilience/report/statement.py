"""The statement of a command: sentences, tables and data, written as text, Markdown or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from consilience.compare import markdown_table
from consilience.errors import visible
from consilience.report.markdown import escaped

LEAST_WIDTH = 8
"""Least width of a column in a terminal, in characters, with its line and its blanks."""


@dataclass(frozen=True)
class Statement:
    """Output of a command.

    Attributes
    ----------
    sentences : sequence of str
    tables : sequence of (title, heads, rows)
        Tables without rows are left out.
    data : dict
        The same and more, for programs.
    """

    sentences: Sequence[str]
    tables: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]]
    data: dict[str, Any]


def _text(statement: Statement) -> str:
    """Write text for a pipe or a terminal, as wide as the terminal; no cell is cut off."""
    console = Console(highlight=False)
    with console.capture() as captured:
        for sentence in statement.sentences:
            console.print(escape(visible(sentence)), soft_wrap=True)
        for title, heads, rows in statement.tables:
            table = Table(title=escape(title), title_justify="left")
            for head, unbroken in zip(heads, _unbroken(heads, rows, console.width), strict=True):
                table.add_column(escape(visible(head)), overflow="fold", no_wrap=unbroken)
            for row in rows:
                table.add_row(*(escape(visible(cell)) for cell in row))
            if rows:
                console.print(table)
    return captured.get()


def _unbroken(heads: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[bool]:
    """Choose the columns of names to keep unbroken, since readers copy names: the narrowest first, while all fit."""
    columns = [[visible(row[n]) for row in rows] for n in range(len(heads))]
    widths = [max(map(len, (head, *column))) + 3 for head, column in zip(heads, columns, strict=True)]
    chosen, left = [False] * len(heads), width - LEAST_WIDTH * len(heads)
    for n in sorted(range(len(heads)), key=widths.__getitem__):
        if not any(" " in cell for cell in columns[n]) and (more := max(widths[n] - LEAST_WIDTH, 0)) <= left:
            chosen[n], left = True, left - more
    return chosen


def _markdown(statement: Statement) -> str:
    blocks = ["\n".join(f"- {escaped(sentence)}" for sentence in statement.sentences)]
    for title, heads, rows in statement.tables:
        if rows:
            blocks += [f"## {escaped(title)}", "\n".join(markdown_table(heads, rows, escape=escaped))]
    return "\n\n".join(blocks) + "\n"


def _json(statement: Statement) -> str:
    return json.dumps(statement.data, indent=2, allow_nan=False) + "\n"


WRITERS: dict[str, Callable[[Statement], str]] = {"text": _text, "markdown": _markdown, "json": _json}
"""Writers of a statement by the name of the format."""
