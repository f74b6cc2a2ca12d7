"""The program ``consilience`` and its commands. Exit codes: 0 agree, 1 disagree, 2 bad input, 3 incomplete."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from importlib import import_module
from typing import Annotated, Any

import typer

from consilience.cli.examples import EXAMPLES, START, epilog
from consilience.errors import ConsilienceError

LAZY_COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("run.run", "Ask the questions, compare, and write report.jsonl, report.html and report.md."),
    "simulate": (
        "simulate.simulate",
        "Simulate one case on one engine, by its first method at its finest level, and write the observables.",
    ),
    "coverage": (
        "coverage.coverage",
        "Check that the uncertainty bands of all motions hold, against finer runs of the same engines.",
    ),
    "crosscheck": (
        "crosscheck.crosscheck",
        "Compare all formulations of the reference with one another on random mechanisms.",
    ),
    "report": ("report.report", "Render the pages of a report again from its report.jsonl."),
    "schema": ("schema.schema", "Print the JSON Schema of a case file."),
    "list": ("list_.list_", "List the shipped cases, the families and the installed engines."),
    "doctor": ("doctor.doctor", "Say which engines start here, and how to mend what does not."),
    "explain": ("explain.explain", "Explain a verdict, a term or a trap: the rule, the theory, where users met it."),
    "show": ("show.show", "Show a case, and draw it; --view: in motion."),
    "play": ("show.play", "Open the mechanisms of a report in motion, engines as ghosts."),
    "new": ("new.new", "Write a commented case file to start from."),
    "validate": ("validate.validate", "Check cases, and say what every engine will make of them."),
    "check": ("check.check", "Check each engine alone, without a reference, against identities."),
    "fuzz": ("fuzz.fuzz", "Judge random mechanisms on all engines, and shrink what disagrees."),
    "values": ("values.values", "Compare the reference with every expected value of the cases."),
    "diff": ("history.diff", "Tell what has changed between two reports."),
    "trend": ("history.trend", "Tell how the reports of a folder have changed over time."),
    "bisect": (
        "bisect.bisect",
        "Find the first version of an engine whose answers are worse than those of an earlier one.",
    ),
    "site": (
        "site.site",
        "Write a static site of many reports: an address for every cell, its history, scores, badges.",
    ),
    "export": ("export.export", "Write a run as JUnit XML, CSV, JSON, a LaTeX table, BibTeX or a badge."),
    "plot": ("export.plot", "Plot a motion on every engine, fit for a paper."),
    "import": ("import_model.import_", "Write a case file from a URDF or MJCF file."),
    "translate": ("translate.translate", "Write the native model of a case for an engine alone."),
    "mutate": ("mutate.mutate", "Plant known errors in adapters, and tell which are caught."),
}
"""Module and function of each command in `consilience.cli.commands`, and its line in the list of commands."""

COLLECTOR_THRESHOLD = 50_000
"""Allocations between two runs of the garbage collector, since imports allocate many objects and hardly any garbage."""


def command_of(name: str) -> Any:
    """Import a command and return it as Typer's command with its own arguments; KeyError for an unknown name."""
    module, function = LAZY_COMMANDS[name][0].split(".")
    own = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    own.command(epilog=epilog(EXAMPLES[name]))(getattr(import_module(f"consilience.cli.commands.{module}"), function))
    return typer.main.get_command(own)


class _LazyCommand(typer.core.TyperCommand):
    """A command that is imported when it is called: the list of all commands needs none of them."""

    def get_short_help_str(self, limit: int = 0) -> str:
        """Return the whole help for the list of commands, which wraps it."""
        return self.help or ""

    def parse_args(self, context: Any, words: list[str]) -> list[str]:
        """Leave all words to the command itself."""
        context.args = words
        return []

    def invoke(self, context: Any) -> None:
        """Import the command, call it with all words, and end with its exit code."""
        code = command_of(context.info_name).main(context.args, context.command_path, standalone_mode=False)
        raise typer.Exit(code or 0)


class _Commands(typer.core.TyperGroup):
    """The group of all commands; completion in a shell imports the command whose arguments it completes."""

    def parse_args(self, context: Any, words: list[str]) -> list[str]:
        """Ask for help where there is no word."""
        return super().parse_args(context, words or ["--help"])

    def format_help(self, context: Any, formatter: Any) -> None:
        """Write plain help, as the commands do: it is there in half the time. Errors keep their frames."""
        self.rich_markup_mode = None
        super().format_help(context, formatter)

    def resolve_command(self, context: Any, words: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return name and command of the first word, and the words after it."""
        name, command, rest = super().resolve_command(context, words)
        if context.resilient_parsing and name in LAZY_COMMANDS:
            command = command_of(name)
        return name, command, rest


def _tell_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version as version_of

        typer.echo(f"consilience {version_of('consilience')}")
        raise typer.Exit


app = typer.Typer(
    cls=_Commands,
    help="Ask several multibody engines the same question and judge the answers.",
    pretty_exceptions_enable=False,
    epilog=epilog(START),
)
for _name, (_, _help) in LAZY_COMMANDS.items():
    app.command(_name, cls=_LazyCommand, help=_help)(lambda: None)


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_tell_version, help="Print the version, and end.")
    ] = False,
) -> None:
    del version


def main() -> None:
    """Run the program: bad input is one clear message and exit code 2, never a traceback."""
    gc.set_threshold(COLLECTOR_THRESHOLD)
    atexit.register(gc.freeze)  # no collection at exit: the operating system frees all memory
    # one thread for each engine: CPU times must not depend on the number of idle cores
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # signs that the encoding of a locale lacks end no command
    try:
        app()
    except ConsilienceError as error:
        from consilience.cli.terminal import err, say

        say(f"consilience: {error}", err, "red")
        sys.exit(2)
