"""The command ``consilience mutate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from consilience.cli.options import CORES, Form, OutputFormat, chosen_cases, chosen_engines, require_folder, writing

if TYPE_CHECKING:
    from consilience.audit.mutate.campaign import MutationCampaign


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
    power: Annotated[
        list[str] | None,
        typer.Option(metavar="CASE", help="Plant errors at 3 and 0.3 times the stated power of the cells; repeat it."),
    ] = None,
    jobs: Annotated[int, typer.Option("-j", "--jobs", min=1, help="Worker processes.")] = CORES,
    limit: Annotated[float, typer.Option(min=1.0, help="Time limit of one mutant at one magnitude in s.")] = 300.0,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Plant known errors in the adapters, one at a time, and report which the harness catches."""
    from consilience.audit.mutate import plan, report, summary
    from consilience.audit.mutate.campaign import run_campaign
    from consilience.audit.mutate.synthetic import NAME
    from consilience.cli.terminal import progress_bar, say, write_json

    require_folder(output, "report")
    if power:
        _stated_power(power, engine, limit, output, form)
    chosen, hosts = plan.mutants_named(mutants or []), plan.hosts_named(engine or [])
    tasks, alarms = plan.short(chosen, hosts) if short else plan.full(chosen, hosts, mechanisms, correct)
    with progress_bar() as bar:
        task = bar.add_task("mutants", total=len(tasks))
        adapters = [name for name in hosts if name != NAME]
        campaign = run_campaign(
            tasks, adapters, alarms, jobs, limit, lambda found: bar.update(task, completed=len(found.outcomes))
        )
    with writing(output):
        report.write_report(campaign, output)
    if form is OutputFormat.JSON:
        write_json(report.as_json(campaign))
    elif form is OutputFormat.MARKDOWN:
        say(report.markdown(campaign))
    else:
        _print(campaign, output)
    raise typer.Exit(summary.exit_code(campaign))


def _print(campaign: MutationCampaign, output: Path) -> None:
    """Print what is caught, then each mutant that is missed and each false alarm."""
    from consilience.audit.mutate import report, summary
    from consilience.cli.terminal import print_table, say

    heads = ("trap", "", "mutants caught", "smallest magnitude caught")
    print_table(heads, report.short_table(campaign), "detection power")
    say(summary.verdict_of(campaign))
    for row in summary.rows_of(campaign):
        if row.standing in (summary.Standing.MISSED, summary.Standing.FALSE_ALARM, summary.Standing.NOT_JUDGED):
            say(f"{row.standing}: {row.mutant.name}, {row.host}: {row.why_missed or row.by}")
    for alarm in campaign.alarms:
        say(f"false alarm: {alarm.host}, {alarm.subject}, {alarm.question}, {alarm.method}: {alarm.why}")
    say(f"report: {output / 'detection.md'}")


def _stated_power(
    names: list[str], engine: list[str] | None, limit: float, output: Path, form: OutputFormat
) -> NoReturn:
    """Check the stated power of all cells of the cases by planted errors; ends the command."""
    from consilience.audit.mutate import stated_power
    from consilience.cli.terminal import err, print_tables, write_json

    cases, found = chosen_cases(names), []
    for name in chosen_engines(engine):
        for trial in stated_power.trials(cases, name, limit=limit):
            found.append(trial)
            err.print(
                f"{trial.engine}, {trial.case}, {trial.question}, {trial.method}, {trial.stated.of}", soft_wrap=True
            )
    text = stated_power.table(found)
    with writing(output):
        output.mkdir(parents=True, exist_ok=True)
        (output / "power.md").write_text(text, encoding="utf-8")
    if form is OutputFormat.JSON:
        write_json(found)
    else:
        print_tables(text, form)
    raise typer.Exit(stated_power.exit_code(found))
