"""The site of many reports: addresses, histories, scores over an edition, findings, and what it refuses."""

import json
import re
from html import unescape
from pathlib import Path

import pytest

from consilience.case import Edition, case_names, chosen_edition, load_case, load_cases
from consilience.case.file.digest import case_digest
from consilience.errors import InvalidInput
from consilience.report.site.findings import threads
from consilience.report.site.pages import write_site
from consilience.report.site.score import ALL
from records import comparison, record_of

EDITION = Edition("2030", "2030-01-01", {"arm": "a1", "bar": "b1", "cam": "c1", "disc": "d1"})
VERSIONS = ("1.9", "1.10", "2.0", "2.1", "2.2")
"""Five versions; the planted regression is in 2.1."""


def motion(case, engine, digits, verdict="agrees"):
    return comparison(case, engine, "trajectory", verdict=verdict, digits=digits)


def report(folder, comparisons, versions, digests=None, day=1, quick=False):
    """Write a record that was never made, with the version of each engine and the digest of each case."""
    record = record_of(comparisons, engines=tuple(versions))
    header = record.header | {"written": f"2030-01-{day:02}T00:00:00+00:00", "quick": quick}
    for name, version in versions.items():
        header["engines"][name] |= {"name": name.partition("@")[0], "version": version}
    known = EDITION.digests | (digests or {})
    cases = [case | {"digest": known.get(case["name"])} for case in record.cases]
    written(folder, record, header, cases)


