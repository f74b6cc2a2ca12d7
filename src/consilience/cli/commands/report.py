"""The command ``consilience report``, and the statement that ends a run."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from consilience.cli.options import Form, OutputFormat, ReportFolder, writing

if TYPE_CHECKING:
    from consilience.report.record import Record


def report(folder: ReportFolder, form: Form = OutputFormat.TEXT) -> None:
    """Render the pages of a report again from its report.jsonl."""
    from consilience.report.pages import write_pages

    with writing(folder):
        write_pages(folder)
    raise typer.Exit(state_report(folder, form))


def state_report(folder: Path, form: OutputFormat) -> int:
    """Print what a report comes to, as text, as its Markdown page or as data; return the exit code."""
    from consilience.cli.terminal import print_missing, say, write_json
    from consilience.report.markdown import render_markdown
    from consilience.report.record import read_record

    record = read_record(folder)
    if form is OutputFormat.MARKDOWN:
        say(render_markdown(record))
    elif form is OutputFormat.JSON:
        write_json(_data(record, folder))
    else:
        _print_matrix(record)
        print_missing(record.header["missing"])
        _print_headline(record)
        say(f"report: {folder / 'report.html'}")
    return int(record.footer["exit_code"])


def _print_matrix(record: Record) -> None:
    """Print the verdicts of a report, a row for each case and a column for each engine."""
    from consilience.cli.terminal import print_table, say
    from consilience.report.summary import legend, matrix

    engines, rows = matrix(record)
    title = "worst verdict and least digits over all questions and matched methods"
    print_table(("case", *engines), [(case, *cells) for case, cells in rows], title)
    say("\n".join(["", *legend(record)]))


def _print_headline(record: Record) -> None:
    """Print the headline, then each cell that differs in the model, failed or is unresolved, with its cause."""
    from consilience.cli.terminal import say
    from consilience.errors import visible
    from consilience.report.headline import headline, look_first, without_horizon

    cells = look_first(record)
    lines = *(f"{line}." for line in headline(record)), *(cell.line for cell in cells), *without_horizon(record)
    say(visible("\n".join(["", *lines])))
    if cells:
        say(f'`consilience explain "{cells[0].look.name}"` says what that verdict means.')


def _data(record: Record, folder: Path) -> dict[str, Any]:
    from consilience.report.exports.digest import cells
    from consilience.report.headline import headline, look_first

    return {
        "headline": headline(record),
        "look_first": [asdict(cell) | {"look": cell.look.name} for cell in look_first(record)],
        "cells": [
            {"case": c.case, "engine": c.engine, "question": c.question, "verdict": c.verdict, "digits": c.digits}
            for c in cells(record)
        ],
        "missing": record.header["missing"],
        "exit_code": record.footer["exit_code"],
        "report": str(folder / "report.html"),
    }
