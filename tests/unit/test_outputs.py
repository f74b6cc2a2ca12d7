"""Outputs for programs and papers: JUnit, CSV, JSON, LaTeX, BibTeX and badges of a record of invented verdicts."""

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import jsonschema
import pytest

from consilience.case import shipped_cases
from consilience.compare import CODES, Verdict
from consilience.report.exports import badge, bibtex, document, junit, latex, spreadsheet
from consilience.report.exports.digest import cells
from consilience.report.selection import deciding
from records import LONG, case_of, comparison, quantity, record_of


@pytest.fixture
def record():
    """A record with every verdict, a bad method beside a good one, and a bad one at the engine's defaults only."""
    return record_of(
        [
            comparison("one", "alpha", "model"),
            comparison("one", "alpha", "instant"),
            comparison("one", "alpha", "instant", Verdict.MODEL, method="other", digits=2.0),
            comparison("one", "alpha", "trajectory", Verdict.DISCRETISATION),
            comparison("one", "alpha", "trajectory", Verdict.MODEL, method="stock", profile="default"),
            comparison(LONG, "alpha", "instant", Verdict.REGULARISATION),
            comparison(LONG, "alpha", "trajectory", Verdict.UNSUPPORTED, digits=None, why="joint 'a': <no> & never"),
            comparison("one", "beta_1", "model", Verdict.FAILED, digits=None, quantities=[]),
            comparison("one", "beta_1", "instant", Verdict.UNRESOLVED, digits=None),
            comparison("one", "reference", "instant", method="null_space"),
        ],
        missing={"gamma": "no licence"},
    )


def test_the_worst_matched_method_decides_a_cell_and_defaults_do_not(record):
    found = {(c.case, c.engine, c.question): c for c in cells(record)}
    assert found["one", "alpha", "instant"].verdict is Verdict.MODEL
    assert found["one", "alpha", "instant"].digits == 2.0
    assert found["one", "alpha", "trajectory"].verdict is Verdict.DISCRETISATION
    assert len(found) == 8


def test_the_deciding_quantity_is_nearest_to_its_bar_and_nothing_compared_is_no_zero():
    case, c = case_of("one"), comparison("one", "alpha", "instant")
    # nearness to the bar counts, not the bar: 3e-13 of 1e-11 is 0.03, 2e-13 of 1e-12 is 0.2
    assert deciding(c, case).name == "reactions"
    lost = c | {"quantities": [*c["quantities"], quantity("energy", None, 1e-12)]}
    assert (deciding(lost, case).name, deciding(lost, case).difference) == ("energy", None)
    exact = c | {"quantities": [quantity("freedom", 1.0, 0.0), *c["quantities"]]}
    assert deciding(exact, case).name == "freedom"
    none = c | {"quantities": [quantity("reactions", 0.0, 1e-10, count=0)]}
    assert deciding(none, case).difference is None
    moving = comparison("one", "alpha", "trajectory", horizon=1.0)
    assert (deciding(moving, case).difference, deciding(moving, case).bar) == (1e-6, 1e-8)


# required attributes of a suite in Ant's JUnit schema (windyroad)
SUITE = {"name", "package", "id", "timestamp", "hostname", "tests", "failures", "errors", "time"}


def test_junit_keeps_the_common_form(record):
    root = ET.fromstring(junit.render(record))
    assert [suite.get("id") for suite in root] == [str(n) for n in range(len(root))]
    for suite in root:
        assert set(suite.keys()) >= SUITE
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", suite.get("timestamp"))
        assert re.fullmatch(r"\d+\.\d{3}", suite.get("time"))
        tests = suite.findall("testcase")
        assert [child.tag for child in suite] == ["properties", *["testcase"] * len(tests), "system-out", "system-err"]
        assert int(suite.get("tests")) == len(tests)
        for kind, attribute in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
            assert int(suite.get(attribute)) == len(suite.findall(f"testcase/{kind}"))
        for test in tests:
            assert set(test.keys()) == {"name", "classname", "time"}
            assert len(test) <= 1
            assert all(child.get("type") for child in test if child.tag != "skipped")


