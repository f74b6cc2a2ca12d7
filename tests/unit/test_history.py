"""`diff` and `trend` of two reports: one of a real run, the other a copy with a known change."""

import copy
import json

import pytest

from consilience.case import load_case
from consilience.cli.commands.history import diff_statement, renamed
from consilience.errors import InvalidInput
from consilience.report.annotations import cell_lines
from consilience.report.columns import wrapped
from consilience.report.history.changes import changes
from consilience.report.history.series import read_series, series_statement
from consilience.report.record import read_record, write_record
from consilience.report.statement import WRITERS, Statement
from consilience.suite import QUICK, run_suite


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the lines of a report of the reference and one engine."""
    folder = tmp_path_factory.mktemp("run")
    write_record(run_suite([load_case("double_pendulum")], ["pinocchio"], thoroughness=QUICK), 1.0, folder)
    return [json.loads(line) for line in (folder / "report.jsonl").read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def written(tmp_path, run):
    """Return a function that writes a report with changed lines and reads the file."""

    def writer(change=lambda _: None, name="report"):
        lines = copy.deepcopy(run)
        change(lines)
        compared = [line for line in lines if line["record"] == "comparison"]
        lines = [line for line in lines[:-1] if line["record"] != "cell"] + [*cell_lines(compared), lines[-1]]
        kinds = [line["record"] for line in lines]
        counted = (("cases", "case"), ("runs", "run"), ("comparisons", "comparison"))
        lines[-1].update({what: kinds.count(kind) for what, kind in counted})
        (tmp_path / name).mkdir()
        text = "".join(json.dumps(line) + "\n" for line in lines)
        (tmp_path / name / "report.jsonl").write_text(text, encoding="utf-8")
        return read_record(tmp_path / name)

    return writer


def comparison(lines, question):
    return next(
        line
        for line in lines
        if line["record"] == "comparison" and (line["engine"], line["question"]) == ("pinocchio", question)
    )


def told(found):
    return [(c.kind, c.effect, c.before, c.after) for c in found]


def test_a_report_does_not_differ_from_itself(written):
    record = written()
    sheet = diff_statement(record, record, {}, 0.5)
    assert sheet.data["changes"] == []
    assert "0 worse, 0 better, 0 other changes" in WRITERS["text"](sheet)


def test_a_verdict_that_falls_is_worse_and_says_why(written):
    def spoil(lines):
        comparison(lines, "instant").update(verdict="differs: model", digits=2.0, why="accelerations differ by 0.01")

    old, new = written(), written(spoil, "new")
    (change,) = changes(old, new)
    assert (change.kind, change.effect, change.why) == ("verdict", "worse", "accelerations differ by 0.01")
    assert change.before.startswith("agrees (")
    assert change.after == "differs: model (2.0 digits)"
    assert change.where.startswith("double_pendulum on pinocchio, instant")
    assert [c.effect for c in changes(new, old)] == ["better"]


def test_digits_are_told_from_a_threshold_on_and_of_defaults_decide_nothing(written):
    def at(digits, profile="matched"):
        return lambda lines: comparison(lines, "instant").update(digits=digits, profile=profile)

    old, new = written(at(13.0), "old"), written(at(12.4), "new")
    assert told(changes(old, new)) == [("digits", "worse", "13.0", "12.4")]
    assert told(changes(new, old)) == [("digits", "better", "12.4", "13.0")]
    assert changes(old, new, digits=0.7) == []
    by_default = written(at(13.0, "default"), "old default"), written(at(12.0, "default"), "new default")
    assert told(changes(*by_default)) == [("digits", "", "13.0", "12.0")]


def test_time_is_told_where_it_matters_and_on_one_machine_alone(written):
    def of(cpu, processor="one"):
        def change(lines):
            lines[0]["processor"] = processor
            asked = comparison(lines, "instant")
            for line in lines:
                if line["record"] == "run" and line["engine"] == "pinocchio" and line["question"] == "instant":
                    line["cpu"] = cpu if line["method"]["name"] == asked["method"] else 0.0

        return change

    fast, slow = written(of(0.2), "fast"), written(of(0.5), "slow")
    assert told(changes(fast, slow)) == [("time", "", "0.2 s", "0.5 s")]
    assert changes(written(of(0.02), "short"), written(of(0.05), "shortish")) == []  # differences too short to measure
    assert [c.kind for c in changes(fast, written(of(0.5, "another"), "elsewhere"))] == ["version"]


def test_versions_cases_and_engines_that_come_and_go(written):
    def later(lines):
        lines[0]["engines"]["pinocchio"]["version"] = "99.0"
        lines[1:1] = [{**lines[1], "name": "another"}]

    old, new = written(), written(later, "new")
    assert ("version", "", old.header["engines"]["pinocchio"]["version"], "99.0") in told(changes(old, new))
    assert ("case", "", "", "asked") in told(changes(old, new))
    assert ("case", "", "asked", "") in told(changes(new, old))

    def without(missing):
        def change(lines):
            del lines[0]["engines"]["pinocchio"]
            lines[0]["missing"] = missing
            lines[:] = [line for line in lines if line.get("engine") != "pinocchio"]

        return change

    assert told(changes(old, written(without({}), "not asked"))) == [("engine", "", "asked", "")]
    broken = written(without({"pinocchio": "ImportError"}), "broken")
    assert told(changes(old, broken)) == [("engine", "worse", "available", "not available")]
    assert told(changes(broken, old)) == [("engine", "better", "not available", "available")]


def test_a_case_that_asks_something_else_makes_nothing_worse(written):
    def shorter(lines):
        lines[1]["duration"] *= 2
        comparison(lines, "trajectory")["digits"] = 1.0

    found = changes(written(), written(shorter, "new"))
    assert [(c.kind, c.effect) for c in found] == [("digits", ""), ("case", "")]
    assert found[1].where == "case double_pendulum, duration"


def test_two_versions_in_one_report_are_compared_under_their_names(written):
    def both(lines):
        newer = [copy.deepcopy(line) for line in lines if line.get("engine") == "pinocchio"]
        for line in newer:
            line["engine"] = "pinocchio@5"
        next(n for n in newer if n["record"] == "comparison" and n["question"] == "instant").update(digits=3.0)
        lines[0]["engines"]["pinocchio@5"] = {**lines[0]["engines"]["pinocchio"], "version": "5"}
        lines[-1:-1] = newer

    record = written(both)
    names = renamed(["pinocchio=pinocchio@5"], record, record)
    found = changes(record, record, names)
    assert sorted({(c.kind, c.effect) for c in found}) == [("digits", "worse"), ("version", "")]
    with pytest.raises(InvalidInput, match="no engine 'pinocchio@6'"):
        renamed(["pinocchio=pinocchio@6"], record, record)


def test_every_format_takes_any_text_as_text(written):
    hostile = "<b>|x|</b> [red]\x1b[2J https://x.invalid"

    def spoil(lines):
        comparison(lines, "instant").update(verdict="failed", digits=None, why=hostile)

    sheet = diff_statement(written(), written(spoil, "new"), {}, 0.5)
    assert "\x1b" not in WRITERS["text"](sheet)
    assert "[red]" in WRITERS["text"](sheet).replace("\n", "")
    markdown = WRITERS["markdown"](sheet)
    assert "<b>" not in markdown
    assert "://" not in markdown
    data = json.loads(WRITERS["json"](sheet))
    assert (data["worse"], data["changes"][0]["why"]) == (1, hostile)


def test_a_series_is_in_the_order_of_its_dates_and_leaves_out_what_is_cut_off(written, tmp_path):
    def on(day, digits):
        def change(lines):
            lines[0]["written"] = f"2026-03-{day:02d}T12:00:00+00:00"
            comparison(lines, "instant")["digits"] = digits

        return change

    written(on(3, 12.0), "a")
    written(on(1, 13.0), "b")
    written(on(2, 13.1), "c")
    written(on(4, 1.0), "d")
    cut = tmp_path / "d" / "report.jsonl"
    cut.write_text("".join(cut.read_text().splitlines(keepends=True)[:-1]))
    series, unread = read_series(tmp_path)
    assert [name for name, _ in series] == ["b", "c", "a"]
    assert "cut off" in unread["d"]
    sheet = series_statement(series, unread, 0.5)
    assert [step["worse"] for step in sheet.data["changes"]] == [0, 1]
    assert sheet.data["worse"] == 1
    points = next(s["points"] for s in sheet.data["series"] if (s["engine"], s["question"]) == ("pinocchio", "instant"))
    assert [p["digits"] for p in points] == [13.0, 13.1, 12.0]
    for write in WRITERS.values():
        assert "cut off" in write(sheet).replace("\n", " ")
    with pytest.raises(InvalidInput, match="there is no report in it"):
        read_series(tmp_path / "a" / "nowhere")


@pytest.mark.parametrize("width", [200, 80, 40, 12])
def test_no_word_of_a_table_or_a_sentence_is_broken_at_any_width(monkeypatch, width):
    rows = [("closed_forms", "physical_pendulum-rotating", "1", "revolute", "a title of quite a number of words")]
    sheet = Statement(["one sentence"], [("cases", ("group", "name", "bodies", "joints", "title"), rows)], {})
    monkeypatch.setenv("COLUMNS", str(width))
    shown = WRITERS["text"](sheet)
    assert set(" ".join(rows[0]).split()) <= set(shown.split())
    assert max(map(len, shown.splitlines())) <= max(width, len("name: physical_pendulum-rotating") + 2)
    assert [line for line in wrapped("  two words", 8).splitlines()] == ["  two", "    words"]
