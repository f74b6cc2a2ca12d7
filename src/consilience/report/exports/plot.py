"""Plots of a motion for a paper: every engine against the reference, as SVG, PDF or PNG.

Matplotlib draws without a browser: text is outlines, and the same record gives the same bytes. Engines differ by
colour, dashes and marker at once, so that a plot can be read in grey.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from consilience.compare.judge import REFERENCE
from consilience.errors import InvalidInput, nearest
from consilience.report.figure import COLOURS
from consilience.report.record import Record
from consilience.report.selection import is_matched, judged_largest, mean_step, method_of
from consilience.report.wording import order_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNDATED: dict[str, dict[str, None]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
"""Formats of a file, and the metadata that leave out its date."""

DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)))
MARKERS = ("o", "s", "D", "^", "v", "x", "P")
GREY = "#6e6e6e"

SETTINGS: Any = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "lines.markersize": 4.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "svg.hashsalt": "consilience",
    "pdf.fonttype": 42,
}
WIDTH, HEIGHT, ENTRY = 4.8, 3.0, 0.15
"""Size in inches, one and a half columns of a journal, and height of an entry of the legend below."""

Points = Iterator[tuple[float | None, float | None]]


@dataclass(frozen=True)
class PlotKind:
    """A kind of plot.

    Attributes
    ----------
    across, upwards : str
        Titles of the axes.
    points : callable
        Function from the comparison of a motion, its method and its case to abscissas and ordinates; None: no value.
    over_time : bool
        Whether a motion is a line over time; else it has a marker for each level, on two logarithmic axes.
    asked : bool
        Whether the digits asked can be shown on the axis upwards.
    """

    across: str
    upwards: str
    points: Callable[[dict[str, Any], dict[str, Any], dict[str, Any]], Points]
    over_time: bool
    asked: bool


def _over_time(name: str) -> Callable[[dict[str, Any], dict[str, Any], dict[str, Any]], Points]:
    """Return the points of a field of the finest level over time."""
    return lambda motion, _method, _case: zip(motion["times"], motion["levels"][-1][name], strict=True)


def _over_step(motion: dict[str, Any], method: dict[str, Any], case: dict[str, Any]) -> Points:
    return ((mean_step(level, method, case["duration"]), judged_largest(motion, level)) for level in motion["levels"])


def _over_work(motion: dict[str, Any], _method: dict[str, Any], _case: dict[str, Any]) -> Points:
    return ((level["cpu"], judged_largest(motion, level)) for level in motion["levels"])


_DIFFERENCE = "largest difference to the reference"
PLOTS: dict[str, PlotKind] = {
    "difference": PlotKind("time in s", "difference to the reference", _over_time("difference"), True, True),
    "convergence": PlotKind("step in s", _DIFFERENCE, _over_step, False, True),
    "energy": PlotKind("time in s", "|energy change| / largest kinetic energy", _over_time("energy"), True, False),
    "work-precision": PlotKind("CPU time in s", _DIFFERENCE, _over_work, False, True),
}
"""Kinds of plots by the value of ``--what``."""


@dataclass(frozen=True)
class PlottedMotion:
    """The points of a motion, without those that a logarithmic axis cannot show."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]


def drawing_tools() -> tuple[Callable[..., AbstractContextManager[None]], type[Figure]]:
    """Return Matplotlib's context of settings and its class of figures.

    Raises
    ------
    InvalidInput
        Matplotlib is not installed.
    """
    try:
        from matplotlib import rc_context  # noqa: PLC0415 - an extra: only a plot needs it

        from consilience.report.exports.notebookfigure import NotebookFigure  # noqa: PLC0415
    except ImportError:
        remedy = "Install the extra: pip install 'consilience[plot]'."
        raise InvalidInput("Matplotlib", "it is not installed, and draws the plots", remedy) from None
    return rc_context, NotebookFigure


