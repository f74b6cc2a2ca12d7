"""Plot of many motions: bands of a coordinate over time, and beside them the effects of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.report.exports.motionplot import PANEL, TOP, WIDTH
from consilience.report.exports.plot import DASHES, SETTINGS, drawing_tools
from consilience.report.figure import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Panel(NamedTuple):
    """One coordinate of all sets."""

    name: str
    unit: str
    values: Array  # (n, n_t)
    effects: Mapping[str, Array]  # of parameters, (n_t,)


def study_figure(time: Array, panels: Sequence[Panel], title: str) -> Figure:
    """Draw a row for each coordinate: minimum to maximum, quartiles and median; effects of the parameters.

    Raises
    ------
    InvalidInput
        Matplotlib is not installed.
    """
    settings, figures = drawing_tools()
    columns = 2 if any(panel.effects for panel in panels) else 1
    with settings(SETTINGS):
        figure = figures(figsize=(WIDTH * (0.5 + 0.5 * columns), TOP + 1.3 * PANEL * len(panels)), layout="constrained")
        axes = figure.subplots(len(panels), columns, sharex=True, squeeze=False)
        figure.suptitle(title, fontsize=8.0)
        for row, panel in zip(axes, panels, strict=True):
            low, first, median, third, high = np.quantile(panel.values, (0.0, 0.25, 0.5, 0.75, 1.0), axis=0)
            row[0].fill_between(time, low, high, color=COLOURS[0], alpha=0.2, linewidth=0.0, label="all sets")
            row[0].fill_between(time, first, third, color=COLOURS[0], alpha=0.4, linewidth=0.0, label="middle half")
            row[0].plot(time, median, color=COLOURS[0], label="median")
            row[0].set_ylabel(f"{panel.name} [{panel.unit}]")
            for n, (name, effect) in enumerate(panel.effects.items()):
                style = {"color": COLOURS[n % len(COLOURS)], "linestyle": DASHES[n % len(DASHES)]}
                row[1].plot(time, effect, label=name, **style)
            if columns > 1:
                row[1].set_ylabel(f"[{panel.unit}]")
        axes[0, 0].legend()
        if columns > 1:
            axes[0, 1].set_title("effect of one standard deviation", fontsize=8.0)
            axes[0, 1].legend()
        for last in axes[-1]:
            last.set_xlabel("time [s]")
    return figure
