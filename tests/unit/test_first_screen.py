"""The first screen of a report: engines, what to look at first, and the matrix with its two channels."""

import re
from pathlib import Path

import numpy as np
import pytest

import consilience.report
from consilience.compare import Verdict
from consilience.report.findings import signs
from consilience.report.html import render_html
from consilience.report.standings import HEADS
from consilience.report.view import page
from records import comparison, level, record_of

HARNESS = "engine accelerations with the harness's integrator"


def motion(case, engine, digits, verdict=Verdict.AGREES, cpus=(0.01, 0.02), **more):
    """Comparison of a motion whose finest of two levels has so many digits, the other two fewer."""
    levels = [
        {**level(step, (0.0, 10.0 ** -(digits - lost))), "cpu": cpu}
        for step, lost, cpu in zip((0.02, 0.01), (2.0, 0.0), cpus, strict=True)
    ]
    rule = {Verdict.DISCRETISATION: "steps", Verdict.UNRESOLVED: "not asymptotic"}.get(verdict, "agreement")
    plain = {"digits": digits, "rule": rule, "times": [0.0, 1.0], "levels": levels}
    return comparison(case, engine, "trajectory", verdict, **(plain | more))


def entries(view, engine):
    (row,) = [row for row in view.standings if row.name == engine]
    return {name: entry for (name, _), entry in zip(HEADS, row.entries, strict=True)}


def tile(view, case, engine):
    return next(t for row in view.rows for t in row.tiles if (t.cell.case, t.cell.engine) == (case, engine))


def test_an_engine_with_a_further_worse_integrator_looks_the_same():
    good = [comparison("arm", "alpha", "instant"), motion("arm", "alpha", 9.0)]
    worse = motion("arm", "alpha", 2.0, Verdict.DISCRETISATION, method="Euler")
    one, two = (page(record_of(found, engines=("alpha",))) for found in (good, [*good, worse]))
    assert entries(one, "alpha") == entries(two, "alpha")
    first, second = tile(one, "arm", "alpha"), tile(two, "arm", "alpha")
    assert (first.tint, first.marks, first.bar, first.keys) == (second.tint, second.marks, second.bar, second.keys)
    assert second.cell.look.verdict == Verdict.AGREES


def test_few_digits_are_no_colour_and_another_model_is():
    view = page(
        record_of(
            [
                comparison("arm", "alpha", "instant"),
                motion("arm", "alpha", 2.1, Verdict.DISCRETISATION),
                comparison("arm", "beta_1", "instant", Verdict.MODEL, digits=9.5),
                motion("arm", "beta_1", 12.0),
            ]
        )
    )
    short, other = tile(view, "arm", "alpha"), tile(view, "arm", "beta_1")
    assert (short.tint, short.marks, short.digits) == ("same", (), "2.1")
    assert (short.bar.length, short.bar.asked) == (pytest.approx(100 * 2.1 / 16, abs=0.05), 50.0)
    assert (other.tint, [m.text for m in other.marks]) == ("differs", ["instant 9.5"])


def test_every_symbol_of_the_matrix_is_in_its_key():
    unlike = [v for v in Verdict if v not in (Verdict.AGREES, Verdict.DISCRETISATION)]
    given = record_of([comparison(f"arm{n}", "alpha", "instant", verdict) for n, verdict in enumerate(unlike)])
    (key,) = re.findall(r'<p class="key.*?</p>', render_html(given), re.DOTALL)
    marks = [mark for row in page(given).rows for tile in row.tiles for mark in tile.marks]
    assert {mark.look.verdict for mark in marks} == set(unlike)
    assert [mark.look.symbol for mark in marks if mark.look.symbol not in key] == []