def plotted(record: Record, case: str, what: str, form: str) -> bytes:
    """Plot a case, and return the bytes of the file.

    Parameters
    ----------
    record : Record
    case : str
        Name of the case.
    what : str
        A key of `PLOTS`.
    form : str
        A key of `UNDATED`.

    Raises
    ------
    InvalidInput
        If the record has no such case, no motion of it, or Matplotlib is not installed.
    """
    settings, figures = drawing_tools()
    cases = {one["name"]: one for one in record.cases}
    if case not in cases:
        raise InvalidInput(f"case '{case}'", "it is not in this run", nearest(case, cases, "Cases"))
    drawn, motions = lines(record, cases[case], PLOTS[what]), record.motions(case)
    with settings(SETTINGS):
        figure = figures(figsize=(WIDTH, HEIGHT + ENTRY * len(drawn)), layout="constrained")
        axes = figure.subplots()
        _draw(axes, PLOTS[what], drawn)
        _mark(axes, PLOTS[what], cases[case], motions[0])
        figure.legend(loc="outside lower left")
        target = io.BytesIO()
        # without a date the same record gives the same file
        figure.savefig(target, format=form, dpi=300, metadata={"Title": f"{case}: {what}"} | UNDATED[form])
    return target.getvalue()


def lines(record: Record, case: dict[str, Any], kind: PlotKind) -> list[tuple[int, PlottedMotion]]:
    """List the motions with matched settings, each with the number of its engine."""
    names = [name for name in record.header["engines"] if name != REFERENCE]
    found = []
    for motion in record.motions(case["name"]):
        if motion["engine"] not in names or not is_matched(motion):
            continue
        method = method_of(record.runs_of(motion))
        shown = [(x, abs(y)) for x, y in kind.points(motion, method, case) if x is not None and y]
        if shown:
            label = f"{motion['engine']}: {motion['method']}"
            if not kind.over_time and motion["order"] is not None:
                label += f", order {order_text(motion['order'])}"
            x, y = zip(*shown, strict=True)
            found.append((names.index(motion["engine"]), PlottedMotion(label, x, y)))
    if not found:
        raise InvalidInput(
            f"case '{case['name']}'",
            "no motion of an engine was compared",
            "Run it with the question `trajectory`, on an engine that can simulate it.",
        )
    return sorted(found, key=lambda pair: pair[0])


def _draw(axes: Axes, kind: PlotKind, lines: list[tuple[int, PlottedMotion]]) -> None:
    seen: dict[int, int] = {}
    for engine, line in lines:
        nth = seen[engine] = seen.get(engine, -1) + 1
        axes.plot(
            line.x,
            line.y,
            label=line.label,
            color=COLOURS[engine % len(COLOURS)],
            linestyle=DASHES[engine % len(DASHES)],
            marker=MARKERS[engine % len(MARKERS)],
            markevery=max(1, len(line.x) // 8),
            # methods of one engine: filled, then hollow
            markerfacecolor=COLOURS[engine % len(COLOURS)] if nth == 0 else "white",
        )
    axes.set_xlabel(kind.across)
    axes.set_ylabel(kind.upwards)
    axes.set_yscale("log")
    if not kind.over_time:
        axes.set_xscale("log")
        _label(axes)
    axes.grid(visible=True, which="major", color="#d9d9d9", linewidth=0.5)
    axes.set_axisbelow(True)


def _label(axes: Axes) -> None:
    """Label 1, 2 and 5 times powers of ten as plain numbers on an axis of few decades: labels must not overlap."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: PLC0415 - an extra

    least, most = axes.get_xlim()
    axes.xaxis.set_minor_formatter(NullFormatter())
    if most < 50.0 * least:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _mark(axes: Axes, kind: PlotKind, case: dict[str, Any], motion: dict[str, Any]) -> None:
    """Mark the digits asked, the uncertainty of the reference, and the time beyond the horizon."""
    if kind.asked:
        axes.axhline(10.0 ** -case["digits"], color=GREY, linestyle="--", linewidth=0.8, label="asked")
        if motion["reference_spread"]:
            axes.axhline(
                motion["reference_spread"],
                color=GREY,
                linestyle=":",
                linewidth=0.8,
                label="uncertainty of the reference",
            )
    if kind.over_time and motion["horizon"] is not None:
        start = motion["times"][0] + motion["horizon"]
        axes.axvspan(start, motion["times"][-1], color="#e6e6e6", hatch="///", label="beyond the horizon")
