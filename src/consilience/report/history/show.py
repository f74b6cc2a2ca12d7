"""Changes and series as text, Markdown and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from consilience.errors import visible
from consilience.report.history.changes import Change
from consilience.report.markdown import escaped

HEADS = {"effect": "", "kind": "what", "where": "where", "before": "before", "after": "after", "why": "why"}
"""Columns of a table of changes."""

FORMATS = ("text", "markdown", "json")


@dataclass(frozen=True)
class Sheet:
    """What a command has to say.

    Attributes
    ----------
    sentences : sequence of str
    tables : sequence of (title, heads, rows)
    data : dict
        The same for machines.
    """

    sentences: Sequence[str]
    tables: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]]
    data: dict[str, Any]


def table_of(changes: Sequence[Change], title: str) -> tuple[str, Sequence[str], Sequence[Sequence[str]]]:
    """Changes as a table, without columns that say nothing."""
    told = [name for name in HEADS if any(getattr(change, name) for change in changes)]
    rows = [tuple(str(getattr(change, name)) for name in told) for change in changes]
    return title, [HEADS[name] for name in told], rows


def counted_effects(changes: Sequence[Change]) -> str:
    """How many changes are worse, better and neither, in a sentence."""
    count = {name: sum(change.effect == name for change in changes) for name in ("worse", "better", "")}
    return f"{count['worse']} worse, {count['better']} better, {count['']} other changes."


def plain(changes: Sequence[Change]) -> list[dict[str, str]]:
    """Changes for JSON."""
    return [asdict(change) for change in changes]


def _text(sheet: Sheet) -> str:
    # for a pipe, or a screen: as wide as there is room, and never cut off
    console = Console(highlight=False)
    with console.capture() as captured:
        for sentence in sheet.sentences:
            console.print(escape(visible(sentence)), soft_wrap=True)
        for title, heads, rows in sheet.tables:
            table = Table(title=escape(title), title_justify="left")
            for head, whole in zip(heads, _whole(heads, rows, console.width), strict=True):
                table.add_column(escape(visible(head)), overflow="fold", no_wrap=whole)
            for row in rows:
                table.add_row(*(escape(visible(cell)) for cell in row))
            if rows:
                console.print(table)
    return captured.get()


_LEAST = 8
"""Room that every column of a table for the terminal keeps, with its line and its blanks."""


def _whole(heads: Sequence[str], rows: Sequence[Sequence[str]], room: int) -> list[bool]:
    """Columns of names, which are to be copied and not to be broken; the narrowest first, while there is room."""
    columns = [[visible(row[n]) for row in rows] for n in range(len(heads))]
    widths = [max(map(len, (head, *column))) + 3 for head, column in zip(heads, columns, strict=True)]
    whole, left = [False] * len(heads), room - _LEAST * len(heads)
    for n in sorted(range(len(heads)), key=widths.__getitem__):
        if not any(" " in cell for cell in columns[n]) and (more := max(widths[n] - _LEAST, 0)) <= left:
            whole[n], left = True, left - more
    return whole


def _markdown(sheet: Sheet) -> str:
    blocks = ["\n".join(f"- {escaped(sentence)}" for sentence in sheet.sentences)]
    for title, heads, rows in sheet.tables:
        lines = [" | ".join(("", *map(escaped, row), "")).strip() for row in (heads, *rows)]
        lines.insert(1, "|" + "---|" * len(heads))
        if rows:
            blocks += [f"## {escaped(title)}", "\n".join(lines)]
    return "\n\n".join(blocks) + "\n"


def _json(sheet: Sheet) -> str:
    return json.dumps(sheet.data, indent=2, allow_nan=False) + "\n"


WRITERS: dict[str, Callable[[Sheet], str]] = dict(zip(FORMATS, (_text, _markdown, _json), strict=True))
"""How a sheet is written, by the name of the format."""
