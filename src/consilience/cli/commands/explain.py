"""The command ``consilience explain``."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import Annotated

import typer
from rich.markup import escape

from consilience.cli.explanations import Explanation, Topic, find_explanations, read_explanations
from consilience.cli.options import Form, OutputFormat
from consilience.cli.terminal import out, say


def _words_like(incomplete: str) -> list[str]:
    """Complete names of one word; a shell would split a name of several words."""
    names = dict.fromkeys(entry.name for entry in read_explanations())
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
    form: Form = OutputFormat.TEXT,
) -> None:
    """Explain a verdict, a rule, a term or a trap: what decides, the theory in three lines, where users met it."""
    entries = find_explanations(" ".join(words)) if words else read_explanations()
    if form is OutputFormat.JSON:
        sys.stdout.write(json.dumps([asdict(entry) for entry in entries], indent=2) + "\n")
    elif form is OutputFormat.MARKDOWN:
        sys.stdout.write("\n".join(_markdown(entry) for entry in entries))
    elif words:
        for entry in entries:
            _print(entry)
    else:
        for topic in Topic:
            names = (f"{e.number} {e.name}" if e.number else e.name for e in entries if e.kind is topic)
            say(f"{topic.title}: {'; '.join(names)}")


def _print(entry: Explanation) -> None:
    number = f" {entry.number}" if entry.number else ""
    out.print(f"[bold]{escape(entry.name)}[/bold] ({entry.kind}{number})", highlight=False)
    for line in (f"rule: {entry.rule}", *entry.theory.splitlines(), *(f"met: {place}" for place in entry.met)):
        say(f"  {line}")
    out.print(f"  more: docs/{entry.page}", highlight=False)


def _markdown(entry: Explanation) -> str:
    met = "".join(f"- {place}\n" for place in entry.met)
    return f"### {entry.name} ({entry.kind})\n\n**{entry.rule}**\n\n{entry.theory}\n\n{met}\n"
