"""The command line: argument parsing only. Exit codes: 0 agree, 1 disagree, 2 bad input, 3 incomplete."""

from __future__ import annotations

import atexit
import gc
import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from consilience.cli.examples import EXAMPLES, START, epilog
from consilience.errors import ConsilienceError, InvalidInput, visible

if TYPE_CHECKING:
    from consilience.case import Case


class _Commands(typer.core.TyperGroup):
    """The commands; a shell that completes is shown the arguments of those that are imported when they are called."""

    def resolve_command(self, context: Any, words: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the first word names, and the words after it."""
        name, command, rest = super().resolve_command(context, words)
        if context.resilient_parsing and name in CAMPAIGNS:
            command = command_of(name)
        return name, command, rest


app = typer.Typer(
    cls=_Commands,
    help="Ask several multibody engines the same question and judge the answers.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    epilog=epilog(START),
)
CORES = os.cpu_count() or 2
out, err = Console(), Console(stderr=True)


def _cases_like(incomplete: str) -> list[str]:
    from consilience.case import cases_like

    return cases_like(incomplete)


def _engines_like(incomplete: str) -> list[str]:
    from consilience.engine import engines_like

    return engines_like(incomplete)


def _questions_like(incomplete: str) -> list[str]:
    from consilience.engine import Question

    return [str(question) for question in Question if question.startswith(incomplete)]


Cases = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CASE]...", help="Names or case files; default: all.", autocompletion=_cases_like),
]
Engines = Annotated[
    list[str] | None,
    typer.Option("-e", "--engine", help="Engine; repeat it. Default: all.", autocompletion=_engines_like),
]
Questions = Annotated[
    list[str] | None,
    typer.Option("-q", "--question", help="Question; repeat it. Default: all.", autocompletion=_questions_like),
]
Jobs = Annotated[int, typer.Option("-j", "--jobs", min=1, help="Engines that work at a time.")]
Limit = Annotated[float, typer.Option(min=0.1, help="Time limit of one job in s.")]


def _questions(names: list[str] | None) -> list[object]:
    from consilience.engine import Question

    known = [str(q) for q in Question]
    for name in names or []:
        if name not in known:
            raise InvalidInput(f"question '{name}'", "it is not one we know", f"Questions: {', '.join(known)}.")
    return [q for q in Question if not names or str(q) in names]


def _engines(names: list[str] | None) -> list[str]:
    from consilience.engine import installed, require_installed

    for name in names or []:
        require_installed(name)
    return list(dict.fromkeys(names or installed()))


def _tagged(cases: list[Case], tags: list[str] | None) -> list[Case]:
    """Cases with one of the tags, or of a group of that name."""
    for tag in tags or []:
        if not any(tag in (case.group, *case.tags) for case in cases):
            known = sorted({name for case in cases for name in (case.group, *case.tags) if name})
            raise InvalidInput(f"tag '{tag}'", "no chosen case has it", f"Tags and groups: {', '.join(known)}.")
    return [case for case in cases if not tags or set(tags) & {case.group, *case.tags}]


def _folder(path: Path) -> Path:
    if path.exists() and not path.is_dir():
        raise InvalidInput(str(path), "it is a file", "Give a folder for the report.")
    return path


@contextmanager
def _resumable(folder: Path) -> Iterator[None]:
    """Say how to go on after Ctrl-C."""
    try:
        yield
    except KeyboardInterrupt:
        err.print(f"stopped; answers so far are in {escape(str(folder))}: the same command goes on from there")
        raise typer.Exit(130) from None


@app.command(epilog=epilog(EXAMPLES["run"]))
def run(
    cases: Cases = None,
    engine: Engines = None,
    question: Questions = None,
    tag: Annotated[
        list[str] | None, typer.Option("--tag", help="Only cases with this tag or of this group; repeat it.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the report.")] = Path("consilience-report"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Few states, short motions, the headline of each engine alone.")
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Ask again what the folder has answers to.")] = False,
    jobs: Jobs = CORES,
    limit: Limit = 180.0,
    memory: Annotated[float, typer.Option(min=0.1, help="Memory that an engine may use in GiB.")] = 4.0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Engines work on the Dask cluster of this scheduler.")
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Say on stderr what happens, and when.")] = False,
) -> None:
    """Ask the questions, compare, and write report.jsonl, report.html and report.md.

    Answers are kept in the folder as they come: the same command after an interruption goes on where it was.
    """
    from consilience.case import load_cases, shipped_cases
    from consilience.cli.campaign_options import cluster_of, log_to_stderr
    from consilience.cli.progress import per_engine
    from consilience.report.pages import write_pages
    from consilience.report.record import exit_code, write_record
    from consilience.suite import FULL, QUICK, Store, run_suite

    folder = _folder(output)
    chosen = [c for name in cases for c in load_cases(name)] if cases else shipped_cases()
    chosen = _tagged(chosen, tag)
    engines, questions = _engines(engine), _questions(question)
    start, store = time.perf_counter(), Store(folder, fresh)
    if verbose:
        log_to_stderr()
    asked = list(dict.fromkeys(["reference", *engines]))
    with (
        _resumable(folder),
        cluster_of(scheduler) as cluster,
        per_engine(asked, len(chosen), err, silent=verbose) as progress,
    ):
        results = run_suite(
            chosen,
            engines,
            questions,  # type: ignore[arg-type]
            jobs=jobs,
            limit=limit,
            progress=progress,
            thoroughness=QUICK if quick else FULL,
            store=store,
            memory=int(memory * 2**30),
            cluster=cluster,
        )
    store.close()
    write_record(results, time.perf_counter() - start, folder)
    write_pages(folder)
    _print_matrix(folder)
    raise typer.Exit(exit_code(results))


def _print_matrix(folder: Path) -> None:
    from rich.table import Table

    from consilience.report.record import read_record
    from consilience.report.summary import legend, matrix

    record = read_record(folder)
    out.print("worst verdict and least digits over all questions and matched methods", highlight=False)
    table = Table()
    table.add_column("case", no_wrap=True)  # a name that is cut off names no case
    engines, rows = matrix(record)
    for name in engines:
        table.add_column(escape(visible(name)), overflow="fold")
    for case, cells in rows:
        table.add_row(escape(visible(case)), *(escape(cell) for cell in cells))
    out.print(table)
    for line in legend(record):
        out.print(escape(line), soft_wrap=True, highlight=False)
    for name, reason in record.header["missing"].items():
        err.print(f"{escape(visible(name))}: not available: {escape(visible(reason))}")
    out.print(f"report: {folder / 'report.html'}", soft_wrap=True, highlight=False)


@contextmanager
def _reference_here() -> Iterator[None]:
    """The reference works in this process: Ctrl-C ends its compiled kernels, and compiling them is no silence."""
    from numba.core.event import Event, Listener, install_listener

    class Compiling(Listener):  # type: ignore[misc]
        kernels = 0

        def on_start(self, event: Event) -> None:
            """Say which kernel is compiled; before the first, that it takes a while."""
            if self.kernels == 0:
                err.print("compiling the reference solver for this machine: about a minute, the first time only")
                status.start()
            self.kernels += 1
            status.update(f"kernel {self.kernels}: {event.data['dispatcher'].__name__}")

        def on_end(self, event: Event) -> None: ...

    status = err.status("")
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        with install_listener("numba:compile", Compiling()):
            yield
    finally:
        status.stop()
        signal.signal(signal.SIGINT, before)


@app.command(epilog=epilog(EXAMPLES["simulate"]))
def simulate(
    case: Annotated[str, typer.Argument(help="Name or case file.", autocompletion=_cases_like)],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File: .json, .npz or .csv; default: CASE.json here.")
    ] = None,
    engine: Annotated[str, typer.Option("-e", "--engine", autocompletion=_engines_like)] = "reference",
    duration: Annotated[float | None, typer.Option(help="s; default: the case's.")] = None,
    sample: Annotated[float | None, typer.Option(help="s; default: the case's.")] = None,
    limit: Limit = 600.0,
) -> None:
    """Simulate one case on one engine, by its first method at its finest level, and write the observables."""
    from consilience.case import load_case
    from consilience.report.trajectory_files import check_target, export_trajectory
    from consilience.suite import simulate_case

    if output is not None:
        check_target(output)
    chosen = load_case(case).with_span(duration, sample)
    (name,) = _engines([engine])
    with _reference_here() if name.partition(":")[0] == "reference" else nullcontext():
        answer, how = simulate_case(chosen, name, limit)
    output = output or Path(f"{chosen.name}.json")
    export_trajectory(chosen.mechanism, answer, output)
    out.print(f"{chosen.name} on {name} ({how}): {len(answer.time)} samples in {output}", soft_wrap=True)


@app.command(epilog=epilog(EXAMPLES["coverage"]))
def coverage(
    cases: Cases = None,
    engine: Engines = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Markdown file for the tables.")] = None,
) -> None:
    """Check that the uncertainty bands of all motions hold, against far finer runs of the same engines."""
    from consilience.audit import coverage as campaign
    from consilience.case import load_cases, shipped_cases

    chosen = [c for name in cases for c in load_cases(name)] if cases else shipped_cases()
    found = []
    for name in _engines(engine):
        for one in campaign.trials(chosen, name):
            found.append(one)
            err.print(f"{one.engine}, {one.case}, {one.method}", highlight=False, soft_wrap=True)
    text = campaign.table(found)
    if output is not None:
        output.write_text(text, encoding="utf-8")
    out.print(text, soft_wrap=True, highlight=False, markup=False)
    raise typer.Exit(campaign.exit_code(found))


@app.command(epilog=epilog(EXAMPLES["crosscheck"]))
def crosscheck(
    mechanisms: Annotated[int, typer.Option(help="Number of random mechanisms.")] = 200,
    states: Annotated[int, typer.Option(help="States of each.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the first mechanism; the others follow.")] = 1,
    jobs: Jobs = CORES,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Markdown file for the tables.")] = None,
) -> None:
    """Compare all formulations of the reference with one another on random mechanisms."""
    from consilience.audit.formulations.tables import main as compare_formulations

    compare_formulations(mechanisms, states, seed, None, jobs, output)


@app.command(epilog=epilog(EXAMPLES["report"]))
def report(folder: Annotated[Path, typer.Argument(help="Folder of a report.")]) -> None:
    """Render the pages of a report again from its report.jsonl."""
    from consilience.report.pages import write_pages
    from consilience.report.record import read_record

    record = read_record(folder)
    write_pages(folder)
    _print_matrix(folder)
    raise typer.Exit(record.footer["exit_code"])


@app.command(epilog=epilog(EXAMPLES["schema"]))
def schema(kind: Annotated[str, typer.Argument(help="What to describe: case.")]) -> None:
    """Print the JSON Schema of a case file."""
    from consilience.case.file.schema import case_schema

    if kind != "case":
        raise InvalidInput(f"schema '{kind}'", "there is none", "Schemas: case.")
    sys.stdout.write(json.dumps(case_schema(), indent=2) + "\n")


CAMPAIGNS = {
    "list": ("consilience.cli.commands.list_", "List the shipped cases, the families and the installed engines."),
    "doctor": ("consilience.cli.commands.doctor", "Say which engines start here, and how to mend what does not."),
    "explain": (
        "consilience.cli.commands.explain",
        "Explain a verdict, a term or a trap: the rule, the theory, where users met it.",
    ),
    "show": ("consilience.cli.commands.show", "Show a case, and draw it; --view: in motion."),
    "play": ("consilience.cli.commands.show", "Open the mechanisms of a report in motion, engines as ghosts."),
    "new": ("consilience.cli.commands.new", "Write a commented case file to start from."),
    "validate": ("consilience.cli.commands.validate", "Check cases, and say what every engine will make of them."),
    "check": ("consilience.cli.commands.check", "Check each engine alone, without a reference, against identities."),
    "fuzz": ("consilience.cli.commands.fuzz", "Judge random mechanisms on all engines, and shrink what disagrees."),
    "values": ("consilience.cli.commands.values", "Compare the reference with every expected value of the cases."),
    "diff": ("consilience.cli.commands.history", "Tell what has changed between two reports."),
    "trend": ("consilience.cli.commands.history", "Tell how the reports of a folder have changed over time."),
    "export": (
        "consilience.cli.commands.export",
        "Write a run as JUnit XML, CSV, JSON, a LaTeX table, BibTeX or a badge.",
    ),
    "plot": ("consilience.cli.commands.export", "Plot a motion on every engine, fit for a paper."),
    "import": ("consilience.cli.commands.import_model", "Write a case file from a URDF or MJCF file."),
    "translate": ("consilience.cli.commands.translate", "Write the native model of a case for an engine alone."),
    "mutate": ("consilience.cli.commands.mutate", "Plant known errors in adapters, and tell which are caught."),
}
"""Commands that parse their own arguments: module with a function of the same name, and what they do."""
RESERVED = ("list",)
"""Commands whose function has an underscore because Python's own name is not to be hidden; so have keywords."""


def command_of(name: str) -> Any:
    """The command of a name with its own arguments, as Typer has it; a KeyError where there is none."""
    if name not in CAMPAIGNS:
        return typer.main.get_group(app).commands[name]
    own = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    function = f"{name}_" if iskeyword(name) or name in RESERVED else name
    own.command(epilog=epilog(EXAMPLES[name]))(getattr(import_module(CAMPAIGNS[name][0]), function))
    return typer.main.get_command(own)


def _delegate(name: str) -> None:
    """Make a command that imports its module when it is called, so that the help of all appears at once."""

    def command(context: typer.Context) -> None:
        code = command_of(name).main(context.args, f"consilience {name}", standalone_mode=False)
        raise typer.Exit(code or 0)

    settings = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
    app.command(name, help=CAMPAIGNS[name][1], context_settings=settings)(command)


for _name in CAMPAIGNS:
    _delegate(_name)


_COLLECT_AFTER = 50_000
"""Objects made before garbage is looked for. After Python's own few hundred, it is looked for again and again while
modules are imported, which make next to none: an eighth of a short command."""


def main() -> None:
    """Entry point: bad input is one clear message and exit code 2, never a traceback."""
    gc.set_threshold(_COLLECT_AFTER)
    atexit.register(gc.freeze)  # at the end garbage is not looked for once more: the system takes all there is
    # one thread per engine: the comparison is about answers, and timings must not depend on idle cores
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    try:
        app()
    except ConsilienceError as error:
        err.print(f"consilience: {escape(str(error))}", style="red", soft_wrap=True, highlight=False)
        sys.exit(2)
