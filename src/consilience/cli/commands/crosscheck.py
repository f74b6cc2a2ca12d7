"""The command ``consilience crosscheck``."""

from __future__ import annotations

from typing import Annotated

import typer

from consilience.cli.options import CORES, Form, Jobs, OutputFormat, TablesFile, require_place, writing


def crosscheck(
    mechanisms: Annotated[int, typer.Option(help="Number of random mechanisms.")] = 200,
    states: Annotated[int, typer.Option(help="States of each.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the first mechanism; the others follow.")] = 1,
    jobs: Jobs = CORES,
    output: TablesFile = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Compare all formulations of the reference with one another on random mechanisms."""
    from consilience.audit.formulations.compare import agrees, campaign
    from consilience.audit.formulations.tables import report, summary
    from consilience.cli.terminal import print_tables, write_json

    require_place(output)
    found = []
    for examination in campaign(range(seed, seed + mechanisms), states, jobs=jobs):
        found.append(examination)
        typer.echo(f"\r{len(found)} of {mechanisms} mechanisms", nl=False, err=True)
    typer.echo(err=True)
    if output is not None:
        with writing(output):
            output.write_text(report(found), encoding="utf-8")
    if form is OutputFormat.JSON:
        write_json(found)
    else:
        print_tables(summary(found) if output is not None else report(found), form)
    raise typer.Exit(0 if agrees(found) else 1)
