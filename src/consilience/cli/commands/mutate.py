"""The command ``consilience mutate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from consilience.cli.options import CORES, require_folder


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
    jobs: Annotated[int, typer.Option("-j", "--jobs", min=1, help="Worker processes.")] = CORES,
    limit: Annotated[float, typer.Option(min=1.0, help="Time limit of one mutant at one magnitude in s.")] = 300.0,
) -> None:
    """Plant known errors in the adapters, one at a time, and report which the harness catches."""
    from consilience.audit.mutate import plan, report, summary
    from consilience.audit.mutate.campaign import run_campaign
    from consilience.audit.mutate.synthetic import NAME
    from consilience.cli.terminal import print_table, progress_bar, say

    require_folder(output, "report")
    chosen, hosts = plan.mutants_named(mutants or []), plan.hosts_named(engine or [])
    tasks, alarms = plan.short(chosen, hosts) if short else plan.full(chosen, hosts, mechanisms, correct)
    with progress_bar() as bar:
        task = bar.add_task("mutants", total=len(tasks))
        adapters = [name for name in hosts if name != NAME]
        campaign = run_campaign(
            tasks, adapters, alarms, jobs, limit, lambda found: bar.update(task, completed=len(found.outcomes))
        )
    report.write_report(campaign, output)
    heads = ("trap", "", "mutants caught", "smallest magnitude caught")
    print_table(heads, report.short_table(campaign), "detection power")
    say(summary.verdict_of(campaign))
    for row in summary.rows_of(campaign):
        if row.standing in (summary.Standing.MISSED, summary.Standing.FALSE_ALARM, summary.Standing.NOT_JUDGED):
            say(f"{row.standing}: {row.mutant.name}, {row.host}: {row.why_missed}")
    for alarm in campaign.alarms:
        say(f"false alarm: {alarm.host}, {alarm.subject}, {alarm.question}, {alarm.method}: {alarm.why}")
    say(f"report: {output / 'detection.md'}")
    raise typer.Exit(summary.exit_code(campaign))
