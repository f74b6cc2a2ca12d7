"""Report pages: verdicts, reasons, missing values and names appear as the record has them."""

import base64
import gzip
import json
import re
import tempfile
from dataclasses import replace
from html.parser import HTMLParser

import plotly.graph_objects as go
import pytest
from jinja2 import Environment

from consilience.case import load_case
from consilience.compare import Comparison, Verdict
from consilience.compare.rules import INSTANT_RULES, RULES
from consilience.engine import Profile, Question, Route
from consilience.errors import InvalidInput
from consilience.report import wording
from consilience.report.cases import unwrapped
from consilience.report.figure import LEGEND, title_of
from consilience.report.html import OF_CASE, render_html
from consilience.report.markdown import render_markdown
from consilience.report.packs import packed
from consilience.report.pages import write_pages
from consilience.report.plots import compact, figures
from consilience.report.record import Record, exit_code, lines
from consilience.report.recordschema import FORMAT
from consilience.report.selection import levels_of, method_of, probes_of
from consilience.report.summary import legend, matrix
from consilience.report.templating import template_environment
from consilience.report.view import page
from consilience.suite import Results
from hostile.pages import opened, plotted, unpacked

HOSTILE = '<script>alert(1)</script> | `x` & "y" [a](b)'
VOID = {"col", "meta", "br", "link", "img", "hr", "input"}


def method(
    name, route=Route.NATIVE, order=None, substeps=(), tolerances=(), profile=Profile.MATCHED, softness=None, **settings
):
    return {
        "name": name,
        "route": str(route),
        "order": order,
        "substeps": list(substeps),
        "tolerances": list(tolerances),
        "settings": settings,
        "profile": str(profile),
        "softness": softness,
    }


def run(case, engine, question, how, status="answered", step=None, answer=None, reason="", log="", manifest=None):
    return {
        "record": "run",
        "case": case,
        "engine": engine,
        "question": question,
        "method": how,
        "level": 0,
        "step": step,
        "status": status,
        "answer": answer,
        "reason": reason,
        "manifest": manifest,
        "cpu": 0.0123456,
        "log": log,
    }


def comparison(case, engine, question, how, verdict, why, digits=None, **more):
    none = ("limit_digits", "declared_order", "order", "self_order", "band", "reference_spread", "horizon", "softness")
    return {
        "record": "comparison",
        "case": case,
        "engine": engine,
        "question": question,
        "method": how["name"] if how else "",
        "route": how["route"] if how else None,
        "verdict": str(verdict),
        "why": why,
        "digits": digits,
        **dict.fromkeys(none),
        "rule": "",
        "profile": how["profile"] if how else "matched",
        "observables": [],
        "growth": [],
        "quantities": [],
        "times": [],
        "levels": [],
        "coarser": [],
        "power": [],
        **more,
    }


def quantity(name, difference, bar=1e-10, count=6, remark=""):
    return {"name": name, "difference": difference, "bar": bar, "count": count, "remark": remark}


def level(step, largest, cpu):
    return {
        "step": step,
        "cpu": cpu,
        "largest": largest,
        "rms": largest / 2,
        "difference": [0.0, largest / 3, largest],
        "energy": [0.0, -largest, None],
        "residual": 1.2e-15,
        "counters": {"steps": 1000, "mean_iterations": 2.34567},
    }


def case(name, title="A title", remarks="Line one\nline two.", undetermined=None):
    return {
        "record": "case",
        "name": name,
        "title": title,
        "bodies": ["b1"],
        "joints": [["j1", "revolute", "ground", "b1"], ["j2", "revolute", "ground", "b1"]],
        "rows": 5,
        "duration": 5.0,
        "sample": 0.05,
        "digits": 8,
        "instants": 20,
        "undetermined": undetermined or {},
        "sources": ["A source"],
        "remarks": remarks,
        "tags": ["t"],
    }


MODEL = method("model")
ABA = method("aba", Route.HARNESS_SOLVE, mu=1e-6, flags=["a", "b"])
RK4 = method("RK4", Route.TUNED, order=4, substeps=(10, 20, 40))
ADAPTIVE = method("dopri", Route.HARNESS_INTEGRATOR, tolerances=(1e-8, 1e-10))
ACCOUNT = {
    "mass": 3.5,
    "com": [0.1, 0.2, 0.3],
    "inertia": [[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]],
    "freedom": 1,
}
MANIFEST = {"exact": ["joints"], "approximated": ["bodies of 1e-14 kg"]}


def answered(name="swing", engine="good"):
    """Return runs and comparisons of an engine that answers everything except reactions."""
    steps = (0.005, 0.0025, 0.00125)
    runs = [
        run(name, engine, "model", MODEL, answer={**ACCOUNT, "mass": 3.6}, manifest=MANIFEST),
        run(name, engine, "instant", ABA, log="a warning"),
        *(run(name, engine, "trajectory", RK4, step=s) for s in steps),
        *(run(name, engine, "trajectory", ADAPTIVE, step=s) for s in (1e-8, 1e-10)),
    ]
    instant = [
        quantity("accelerations", 2.345e-13, 1e-11, remark="state 3"),
        quantity("reactions", 0.0, count=0, remark="this method gives none"),
    ]
    convergence = {"declared_order": 4, "order": 3.987, "self_order": None, "band": 1.23e-9, "limit_digits": 11.2}
    over_time = {"times": [0.0, 2.5, 5.0], "reference_spread": 1e-13}
    comparisons = [
        comparison(
            name, engine, "model", MODEL, Verdict.AGREES, "mass", 15.3, quantities=[quantity("total mass", 0.0)]
        ),
        comparison(name, engine, "instant", ABA, Verdict.AGREES, "within the bar", 12.6, quantities=instant),
        comparison(
            name,
            engine,
            "trajectory",
            RK4,
            Verdict.DISCRETISATION,
            "smaller steps lead to the reference",
            6.6,
            levels=[level(s, 1e-6 * s, 0.1 / s) for s in steps],
            rule="steps",
            **convergence,
            **over_time,
        ),
        comparison(
            name,
            engine,
            "trajectory",
            ADAPTIVE,
            Verdict.AGREES,
            "fine",
            9.5,
            levels=[level(s, s, 1.0) for s in (1e-8, 1e-10)],
            rule="agreement",
            declared_order=1,
            **over_time,
        ),
    ]
    return runs, comparisons


