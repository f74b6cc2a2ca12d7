"""The pages say what the record says: verdicts, reasons, absent values as absent, and names as text."""

import json
import re
from html.parser import HTMLParser

import plotly.graph_objects as go
import pytest

from consilience.compare import Verdict
from consilience.errors import InvalidInput
from consilience.report import wording
from consilience.report.html import embedded_json, render_html
from consilience.report.markdown import render_markdown
from consilience.report.pages import write_pages
from consilience.report.plots import compact, figures
from consilience.report.record import Record
from consilience.report.view import page, unwrapped
from consilience.run import Question, Route

HOSTILE = '<script>alert(1)</script> | `x` & "y" [a](b)'
VOID = {"meta", "br", "link", "img", "hr", "input"}


def method(name, route=Route.NATIVE, order=None, substeps=(), tolerances=(), **settings):
    return {
        "name": name,
        "route": str(route),
        "order": order,
        "substeps": list(substeps),
        "tolerances": list(tolerances),
        "settings": settings,
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
    blank = {k: None for k in ("limit_digits", "declared_order", "order", "self_order", "band", "reference_spread")}
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
        **blank,
        "quantities": [],
        "times": [],
        "levels": [],
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


def case(name, title="A title", remarks="Line one\nline two."):
    return {
        "record": "case",
        "name": name,
        "title": title,
        "bodies": ["b1"],
        "joints": [["j1", "revolute", "ground", "b1"]],
        "rows": 5,
        "duration": 5.0,
        "sample": 0.05,
        "digits": 8,
        "instants": 20,
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
    """Runs and comparisons of an engine that answers everything, the reactions apart."""
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
            **over_time,
        ),
    ]
    return runs, comparisons


def troubled(name="swing"):
    """An engine that crashes, one that cannot, one that differs, one whose difference is not finite."""
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


