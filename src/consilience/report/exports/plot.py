"""Plots of a motion fit for a paper: every engine against the reference, as SVG, PDF or PNG.

Drawn by Matplotlib, which needs no browser: text as outlines, the same bytes for the same record. Engines differ by
colour, dashes and marker at once, so that a print in grey can be read.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from consilience.errors import InvalidInput
from consilience.report.exports.digest import REFERENCE
from consilience.report.figure import COLOURS
from consilience.report.record import Record
from consilience.report.selection import is_matched, judged_largest, mean_step, method_of, motions_of
from consilience.report.wording import order_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMATS = ("svg", "pdf", "png")

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
"""Inches: one and a half columns of a journal, and what an entry of the legend below adds."""

Motion = dict[str, Any]


@dataclass(frozen=True)
class Kind:
    """A kind of plot.

    Attributes
    ----------
    points : callable
        Abscissas and ordinates of a motion, of its method and of its case; None where there is none.
    over_time : bool
        One line a motion; else one marker a level, both axes logarithmic.
    asked : bool
        Whether the digits asked are on the axis upwards.
    """

    across: str
    upwards: str
    points: Callable[[Motion, dict[str, Any], dict[str, Any]], Iterator[tuple[float | None, float | None]]]
    over_time: bool
    asked: bool


def _over_time(name: str) -> Callable[[Motion, dict[str, Any], dict[str, Any]], Iterator[tuple[float, float | None]]]:
    def points(motion: Motion, method: dict[str, Any], case: dict[str, Any]) -> Iterator[tuple[float, float | None]]:
        yield from zip(motion["times"], motion["levels"][-1][name], strict=True)

    return points


def _over_step(
    motion: Motion, method: dict[str, Any], case: dict[str, Any]
) -> Iterator[tuple[float | None, float | None]]:
    for level in motion["levels"]:
        yield mean_step(level, method, case["duration"]), judged_largest(motion, level)


def _over_work(
    motion: Motion, method: dict[str, Any], case: dict[str, Any]
) -> Iterator[tuple[float | None, float | None]]:
    for level in motion["levels"]:
        yield level["cpu"], judged_largest(motion, level)


_DIFFERENCE = "largest difference to the reference"
KINDS: dict[str, Kind] = {
    "difference": Kind("time in s", "difference to the reference", _over_time("difference"), True, True),
    "convergence": Kind("step in s", _DIFFERENCE, _over_step, False, True),
    "energy": Kind("time in s", "|energy change| / largest kinetic energy", _over_time("energy"), True, False),
    "work-precision": Kind("CPU time in s", _DIFFERENCE, _over_work, False, True),
}
"""What can be drawn, by the word of ``--what``."""


@dataclass(frozen=True)
class Line:
    """A motion as it is drawn: what a logarithmic axis cannot show is left out."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]


def plotted(record: Record, case: str, what: str, form: str) -> bytes:
    """Plot of a case as the bytes of a file.

    Parameters
    ----------
    what : str
        A key of `KINDS`.
    form : str
        One of `FORMATS`.

    Raises
    ------
    InvalidInput
        If the record has no such case, no motion of it, or Matplotlib is not installed.
    """
    try:
        from matplotlib import rc_context  # noqa: PLC0415 - an extra: only a plot needs it
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError:
        raise InvalidInput(
            "Matplotlib",
            "it is not installed, and draws the plots",
            "Install the extra: pip install 'consilience[plot]'.",
        ) from None
    about = _case(record, case)
    drawn, motions = lines(record, about, KINDS[what]), motions_of(case, record.comparisons)
    with rc_context(SETTINGS):
        figure = Figure(figsize=(WIDTH, HEIGHT + ENTRY * len(drawn)), layout="constrained")
        axes = figure.subplots()
        _draw(axes, KINDS[what], drawn)
        _mark(axes, KINDS[what], about, motions[0])
        figure.legend(loc="outside lower left")
        target = io.BytesIO()
        # no date: the same record makes the same file
        figure.savefig(target, format=form, dpi=300, metadata={"Title": f"{case}: {what}"} | _undated(form))
    return target.getvalue()


def _undated(form: str) -> dict[str, None]:
    return {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(form, {})


def _case(record: Record, name: str) -> dict[str, Any]:
    for case in record.cases:
        if case["name"] == name:
            return case
    known = ", ".join(case["name"] for case in record.cases)
    raise InvalidInput(f"case '{name}'", "it is not in this run", f"Cases: {known}.")


def lines(record: Record, case: dict[str, Any], kind: Kind) -> list[tuple[int, Line]]:
    """Lines of the motions with matched settings, each with the number of its engine."""
    names = [name for name in record.header["engines"] if name != REFERENCE]
    found = []
    for motion in motions_of(case["name"], record.comparisons):
        if motion["engine"] not in names or not is_matched(motion):
            continue
        method = method_of(record.runs_of(motion))
        shown = [(x, abs(y)) for x, y in kind.points(motion, method, case) if x is not None and y]
        if shown:
            label = f"{motion['engine']}: {motion['method']}"
            if not kind.over_time and motion["order"] is not None:
                label += f", order {order_text(motion['order'])}"
            x, y = zip(*shown, strict=True)
            found.append((names.index(motion["engine"]), Line(label, x, y)))
    if not found:
        raise InvalidInput(
            f"case '{case['name']}'",
            "no motion of an engine was compared",
            "Run it with the question `trajectory`, on an engine that can simulate it.",
        )
    return sorted(found, key=lambda pair: pair[0])


def _draw(axes: Axes, kind: Kind, lines: list[tuple[int, Line]]) -> None:
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
    """Plain numbers at 1, 2, 5 where there are few powers of ten, instead of labels that run into one another."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: PLC0415 - an extra

    least, most = axes.get_xlim()
    axes.xaxis.set_minor_formatter(NullFormatter())
    if most < 50.0 * least:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _mark(axes: Axes, kind: Kind, case: dict[str, Any], motion: Motion) -> None:
    """What was asked, how certain the reference is, and what lies beyond the horizon."""
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
