"""Packs of the report page: texts come back as they were, curves as closely as a screen can show."""

import json

import numpy as np
import pytest
from markupsafe import Markup

from consilience.report.figure import figure, log_axis
from consilience.report.packs import LEVELS, LOG_LEVEL, packed_figures, packed_pages
from hostile.pages import opened, plotted, unpacked


def element(name, pack):
    return Markup('<script type="application/gzip" id="{}">{}</script>').format(name, pack)


def test_pages_come_back_with_every_line_break():
    pages = {"a": "one\n\n  two\n", "b": "  two\r\none", "c": "", "d": "\n\n"}
    assert opened(element("pages", packed_pages(pages.items()))) == pages


@pytest.mark.parametrize("log", [False, True])
def test_a_curve_comes_back_within_half_a_level_and_with_its_gaps(log):
    rng = np.random.default_rng(7)
    walk = np.cumsum(rng.normal(size=(3, 400)), axis=1)
    curves = (10.0 ** (walk - 12.0) if log else walk * [[1e-9], [1.0], [1e9]]).tolist()
    curves += [[0.0, 0.0], [curves[0][0]], []]
    given = [[None if rng.random() < 0.1 else v for v in values] for values in curves]
    axis = log_axis("") if log else {}
    drawn = figure([{"x": list(range(len(y))), "y": y} for y in given], {}, axis)
    back = plotted(element("figures", packed_figures({"drawn": drawn})))["drawn"]["data"]
    for trace, values in zip(back, given, strict=True):
        y = np.array(values, dtype=float)
        y[(y == 0.0) & log] = np.nan
        off = np.array(trace["y"], dtype=float)
        assert np.array_equal(np.isnan(off), np.isnan(y))
        known = ~np.isnan(y)
        error = np.log10(off[known] / y[known]) if log else off[known] - y[known]
        level = LOG_LEVEL if log else np.max(np.abs(y[known]), initial=0.0) / LEVELS
        # the level itself has three digits
        assert np.all(np.abs(error) <= 0.5 * level * 1.01)
        assert np.allclose(trace["x"], range(len(values)), atol=0.5 * len(values) / LEVELS * 1.01)


def test_curves_that_are_alike_are_stored_once():
    drawn = figure([{"x": [0.0, 1.0, 2.0], "y": [1.0, 3.0, 2.0]}] * 2, {}, {})
    pack = json.loads(unpacked(element("figures", packed_figures({"a": drawn, "b": drawn})), "figures"))
    assert len(pack["curves"]) == 2