@pytest.mark.parametrize(
    ("verdict", "symbol", "tint"),
    [
        (Verdict.FAILED, "!", "failed"),
        (Verdict.UNRESOLVED, "?", "unsure"),
        (Verdict.UNSUPPORTED, "\N{EMPTY SET}", "none"),
    ],
)
def test_a_cell_shows_what_is_answered_and_what_is_not(verdict, symbol, tint):
    refused = comparison("arm", "alpha", "trajectory", verdict, digits=None, levels=[], times=[], band=None)
    shown = tile(page(record_of([comparison("arm", "alpha", "instant"), refused])), "arm", "alpha")
    assert (shown.tint, shown.bar, shown.digits) == ("same", None, "")
    assert [(m.look.symbol, m.look.tint, m.text) for m in shown.marks] == [(symbol, tint, "trajectory")]


def test_engines_are_told_by_their_own_integrators_and_the_harness_apart():
    view = page(
        record_of(
            [
                *(
                    motion(case, "alpha", d, Verdict.DISCRETISATION, method="step")
                    for case, d in (("a", 3.2), ("b", 4.2))
                ),
                *(motion(case, "alpha", 11.0, route=HARNESS, method="ours") for case in ("a", "b")),
                motion("a", "beta_1", 10.0, route=HARNESS, cpus=(0.05, 0.1)),
                motion("b", "beta_1", 8.0, route=HARNESS, cpus=(0.07, 0.14)),
            ]
        )
    )
    alpha, beta = entries(view, "alpha"), entries(view, "beta_1")
    assert (alpha["own"].before, alpha["own"].text, alpha["harness's"].text) == ("step", "3.7", "11.0")
    assert (beta["own"].text, beta["harness's"].text, beta["harness's"].harness) == ("none", "9.0", True)
    # alpha has 3 digits at its finest level alone, in both cases; beta already at its coarsest
    assert (alpha["3 digits"].text, alpha["3 digits"].harness) == ("20 ms", False)
    assert (beta["3 digits"].text, beta["3 digits"].harness) == ("\N{LESS-THAN OR EQUAL TO} 60 ms", True)
    assert (beta["9 digits"].text, beta["9 digits"].note, beta["9 digits"].few) == ("100 ms", "in 1", False)
    assert alpha["6 digits"].text == "\N{EM DASH}"
    assert [row.name for row in view.standings] == ["alpha", "beta_1"]


@pytest.mark.parametrize(
    ("coarser", "text"),
    [
        ([(0.5, 0.002, 1e-2), (0.1, 0.004, 1e-4)], "4 ms"),
        ([(0.5, 0.002, None), (0.1, 0.004, 1e-4)], "4 ms"),
        ([(1.0, 0.002, 1e-4), (0.1, 0.004, 1e-5)], "2 ms"),
        ([(0.5, 0.002, 1e-4), (0.1, 0.004, 1e-5)], "\N{LESS-THAN OR EQUAL TO} 2 ms"),
    ],
    ids=["digits lost", "motion dies", "a single step", "not tried to the end"],
)
def test_longer_steps_make_the_time_to_few_digits_a_number(coarser, text):
    """The motion of 1 s has 7 digits at the coarsest level of its ladder."""
    tried = [dict(zip(("step", "cpu", "largest"), one, strict=True)) for one in coarser]
    told = entries(page(record_of([motion("a", "alpha", 9.0, coarser=tried)])), "alpha")
    assert told["3 digits"].text == text
    assert told["9 digits"].text == "20 ms"


def test_what_to_look_at_first_is_another_model_and_alike_cells_share_a_line():
    failed = [
        comparison(case, "alpha", "instant", Verdict.FAILED, digits=None, why="the worker died: signal SIGSEGV")
        for case in ("a", "b", "c")
    ]
    view = page(record_of([*failed, comparison("b", "beta_1", "instant", Verdict.MODEL, digits=9.5)]))
    other, crash = view.look_first.lines
    assert (other.badge, [c.case for c in other.cells]) == ("another model", ["b"])
    assert sorted(c.case for c in crash.cells) == ["a", "b", "c"]
    assert crash.cause == "instant, solve: The engine's process died."
    assert view.look_first.grave
    assert view.rows[0].case.name == "b"


