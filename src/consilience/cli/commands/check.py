"""The command ``consilience check``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from consilience.audit.identities import tables
from consilience.audit.identities.check import Checks, check_engines
from consilience.audit.identities.result import exit_code
from consilience.cli.options import (
    CORES,
    CaseNames,
    EngineNames,
    Form,
    JobLimit,
    Jobs,
    OutputFormat,
    chosen_cases,
    chosen_engines,
    require_place,
    writing,
)
from consilience.cli.terminal import print_missing, print_table, progress_bar, say
from consilience.engine import Profile

MOST_PRINTED = 20
"""Findings that are printed; the file of ``--output`` has all findings."""


def check(
    cases: CaseNames = None,
    engine: EngineNames = None,
    states: Annotated[int, typer.Option(min=1, help="States of each case that are looked at.")] = 3,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File: .json or .md.")] = None,
    jobs: Jobs = CORES,
    limit: JobLimit = 180.0,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Check each engine alone, without a reference, against identities that hold whatever the truth is."""
    if output is not None:
        tables.check_target(output)
        require_place(output)
    engines, chosen = chosen_engines(engine), chosen_cases(cases)
    with progress_bar() as bar:
        task = bar.add_task("starting engines", total=len(chosen) * len(engines))
        checks = check_engines(
            chosen,
            engines,
            states,
            jobs,
            limit,
            progress=lambda name, case: bar.update(task, advance=1, description=f"{name}: {case}"),
        )
    if form is OutputFormat.TEXT:
        _print(checks)
    else:
        sys.stdout.write(tables.as_json(checks) if form is OutputFormat.JSON else tables.markdown(checks))
    if output is not None:
        with writing(output):
            tables.write(checks, output)
    raise typer.Exit(exit_code(checks.findings, len(checks.missing)))


def _print(checks: Checks) -> None:
    for profile in Profile:
        if any(f.profile is profile for f in checks.findings):
            rows = [(name, *cells) for name, cells in tables.matrix(checks, profile)]
            print_table(("identity", *checks.engines), rows, f"identities, settings: {profile}")
    say(tables.LEGEND)
    print_missing(checks.missing)
    found = list(tables.blemishes(checks))
    for finding in found[:MOST_PRINTED]:
        say(tables.sentence(finding))
    if len(found) > MOST_PRINTED:
        say(f"and {len(found) - MOST_PRINTED} more: see the file of --output")
