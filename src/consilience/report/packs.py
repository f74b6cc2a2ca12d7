"""Packs of the HTML page: texts that its script unpacks, each line of the pages and each curve stored once.

gzip looks 32 kB back, less than a page is long: what pages share, it would store again. Curves are rounded to what a
screen and the labels of a plot can show.
"""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from consilience.report.figure import Figure

LEVELS = 10000
"""Number of levels from zero to the largest magnitude of a curve on a linear axis."""

LOG_LEVEL = 0.001
"""Distance of the levels of a curve on a logarithmic axis, in decimal digits: 0.23 %."""


def packed(text: str) -> Markup:
    """Compress text for a script element that the page unpacks; base64 cannot end the element."""
    return Markup(b64encode(gzip.compress(text.encode(), compresslevel=6, mtime=0)).decode())


def packed_json(value: object) -> Markup:
    """Compress a value as JSON, as `packed`."""
    return packed(json.dumps(value, separators=(",", ":"), allow_nan=False))


def packed_pages(pages: Iterable[tuple[str, str]]) -> Markup:
    """Compress pages, given by anchor and HTML: all lines once, and the numbers of the lines of each page."""
    numbers = dict[str, int]()
    found = {name: [numbers.setdefault(line, len(numbers)) for line in text.split("\n")] for name, text in pages}
    return packed_json({"lines": list(numbers), "pages": found})


def packed_figures(figures: Mapping[str, Figure]) -> Markup:
    """Compress figures: all curves once, and in place of each the number of its curve."""
    numbers = dict[tuple[Any, ...], int]()
    found = {}
    for name, figure in figures.items():
        data = []
        for trace in figure["data"]:
            own = {axis: _curve(trace, axis, figure["layout"]) for axis in ("x", "y") if axis in trace}
            data.append(trace | {axis: numbers.setdefault(curve, len(numbers)) for axis, curve in own.items()})
        found[name] = figure | {"data": data}
    curves = [{"log": log, "level": level, "changes": changes} for log, level, changes in numbers]
    return packed_json({"curves": curves, "figures": found})


def _curve(trace: Figure, axis: str, layout: Figure) -> tuple[bool, float, tuple[int | None, ...]]:
    """Return a coordinate of a trace: whether its axis is logarithmic, the level, and changes between samples."""
    place = trace.get(f"{axis}axis", axis)
    log = layout[f"{axis}axis{place[1:]}"].get("type") == "log"
    return log, *levels(trace[axis], log)


def levels(values: Sequence[float | None], log: bool) -> tuple[float, tuple[int | None, ...]]:
    """Round numbers, or their decimal logarithms, to whole levels.

    Returns
    -------
    level : float
        Distance of the levels.
    changes : tuple of int or None
        Change to each number from the one before it, from zero to the first, in levels; None for a gap.
    """
    given = np.array(values, dtype=float)  # None becomes nan
    known = np.isfinite(given) & ((given > 0.0) | (not log))
    own = np.log10(given[known]) if log else given[known]
    level = LOG_LEVEL if log else float(f"{np.max(np.abs(own), initial=0.0) / LEVELS:.3g}") or 1.0
    changes = np.full(len(given), None, dtype=object)
    changes[known] = np.diff(np.rint(own / level).astype(int), prepend=0)
    return level, tuple(changes.tolist())