def troubled(name="swing"):
    """Return four engines: one crashes, one has unsupported features, one differs, one has a non-finite difference."""
    crash = "the worker died: signal SIGSEGV"
    cannot = "rod: there is no such joint; spring: none either"
    runs = [
        run(name, "crashes", "trajectory", RK4, "failed", 0.005, reason=crash, log="last words <b>"),
        run(name, "cannot", "instant", None, "unsupported", reason=cannot),
        run(name, "differs", "instant", ABA),
        run(name, "infinite", "instant", ABA),
        run(name, "reference", "model", MODEL, answer=ACCOUNT),
        run(name, "plan", "model", None, "failed", reason="ValueError: no plan"),
    ]
    missed = [quantity("accelerations", 0.02), quantity("reactions", 3e-12, remark="4 components not compared")]
    comparisons = [
        comparison(name, "crashes", "trajectory", RK4, Verdict.FAILED, crash),
        comparison(name, "cannot", "instant", None, Verdict.UNSUPPORTED, cannot),
        comparison(name, "differs", "instant", ABA, Verdict.MODEL, "above the bar", 1.7, quantities=missed),
        comparison(
            name, "infinite", "instant", ABA, Verdict.MODEL, "difference inf", quantities=[quantity("reactions", None)]
        ),
        comparison(name, "plan", "model", None, Verdict.FAILED, "ValueError: no plan"),
    ]
    return runs, comparisons


SOFT = method("weld", Route.TUNED, order=4, substeps=(10, 20), softness=1.0)
SOFT_DEFAULT = method("weld as it comes", order=1, substeps=(25, 50), profile=Profile.DEFAULT, softness=1.0)
FORWARD = method("forward as it comes", profile=Profile.DEFAULT)
OPEN = {"j1": [0, 0, 20, 20, 3, 0], "j2": [0, 0, 20, 20, 3, 0]}
OBSERVABLES = [
    {"name": "position", "order": 3.98, "band": 2.5e-9, "change": 3e-8},
    {"name": "velocity", "order": None, "band": 6.3e-9, "change": 7.6e-8},
]


def probe(how, scale, **more):
    """Return a run of a method at another softness and the finest level; such runs follow all levels."""
    return run("swing", "soft", "trajectory", {**how, "softness": scale}, step=0.0025, **more)


def softened():
    """Return an engine with soft constraints: right with matched settings, wrong by default; the horizon is 3 s."""
    soft = {"softness": {"order": 1.03, "shift": 8.7e-4, "limit": 2.4e-9}}
    over_time = {"times": [0.0, 2.5, 5.0], "growth": [1.0, 1e6, 1e9], "horizon": 3.0, "reference_spread": 1e-13, **soft}
    missed = [quantity("accelerations", 2.2), quantity("reactions", 0.28, count=77, remark="86 values not determined")]
    runs = [
        run("swing", "soft", "instant", FORWARD),
        *(run("swing", "soft", "trajectory", SOFT, step=s) for s in (0.005, 0.0025)),
        probe(SOFT, 4.0, log="softer still"),
        probe(SOFT, 2.0),
        *(run("swing", "soft", "trajectory", SOFT_DEFAULT, step=s) for s in (0.002, 0.001)),
        probe(SOFT_DEFAULT, 0.5),
        probe(SOFT_DEFAULT, 0.25),
    ]
    comparisons = [
        comparison("swing", "soft", "instant", FORWARD, Verdict.MODEL, "above the bar", 0.0, quantities=missed),
        comparison(
            "swing",
            "soft",
            "trajectory",
            SOFT_DEFAULT,
            Verdict.REGULARISATION,
            "differs by 0.2, by 1e-9 without softness",
            0.7,
            rule="softness",
            declared_order=1,
            levels=[level(0.002, 3e-2, 0.1), level(0.001, 2e-2, 0.2)],
            **over_time,
        ),
        comparison(
            "swing",
            "soft",
            "trajectory",
            SOFT,
            Verdict.AGREES,
            "fine up to the horizon",
            8.3,
            rule="agreement",
            declared_order=4,
            order=3.99,
            band=6.1e-9,
            levels=[level(0.005, 6e-5, 0.1), level(0.0025, 3e-6, 0.2)],
            observables=OBSERVABLES,
            **over_time,
        ),
    ]
    return runs, comparisons


def record(parts, cases, missing=None, code=1):
    runs = [r for part in parts for r in part[0]]
    comparisons = [c for part in parts for c in part[1]]
    names = dict.fromkeys(["reference", *(r["engine"] for r in runs)])
    header = {
        "record": "header",
        "format": FORMAT,
        "written": "2026-01-02T03:04:05+00:00",
        "elapsed": 12.34,
        "platform": "Linux x86_64, 2 processors",
        "processor": "A processor",
        "python": "3.11.7",
        "packages": {"consilience": "0.1.0"},
        "engines": {n: {"name": n, "version": "1.2", "adapter": "0.1", "remarks": "as it is"} for n in names},
        "missing": missing or {},
        "questions": ["model", "instant", "trajectory"],
    }
    footer = {
        "record": "footer",
        "cases": len(cases),
        "runs": len(runs),
        "comparisons": len(comparisons),
        "exit_code": code,
    }
    return Record.annotated(header, cases, runs, comparisons, footer)


