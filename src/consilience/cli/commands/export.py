"""The commands ``consilience export`` and ``consilience plot``."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from consilience.cli.options import Form, OutputFormat, require_ending, writing
from consilience.cli.terminal import say, state
from consilience.errors import InvalidInput, nearest
from consilience.report.curves import CurveSet
from consilience.report.exports.motionplot import motion_plot, one_kind
from consilience.report.exports.plot import PLOTS, UNDATED, plotted
from consilience.report.record import read_record, write_atomically
from consilience.report.replayschema import read_replay
from consilience.report.statement import Statement


class ExportFormat(StrEnum):
    """Formats of an export."""

    JUNIT = "junit"
    CSV = "csv"
    JSON = "json"
    LATEX = "latex"
    BIBTEX = "bibtex"
    BADGE = "badge"


class PlotName(StrEnum):
    """Keys of `plot.PLOTS`, and of `curves.KINDS`: the motion by the reference."""

    DIFFERENCE = "difference"
    CONVERGENCE = "convergence"
    ENERGY = "energy"
    WORK_PRECISION = "work-precision"
    COORDINATES = "coordinates"
    RATES = "rates"
    POSITIONS = "positions"
    VELOCITIES = "velocities"
    ENERGIES = "energies"
    REACTIONS = "reactions"


MODULES = {ExportFormat.CSV: "spreadsheet", ExportFormat.JSON: "document"}
"""Modules of `consilience.report.exports` whose names differ from the names of their formats."""


def export(
    run: Annotated[Path | None, typer.Argument(metavar="RUN", help="Folder that `consilience run` wrote.")] = None,
    form: Annotated[
        ExportFormat | None,
        typer.Option("-f", "--format", metavar="FORMAT", help=f"What to write: {', '.join(ExportFormat)}."),
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
        raise InvalidInput("export", "no format is named", f"Give --format and one of: {', '.join(ExportFormat)}.")
    else:
        text = import_module(f"consilience.report.exports.{MODULES.get(form, form)}").render(read_record(run))
    if output is None:
        sys.stdout.write(text)
    else:
        with writing(output):
            write_atomically(output, text)
        say(f"{'schema' if schema else form}: {output}")


def plot(
    run: Annotated[Path, typer.Argument(help="Folder that `consilience run` wrote.")],
    case: Annotated[str, typer.Argument(help="Name of a case of the run.")],
    what: Annotated[
        PlotName, typer.Option("--what", metavar="KIND", help=f"What to draw: {', '.join(PlotName)}.")
    ] = PlotName.DIFFERENCE,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="File: .svg, .pdf or .png; default: CASE-WHAT.svg."),
    ] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Plot the motion of a case by the reference, or its differences on every engine, fit for a paper."""
    target = output or Path(f"{case}-{what}.svg")
    require_ending(target, "plot", *(f".{ending}" for ending in UNDATED))
    record, ending = read_record(run), target.suffix[1:]
    if what in PLOTS:
        picture = plotted(record, case, what, ending)
    else:
        known = [one["name"] for one in record.cases]
        if case not in known:
            raise InvalidInput(f"case '{case}'", "it is not in this run", nearest(case, known, "Cases"))
        curves = [CurveSet.of(one) for one in read_replay(run).get(case, {}).get("curves", [])]
        picture = motion_plot(one_kind(curves, what, case), case, ending)
    with writing(target):
        target.write_bytes(picture)
    state(Statement([f"plot: {target}"], [], {"file": str(target)}), form)
