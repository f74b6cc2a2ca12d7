"""The commands ``consilience diff`` and ``consilience trend``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from consilience.cli.options import Form, OutputFormat
from consilience.errors import InvalidInput, nearest
from consilience.report.history.changes import DIGITS, change_table, changes, count_effects, plain
from consilience.report.history.series import read_series, series_statement
from consilience.report.record import Record, read_record
from consilience.report.statement import WRITERS, Statement

Digits = Annotated[float, typer.Option(min=0.0, help="Change in digits from which on one is told.")]


def _write_and_exit(statement: Statement, form: OutputFormat) -> None:
    """Write a statement; end with exit code 1 if anything is worse."""
    sys.stdout.write(WRITERS[form](statement))
    raise typer.Exit(1 if statement.data["worse"] else 0)


def renamed(pairs: list[str], before: Record, after: Record) -> dict[str, str]:
    """Read pairs ``OLD=NEW`` of engines that are compared with one another.

    Raises
    ------
    InvalidInput
        If a report has no such engine.
    """
    found = {}
    for pair in pairs:
        old, _, new = pair.partition("=")
        for name, record in ((old, before), (new, after)):
            if name not in record.header["engines"]:
                known = nearest(name, record.header["engines"], "Engines")
                raise InvalidInput(f"--as {pair}", f"the report has no engine '{name}'", known)
        found[old] = new
    return found


def diff_statement(before: Record, after: Record, names: dict[str, str], digits: float) -> Statement:
    """State the changes between two records."""
    found = changes(before, after, names, digits)
    old, new = before.header["written"], after.header["written"]
    codes = before.footer["exit_code"], after.footer["exit_code"]
    data = {
        "before": {"written": old, "exit_code": codes[0]},
        "after": {"written": new, "exit_code": codes[1]},
        "worse": sum(change.effect == "worse" for change in found),
        "better": sum(change.effect == "better" for change in found),
        "changes": plain(found),
    }
    sentence = f"From {old} (exit code {codes[0]}) to {new} (exit code {codes[1]}): {count_effects(found)}"
    return Statement([sentence], [change_table(found, "changes")], data)


def diff(
    before: Annotated[Path, typer.Argument(metavar="RUN1", help="Folder of the earlier report.")],
    after: Annotated[Path, typer.Argument(metavar="RUN2", help="Folder of the later one.")],
    same: Annotated[
        list[str] | None,
        typer.Option("--as", metavar="OLD=NEW", help="Compare engine OLD of RUN1 with NEW of RUN2 alone; repeat it."),
    ] = None,
    digits: Digits = DIGITS,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Tell what has changed between two reports. Exit code 0: nothing is worse; 1: something is."""
    old, new = read_record(before), read_record(after)
    _write_and_exit(diff_statement(old, new, renamed(same or [], old, new), digits), form)


def trend(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that holds folders of reports.")],
    digits: Digits = DIGITS,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Tell how reports have changed over time. Exit code 1: the last is worse than the one before; else 0."""
    _write_and_exit(series_statement(*read_series(folder), digits), form)