def test_junit_says_what_the_exit_code_says_and_why(record):
    root = ET.fromstring(junit.render(record))
    outcome = {(t.get("classname"), t.get("name")): t for t in root.iter("testcase")}
    expected = {
        ("consilience.alpha", "one[model]"): None,
        ("consilience.alpha", "one[instant]"): "failure",
        ("consilience.alpha", "one[trajectory]"): None,
        ("consilience.alpha", f"{LONG}[instant]"): None,
        ("consilience.alpha", f"{LONG}[trajectory]"): "skipped",
        ("consilience.beta_1", "one[model]"): "error",
        ("consilience.beta_1", "one[instant]"): "error",
        ("consilience.reference", "one[instant]"): None,
        ("consilience.gamma", "starts"): "error",
    }
    assert {key: (test[0].tag if len(test) else None) for key, test in outcome.items()} == expected
    assert (
        outcome["consilience.alpha", f"{LONG}[trajectory]"][0].get("message") == "unsupported: joint 'a': <no> & never"
    )
    text = outcome["consilience.alpha", "one[instant]"][0].text
    for part in ("other: differs: model", "because of instant", "reactions: difference 2e-13, bar 1e-12", "again: "):
        assert part in text
    assert "consilience run one -e alpha -q instant" in text
    # only characters that XML cannot hold are replaced
    assert (
        "core \N{REPLACEMENT CHARACTER}[31mdumped\N{REPLACEMENT CHARACTER}"
        in outcome["consilience.beta_1", "one[model]"][0].text
    )
    assert "one, trajectory: differs: discretisation, 6.0 digits" in root.find("testsuite/system-out").text


def test_csv_has_a_row_a_comparison_with_numbers_in_full(record):
    rows = list(csv.DictReader(io.StringIO(spreadsheet.render(record), newline="")))
    assert len(rows) == len(record.comparisons)
    assert list(rows[0]) == list(spreadsheet.COLUMNS)
    (motion,) = [r for r in rows if r["question"] == "trajectory" and r["method"] == "RK4" and r["case"] == "one"]
    assert (motion["version"], motion["digits"], motion["difference"]) == ("1.2.3", "6.0", "0.5")
    assert (float(motion["bar"]), float(motion["step"]), float(motion["cpu"])) == (1e-8, 0.01, 0.25)
    (failed,) = [r for r in rows if r["verdict"] == "failed"]
    assert (failed["digits"], failed["difference"], failed["quantity"]) == ("", "", "")


