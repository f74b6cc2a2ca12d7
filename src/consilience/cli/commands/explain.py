"""The command ``consilience explain``: argument parsing and printing only."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from consilience.cli.explanations import Entry, Kind, explained, read_entries
from consilience.cli.formats import Format, SheetFormat

out = Console()


def _words_like(incomplete: str) -> list[str]:
    """Names of one word that begin so: a shell would take a name of several for several."""
    names = dict.fromkeys(entry.name for entry in read_entries())
    return [name for name in names if name.startswith(incomplete) and " " not in name]


def explain(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[VERDICT|TERM|TRAP]",
            help="Name, or number of a trap; default: list all.",
            autocompletion=_words_like,
        ),
    ] = None,
    form: SheetFormat = Format.TEXT,
) -> None:
    """Explain a verdict, a rule, a term or a trap: what decides, the theory in three lines, where users met it."""
    entries = explained(" ".join(words)) if words else read_entries()
    if form is Format.JSON:
        sys.stdout.write(json.dumps([asdict(entry) for entry in entries], indent=2) + "\n")
    elif form is Format.MARKDOWN:
        sys.stdout.write("\n".join(_markdown(entry) for entry in entries))
    elif words:
        for entry in entries:
            _print(entry)
    else:
        for kind in Kind:
            names = (f"{e.number} {e.name}" if e.number else e.name for e in entries if e.kind is kind)
            out.print(f"[bold]{kind.title}[/bold]: {escape('; '.join(names))}", highlight=False, soft_wrap=True)


def _print(entry: Entry) -> None:
    number = f" {entry.number}" if entry.number else ""
    out.print(f"[bold]{escape(entry.name)}[/bold] ({entry.kind}{number})", highlight=False)
    for line in (f"rule: {entry.rule}", *entry.theory.splitlines(), *(f"met: {place}" for place in entry.met)):
        out.print(f"  {escape(line)}", highlight=False, soft_wrap=True)
    out.print(f"  more: docs/{entry.page}", highlight=False)


def _markdown(entry: Entry) -> str:
    met = "".join(f"- {place}\n" for place in entry.met)
    return f"### {entry.name} ({entry.kind})\n\n**{entry.rule}**\n\n{entry.theory}\n\n{met}\n"
