"""The commands ``consilience export`` and ``consilience plot``: argument parsing and writing only."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from consilience.errors import InvalidInput
from consilience.report.exports.plot import FORMATS, plotted
from consilience.report.record import Record, read_record, write_atomically


class Format(StrEnum):
    """What a run can be exported as."""

    JUNIT = "junit"
    CSV = "csv"
    JSON = "json"
    LATEX = "latex"
    BIBTEX = "bibtex"
    BADGE = "badge"


class What(StrEnum):
    """What can be plotted of a motion."""

    DIFFERENCE = "difference"
    CONVERGENCE = "convergence"
    ENERGY = "energy"
    WORK_PRECISION = "work-precision"


MODULES = {Format.CSV: "spreadsheet", Format.JSON: "document"}
"""Module of `consilience.report.exports` whose ``render`` writes a format, where it has another name."""


def export(
    run: Annotated[Path | None, typer.Argument(metavar="RUN", help="Folder that `consilience run` wrote.")] = None,
    form: Annotated[Format | None, typer.Option("-f", "--format", help="What to write.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="File; default: standard output.")
    ] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of `--format json` instead.")] = False,
) -> None:
    """Write a run for other programs and papers: JUnit XML, CSV, JSON, a LaTeX table, BibTeX or a badge.

    Examples: `consilience export RUN --format junit -o junit.xml`, `consilience export RUN --format csv | head`.
    """
    if schema:
        from consilience.report.exports.document import schema as described  # noqa: PLC0415 - only this needs pydantic's

        text = json.dumps(described(), indent=2) + "\n"
    elif run is None:
        raise InvalidInput("export", "no run is named", "Name a folder that `consilience run` wrote.")
    elif form is None:
        raise InvalidInput("export", "no format is named", f"Give --format and one of: {', '.join(Format)}.")
    else:
        text = _renderer(form)(read_record(run))
    if output is None:
        sys.stdout.write(text)
    else:
        _written(output, lambda path: write_atomically(path, text))


def _renderer(form: Format) -> Callable[[Record], str]:
    render: Callable[[Record], str] = import_module(f"consilience.report.exports.{MODULES.get(form, form)}").render
    return render


def _written(path: Path, write: Callable[[Path], object]) -> None:
    try:
        write(path)
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be written ({error.strerror})", "Choose another place.") from None


def plot(
    run: Annotated[Path, typer.Argument(help="Folder that `consilience run` wrote.")],
    case: Annotated[str, typer.Argument(help="Name of a case of the run.")],
    what: Annotated[What, typer.Option("--what", help="What to draw.")] = What.DIFFERENCE,
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
    _written(target, lambda path: path.write_bytes(picture))
    typer.echo(f"plot: {target}")
