"""Plots for papers, from a record of invented runs."""

import re
from itertools import pairwise
from xml.etree import ElementTree as ET

import pytest

from consilience.compare import Verdict
from consilience.errors import InvalidInput
from consilience.report.exports import plot
from records import comparison, record_of


@pytest.fixture
def moving():
    return record_of(
        [
            comparison("one", "alpha", "trajectory", Verdict.MODEL, horizon=1.0),
            comparison("one", "beta_1", "trajectory", Verdict.DISCRETISATION),
            comparison("one", "beta_1", "trajectory", profile="default", method="stock"),
            comparison("two", "alpha", "instant"),
        ]
    )


@pytest.mark.parametrize("what", plot.PLOTS)
def test_a_plot_is_one_svg_the_same_for_the_same_record(moving, what):
    drawn = plot.plotted(moving, "one", what, "svg")
    assert drawn == plot.plotted(moving, "one", what, "svg")
    root = ET.fromstring(drawn)
    assert root.tag.endswith("svg")
    assert b"http" not in re.sub(
        rb'xmlns(:\w+)?="[^"]*"|<!DOCTYPE[^>]*>|<metadata>.*?</metadata>', b"", drawn, flags=re.S
    )


def test_lines_of_a_plot_hold_the_numbers_of_the_record(moving):
    lines = dict(plot.lines(moving, moving.cases[0], plot.PLOTS["convergence"]))
    # the first engine is judged up to its horizon of 1 s, the second to the end
    assert (lines[0].x, lines[0].y) == ((0.02, 0.01), (1e-5, 1e-6))
    assert (lines[1].x, lines[1].y) == ((0.02, 0.01), (1e-4, 0.5))
    assert lines[0].label == "alpha: RK4, order 3.98"
    energy = dict(plot.lines(moving, moving.cases[0], plot.PLOTS["energy"]))
    assert (energy[0].x, energy[0].y) == ((1.0, 2.0), (1e-9, 2e-9))
    work = dict(plot.lines(moving, moving.cases[0], plot.PLOTS["work-precision"]))
    assert work[1].x == (50.0, 100.0)
    assert len(plot.lines(moving, moving.cases[0], plot.PLOTS["difference"])) == 2


@pytest.mark.parametrize("most", [0.3, 4.2, 40.0])
def test_numbers_along_a_short_axis_do_not_run_into_one_another(most):
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(plot.SETTINGS):
        figure = Figure(figsize=(plot.WIDTH, plot.HEIGHT))
        axes = FigureCanvasAgg(figure).figure.subplots()
        plot._draw(
            axes, plot.PLOTS["work-precision"], [(0, plot.PlottedMotion("alpha: RK4", (0.13, most), (1e-2, 1e-8)))]
        )
        figure.canvas.draw()
        low, high = axes.get_xlim()
        ticks = sorted(
            (tick.get_loc(), tick.label1.get_window_extent())
            for tick in (*axes.xaxis.get_major_ticks(), *axes.xaxis.get_minor_ticks())
            if low <= tick.get_loc() <= high and tick.label1.get_text()
        )
    assert len(ticks) >= 2
    assert all(left.x1 < right.x0 for (_, left), (_, right) in pairwise(ticks))


@pytest.mark.parametrize(("case", "message"), [("three", "Cases: one, two"), ("two", "no motion of an engine")])
def test_what_cannot_be_plotted_is_told(moving, case, message):
    with pytest.raises(InvalidInput, match=message):
        plot.plotted(moving, case, "difference", "svg")


def test_pdf_and_png_are_written_too(moving):
    assert plot.plotted(moving, "one", "difference", "pdf").startswith(b"%PDF")
    assert plot.plotted(moving, "one", "difference", "png").startswith(b"\x89PNG")