def test_a_known_finding_shows_in_the_matrix_and_in_what_to_look_at_first():
    sign = signs()[0]
    seen = comparison(
        *("arm", sign.engine, "instant", Verdict.FAILED),
        method=sign.method.replace("*", ""),
        profile=sign.profile,
        why="a_WB_W has 9 values that are not finite",
    )
    record = record_of([comparison("arm", sign.engine, "model"), seen], engines=(sign.engine,))
    assert tile(page(record), "arm", sign.engine).findings == ()  # no reaction of the case is undetermined
    record.cases[0]["undetermined"] = {"pin": [0, 0, 3, 3, 0, 0]}
    view = page(record.annotated(record.header, record.cases, record.runs, record.comparisons, record.footer))
    shown = tile(view, "arm", sign.engine)
    assert shown.findings == (sign.finding,)
    assert shown.label.endswith(f"known finding {sign.finding}")
    assert sign.finding in [line.finding for line in view.look_first.lines]


def test_where_nothing_differs_the_worst_of_the_rest_is_told():
    fewest = motion("b", "alpha", 2.1, Verdict.DISCRETISATION)
    view = page(record_of([motion("a", "alpha", 3.0, Verdict.DISCRETISATION), fewest, motion("c", "alpha", 9.0)]))
    (line,) = view.look_first.lines
    assert (line.badge, [c.case for c in line.cells], view.look_first.grave) == ("2.1 of 8 digits", ["b"], False)
    assert [row.case.name for row in view.rows] == ["b", "a", "c"]


def test_of_many_lines_four_are_shown_and_the_others_counted():
    found = [comparison("a", "alpha", "instant", Verdict.MODEL)]
    found += [comparison(case, f"e{n}", "instant", Verdict.MODEL) for n, case in enumerate("abcdef")]
    view = page(record_of(found, engines=("alpha", *(f"e{n}" for n in range(6)))))
    assert (len(view.look_first.lines), view.look_first.more) == (4, 3)


def test_names_break_at_underscores_and_hyphens_alone_and_stay_text():
    name = "long_case-name <b>"
    html = render_html(record_of([comparison(name, "alpha", "instant")]))
    head = re.search(r'<th scope="row"><a[^>]*>(.*?)</a>', html).group(1)
    assert head == "long_<wbr>case-<wbr>name &lt;b&gt;"


# Machado, Oliveira, Fernandes: A physiologically-based model for simulation of color vision deficiency,
# IEEE TVCG 15 (2009), severity 1, on linear sRGB
SEEN = {
    "all cones": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""Linear sRGB to CIE XYZ, IEC 61966-2-1."""


def lab(colour, seen):
    """Return CIELAB coordinates of a colour, white point D65."""
    channels = np.array([int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)])
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    ratio = XYZ @ np.clip(seen @ linear, 0.0, 1.0) / XYZ.sum(axis=1)
    f = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("seen", SEEN.values(), ids=SEEN.keys())
def test_filled_statuses_stay_apart_for_every_eye(seen, theme):
    style = render_html(record_of([comparison("arm", "alpha", "instant")]))
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", re.findall(r":root \{(.*?)\}", style, re.DOTALL)[theme]))
    points = [lab(colours[tint], np.array(seen)) for tint in ("same", "unsure", "differs", "failed")]
    for n, one in enumerate(points):
        for other in points[:n]:
            assert np.linalg.norm(one - other) >= 29.0


def test_a_class_has_its_look_from_one_sheet():
    """A class that stands alone in two sheets is two things of one name: the later one spoils the earlier."""
    sheets = Path(consilience.report.__file__).parent / "templates"
    found = []
    for name in ("style", "style_first", "style_parts"):
        text = re.sub(r"@media[^{]*\{(?:[^{}]|\{[^{}]*\})*\}", "", (sheets / f"{name}.css.j2").read_text("utf-8"))
        alone = {part.strip() for rule in re.findall(r"([^{}]+)\{", text) for part in rule.split(",")}
        found += [part for part in alone if re.fullmatch(r"\.[a-z-]+", part)]
    assert len(found) > 30
    assert not {part for part in found if found.count(part) > 1}
