"""The command ``consilience simulate``."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated

import typer

from consilience.cli.options import CaseName, EngineName, Form, JobLimit, OutputFormat, chosen_engines


@contextmanager
def _reference_in_this_process() -> Iterator[None]:
    """Say whether kernels of the reference are to be compiled, and let Ctrl-C end them."""
    from consilience.reference.kernel.cache import announce_compilation

    announce_compilation()
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def simulate(
    case: CaseName,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File: .json, .npz or .csv; default: CASE.json here.")
    ] = None,
    engine: EngineName = "reference",
    duration: Annotated[float | None, typer.Option(help="s; default: the case's.")] = None,
    sample: Annotated[float | None, typer.Option(help="s; default: the case's.")] = None,
    limit: JobLimit = 600.0,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Simulate one case on one engine, by its first method at its finest level, and write the observables."""
    from consilience.case import load_case
    from consilience.cli.terminal import state
    from consilience.report.statement import Statement
    from consilience.report.trajectory_files import check_target, export_trajectory
    from consilience.suite import simulate_case

    if output is not None:
        check_target(output)
    chosen = load_case(case).with_span(duration, sample)
    (name,) = chosen_engines([engine])
    with _reference_in_this_process() if name.partition(":")[0] == "reference" else nullcontext():
        answer, how = simulate_case(chosen, name, limit)
    output = output or Path(f"{chosen.name}.json")
    export_trajectory(chosen.mechanism, answer, output)
    data = {"case": chosen.name, "engine": name, "how": how, "samples": len(answer.time), "file": str(output)}
    state(Statement([f"{chosen.name} on {name} ({how}): {len(answer.time)} samples in {output}"], [], data), form)