def test_json_follows_its_schema_and_the_schema_refuses_other_documents(record):
    schema = document.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    written = json.loads(document.render(record))
    jsonschema.validate(written, schema)
    assert written["exit_code"] == 1
    assert written["missing"] == {"gamma": "no licence"}
    assert len(written["comparisons"]) == len(record.comparisons)
    assert written["comparisons"][3]["settings"] == {"iterations": 9}
    for spoilt in (
        written | {"format": 2},
        written | {"colour": 1},
        {k: v for k, v in written.items() if k != "cases"},
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(spoilt, schema)
    written["comparisons"][0]["verdict"] = "differs: colour"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(written, schema)


def test_json_judges_levels_up_to_the_horizon():
    written = document.document(record_of([comparison("one", "alpha", "trajectory", horizon=1.0)]))
    assert [level.largest for level in written.comparisons[0].levels] == [1e-5, 1e-6]


def test_latex_has_a_cell_for_each_question_and_engine_and_escapes_names(record):
    text = latex.render(record)
    assert r"\begin{tabular}{lrrrr}" in text
    body = [line.strip() for line in text.split(r"\midrule")[1].split(r"\bottomrule")[0].strip().splitlines()]
    assert body[0] == r"\texttt{one} & $\neq$ 2.0 & ? & $\approx$ 6.0 &  \\"
    name = r"name\_with \& 50 \% of \#specials\$ \textasciicircum{}\textasciitilde{}\{\}\textbackslash{}"
    assert body[1] == rf"\texttt{{{name}}} & $\propto$ 12.5 &  & -- &  \\"
    assert r"$\neq$~differs: model" in text
    assert r"beta\_1 1.2.3" in text
    assert text.count(r"\begin{") == text.count(r"\end{") == 2


def entries(text):
    """Return BibTeX entries by key: type and fields; all other lines must be comments."""
    found = {}
    rest = re.sub(r"@(\w+)\{([^,{}\s]+),\n((?:  \w+ = \{.*\},\n)*)\}\n", lambda m: found.update({m[2]: m}) or "", text)
    assert not [line for line in rest.splitlines() if line and not line.startswith("%")], rest
    return {key: (m[1], dict(re.findall(r"  (\w+) = \{(.*)\},\n", m[3]))) for key, m in found.items()}


def test_bibtex_cites_comparison_engines_methods_and_sources():
    used = [
        comparison("one", "mujoco", "instant"),
        comparison("two", "exudyn", "trajectory", method="GeneralizedAlpha"),
        comparison("two", "reference", "trajectory", method="relative"),
    ]
    given = record_of(used, engines=("mujoco", "exudyn"))
    sources = {
        "one": ("The bench of J. Doe & Sons, 50 %",),
        "two": ("L. D. Landau, E. M. Lifshitz, Mechanics, section 5",),
    }
    given = replace(given, cases=[case | {"sources": sources[case["name"]]} for case in given.cases])
    found = entries(bibtex.render(given))
    expected = {"consilience", "roache1994", "asme_vv20", "todorov2012", "gerstmayr2024", "chung_hulbert1993"}
    expected |= {"featherstone2008", "hairer_norsett_wanner1993", "landau_lifshitz", "source-one-1"}
    assert expected <= set(found)
    assert not {"lee2018", "carpentier2019", "benettin1980", "attia", "chrono"} & set(found)
    assert found["source-one-1"][1]["note"] == r"The bench of J. Doe \& Sons, 50 \%"
    assert "% for: two\n@book{landau_lifshitz," in bibtex.render(given)


def test_a_question_that_was_not_asked_is_not_cited():
    found = entries(bibtex.render(record_of([comparison("one", "alpha", "instant")])))
    assert set(found) == {"consilience", "source-one-1"}


REQUIRED = {
    "article": {"author", "title", "journal", "year"},
    "book": {"title", "publisher"},
    "inproceedings": {"author", "title", "booktitle", "year"},
    "techreport": {"author", "title", "institution", "year"},
    "misc": {"title"},
}
"""Fields that BibTeX's standard styles demand, except years of books with many editions."""


def test_the_literature_is_well_formed_and_every_pattern_finds_something():
    table = bibtex.literature()
    assert {"gerstmayr2024", "roache1994"} <= set(table)  # one of an adapter, one of our own
    sources = [source for case in shipped_cases() for source in case.sources]
    for key, entry in table.items():
        assert REQUIRED[entry["type"]] <= set(entry), key
        assert set(entry) & set(bibtex.CONDITIONS), key
        text = "".join(v for name, v in entry.items() if name not in bibtex.CONDITIONS)
        assert text.isascii(), key
        assert text.count("{") == text.count("}"), key
        assert not re.search(r"(?<!\\)[&%#]", text), key
        if "source" in entry:
            assert any(re.search(entry["source"], source) for source in sources), key
        if "doi" in entry:
            assert re.fullmatch(r"10\.\d{4,5}/\S+", entry["doi"]), key


def test_hardly_a_source_of_the_library_is_left_without_an_entry():
    cases = [case_of(case.name, *case.sources) for case in shipped_cases()]
    given = replace(record_of([comparison("one", "alpha", "instant")]), cases=cases)
    left = {text for _, text, _ in bibtex.others(given)}
    known = ("our own", "lecture slides", "numerical difficulty well known", "Peaucellier")
    assert not [text for text in left if not any(part in text for part in known)]


BADGES = {
    "all agree": (("instant", Verdict.AGREES),) * 2 + ((12.9, 11.2), "\N{CHECK MARK} agrees 11 digits"),
    "steps": (
        ("instant", Verdict.AGREES),
        ("trajectory", Verdict.DISCRETISATION),
        (12.9, 4.9),
        "\N{ALMOST EQUAL TO} agrees 4 digits, more in the limit",
    ),
    "unsupported": (
        ("instant", Verdict.AGREES),
        ("trajectory", Verdict.UNSUPPORTED),
        (12.9, None),
        "\N{EMPTY SET} agrees 12 digits, 1 unsupported",
    ),
    "model": (
        ("instant", Verdict.MODEL),
        ("trajectory", Verdict.DISCRETISATION),
        (2.0, 4.9),
        "\N{NOT EQUAL TO} 1 of 2 model",
    ),
}


@pytest.mark.parametrize("name", BADGES)
def test_a_badge_says_it_in_words_and_names_the_one_engine(name):
    *asked, digits, statement = BADGES[name]
    given = [
        comparison(f"case{n}", "alpha", q, v, digits=d) for n, ((q, v), d) in enumerate(zip(asked, digits, strict=True))
    ]
    found = badge.badge(record_of(given, engines=("alpha",)))
    assert (found.subject, found.statement) == ("consilience: alpha", statement)
    svg = ET.fromstring(badge.drawn(found))
    assert svg.get("aria-label") == svg[0].text == f"consilience: alpha: {statement}"
    assert float(svg.get("width")) > 0


def test_an_engine_that_is_missing_is_no_badge_of_agreement(record):
    assert badge.badge(record).statement == "! 1 engine missing"


def test_badges_can_be_read():
    """WCAG 2: white text of this size needs a contrast of 4.5 to its background."""
    assert set(badge.COLOURS) == set(Verdict) == set(CODES)
    for colour in (*badge.COLOURS.values(), "#444444"):
        channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        assert 1.05 / (luminance + 0.05) >= 4.5, colour


def test_every_column_of_the_page_on_outputs_is_one():
    page = (Path(__file__).parents[2] / "docs" / "outputs.md").read_text(encoding="utf-8")
    table = page.split("## CSV")[1].split("\n## ")[0]
    assert re.findall(r"^\| `(\w+)` \| (.*) \|$", table, flags=re.M) == list(spreadsheet.COLUMNS.items())
