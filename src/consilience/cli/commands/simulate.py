"""The command ``consilience simulate``."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from consilience.cli.options import (
    CaseName,
    EngineName,
    Form,
    JobLimit,
    OutputFormat,
    chosen_engines,
    chosen_profile,
    require_ending,
    require_place,
    writing,
)

if TYPE_CHECKING:
    from consilience.case import Case
    from consilience.engine import Profile, TrajectoryAnswer


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
    method: Annotated[
        str | None, typer.Option("-m", "--method", help="Method of the engine; default: its first one.")
    ] = None,
    profile: Annotated[str, typer.Option(help="matched, or default: the engine's own settings.")] = "matched",
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the motion as well: a file for each kind of curves."),
    ] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Simulate one case by one method of an engine at its finest level, and write the observables."""
    from consilience.case import load_case
    from consilience.cli.terminal import state
    from consilience.report.contact_values import open_in_words
    from consilience.report.statement import Statement
    from consilience.report.trajectory_files import check_target, export_trajectory
    from consilience.suite import simulate_case

    if output is not None:
        check_target(output)
    require_place(output)
    if plot is not None:
        require_ending(plot, "plot", ".svg", ".pdf", ".png")
    chosen = load_case(case).with_span(duration, sample)
    (name,) = chosen_engines([engine])
    asked = chosen_profile(profile)
    with _reference_in_this_process() if name.partition(":")[0] == "reference" else nullcontext():
        answer, how = simulate_case(chosen, name, limit, method, asked)
        plots = [] if plot is None else _write_plots(chosen, name, plot, (answer, method, asked, limit))
    output = output or Path(f"{chosen.name}.json")
    with writing(output):
        export_trajectory(chosen.mechanism, answer, output)
    data = {"case": chosen.name, "engine": name, "how": how, "samples": len(answer.time), "file": str(output)}
    data |= {"plots": [str(target) for target in plots]} if plots else {}
    told = f"{chosen.name} on {name} ({how}): {len(answer.time)} samples in {output}"
    undetermined = open_in_words(chosen.mechanism, answer)
    data |= {"open": undetermined} if undetermined else {}
    state(Statement([told, *undetermined, *(f"plot: {target}" for target in plots)], [], data), form)


def _write_plots(
    case: Case, engine: str, path: Path, asked: tuple[TrajectoryAnswer, str | None, Profile, float]
) -> list[Path]:
    """Draw every kind of curves of a motion, each in a file that ends in its name.

    The reference has a dense solution, whose samples cost nothing; an engine would take other steps between others.
    """
    from consilience.report.curves import curve_sets
    from consilience.report.exports.motionplot import motion_plot
    from consilience.suite import densely_sampled, simulate_case

    answer, method, profile, limit = asked
    if engine.partition(":")[0] == "reference":
        answer, _ = simulate_case(densely_sampled(case), engine, limit, method, profile)
    targets = []
    for curves in curve_sets(case.mechanism, answer):
        targets.append(path.with_stem(f"{path.stem}-{curves.what}"))
        with writing(targets[-1]):
            targets[-1].write_bytes(motion_plot(curves, case.name, path.suffix[1:]))
    return targets
