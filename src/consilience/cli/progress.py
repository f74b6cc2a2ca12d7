"""Live progress of a run: a line for each engine, with the case it has just finished and the time that is left."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

COLUMNS = (
    TextColumn("{task.description}"),
    BarColumn(),
    MofNCompleteColumn(),
    TimeElapsedColumn(),
    TextColumn("left"),
    TimeRemainingColumn(),
    TextColumn("{task.fields[last]}"),
)


@contextmanager
def per_engine(
    engines: Sequence[str], cases: int, console: Console, *, silent: bool = False
) -> Iterator[Callable[[str, str], None]]:
    """Show progress while the block runs.

    Parameters
    ----------
    engines : sequence of str
    cases : int
        How many each of them has to do.
    console : Console
    silent : bool
        Draw nothing: a log goes to the same terminal.

    Yields
    ------
    callable
        To be called with an engine and the case it has just finished.
    """
    with Progress(*COLUMNS, console=console, disable=silent) as bar:
        tasks = {name: bar.add_task(name, total=cases, last="") for name in engines}

        def advance(engine: str, case: str) -> None:
            bar.update(tasks[engine], advance=1, last=case)

        yield advance