def record(parts, cases, missing=None, code=1):
    runs = [r for part in parts for r in part[0]]
    comparisons = [c for part in parts for c in part[1]]
    names = dict.fromkeys(["reference", *(r["engine"] for r in runs)])
    header = {
        "record": "header",
        "format": 1,
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
    return Record(header, cases, runs, comparisons, footer)


@pytest.fixture(scope="module")
def everything():
    return record([answered(), troubled()], [case("swing")], {"gone": "ImportError: no module"})


@pytest.fixture(scope="module")
def hostile():
    runs, comparisons = answered(HOSTILE, HOSTILE)
    for r, c in zip(runs[1:3], comparisons[1:3], strict=True):
        r["method"] = {**r["method"], "name": HOSTILE, "settings": {HOSTILE: HOSTILE}}
        c.update(method=HOSTILE, why=HOSTILE)
    return record([(runs, comparisons)], [case(HOSTILE, HOSTILE, HOSTILE)], {HOSTILE: HOSTILE})


class Structure(HTMLParser):
    """Elements of a page: whether they nest, their identifiers, their links and their text."""

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


def cell_of(view, engine):
    return next(cell for cell in view.cells if cell.engine == engine)


def test_every_verdict_route_question_and_exit_code_has_its_words():
    assert list(wording.LOOKS) == list(Verdict)
    assert list(wording.PHRASES) == list(Verdict)
    assert set(wording.ROUTES) == set(Route)
    assert set(wording.QUESTIONS) == set(Question)
    looks = list(wording.LOOKS.values())
    assert len({look.symbol for look in looks}) == len({look.key for look in looks}) == len(looks)


def test_the_head_counts_cells_and_leaves_the_reference_out(everything):
    view = page(everything)
    assert view.headline == (
        "0 of 6 cells agree with the reference in every question and by every method; "
        "1 differ by the step size alone, which smaller steps remove; 1 hold something the engine cannot represent; "
        "2 differ in the model; 2 failed; 1 engine not available (gone)."
    )
    assert view.exit_code == 1
    assert sum(t.count for t in view.tallies) == 6


def test_a_cell_shows_the_worst_verdict_and_each_question_its_methods(everything):
    cell = cell_of(page(everything), "good")
    assert cell.look is wording.LOOKS[Verdict.DISCRETISATION]
    model, _, trajectory = cell.marks
    assert [(look.name, digits) for look, digits in model.entries] == [("agrees", "15.3")]
    assert [(look.name, digits) for look, digits in trajectory.entries] == [
        ("differs: discretisation", "6.6"),
        ("agrees", "9.5"),
    ]
    assert cell_of(page(everything), "reference").look is wording.YARDSTICK
    assert cell_of(page(everything), "cannot").marks[0].entries == ((wording.NOT_ASKED, ""),)


def test_what_was_not_compared_is_a_dash_and_never_zero(everything):
    answer = next(a for a in cell_of(page(everything), "good").answers if a.question == "instant")
    reactions = answer.quantities[1]
    assert (reactions.difference, reactions.count, reactions.state) == (wording.DASH, wording.DASH, "absent")
    assert reactions.remark == "not given by this method"
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
    text = render_html(everything)
    assert "signal SIGSEGV" in text
    assert "last words &lt;b&gt;" in text


def test_unsupported_lists_every_reason(everything):
    (answer,) = cell_of(page(everything), "cannot").answers
    assert answer.unsupported == ("rod: there is no such joint", "spring: none either")


def test_levels_have_units_and_adaptive_ones_tolerances(everything):
    rk4, adaptive = (a for a in cell_of(page(everything), "good").answers if a.question == "trajectory")
    assert rk4.levels.heads[0] == "step"
    assert rk4.levels.rows[0] == ("0.005 s", "5e-09", "2.5e-09", "20 s", "1.2e-15", "1000", "2.35")
    assert (adaptive.levels.heads[0], adaptive.levels.rows[1][0]) == ("tolerance", "1e-10")
    facts = {f.name: (f.value, f.note) for f in rk4.facts}
    assert facts["observed order"][0] == "3.99"
    assert facts["self order"] == (wording.DASH, "hidden by rounding")
    assert facts["digits"] == ("6.6", "at the finest level; asked 8")
    assert "declared order" not in {f.name for f in adaptive.facts}


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
    (row,) = page(everything).orders
    assert (row.cell.engine, row.answer.method) == ("good", "RK4")
    assert row.values == ("4", "3.99", wording.DASH, "6.6", "11.2", "1.2e-09")


def test_all_answers_that_do_not_agree_are_listed_worst_first(everything):
    view = page(everything)
    listed = [answer.look.name for _, answer in view.remarkable]
    assert listed == ["failed", "failed", "differs: model", "differs: model", "unsupported", "differs: discretisation"]


@pytest.mark.parametrize("name", ["everything", "hostile"])
def test_the_page_is_sound_html_that_links_within_itself(name, request):
    structure = Structure(render_html(request.getfixturevalue(name)))
    assert structure.open == []
    assert len(set(structure.ids)) == len(structure.ids)
    assert structure.links
    assert all(link.startswith("#") and link[1:] in structure.ids for link in structure.links)
    assert structure.scripts == 3
    assert all(re.fullmatch(r"\S+", name) for name in structure.ids)


def test_the_page_fetches_nothing_and_holds_plotly_once(everything):
    text = render_html(everything)
    assert "default-src 'none'" in text
    assert text.count("plotly.js v") == 1
    outside = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"https?://|@import|url\(", outside)


@pytest.mark.parametrize("name", ["everything", "hostile"])
def test_every_place_of_a_plot_has_its_figure_and_plotly_takes_it(name, request):
    given = request.getfixturevalue(name)
    text = render_html(given)
    embedded = re.search(r'<script type="application/json" id="figures">(.*?)</script>', text, re.DOTALL).group(1)
    found = json.loads(embedded)
    assert found == figures(given)
    assert sorted(Structure(text).figures) == sorted(found)
    for figure in found.values():
        go.Figure(figure)


