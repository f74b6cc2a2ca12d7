"""Plots of a motion for papers: curves over time in panels above one another, as SVG, PDF or PNG.

A panel whose peak is not settled says by how much it may be off. Components differ by colour and dashes at once.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from consilience.errors import InvalidInput
from consilience.report.curves import CurveSet
from consilience.report.exports.plot import DASHES, SETTINGS, UNDATED, drawing_tools
from consilience.report.figure import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, TOP, PANEL = 6.0, 0.7, 1.5
"""Width of a plot, height of its margins and of a panel, inches."""


def motion_figure(curves: CurveSet) -> Figure:
    """Draw curves in panels; a legend stands beside each panel of several curves.

    Raises
    ------
    InvalidInput
        Matplotlib is not installed.
    """
    settings, figures = drawing_tools()
    panels, marks = curves.by_panel(), curves.marks
    with settings(SETTINGS):
        figure = figures(figsize=(WIDTH, TOP + PANEL * len(panels)), layout="constrained")
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (name, own) in zip(axes, panels.items(), strict=True):
            for n, k in enumerate(own):
                style = {"color": COLOURS[n % len(COLOURS)], "linestyle": DASHES[n % len(DASHES)]}
                panel.plot(curves.time, curves.values[:, k], label=curves.names[k].label, **style)
            panel.set_ylabel(f"{name} [{curves.names[own[0]].unit}]")
            panel.set_title(marks.get(name, ""), loc="left", fontsize=7.0)
            if len(own) > 1:
                panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        left_out = f"; the first {len(panels)} of {curves.panels} panels" if curves.panels > len(panels) else ""
        axes[-1].set_xlabel(f"time [s]{left_out}")
    return figure


def motion_plot(curves: CurveSet, title: str, form: str) -> bytes:
    """Draw curves, and return the bytes of the file; `form` is a key of `plot.UNDATED`."""
    figure, target = motion_figure(curves), io.BytesIO()
    settings, _ = drawing_tools()
    with settings(SETTINGS):
        # without a date the same record gives the same file
        figure.savefig(target, format=form, dpi=300, metadata={"Title": f"{title}: {curves.what}"} | UNDATED[form])
    return target.getvalue()


def one_kind(found: list[CurveSet], what: str, case: str) -> CurveSet:
    """Return the curves of a kind.

    Raises
    ------
    InvalidInput
        There are none.
    """
    own = [one for one in found if one.what == what]
    if not own:
        known = ", ".join(one.what for one in found) or "none: the motion is missing"
        raise InvalidInput(f"case '{case}'", f"its motion has no {what} to draw", f"There are: {known}.")
    return own[0]
