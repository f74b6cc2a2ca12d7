"""Terminal output: consoles, tables, live progress, and the log of a verbose command."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pydantic_core import to_json
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from consilience.errors import visible
from consilience.report.columns import columns, tables_as_columns, wrapped

if TYPE_CHECKING:
    from consilience.report.statement import Statement

out, err = Console(), Console(stderr=True)

BAR = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
BAR_OF_ENGINE = (*BAR, TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.fields[last]}"))


def say(text: str, console: Console = out, style: str | None = None) -> None:
    """Print text without highlights: in a terminal wrapped at blanks, into a file or a pipe as it is."""
    shown = wrapped(text, console.width) if console.is_terminal else text
    console.print(shown, soft_wrap=True, highlight=False, markup=False, style=style)


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> None:
    """Print a table with a title, no wider than the terminal."""
    cells = [[visible(cell) for cell in row] for row in rows]
    say(f"{title}\n{columns([visible(head) for head in heads], cells, out.width)}")


def print_tables(markdown: str, form: str) -> None:
    """Print a Markdown text as it is, or as text with its tables in columns."""
    say(tables_as_columns(markdown, out.width) if form == "text" else markdown)


def write_json(data: object) -> None:
    """Write data to standard output as JSON; numbers that are not finite are null."""
    sys.stdout.write(to_json(data, indent=2, inf_nan_mode="null", fallback=str).decode() + "\n")


def state(statement: Statement, form: str) -> None:
    """Write a statement to standard output in a format."""
    from consilience.report.statement import WRITERS

    sys.stdout.write(WRITERS[form](statement))


def print_missing(missing: Mapping[str, str]) -> None:
    """Print to standard error the engines that did not start, and the reasons."""
    for name, reason in missing.items():
        say(visible(f"{name}: not available: {reason}"), err)


def progress_bar(silent: bool = False) -> Progress:
    """Return a progress bar on standard error; a silent bar draws nothing."""
    return Progress(*BAR, console=err, disable=silent)


@contextmanager
def progress_per_engine(
    engines: Sequence[str], cases: int, console: Console = err, *, silent: bool = False
) -> Iterator[Callable[[str, str], None]]:
    """Show a progress bar for each engine while the block runs.

    Parameters
    ----------
    engines : sequence of str
    cases : int
        Number of cases of each engine.
    console : Console
    silent : bool
        Draw nothing: a log goes to the same terminal.

    Yields
    ------
    callable
        To be called with the engine and the case that the engine has just finished.
    """
    with Progress(*BAR_OF_ENGINE, console=console, disable=silent) as bar:
        tasks = {name: bar.add_task(name, total=cases, last="") for name in engines}

        def advance(engine: str, case: str) -> None:
            bar.update(tasks[engine], advance=1, last=case)

        yield advance


class _OneLineFormatter(logging.Formatter):
    """Formatter that writes each message on one line, control characters written out."""

    def format(self, record: logging.LogRecord) -> str:
        return visible(super().format(record)).replace("\n", "\\n")


def log_to_stderr() -> None:
    """Log to standard error what workers and the schedule do, with the time of day."""
    handler = logging.StreamHandler()
    handler.setFormatter(_OneLineFormatter("%(asctime)s.%(msecs)03d %(message)s", "%H:%M:%S"))
    log = logging.getLogger("consilience")
    log.setLevel(logging.DEBUG)
    log.handlers = [handler]
