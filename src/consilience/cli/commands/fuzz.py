"""``consilience fuzz``: argument parsing and printing only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from consilience.audit.fuzz.campaign import Panel, run_campaign, run_on_cluster
from consilience.audit.fuzz.findings import find
from consilience.audit.fuzz.shrink import require_hypothesis
from consilience.audit.fuzz.summary import outcome, shown_digits, write_outcome
from consilience.cli.campaign_options import cluster_of, log_to_stderr
from consilience.engine import engines_like, installed, require_installed
from consilience.errors import InvalidInput


def fuzz(
    mechanisms: Annotated[int, typer.Option("-n", "--mechanisms", min=1, help="How many.")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first; the next ones follow.")] = 1,
    engine: Annotated[
        list[str] | None,
        typer.Option("-e", "--engine", help="Engine; repeat it. Default: all.", autocompletion=engines_like),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the outcome.")] = Path("consilience-fuzz"),
    limit: Annotated[float, typer.Option(min=0.1, help="Time limit of one message to an engine in s.")] = 180.0,
    effort: Annotated[float, typer.Option(min=0.0, help="Time to shrink one disagreement in s.")] = 120.0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Draw, ask and judge on the Dask cluster of this scheduler.")
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Say on stderr what happens, and when.")] = False,
) -> None:
    """Ask all engines about random mechanisms; shrink what shows a disagreement, and keep it as a case file."""
    for name in engine or []:
        require_installed(name)
    if output.exists() and not output.is_dir():
        raise InvalidInput(str(output), "it is a file", "Give a folder for the outcome.")
    require_hypothesis()
    out, err = Console(), Console(stderr=True)
    engines, seeds = list(dict.fromkeys(engine or installed())), range(seed, seed + mechanisms)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    if verbose:
        log_to_stderr()
    with cluster_of(scheduler) as cluster, Progress(*columns, console=err, disable=verbose) as bar:
        task = bar.add_task("starting engines", total=mechanisms)

        def show(done: int) -> None:
            bar.update(task, completed=done, description="asking")

        far = None if cluster is None else run_on_cluster(cluster, cluster.engines(engines, limit), seeds, show)
        with Panel(engines, limit) as panel:
            campaign = far or run_campaign(panel, seeds, show)
            findings = find(
                campaign, panel, output, effort, lambda what: bar.update(task, description=f"shrinking: {escape(what)}")
            )
    data = outcome(campaign, findings)
    write_outcome(data, output)
    table = Table(title=f"{len(data['seeds'])} mechanisms, {data['time']['per_minute']:.0f} a minute")
    for column in ("engine", "judged", "differs", "failed", "unresolved", "unsupported", "worst digits", "median"):
        table.add_column(column)
    for name, e in data["engines"].items():
        counts = (str(e[key]) for key in ("judged", "differs", "failed", "unresolved", "unsupported"))
        table.add_row(name, *counts, shown_digits(e["worst_digits"]), shown_digits(e["median_digits"]))
    out.print(table)
    for f in findings:
        out.print(escape(f"{output / f.file}: {f.bodies} bodies: {f.shown.why}"), soft_wrap=True, highlight=False)
    for name, reason in data["missing"].items():
        err.print(f"{name}: not available: {escape(reason)}")
    out.print(f"outcome: {output / 'fuzz.md'}", soft_wrap=True, highlight=False)
    raise typer.Exit(data["exit_code"])