def written(folder, record, header, cases):
    lines = [header, *cases, *record.runs, *record.comparisons, *record.cells, record.footer | {"record": "footer"}]
    folder.mkdir(parents=True)
    (folder / "report.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """A site of five versions of one engine, each in a report of its own, and of another engine in one version."""
    folder = tmp_path_factory.mktemp("five")
    for n, version in enumerate(VERSIONS):
        wrong = {"verdict": "differs: model", "digits": 3.0, "why": "accelerations differ by 1e-3"} if n >= 3 else {}
        found = [motion("arm", f"alpha@{version}", 9.5), comparison("bar", f"alpha@{version}", "instant", **wrong)]
        versions = {f"alpha@{version}": version}
        if n == 0:
            found += [motion("arm", "beta_1", 6.5), motion("<b>../x", "beta_1", 4.0)]
            versions["beta_1"] = "0.3"
        report(folder / "reports" / version, found, versions, day=5 - n)  # asked in the opposite order
    write_site([folder / "reports"], folder / "site", EDITION)
    return folder


def data(folder):
    return json.loads((folder / "site" / "site.json").read_text())


def test_a_history_follows_versions_not_dates_and_the_planted_one_is_named(five):
    (cell,) = [c for c in data(five)["cells"] if (c["case"], c["engine"]) == ("bar", "alpha")]
    assert [point["version"] for point in cell["history"]] == list(VERSIONS)
    assert [point["model"] == "agrees" for point in cell["history"]] == [True, True, True, False, False]
    page = (five / "site" / "cell" / "bar" / "alpha" / "index.html").read_text()
    assert re.findall(r"alpha (\S+) → (\S+)</span>", page) == [("2.0", "2.1")]
    assert page.count("accelerations differ by 1e-3") == 2
    for name in ("index.html", "engine/alpha/index.html"):
        assert "2.0 → 2.1" in (five / "site" / name).read_text()


def test_every_link_leads_to_a_file_of_the_site_or_a_thread(five):
    site = (five / "site").resolve()
    seen = 0
    for page in site.rglob("index.html"):
        for link in map(unescape, re.findall(r'(?:href|src)="([^"]*)"', page.read_text())):
            if not link.startswith(("https://github.com/", "data:")):
                target = (page.parent / link.partition("#")[0]).resolve()
                assert target.is_file(), f"{page}: {link}"
                assert site in target.parents, "nothing is written outside of the site"
                seen += 1
    assert seen > 40
    assert "<b>" not in "".join(page.read_text() for page in site.rglob("index.html"))


def test_addresses_depend_on_names_alone_and_stay(five, tmp_path):
    before = {c["address"] for c in data(five)["cells"]}
    report(tmp_path / "more" / "later", [motion("aaa", "alpha", 9.0)], {"alpha": "3.0"}, day=9)
    (tmp_path / "site").mkdir()
    write_site([tmp_path / "more", five / "reports" / "2.2", five / "reports"], tmp_path / "site", EDITION)
    after = json.loads((tmp_path / "site" / "site.json").read_text())
    assert before < {c["address"] for c in after["cells"]}
    assert {r["address"] for r in data(five)["reports"]} < {r["address"] for r in after["reports"]}
    # a smaller site over it keeps the pages
    write_site([tmp_path / "more"], tmp_path / "site", EDITION)
    assert all((tmp_path / "site" / address / "index.html").is_file() for address in before)


def test_the_score_counts_what_the_edition_froze_and_says_what_does_not_count(tmp_path):
    engines = {"alpha": "1.0", "beta": "1.0"}
    found = [
        *(motion("arm", name, digits) for name, digits in (("alpha", 12.5), ("beta", 6.2))),
        *(motion("bar", name, 9.9, "differs: discretisation") for name in engines),
        *(motion("cam", name, 9.0) for name in engines),
        # ten digits, and another model: no agreement
        *(motion("disc", name, 10.0) for name in engines),
        comparison("disc", "alpha", "instant", verdict="differs: model", digits=2.0),
    ]
    report(tmp_path / "in" / "one", found, engines, {"cam": "c2"})
    view = write_site([tmp_path / "in"], tmp_path / "site", EDITION)
    scores = {score.engine: score for score in view.scores}
    assert scores[ALL].agreeing == (2, 2, 1, 0)
    assert scores["alpha"].agreeing == (2, 2, 2, 1)
    assert scores["beta"].agreeing == (3, 3, 2, 0)
    assert {s.of for s in view.scores} == {3}
    assert scores[ALL].shares == ["66 %", "66 %", "33 %", "0 %"]
    assert scores[ALL].note == "of 3 cases; 1 case changed since the edition"
    badge = (tmp_path / "site" / "badge" / "score-6.svg").read_text()
    assert 'aria-label="consilience 2030: 6 digits: 66 % of 3 cases"' in badge
    # quick answers, and cases that were not asked
    report(tmp_path / "quick" / "one", [motion("arm", "alpha", 9.0)], {"alpha": "1.0"}, quick=True)
    (score,) = write_site([tmp_path / "quick"], tmp_path / "other", EDITION).scores
    assert score.note == "of 0 cases; 3 cases not asked; 1 case asked quickly"
    assert score.shares == []
    # what an engine cannot represent counts, and is said
    refused = comparison("bar", "alpha", "trajectory", verdict="unsupported", digits=None)
    report(tmp_path / "refused" / "one", [motion("arm", "alpha", 9.0), refused], {"alpha": "1.0"})
    (score,) = write_site([tmp_path / "refused"], tmp_path / "third", EDITION).scores
    assert score.agreeing == (1, 1, 1, 0)
    assert score.note == "of 2 cases, 1 of them unsupported; 2 cases not asked"
    # a quick run after a full one of the same version takes nothing away
    report(tmp_path / "quick" / "two", [motion("arm", "alpha", 9.0)], {"alpha": "1.0"}, day=2)
    report(tmp_path / "quick" / "three", [motion("arm", "alpha", 5.0)], {"alpha": "1.0"}, day=3, quick=True)
    (score,) = write_site([tmp_path / "quick"], tmp_path / "other", EDITION).scores
    assert (score.of, score.agreeing) == (1, (1, 1, 1, 0))


def test_a_cell_leads_to_its_finding_and_the_finding_to_its_thread(tmp_path):
    shown = {"profile": "default", "verdict": "failed", "why": "a_WB_W has 9 values that are not finite"}
    failing = comparison("arm", "pinocchio", "instant", method="constraintDynamics", **shown)
    record = record_of([failing, comparison("arm", "pinocchio", "model")], engines=("pinocchio",))
    cases = [case | {"undetermined": {"pin": [1, 0, 0, 0, 0, 0]}} for case in record.cases]
    again = type(record).annotated(record.header, cases, record.runs, record.comparisons, record.footer)
    written(tmp_path / "in", again, again.header, again.cases)
    write_site([tmp_path / "in"], tmp_path / "site", EDITION)
    thread = 'href="https://github.com/stack-of-tasks/pinocchio/issues/2150"'
    page = (tmp_path / "site" / "cell" / "arm" / "pinocchio" / "index.html").read_text()
    assert 'href="../../../finding/pinocchio_default_proximal/index.html"' in page
    assert thread in page
    finding = (tmp_path / "site" / "finding" / "pinocchio_default_proximal" / "index.html").read_text()
    assert thread in finding
    assert "<strong>Expected.</strong>" in finding
    assert 'href="../../cell/arm/pinocchio/index.html"' in finding


def test_a_bare_number_is_of_the_project_named_before():
    found = threads("# Title\n#3, then a/b#12 and #14; c-d/e.f#7, `x#9y`.")
    assert [thread.name for thread in found] == ["a/b#12", "a/b#14", "c-d/e.f#7"]


def test_what_cannot_be_read_is_left_out_and_said(five, tmp_path):
    (tmp_path / "in" / "broken").mkdir(parents=True)
    (tmp_path / "in" / "broken" / "report.jsonl").write_text("{}\n")
    with pytest.raises(InvalidInput, match="it is not a record of a report"):
        write_site([tmp_path / "in"], tmp_path / "site", EDITION)
    view = write_site([tmp_path / "in", five / "reports" / "2.2"], tmp_path / "site", EDITION)
    assert list(view.left_out) == [str(tmp_path / "in" / "broken")]
    assert "is left out" in (tmp_path / "site" / "index.html").read_text()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("work of years")
    with pytest.raises(InvalidInput, match="there is something in it that is no site"):
        write_site([five / "reports"], tmp_path / "mine", EDITION)


# ---------------------------------------------------------------- editions


def test_the_digest_is_of_what_a_file_asks():
    tables = {"title": "A", "gravity": [0.0, 0.0, -9.81], "body": [{"name": "rod", "mass": 1.0}]}
    digest = case_digest(tables)
    assert digest == case_digest({"body": [{"mass": 1.0, "name": "rod"}], "gravity": [0.0, 0.0, -9.81]})
    assert digest == case_digest(tables | {"title": "B", "remarks": "well known", "published": [{"value": 1.0}]})
    assert digest != case_digest(tables | {"gravity": [0.0, 0.0, -9.80665]})
    varied = tables | {"variants": {"a": {"title": "a", "digits": 8}, "b": {"title": "b", "digits": 6}}}
    assert case_digest(varied, "a") != case_digest(varied, "b")
    more = varied | {"variants": varied["variants"] | {"c": {}}}
    assert case_digest(varied, "a") == case_digest(more, "a"), "other variants are other cases"


def test_cases_know_their_digests_and_editions_their_cases(tmp_path):
    digest = load_case("four_bar").digest
    cases = load_cases("simple_pendulum")
    assert len({case.digest for case in cases}) == len(cases) > 1
    source = Path(__file__).parents[2] / "cases" / "mechanisms" / "four_bar.toml"
    copy = tmp_path / "four_bar.toml"
    copy.write_text(f"# mine\n{source.read_text()}")
    assert load_case(copy).digest == digest
    copy.write_text(source.read_text().replace("-9.81", "-9.80665"))
    assert load_case(copy).digest != digest
    assert chosen_edition("2026").digests.keys() <= set(case_names())
    with pytest.raises(InvalidInput, match="there is no such edition"):
        chosen_edition("1926")
