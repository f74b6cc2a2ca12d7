"""The commands ``consilience export`` and ``consilience plot``."""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer
from click import Choice

from consilience.cli.options import writing
from consilience.errors import InvalidInput
from consilience.report.exports.plot import FORMATS, PLOTS, plotted
from consilience.report.record import read_record, write_atomically

MODULES = {
    "junit": "junit",
    "csv": "spreadsheet",
    "json": "document",
    "latex": "latex",
    "bibtex": "bibtex",
    "badge": "badge",
}
"""Module of `consilience.report.exports` whose ``render`` writes a format."""


def export(
    run: Annotated[Path | None, typer.Argument(metavar="RUN", help="Folder that `consilience run` wrote.")] = None,
    form: Annotated[
        str | None, typer.Option("-f", "--format", click_type=Choice(list(MODULES)), help="What to write.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="File; default: standard output.")
    ] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of `--format json` instead.")] = False,
) -> None:
    """Write a run for other programs and papers: JUnit XML, CSV, JSON, a LaTeX table, BibTeX or a badge.

    Examples: `consilience export RUN --format junit -o junit.xml`, `consilience export RUN --format csv | head`.
    """
    if schema:
        from consilience.report.exports.document import schema as document_schema

        text = json.dumps(document_schema(), indent=2) + "\n"
    elif run is None:
        raise InvalidInput("export", "no run is named", "Name a folder that `consilience run` wrote.")
    elif form is None:
        raise InvalidInput("export", "no format is named", f"Give --format and one of: {', '.join(MODULES)}.")
    else:
        text = import_module(f"consilience.report.exports.{MODULES[form]}").render(read_record(run))
    if output is None:
        sys.stdout.write(text)
    else:
        with writing(output):
            write_atomically(output, text)


def plot(
    run: Annotated[Path, typer.Argument(help="Folder that `consilience run` wrote.")],
    case: Annotated[str, typer.Argument(help="Name of a case of the run.")],
    what: Annotated[str, typer.Option("--what", click_type=Choice(list(PLOTS)), help="What to draw.")] = "difference",
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="File: .svg, .pdf or .png; default: CASE-WHAT.svg."),
    ] = None,
) -> None:
    """Plot the motion of a case on every engine, fit for a paper."""
    target = output or Path(f"{case}-{what}.svg")
    form = target.suffix.removeprefix(".")
    if form not in FORMATS:
        raise InvalidInput(str(target), "it is no name of a plot", f"Let it end with .{', .'.join(FORMATS)}.")
    picture = plotted(read_record(run), case, what, form)
    with writing(target):
        target.write_bytes(picture)
    typer.echo(f"plot: {target}")