@pytest.fixture(scope="module")
def everything():
    return record([answered(), troubled()], [case("swing")], {"gone": "ImportError: no module"})


@pytest.fixture(scope="module")
def soft():
    return record([softened()], [case("swing", undetermined=OPEN)], code=0)


@pytest.fixture(scope="module")
def hostile():
    runs, comparisons = answered(HOSTILE, HOSTILE)
    for r, c in zip(runs[1:3], comparisons[1:3], strict=True):
        r["method"] = {**r["method"], "name": HOSTILE, "settings": {HOSTILE: HOSTILE}}
        c.update(method=HOSTILE, why=HOSTILE)
    steps, adaptive = comparisons[2:]
    steps.update(profile="default", rule=HOSTILE, observables=[{**OBSERVABLES[0], "name": HOSTILE}])
    adaptive.update(horizon=3.0, growth=[1.0, 1e6, 1e9])
    own = case(HOSTILE, HOSTILE, HOSTILE, {HOSTILE: OPEN["j1"]})
    own["joints"] = [[HOSTILE, "revolute", "ground", "b1"]]
    return record([(runs, comparisons)], [own], {HOSTILE: HOSTILE})


class Structure(HTMLParser):
    """Parsed page: nesting of elements, identifiers, links and text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.links, self.figures, self.text, self.scripts = [], [], [], [], [], 0
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.scripts += tag == "script"
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given[k] for k in ("href", "src") if k in given]
        self.figures += [given["data-figure"]] if "data-figure" in given else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("script", "style"):
            self.text.append(data)


def whole(given, replays=None):
    """Return the text of a page and of all pages packed into it, each as an element."""
    text = render_html(given, replays)
    return text + "".join(f'<div id="{name}">{html}</div>' for name, html in opened(text).items())


def cell_of(view, engine):
    return next(cell for cell in view.cells if cell.engine == engine)


def test_every_verdict_route_question_and_exit_code_has_its_words():
    assert list(wording.LOOKS) == list(Verdict)
    assert list(wording.PHRASES) == list(Verdict)
    assert set(wording.ROUTES) == set(Route)
    assert all(question.description for question in Question)
    assert set(wording.PROFILES) == set(Profile)
    assert set(wording.CAUSES) == {rule.name for rule in RULES} | set(INSTANT_RULES)
    assert list(wording.CAUSES_BY_VERDICT) == list(Verdict)
    looks = list(wording.LOOKS.values())
    assert len({look.symbol for look in looks}) == len({look.key for look in looks}) == len(looks)


def test_the_head_counts_models_then_motions_and_leaves_the_reference_out(everything):
    view = page(everything)
    assert view.headline == (
        "1 of 4 cells agrees at model and instant; 2 differ in the model; 1 failed; "
        "1 holds something the engine cannot represent."
    )
    assert view.sentences == (
        (
            "0 of 2 motions reach the digits asked, by the engine's own integrator or else the harness's; 1 failed; "
            "1 needs smaller steps, not another model."
        ),
        "1 engine not available: gone.",
    )
    assert view.exit_code == 1
    assert sum(cell.engine != "reference" for cell in view.cells) == 6


def test_a_cell_shows_the_worst_verdict_and_each_question_its_methods(everything):
    cell = cell_of(page(everything), "good")
    assert cell.look is wording.LOOKS[Verdict.DISCRETISATION]
    model, _, trajectory = cell.marks
    assert [(look.name, digits) for look, digits in model.entries] == [("agrees", "15.3")]
    assert [(look.name, digits) for look, digits in trajectory.entries] == [
        ("same model, coarse steps", "6.6"),
        ("agrees", "9.5"),
    ]
    assert cell_of(page(everything), "reference").look is wording.YARDSTICK
    assert cell_of(page(everything), "cannot").marks[0].entries == ((wording.NOT_ASKED, ""),)


def test_what_was_not_compared_is_a_dash_and_never_zero(everything):
    answer = next(a for a in cell_of(page(everything), "good").answers if a.question == "instant")
    reactions = answer.quantities[1]
    assert (reactions.difference, reactions.count, reactions.state) == (wording.DASH, wording.DASH, "absent")
    assert reactions.remark == "this method gives none"
    assert answer.quantities[0].difference == "2.3e-13"


def test_a_difference_that_is_not_finite_misses_its_bar(everything):
    (answer,) = cell_of(page(everything), "infinite").answers
    assert (answer.quantities[0].difference, answer.quantities[0].state) == ("not finite", "missed")
    assert answer.digits == wording.DASH


def test_a_failed_run_brings_its_reason_and_its_log(everything):
    (answer,) = cell_of(page(everything), "crashes").answers
    assert [(t.run, t.reason, t.log) for t in answer.troubles] == [
        ("step 0.005 s", "the worker died: signal SIGSEGV", "last words <b>")
    ]
    (planless,) = cell_of(page(everything), "plan").answers
    assert planless.troubles[0].reason == "ValueError: no plan"
    text = whole(everything)
    assert "signal SIGSEGV" in text
    assert "last words &lt;b&gt;" in text


def test_unsupported_lists_every_reason(everything):
    (answer,) = cell_of(page(everything), "cannot").answers
    assert answer.unsupported == ("rod: there is no such joint", "spring: none either")


def test_levels_have_units_and_adaptive_ones_tolerances(everything):
    rk4, adaptive = (a for a in cell_of(page(everything), "good").answers if a.question == "trajectory")
    assert rk4.tables[0].heads[0] == "step"
    assert rk4.tables[0].rows[0] == ("0.005 s", "5e-09", "2.5e-09", "20 s", "1.2e-15", "1000", "2.35")
    assert (adaptive.tables[0].heads[0], adaptive.tables[0].rows[1][0]) == ("tolerance", "1e-10")
    facts = {f.name: (f.value, f.note) for f in rk4.facts}
    assert facts["observed order"][0] == "3.99"
    assert facts["self order"] == (wording.DASH, "hidden by rounding")
    assert facts["digits"] == ("6.6", "at the finest level; asked 8")
    assert [f.value for f in adaptive.facts if f.name == "declared order"] == ["1 in the tolerance"]


def test_settings_routes_and_manifest_are_told(everything):
    cell = cell_of(page(everything), "good")
    instant = next(a for a in cell.answers if a.question == "instant")
    assert instant.settings == (("mu", "1e-06"), ("flags", "a, b"))
    assert (instant.route, instant.log) == ("harness solve", "a warning")
    assert (cell.exact, cell.approximated) == (("joints",), ("bodies of 1e-14 kg",))


def test_the_account_of_the_model_stands_beside_the_reference(everything):
    facts = {f.name: (f.value, f.note) for f in cell_of(page(everything), "good").answers[0].facts}
    assert facts["total mass"] == ("3.6 kg", "reference 3.5")
    assert facts["centre of mass"] == ("(0.1, 0.2, 0.3) m", "as the reference")
    assert facts["inertia"][0] == "xx 1, yy 2, zz 3, xy 0.1, xz 0.2, yz 0.3 kg m²"


def test_a_case_tells_its_freedom_and_dependent_rows(everything):
    (swing,) = page(everything).cases
    facts = {f.name: (f.value, f.note) for f in swing.facts}
    assert facts["degrees of freedom"] == ("1", "")
    assert facts["constraint rows"] == ("5", "0 of them dependent")
    assert swing.remarks == ("Line one line two.",)


def test_indented_lines_keep_their_breaks():
    assert unwrapped("a\nb\n    c = 1\n    d = 2\ne\nf") == "a b\nc = 1\nd = 2\ne f"


def test_orders_are_read_from_methods_that_declare_one(everything):
    orders = next(table for table in page(everything).tables if table.anchor == "orders")
    row, adaptive = orders.rows
    assert (adaptive.answer.method, adaptive.values[0]) == ("dopri", "1 in the tolerance")
    assert (row.cell.engine, row.answer.method) == ("good", "RK4")
    assert row.values == ("4", "3.99", wording.DASH, "6.6", "11.2", "1.2e-09")


def test_all_answers_that_do_not_agree_are_listed_worst_first(everything):
    view = page(everything)
    listed = [answer.look.verdict for _, answer in view.remarkable]
    assert listed == ["failed", "failed", "differs: model", "differs: model", "unsupported", "differs: discretisation"]


@pytest.mark.parametrize("name", ["everything", "hostile", "soft"])
def test_the_page_is_sound_html_that_links_within_itself(name, request):
    given = request.getfixturevalue(name)
    structure = Structure(whole(given))
    assert structure.open == []
    # only one packed page is open at a time, so each may have this identifier
    ids = [name for name in structure.ids if name != "page-title"]
    assert len(set(ids)) == len(ids)
    links = [link.partition("?")[0] for link in structure.links]
    assert all(link == "#" or (link.startswith("#") and link[1:] in ids) for link in links)
    assert {f"#{cell.anchor}" for cell in page(given).cells} <= set(links)
    assert structure.scripts == 6
    assert all(re.fullmatch(r"\S+", name) for name in structure.ids)


def test_the_page_fetches_nothing_and_holds_plotly_once(everything):
    text = render_html(everything)
    assert "default-src 'none'" in text
    assert unpacked(text, "plotly").count("plotly.js v") == 1
    assert unpacked(text, "three").count("three.js") >= 1
    outside = re.sub(r"<script>.*?</script>", "", whole(everything), flags=re.DOTALL)
    assert not re.search(r"https?://|@import|url\(", outside)


@pytest.mark.parametrize("name", ["everything", "hostile", "soft"])
def test_every_place_of_a_plot_has_its_figure_and_plotly_takes_it(name, request):
    given = request.getfixturevalue(name)
    text = whole(given)
    found, given_figures = plotted(text), figures(given)
    assert set(Structure(text).figures) == set(found) == set(given_figures)
    for place, figure in found.items():
        assert shape_of(figure) == shape_of(given_figures[place])
        go.Figure(figure)


def shape_of(figure):
    """Return a figure with the number of samples in place of its curves, whose values are in `test_packs`."""
    data = [t | {axis: len(t[axis]) for axis in ("x", "y") if axis in t} for t in figure["data"]]
    return figure | {"data": data}


def test_figures_have_a_colour_an_engine_a_marker_a_method_a_dash_a_level_and_gaps_for_zeros(everything):
    figure = figures(everything)["difference.swing.good"]
    assert [t["line"]["dash"] for t in figure["data"][:5]] == ["dot", "dash", "solid", "dash", "solid"]
    looks = {(t["line"]["color"], t["marker"]["color"], t["marker"]["symbol"]) for t in figure["data"][:5]}
    work = [t for t in figures(everything)["work.swing"]["data"] if t["legendgroup"] == "good"]
    assert looks == {(t["line"]["color"], t["marker"]["color"], t["marker"]["symbol"]) for t in work}
    assert len(looks) == 2
    assert figure["data"][0]["y"][0] is None
    assert (figure["data"][0]["x0"], figure["data"][0]["dx"]) == (0.0, 2.5)
    assert figure["layout"]["yaxis"]["type"] == "log"
    assert figure["layout"]["shapes"][0]["y0"] == 1e-8
    assert compact([0.0, None, -1.23456e-9, 1234567.0]) == [None, None, 1.235e-9, 1235000.0]
    work = figures(everything)["work.swing"]["data"]
    assert [len(t["x"]) for t in work] == [3, 2]


def test_names_are_text_in_html(hostile):
    structure = Structure(whole(hostile))
    assert structure.scripts == 6
    assert HOSTILE in "".join(structure.text)
    plotted = figures(hostile)[f"work.{wording.anchor(HOSTILE)}"]["data"]
    assert all("<" not in trace["name"].replace("<br>", "") for trace in plotted)


def test_no_character_of_what_is_packed_can_end_its_element():
    text = str(packed(HOSTILE + "<!-- </script>"))
    assert not set("<>&") & set(text)
    assert gzip.decompress(base64.b64decode(text)).decode() == HOSTILE + "<!-- </script>"


def test_digits_are_none_where_not_even_the_first_is_right():
    assert [wording.digits_text(d) for d in (12.34, -0.7, None)] == ["12.3", "0.0", wording.DASH]


def test_an_order_that_rounds_to_zero_has_no_sign():
    assert [wording.order_text(order) for order in (-0.004, 0.004, -1.0, None)] == [
        "0.00",
        "0.00",
        "-1.00",
        wording.DASH,
    ]


def test_a_long_name_of_a_method_takes_several_lines_of_a_legend():
    name = "constraint solver of rows & " * 4 + "stepping of the harness"
    lines = title_of({"method": name, "profile": "matched"}, ", order 2.00").split("<br>")
    assert max(map(len, lines)) <= LEGEND + len("&amp;&amp;&amp;")
    assert " ".join(lines) == f"{name}, order 2.00".replace("&", "&amp;")


def test_names_are_text_in_markdown(hostile):
    text = render_markdown(hostile)
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    for block in text.split("\n\n"):
        rows = [line for line in block.splitlines() if line.startswith("|")]
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) <= 1
    assert "](b)" not in text.replace(r"\](b)", "")


def test_markdown_has_the_matrix_the_reasons_and_the_orders(everything):
    text = render_markdown(everything)
    assert "| swing | ≈ **same model, coarse steps**<br>model ✓15.3<br>instant ✓12.6<br>trajectory ≈6.6 ✓9.5 |" in text
    assert "| ! failed | swing | crashes | trajectory | RK4 | the worker died: signal SIGSEGV |  |" in text
    assert "| swing | good | RK4 | tuned | 4 | 3.99 | — | 6.6 | 11.2 | 1.2e-09 |" in text
    assert "- **gone** not available: ImportError: no module" in text
    assert not re.search(r"\n{3,}", text)


def luminance(colour):
    """Return the relative luminance of an sRGB colour, as WCAG 2 defines it."""
    channels = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_texts_stand_out_from_their_ground(everything, theme):
    style = re.search(r"<style>(.*?)</style>", render_html(everything), re.DOTALL).group(1)
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", re.findall(r":root \{(.*?)\}", style, re.DOTALL)[theme]))
    pairs = [(f"{look.tint}-text", look.tint) for look in wording.LOOKS.values()]
    pairs += [(text, ground) for text in ("text", "quiet", "link") for ground in ("page", "soft")]
    for text, ground in pairs:
        dark, light = sorted((luminance(colours[text]), luminance(colours[ground])))
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (text, ground)


def test_every_look_has_its_colours_and_no_two_share_a_symbol(everything):
    style = re.search(r"<style>(.*?)</style>", render_html(everything), re.DOTALL).group(1)
    for look in wording.LOOKS.values():
        assert f".{look.tint}:is(.badge, .cell a, .swatch) {{ background: var(--{look.tint});" in style
    assert len({look.symbol for look in wording.LOOKS.values()}) == len(Verdict)
    names = list(wording.LOOKS)
    place = names.index(Verdict.REGULARISATION)
    assert names[place - 1 : place + 2 : 2] == [Verdict.DISCRETISATION, Verdict.UNSUPPORTED]


def results(*judged, missing=False):
    """Return results whose comparisons have these verdicts and profiles."""
    found = [Comparison("c", "e", Question.INSTANT, "m", Route.NATIVE, v, "", profile=p) for v, p in judged]
    return Results([], [], missing={"gone": "why"} if missing else {}, comparisons=found)


@pytest.mark.parametrize("bad", [Verdict.MODEL, Verdict.FAILED, Verdict.UNRESOLVED])
def test_only_matched_methods_decide_the_exit_code(bad):
    good = (Verdict.AGREES, Profile.MATCHED)
    assert exit_code(results(good, (bad, Profile.DEFAULT))) == 0
    assert exit_code(results(good, (bad, Profile.MATCHED))) == (1 if bad is Verdict.MODEL else 3)
    assert exit_code(results(good, (bad, Profile.DEFAULT), missing=True)) == 3


@pytest.mark.parametrize("harmless", [Verdict.DISCRETISATION, Verdict.REGULARISATION, Verdict.UNSUPPORTED])
def test_steps_softness_and_what_cannot_be_represented_are_no_disagreement(harmless):
    assert exit_code(results((harmless, Profile.MATCHED))) == 0


def test_a_cell_and_the_terminal_show_matched_methods_alone(soft):
    view = page(soft)
    cell = cell_of(view, "soft")
    assert cell.look is wording.LOOKS[Verdict.AGREES]
    assert [mark.entries for mark in cell.marks] == [
        ((wording.NOT_ASKED, ""),),
        ((wording.NOT_ASKED, ""),),
        ((wording.LOOKS[Verdict.AGREES], "8.3"),),
    ]
    assert (
        view.headline == "1 of 1 motion reaches the digits asked, by the engine's own integrator or else the harness's."
    )
    assert view.remarkable == []
    assert matrix(soft) == (["soft"], [("swing", ["✓ 8.3"])])
    assert [line.partition(":")[0] for line in legend(soft)] == ["✓ agrees"]


def test_default_methods_stand_after_the_matched_ones_and_are_labelled(soft):
    cell = cell_of(page(soft), "soft")
    assert [(a.method, a.matched) for a in cell.answers] == [
        ("weld", True),
        ("forward as it comes", False),
        ("weld as it comes", False),
    ]
    heads = re.findall(r"<article(.*?)>\s*<h4>(.*?)</h4>", whole(soft))
    assert [("default" in attributes, "engine&#39;s defaults" in head) for attributes, head in heads] == [
        (True, True),
        (False, False),
        (True, True),
    ]


def test_what_a_user_of_the_defaults_gets_is_told_in_numbers(soft):
    view = page(soft).defaults
    instant, motion = view.rows
    assert (instant.first, motion.first, instant.count) == (True, False, 2)
    assert (instant.digits, instant.step, instant.finest) == ("0.0", wording.DASH, wording.DASH)
    assert instant.answer.cause == wording.CAUSES_BY_VERDICT[Verdict.MODEL]
    # at the engine's own step; up to the horizon the largest difference is a third of that up to the end
    assert (motion.step, motion.digits) == ("0.002 s", "2.0")
    assert (motion.finest_step, motion.finest) == ("0.001 s", "0.7")
    assert motion.answer.cause == wording.CAUSES["softness"]
    within, enough = view.sentences
    assert within == "Answers within the bars at given states: 0 of 1."
    assert enough.startswith("Motions with the digits asked at the engine's own step: 0 of 1; ")
    assert enough.endswith("; the least accurate has 2.0 digits (swing on soft).")
    assert view.without == ()
    row = "| swing | soft | trajectory | weld as it comes | 0.002 s | 2.0 | 0.001 s | 0.7 |"
    assert f"{row} ∝ same model, soft constraints |" in render_markdown(soft)
    html = " ".join("".join(Structure(whole(soft)).text).split())
    assert "What a user of the defaults gets" in html
    assert wording.CAUSES["softness"] in html


def test_engines_without_default_methods_are_named(everything):
    view = page(everything).defaults
    assert view.rows == view.sentences == ()
    assert view.without[0] == "good (all cases)"
    assert "No engine was asked at its own defaults." in render_markdown(everything)


def test_a_default_motion_without_an_answer_is_counted_as_one():
    how = method("as it comes", order=1, substeps=(25,), profile=Profile.DEFAULT)
    runs = [run("swing", "e", "trajectory", how, "failed", 0.002, reason="no")]
    failed = comparison("swing", "e", "trajectory", how, Verdict.FAILED, "no")
    view = page(record([(runs, [failed])], [case("swing")])).defaults
    assert view.sentences == ("Motions with the digits asked at the engine's own step: 0 of 1; 1 without an answer.",)
    assert view.rows[0].digits == wording.DASH


@pytest.mark.parametrize(("profile", "name"), [(Profile.MATCHED, "another model"), (Profile.DEFAULT, "another motion")])
def test_what_an_engine_sets_by_itself_is_not_called_its_model(profile, name):
    how = method("m", order=1, substeps=(25,), profile=profile)
    elsewhere = comparison("swing", "e", "trajectory", how, Verdict.MODEL, "elsewhere", rule="elsewhere")
    found = page(record([([run("swing", "e", "trajectory", how, answer={})], [elsewhere])], [case("swing")]))
    (answer,) = cell_of(found, "e").answers
    assert (answer.look.name, answer.look.verdict) == (name, Verdict.MODEL)


def test_probes_of_other_softness_are_no_levels(soft):
    matched, default = (a for a in cell_of(page(soft), "soft").answers if a.question == "trajectory")
    facts = {f.name: (f.value, f.note) for f in matched.softness}
    assert facts["softness asked"] == ("1, 2, 4", "times that of this method; CPU time 0.0247 s")
    assert facts["order in softness"][0] == "1.03"
    assert facts["shift"][0] == "0.00087"
    assert facts["without softness"][0] == "2.4e-09"
    assert next(f.value for f in default.softness) == "0.25, 0.5, 1"
    assert matched.log == ""
    runs = soft.runs_of(soft.comparisons[2])
    assert [r["step"] for r in levels_of(runs)] == [0.005, 0.0025]
    assert [r["method"]["softness"] for r in probes_of(runs)] == [2.0, 4.0]
    assert method_of(runs)["softness"] == 1.0
    rows = next(t for t in page(soft).tables if t.anchor == "softness").rows
    assert [r.values for r in rows] == [("trajectory", "1.03", "0.00087", "2.4e-09")] * 2


def test_a_probe_that_fails_says_which_one_it_was():
    runs = [
        run("swing", "soft", "trajectory", SOFT, step=0.005),
        probe(SOFT, 2.0, status="failed", reason="ValueError: too soft"),
    ]
    failed = comparison("swing", "soft", "trajectory", SOFT, Verdict.FAILED, "ValueError: too soft")
    (answer,) = cell_of(page(record([(runs, [failed])], [case("swing")])), "soft").answers
    assert [(t.run, t.reason) for t in answer.troubles] == [("step 0.0025 s, softness 2", "ValueError: too soft")]


def test_a_motion_tells_its_rule_its_horizon_and_its_observables(soft):
    matched, default = (a for a in cell_of(page(soft), "soft").answers if a.question == "trajectory")
    assert (matched.rule, default.rule) == ("agreement", "softness")
    assert default.condition == "the difference goes away with the engine's own softness"
    assert matched.judged == ("Judged up to 3 s of 5 s: beyond, one rounding error has grown to the 8 digits asked.")
    levels, observables = matched.tables
    assert levels.heads[:3] == ("step", "largest up to the horizon", "largest difference")
    assert levels.rows[0][:3] == ("0.005 s", "2e-05", "6e-05")
    assert observables.heads == ("observable", "change from the level before", "observed order", "band")
    assert observables.rows == (
        ("position", "3e-08", "3.98", "2.5e-09"),
        ("velocity", "7.6e-08", wording.DASH, "6.3e-09"),
    )
    html = " ".join("".join(Structure(whole(soft)).text).split())
    for text in (matched.judged, default.condition, levels.caption, observables.caption):
        assert text in html
    (row,) = next(t for t in page(soft).tables if t.anchor == "observables").rows
    assert row.values == ("2.5e-09 (3.98)", f"6.3e-09 ({wording.DASH})")
    assert "| swing | soft | weld | tuned | 2.5e-09 (3.98) | 6.3e-09 (—) |" in render_markdown(soft)


def test_where_nothing_is_judged_there_are_no_digits():
    runs, (_, default, _) = softened()
    default = {**default, "horizon": 0.0, "digits": None}
    (row,) = page(record([(runs, [default])], [case("swing")])).defaults.rows
    assert (row.digits, row.finest) == (wording.DASH, wording.DASH)
    assert row.answer.tables[0].rows[0][1] == wording.DASH


def test_a_motion_judged_to_its_end_says_nothing_of_a_horizon(everything):
    rk4 = next(a for a in cell_of(page(everything), "good").answers if a.method == "RK4")
    assert rk4.judged == ""
    assert rk4.tables[0].heads[1] == "largest difference"


def test_reactions_that_equilibrium_leaves_open_are_shown_as_such(soft):
    forward = next(a for a in cell_of(page(soft), "soft").answers if a.question == "instant")
    accelerations, reactions = forward.quantities
    assert (reactions.count, reactions.undetermined) == ("77", "86 undetermined")
    assert reactions.remark == "86 values not determined: j1, j2"
    assert accelerations.undetermined == ""
    (swing,) = page(soft).cases
    (row,) = swing.undetermined
    assert row.joints == "j1, j2"
    assert row.components == "force z, torque x at all states; torque y at 3 of 20 states"
    assert swing.undetermined_count == "86 of 240 values"
    html = whole(soft)
    assert '<span class="open">86 undetermined</span>' in html
    assert row.components in html
    assert f"86 of 240 values<br>j1, j2: {row.components}" in render_markdown(soft)


@pytest.mark.parametrize(
    ("counts", "chip", "remark"),
    [([20] * 5 + [19], "", "this method gives none"), ([20] * 6, "120 undetermined", "this method gives none: j1")],
)
def test_a_method_without_reactions_has_no_open_ones_unless_all_are(counts, chip, remark):
    none = [quantity("reactions", 0.0, count=0, remark="this method gives none")]
    compared = comparison("swing", "e", "instant", ABA, Verdict.AGREES, "fine", 15.0, quantities=none)
    own = case("swing", undetermined={"j1": counts})
    own["joints"] = own["joints"][:1]
    (answer,) = cell_of(page(record([([run("swing", "e", "instant", ABA)], [compared])], [own])), "e").answers
    assert (answer.quantities[0].undetermined, answer.quantities[0].remark) == (chip, remark)


def test_the_record_counts_open_reactions_of_each_joint():
    """A planar four-bar: three dependent rows out of the plane, so the share of each hinge is not determined."""
    four_bar = load_case("four_bar")
    asked = Results([four_bar], [Question.INSTANT])
    (found,) = [line for line in lines(asked, 0.0) if line["record"] == "case"]
    n = four_bar.instants
    assert found["undetermined"] == {j.name: [0, 0, n, n, n, 0] for j in four_bar.mechanism.joints}
    (unasked,) = [line for line in lines(Results([four_bar], [Question.MODEL]), 0.0) if line["record"] == "case"]
    assert unasked["undetermined"] == {}


def test_the_horizon_is_plotted_where_rounding_reaches_the_digits_asked(soft):
    found = figures(soft)["horizon.swing"]
    grown = found["data"][0]
    eps = 2.0**-52
    assert grown["y"] == pytest.approx([eps, 1e6 * eps, 1e9 * eps], rel=1e-3)
    asked, shade, edge = found["layout"]["shapes"]
    assert asked["y0"] == asked["y1"] == 1e-8
    assert (edge["x0"], edge["x1"], shade["x0"], shade["x1"]) == (3.0, 3.0, 3.0, 5.0)
    assert "horizon 3 s" in [a["text"] for a in found["layout"]["annotations"]]
    (swing,) = page(soft).cases
    facts = {f.name: (f.value, f.note) for f in swing.facts}
    assert facts["horizon"] == ("3 s of 5 s", "one rounding error grows to 2.2e-07 at the end")


def test_differences_over_time_show_horizon_and_bands(soft):
    found = figures(soft)["difference.swing.soft"]
    lines_ = {t["name"]: t for t in found["data"]}
    band, spread = lines_["band of the finest"], lines_["uncertainty of the reference"]
    solid = [t for t in found["data"] if t["line"]["dash"] == "solid"]
    assert (band["x"], band["y"]) == ([0.0, 3.0], [6.1e-9, 6.1e-9])
    assert band["line"]["color"] == solid[0]["line"]["color"]
    assert spread["y"] == [1e-13, 1e-13]
    assert [shape["x0"] for shape in found["layout"]["shapes"]] == [0, 3.0, 3.0]
    assert [t["legendgrouptitle"]["text"] for t in solid] == ["weld", "weld as it comes (engine's defaults)"]
    assert wording.method_title("Euler, Defaults", matched=False) == "Euler, Defaults"


def test_without_a_horizon_nothing_is_shaded(everything):
    found = figures(everything)
    assert [s["type"] for s in found["difference.swing.good"]["layout"]["shapes"]] == ["line"]
    assert found["energy.swing.good"]["layout"]["shapes"] == []
    assert "horizon.swing" not in found


def test_work_and_steps_are_of_the_same_runs_and_defaults_are_hollow(soft):
    work, steps = (figures(soft)[f"{kind}.swing"]["data"] for kind in ("work", "steps"))
    assert [t["x"] for t in work] == [[0.1, 0.2], [0.1, 0.2]]
    assert [t["x"] for t in steps] == [[0.005, 0.0025], [0.002, 0.001]]
    # the largest difference up to the horizon is a third of that up to the end
    assert [t["y"] for t in work] == [t["y"] for t in steps] == [[2e-5, 1e-6], [0.01, 0.006667]]
    assert [t["marker"]["symbol"] for t in work] == ["circle", "square-open"]
    assert steps[0]["name"] == "weld, order 3.99"


def test_an_adaptive_method_stands_at_its_mean_step(everything):
    steps = figures(everything)["steps.swing"]["data"]
    adaptive = next(t for t in steps if t["name"] == "dopri")
    assert adaptive["x"] == [0.005, 0.005]  # mean step: 5 s in 1000 steps
    assert adaptive["text"] == ["tolerance 1e-08", "tolerance 1e-10"]


def test_anchors_are_fit_for_urls_and_differ_where_names_do():
    names = ["a b", "a-b", "a.b", "a~20~b", "ä"]
    anchors = [wording.anchor(n) for n in names]
    assert len(set(anchors)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_.~-]+", a) for a in anchors)


@pytest.mark.parametrize("kind", ["case", "cell", *OF_CASE])
def test_a_cell_of_a_case_that_is_called_like_a_kind_of_element_has_an_address_of_its_own(kind):
    cell = wording.cell_anchor(kind, "bar")  # the page or the figure of a case "bar" has the plain anchor
    assert cell not in (wording.anchor(kind, "bar"), wording.cell_anchor("cell", f"{kind}.bar"))
    assert wording.cell_anchor("four_bar", "mujoco") == "four_bar.mujoco"


def test_a_report_without_cases_is_a_page_too():
    empty = record([], [], code=3)
    assert "Nothing was compared." in render_html(empty)
    assert "There are none." in render_markdown(empty)


def test_pages_are_written_beside_their_record(everything, tmp_path):
    e = everything
    lines = [e.header, *e.cases, *e.runs, *e.comparisons, *e.cells, e.footer]
    (tmp_path / "report.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    write_pages(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.html", "report.jsonl", "report.md"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == render_html(everything)
    with pytest.raises(InvalidInput, match="no such report"):
        write_pages(tmp_path / "elsewhere")


def test_a_case_is_asked_again_as_it_was_asked(everything):
    assert page(everything).again == "consilience run"
    cases = [case | {"call": "my cases/mine.toml"} for case in everything.cases]
    quick = replace(everything, header=everything.header | {"quick": True}, cases=cases)
    view = page(quick)
    assert view.again == "consilience run --quick"
    assert view.cases[0].command == "consilience run 'my cases/mine.toml' --quick"
    cell = view.cells[0]
    assert cell.command == f"consilience run 'my cases/mine.toml' -e {cell.engine} --quick"
    assert "asked quickly; " in render_html(quick)


def test_a_quick_run_says_nothing_about_defaults_that_engines_have(everything):
    told = page(everything).defaults
    assert told.without
    assert told.empty == "No engine was asked at its own defaults."
    quick = page(replace(everything, header=everything.header | {"quick": True})).defaults
    assert quick.without == ()
    assert quick.empty == "No engine was asked at its own defaults. A quick run leaves them out."


def test_templates_are_compiled_once_for_all_processes_and_for_each_choice_of_options(monkeypatch, tmp_path):
    """Each call makes an environment as another process would."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    fresh = template_environment.__wrapped__
    for options in ({"autoescape": True}, {"autoescape": False}, {"autoescape": False, "finalize": str}):
        with monkeypatch.context() as patch:
            patch.setattr(Environment, "compile", None)
            with pytest.raises(TypeError):
                fresh(**options).get_template("picture.svg.j2")
        fresh(**options).get_template("picture.svg.j2")
        with monkeypatch.context() as patch:
            patch.setattr(Environment, "compile", None)
            assert fresh(**options).get_template("picture.svg.j2").name == "picture.svg.j2"
