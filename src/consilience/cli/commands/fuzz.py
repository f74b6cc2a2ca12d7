"""The command ``consilience fuzz``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from consilience.audit.fuzz.campaign import EnginePanel, run_campaign, run_on_cluster
from consilience.audit.fuzz.findings import shrink_disagreements
from consilience.audit.fuzz.shrink import require_hypothesis
from consilience.audit.fuzz.summary import COUNTS, digits_cell, markdown, outcome
from consilience.cli.options import (
    EngineNames,
    Form,
    MessageLimit,
    OutputFormat,
    Verbose,
    chosen_engines,
    connect_cluster,
    require_folder,
    writing,
)
from consilience.cli.terminal import log_to_stderr, print_missing, print_table, progress_bar, say, write_json
from consilience.compare import write_campaign


def fuzz(
    mechanisms: Annotated[int, typer.Option("-n", "--mechanisms", min=1, help="How many.")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first; the next ones follow.")] = 1,
    contacts: Annotated[
        bool,
        typer.Option("--contacts", help="Draw mechanisms with contacts, stops and dry friction; ask for motions, too."),
    ] = False,
    engine: EngineNames = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the outcome.")] = Path("consilience-fuzz"),
    limit: MessageLimit = 180.0,
    effort: Annotated[float, typer.Option(min=0.0, help="Time to shrink one disagreement in s.")] = 120.0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Draw, ask and judge on the Dask cluster of this scheduler.")
    ] = None,
    verbose: Verbose = False,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Ask all engines about random mechanisms; shrink what shows a disagreement, and keep it as a case file."""
    engines, seeds = chosen_engines(engine), range(seed, seed + mechanisms)
    require_folder(output, "outcome")
    require_hypothesis()
    if verbose:
        log_to_stderr()
    with connect_cluster(scheduler) as cluster, progress_bar(verbose) as bar:
        task = bar.add_task("starting engines", total=mechanisms)

        def show(done: int) -> None:
            bar.update(task, completed=done, description="asking")

        remote = (
            None if cluster is None else run_on_cluster(cluster, cluster.engines(engines, limit), seeds, show, contacts)
        )
        with EnginePanel(engines, limit) as panel:
            campaign = remote or run_campaign(panel, seeds, show, contacts)
            found = shrink_disagreements(
                campaign, panel, output, effort, lambda what: bar.update(task, description=f"shrinking: {escape(what)}")
            )
    data = outcome(campaign, found)
    with writing(output):
        write_campaign(output, "fuzz", data, markdown(data))
    if form is OutputFormat.JSON:
        write_json(data)
    elif form is OutputFormat.MARKDOWN:
        say(markdown(data))
    else:
        _print(data, [(output / one.file, one) for one in found])
        say(f"outcome: {output / 'fuzz.md'}")
    raise typer.Exit(data["exit_code"])


def _print(data: dict[str, Any], found: list[tuple[Path, Any]]) -> None:
    rows = [
        (name, *(str(e[key]) for key in COUNTS), digits_cell(e["worst_digits"]), digits_cell(e["median_digits"]))
        for name, e in data["engines"].items()
    ]
    title = f"{len(data['seeds'])} mechanisms, {data['time']['per_minute']:.0f} a minute"
    print_table(("engine", *COUNTS, "worst digits", "median"), rows, title)
    for path, one in found:
        say(f"{path}: {one.bodies} bodies: {one.shown.why}")
    print_missing(data["missing"])
