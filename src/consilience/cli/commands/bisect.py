"""The command ``consilience bisect``."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from consilience.cli.options import (
    AnyCaseName,
    Form,
    JobLimit,
    OutputFormat,
    QuestionNames,
    chosen_questions,
    require_folder,
    writing,
)
from consilience.errors import InvalidInput
from consilience.report.history.changes import DIGITS

if TYPE_CHECKING:
    from consilience.report.history.bisection import AskVersion
    from consilience.report.record import Record

INCOMPLETE = 3
"""Exit code where fewer than two versions could be asked."""


def versions_of(text: str) -> tuple[str, list[str]]:
    """Return the engine of ``ENGINE@FIRST..LAST``, and its published versions in the range, oldest first.

    Raises
    ------
    InvalidInput
        If the range is none, the engine is not installed, or no version is found.
    """
    from consilience.engine.worker.environments import NoEnvironment, published_versions

    engine, _, bounds = text.partition("@")
    first, dots, last = bounds.partition("..")
    if not (first and dots and last):
        raise InvalidInput(f"engine '{text}'", "it is no range of versions", "Write ENGINE@3.3..4.0.")
    try:
        return engine, published_versions(engine, first, last)
    except NoEnvironment as error:
        reason = str(error).removeprefix(f"engine '{engine}': ")
        raise InvalidInput(f"engine '{text}'", reason, "`consilience list` names the engines.") from None


def bisect(
    case: AnyCaseName,
    engine: Annotated[str, typer.Option("-e", "--engine", metavar="ENGINE@FIRST..LAST", help="Range of versions.")],
    question: QuestionNames = None,
    quick: Annotated[bool, typer.Option("--quick", help="Ask as `run --quick` does.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for the report of each version tried.")
    ] = None,
    digits: Annotated[float, typer.Option(min=0.0, help="Loss of digits from which on an answer is worse.")] = DIGITS,
    limit: JobLimit = 180.0,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Find the first version of an engine whose answers are worse than those of the first version of a range.

    Each version is asked in an environment of its own, made from the versions that pip finds. Exit code 0: the last
    version is not worse than the first; 1: a version is; 3: fewer than two versions could be asked.
    """
    from consilience.cli.terminal import err, say
    from consilience.report.history.bisection import bisect as bisected
    from consilience.report.history.bisection import bisection_statement
    from consilience.report.statement import WRITERS

    name, versions = versions_of(engine)
    say(f"{len(versions)} versions of {name}: {', '.join(versions)}", err)
    with ExitStack() as stack:
        folder = require_folder(output, "reports") if output else Path(stack.enter_context(TemporaryDirectory()))
        ask = _asking(case, question, quick, limit, folder, stack)
        found = bisected(name, versions, ask, digits)
    sys.stdout.write(WRITERS[form](bisection_statement(found)))
    asked = sum(trial.record is not None for trial in found.trials)
    raise typer.Exit(INCOMPLETE if asked < 2 else 1 if found.first_bad else 0)


def _asking(
    case: str, question: list[str] | None, quick: bool, limit: float, folder: Path, stack: ExitStack
) -> AskVersion:
    """Return a function that asks one version, and writes its report; the answers of the reference are kept."""
    from consilience.case import load_cases
    from consilience.cli.terminal import err, say
    from consilience.report.pages import write_pages
    from consilience.report.record import read_record, write_record
    from consilience.suite import FULL, QUICK, Resources, Store, run_suite

    cases, questions = load_cases(case), chosen_questions(question)
    store = stack.enter_context(closing(Store(folder)))

    def ask(engine: str) -> Record | str:
        say(f"{engine} is asked", err)
        start = time.perf_counter()
        thoroughness = QUICK if quick else FULL
        results = run_suite(cases, [engine], questions, Resources(limit=limit), thoroughness=thoroughness, store=store)
        if engine in results.missing:
            return results.missing[engine]
        own = folder / engine.partition("@")[2]
        with writing(own):
            write_record(results, time.perf_counter() - start, own)
            write_pages(own)
        return read_record(own)

    return ask
