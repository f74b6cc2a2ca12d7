"""The command ``consilience run``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from consilience.cli.options import (
    CORES,
    CaseNames,
    EngineNames,
    Form,
    JobLimit,
    Jobs,
    OutputFormat,
    QuestionNames,
    Tags,
    Verbose,
    chosen_engines,
    chosen_questions,
    connect_cluster,
    require_folder,
    sound_cases,
    tagged_cases,
    writing,
)
from consilience.errors import InvalidInput


def tell_replaced(folder: Path, asked: dict[str, Any]) -> None:
    """Say on standard error where a folder holds a report of something else, which the run is going to replace."""
    from consilience.cli.terminal import err, say
    from consilience.errors import visible
    from consilience.report.record import read_question
    from consilience.report.wording import counted

    if not (folder / "report.jsonl").is_file():
        return
    try:
        before = read_question(folder)
        about = f"{counted(len(before['cases']), 'case')}, {', '.join(sorted(before['engines']))}"
    except InvalidInput:
        before, about = {}, "it cannot be read"
    if before != asked:
        what = f"{folder} holds the report of another run ({about}), which this one replaces: -o NAME keeps both"
        say(visible(what), err)


def run(
    cases: CaseNames = None,
    engine: EngineNames = None,
    question: QuestionNames = None,
    tag: Tags = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the report.")] = Path("consilience-report"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Few states; short motions, by one method of each engine.")
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Ask again what the folder has answers to.")] = False,
    jobs: Jobs = CORES,
    limit: JobLimit = 180.0,
    memory: Annotated[float, typer.Option(min=0.1, help="Memory that an engine may use in GiB.")] = 4.0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Engines work on the Dask cluster of this scheduler.")
    ] = None,
    verbose: Verbose = False,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Ask the questions, compare, and write report.jsonl, report.html and report.md.

    Answers are kept in the folder as they come: the same command after an interruption goes on where it was. A case
    that cannot be read, or has no start, is told, and costs no other its answer.
    """
    from consilience.cli.commands.report import state_report
    from consilience.cli.terminal import err, log_to_stderr, progress_per_engine, say
    from consilience.report.pages import write_pages
    from consilience.report.record import write_record
    from consilience.suite import FULL, QUICK, Resources, Store, run_suite

    folder = require_folder(output, "report")
    sound, refused = sound_cases(cases)
    chosen = tagged_cases(sound, tag)
    for error in refused:
        say(f"consilience: {error}", err, "red")
    if refused:
        say("the other cases are asked", err)
    engines, questions = chosen_engines(engine), chosen_questions(question)
    start, store = time.perf_counter(), Store(folder, fresh)
    if verbose:
        log_to_stderr()
    asked = list(dict.fromkeys(["reference", *engines]))
    names = {case.name for case in chosen}
    tell_replaced(folder, {"cases": names, "engines": {*asked}, "questions": {*questions}, "quick": quick})
    progress_bars = progress_per_engine(asked, len(chosen), silent=verbose)
    try:
        with connect_cluster(scheduler) as cluster, progress_bars as progress:
            results = run_suite(
                chosen,
                engines,
                questions,
                Resources(jobs, limit, int(memory * 2**30), cluster),
                progress=progress,
                thoroughness=QUICK if quick else FULL,
                store=store,
            )
    except KeyboardInterrupt:
        err.print(f"stopped; answers so far are in {folder}: the same command goes on from there", markup=False)
        raise typer.Exit(130) from None
    store.close()
    with writing(folder):
        write_record(results, time.perf_counter() - start, folder, jobs)
        write_pages(folder)
    raise typer.Exit(state_report(folder, form) or (2 if refused else 0))