def test_figures_have_a_colour_a_method_a_dash_a_level_and_gaps_for_zeros(everything):
    figure = figures(everything)["difference.swing.good"]
    assert [t["line"]["dash"] for t in figure["data"]] == ["dot", "dash", "solid", "dash", "solid"]
    assert len({t["line"]["color"] for t in figure["data"]}) == 2
    assert figure["data"][0]["y"][0] is None
    assert (figure["data"][0]["x0"], figure["data"][0]["dx"]) == (0.0, 2.5)
    assert figure["layout"]["yaxis"]["type"] == "log"
    assert figure["layout"]["shapes"][0]["y0"] == 1e-8
    assert compact([0.0, None, -1.23456e-9, 1234567.0]) == [None, None, 1.235e-9, 1235000.0]
    work = figures(everything)["work.swing"]["data"]
    assert [len(t["x"]) for t in work] == [3, 2]


def test_names_are_text_in_html(hostile):
    structure = Structure(render_html(hostile))
    assert structure.scripts == 3
    assert HOSTILE in "".join(structure.text)
    plotted = figures(hostile)[f"work.{wording.anchor(HOSTILE)}"]["data"]
    assert all("<" not in trace["name"] for trace in plotted)


def test_no_character_of_embedded_json_can_end_its_element():
    text = str(embedded_json({HOSTILE: "<!-- </script>"}))
    assert not set("<>&") & set(text)
    assert json.loads(text) == {HOSTILE: "<!-- </script>"}


def test_digits_are_none_where_not_even_the_first_is_right():
    assert [wording.digits_text(d) for d in (12.34, -0.7, None)] == ["12.3", "0.0", wording.DASH]


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
    assert "| swing | ≈ **differs: discretisation**<br>model ✓15.3<br>instant ✓12.6<br>trajectory ≈6.6 ✓9.5 |" in text
    assert "| ! failed | swing | crashes | trajectory | RK4 | the worker died: signal SIGSEGV |" in text
    assert "| swing | good | RK4 | tuned | 4 | 3.99 | — | 6.6 | 11.2 | 1.2e-09 |" in text
    assert "- **gone** not available: ImportError: no module" in text
    assert not re.search(r"\n{3,}", text)


def luminance(colour):
    """Relative luminance of sRGB, as WCAG 2 defines it."""
    channels = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_texts_stand_out_from_their_ground(everything, theme):
    style = re.search(r"<style>(.*?)</style>", render_html(everything), re.DOTALL).group(1)
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", re.findall(r":root \{(.*?)\}", style, re.DOTALL)[theme]))
    pairs = [(f"{look.key}-text", look.key) for look in wording.LOOKS.values()]
    pairs += [(text, ground) for text in ("text", "quiet", "link") for ground in ("page", "soft")]
    for text, ground in pairs:
        dark, light = sorted((luminance(colours[text]), luminance(colours[ground])))
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (text, ground)


def test_anchors_are_fit_for_urls_and_differ_where_names_do():
    names = ["a b", "a-b", "a.b", "a~20~b", "ä"]
    anchors = [wording.anchor(n) for n in names]
    assert len(set(anchors)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_.~-]+", a) for a in anchors)


def test_a_report_without_cases_is_a_page_too():
    empty = record([], [], code=3)
    assert "0 of 0 cells" in render_html(empty)
    assert "There are none." in render_markdown(empty)


def test_pages_are_written_beside_their_record(everything, tmp_path):
    lines = [everything.header, *everything.cases, *everything.runs, *everything.comparisons, everything.footer]
    (tmp_path / "report.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    write_pages(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.html", "report.jsonl", "report.md"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == render_html(everything)
    with pytest.raises(InvalidInput, match="no such report"):
        write_pages(tmp_path / "elsewhere")
