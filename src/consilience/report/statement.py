"""The statement of a command: sentences, tables and data, written as text, Markdown or JSON."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from shutil import get_terminal_size
from typing import Any

from consilience.compare import markdown_table
from consilience.errors import visible
from consilience.report.columns import columns, wrapped


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


def escaped(value: object) -> str:
    """Escape text for Markdown and HTML, on one line, inside and outside tables."""
    text = visible(re.sub(r"\s+", " ", str(value)))
    text = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    text = re.sub(r"([\\`*\[\]|~])", r"\\\1", text)
    # a code host turns these into links and mentions
    text = re.sub(r"://|www\.|@", lambda found: "".join(f"&#{ord(c)};" for c in found.group()), text)
    # an underscore within a word needs no escape
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)


def _text(statement: Statement) -> str:
    """Write text for a pipe or a terminal, tables as wide as the terminal; no word is broken."""
    width, to_terminal = get_terminal_size().columns, sys.stdout.isatty()
    parts = [wrapped(visible(line), width) if to_terminal else visible(line) for line in statement.sentences]
    for title, heads, rows in statement.tables:
        if rows:
            cells = [[visible(cell) for cell in row] for row in rows]
            parts += ["", visible(title), columns([visible(head) for head in heads], cells, width)]
    return "\n".join(parts) + "\n"


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
