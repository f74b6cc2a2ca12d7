"""The command ``consilience check``."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from consilience.audit.identities.check import Checks, check_engines
from consilience.audit.identities.result import exit_code
from consilience.audit.identities.tables import (
    LEGEND,
    as_json,
    blemishes,
    check_target,
    markdown,
    matrix,
    sentence,
    write,
)
from consilience.case import cases_like, load_cases, shipped_cases
from consilience.cli.formats import Format, SheetFormat
from consilience.engine import Profile, engines_like, installed, require_installed

CORES = os.cpu_count() or 2
SHOWN = 20
"""Findings that are printed one by one; all of them are in the file."""

out, err = Console(), Console(stderr=True)


def check(
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE]...", help="Names or case files; default: all.", autocompletion=cases_like),
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option("-e", "--engine", help="Engine; repeat it. Default: all.", autocompletion=engines_like),
    ] = None,
    states: Annotated[int, typer.Option(min=1, help="States of each case that are looked at.")] = 3,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File: .json or .md.")] = None,
    jobs: Annotated[int, typer.Option("-j", "--jobs", min=1, help="Engines that work at a time.")] = CORES,
    limit: Annotated[float, typer.Option(min=0.1, help="Time limit of one job in s.")] = 180.0,
    form: SheetFormat = Format.TEXT,
) -> None:
    """Check each engine alone, without a reference, against identities that hold whatever the truth is."""
    if output is not None:
        check_target(output)
    for name in engine or []:
        require_installed(name)
    chosen = [c for name in cases for c in load_cases(name)] if cases else shipped_cases()
    for case in chosen:
        if case.mechanism.contacts:
            err.print(f"{case.name}: left out, the identities are those of motions without impacts", highlight=False)
    chosen = [case for case in chosen if not case.mechanism.contacts]
    engines = list(dict.fromkeys(engine or installed()))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        task = bar.add_task("starting engines", total=len(chosen) * len(engines))
        checks = check_engines(
            chosen,
            engines,
            states,
            jobs,
            limit,
            progress=lambda name, case: bar.update(task, advance=1, description=f"{name}: {case}"),
        )
    if form is Format.TEXT:
        _print(checks)
    else:
        sys.stdout.write(as_json(checks) if form is Format.JSON else markdown(checks))
    if output is not None:
        write(checks, output)
    raise typer.Exit(exit_code(checks.findings, len(checks.missing)))


def _print(checks: Checks) -> None:
    for profile in Profile:
        if any(f.profile is profile for f in checks.findings):
            table = Table(title=f"identities, settings: {profile}")
            table.add_column("identity")
            for name in checks.engines:
                table.add_column(name)
            for name, cells in matrix(checks, profile):
                table.add_row(escape(name), *(escape(text) for text in cells))
            out.print(table)
    out.print(LEGEND, soft_wrap=True, highlight=False)
    for name, reason in checks.missing.items():
        err.print(f"{name}: not available: {escape(reason)}")
    found = list(blemishes(checks))
    for finding in found[:SHOWN]:
        out.print(escape(sentence(finding)), soft_wrap=True, highlight=False)
    if len(found) > SHOWN:
        out.print(f"and {len(found) - SHOWN} more: see the file of --output", highlight=False)
