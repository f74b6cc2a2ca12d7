"""``consilience mutate``: plant the errors, report what the harness notices."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from consilience.errors import InvalidInput

out, err = Console(), Console(stderr=True)


def mutate(
    mutants: Annotated[
        list[str] | None, typer.Argument(metavar="[MUTANT]...", help="Names, or numbers of traps; default: all.")
    ] = None,
    engine: Annotated[
        list[str] | None, typer.Option("-e", "--engine", help="Where to plant; repeat it. Default: everywhere.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the report.")] = Path(
        "consilience-detection"
    ),
    short: Annotated[bool, typer.Option("--short", help="One host, two magnitudes, few mechanisms.")] = False,
    mechanisms: Annotated[int, typer.Option(min=0, help="Random mechanisms that mutants are judged on.")] = 5,
    correct: Annotated[int, typer.Option(min=0, help="Random mechanisms that correct adapters are judged on.")] = 315,
    jobs: Annotated[int, typer.Option("-j", "--jobs", min=1, help="Worker processes.")] = os.cpu_count() or 2,
    limit: Annotated[float, typer.Option(min=1.0, help="Time limit of one mutant at one magnitude in s.")] = 300.0,
) -> None:
    """Plant known errors in the adapters, one at a time, and report which the harness catches."""
    # a command imports what it needs: the help appears at once
    from consilience.audit.mutate import plan, report, summary  # noqa: PLC0415
    from consilience.audit.mutate.campaign import run_campaign  # noqa: PLC0415
    from consilience.audit.mutate.synthetic import NAME  # noqa: PLC0415

    if output.exists() and not output.is_dir():
        raise InvalidInput(str(output), "it is a file", "Give a folder for the report.")
    chosen, hosts = plan.mutants_named(mutants or []), plan.hosts_named(engine or [])
    tasks, alarms = plan.short(chosen, hosts) if short else plan.full(chosen, hosts, mechanisms, correct)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        task = bar.add_task("mutants", total=len(tasks))
        adapters = [name for name in hosts if name != NAME]
        campaign = run_campaign(
            tasks, adapters, alarms, jobs, limit, lambda found: bar.update(task, completed=len(found.outcomes))
        )
    report.write_report(campaign, output)
    table = Table("trap", "", "mutants caught", "smallest magnitude caught", title="detection power")
    for line in report.short_table(campaign):
        table.add_row(*(escape(cell) for cell in line))
    out.print(table)
    out.print(escape(summary.verdict_of(campaign)), soft_wrap=True, highlight=False)
    for row in summary.rows_of(campaign):
        if row.standing in (summary.Standing.MISSED, summary.Standing.FALSE_ALARM, summary.Standing.NOT_JUDGED):
            out.print(escape(f"{row.standing}: {row.mutant.name}, {row.host}: {row.why_missed}"), soft_wrap=True)
    for alarm in campaign.alarms:
        text = f"false alarm: {alarm.host}, {alarm.subject}, {alarm.question}, {alarm.method}: {alarm.why}"
        out.print(escape(text), soft_wrap=True, highlight=False)
    out.print(f"report: {output / 'detection.md'}", soft_wrap=True, highlight=False)
    raise typer.Exit(summary.exit_code(campaign))
