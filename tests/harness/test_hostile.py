"""Mutated case files and reports are either refused with one sentence or accepted; they have no other effect."""

import copy
import io
import itertools
import json
import subprocess
import sys
from contextlib import redirect_stdout, suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from consilience.case import Edition
from consilience.cli.commands.report import state_report
from consilience.cli.options import OutputFormat
from consilience.errors import ConsilienceError
from consilience.report.html import render_html
from consilience.report.markdown import render_markdown
from consilience.report.record import read_record
from consilience.report.site.cellhistory import entries_of, histories
from consilience.report.site.pages import site_files, site_report
from consilience.report.site.views import front
from hostile import campaign as hostile_campaign
from hostile import properties, wire
from hostile.extremes import extreme_mutants, swallow_extreme, warm_extreme
from hostile.mutations import MARK, TEXTS, jsonl_bytes
from hostile.pages import Elements, check_html, check_markdown, check_site, check_terminal, opened
from hostile.properties import (
    SCRIPT,
    case_mutants,
    fresh,
    hostile_everywhere,
    report_mutants,
    report_seed,
    steps,
    swallow_case,
    swallow_report,
    warm,
)
from hostile.watch import Breach, Hang, watched
from hostile.wire import swallow_wire, warm_wire, wire_mutants

EVERYDAY = settings(
    max_examples=100,
    deadline=None,
    database=None,
    phases=(Phase.generate, Phase.shrink),
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A real report, as bytes and as records."""
    folder = tmp_path_factory.mktemp("report")
    found = report_seed(folder)
    warm(found[0], folder)
    return found


@pytest.mark.slow
def test_mutated_case_files_are_refused_or_work(tmp_path):
    warm()

    @seed(7)
    @EVERYDAY
    @given(case_mutants())
    def campaign(raw):
        swallow_case(raw, tmp_path)

    campaign()


@pytest.mark.slow
def test_extreme_mechanisms_are_refused_or_answered(tmp_path):
    warm()
    warm_extreme(tmp_path)

    @seed(7)
    @EVERYDAY
    @given(extreme_mutants(steps))
    def campaign(raw):
        swallow_extreme(raw, tmp_path)

    campaign()


@pytest.mark.slow
def test_mutated_reports_are_refused_or_rendered_as_text(tmp_path, report):
    @seed(7)
    @EVERYDAY
    @given(report_mutants(report))
    def campaign(raw):
        swallow_report(raw, tmp_path)

    campaign()


@pytest.mark.slow
def test_mutated_frames_are_refused_or_understood(tmp_path):
    warm_wire(tmp_path)

    @seed(7)
    @EVERYDAY
    @given(wire_mutants(steps))
    def campaign(raw):
        swallow_wire(raw, tmp_path)

    campaign()


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "step"), [("cases", "examine"), ("reports", "render_markdown"), ("wire", "_sound")])
def test_an_exception_that_no_user_should_see_fails_the_campaign(kind, step, monkeypatch, tmp_path, report, capsys):
    def stumbles(*_):
        raise KeyError("planted")

    monkeypatch.setattr(wire if kind == "wire" else properties, step, stumbles)
    for name in ("warm", "warm_wire"):
        monkeypatch.setattr(hostile_campaign, name, lambda *_: None)
    monkeypatch.setattr(hostile_campaign, "report_seed", lambda _: report)
    assert hostile_campaign.main(["--kind", kind, "--inputs", "40", "--folder", str(tmp_path)]) == 1
    assert "KeyError: 'planted'" in capsys.readouterr().out
    assert (tmp_path / "finding").stat().st_size > 0


@pytest.mark.parametrize("payload", [t for t in TEXTS if 1 < len(t) < 900], ids=lambda t: ascii(t)[1:30])
def test_text_of_a_report_stays_text_wherever_it_stands(payload, report, tmp_path):
    lines = hostile_everywhere(report[1], payload)
    (tmp_path / "report.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    with watched(tmp_path):
        record = read_record(tmp_path)
        page, markdown = render_html(record), render_markdown(record)
        printed = io.StringIO()
        with redirect_stdout(printed):
            state_report(tmp_path, OutputFormat.TEXT)
    check_html(page, SCRIPT)
    about = site_report(record, "0")
    cells = histories(entries_of(record, about))
    check_site(dict(site_files(front(cells, [about], {payload: payload}, Edition("2030", "2030-01-01", {})), cells)))
    check_markdown(markdown)
    check_terminal(printed.getvalue())
    if payload.isascii() and payload.isprintable():
        texts = (page, *opened(page).values())
        assert sum("".join(Elements(text).text).count(payload) for text in texts) > 50


def _rename_out(folder):
    (folder / "inside" / "x").write_text("")
    (folder / "inside" / "x").rename(folder / "y")


def _read_elsewhere(_folder):
    with suppress(FileNotFoundError):
        Path(f"/tmp/{MARK}").read_bytes()


@pytest.mark.parametrize(
    "does",
    [
        lambda folder: (folder / "outside").write_text("x"),
        _rename_out,
        _read_elsewhere,
        lambda _: subprocess.run([sys.executable, "-c", ""], check=True),
        lambda _: eval("1 + 1"),
        lambda _: exec("x = 1"),
    ],
    ids=["write", "rename", "read", "program", "eval", "exec"],
)
def test_the_watch_sees_what_no_input_may_do(does, tmp_path):
    (tmp_path / "inside").mkdir()
    with watched(tmp_path / "inside"):
        (tmp_path / "inside" / "allowed").write_text("x")
    with pytest.raises(Breach):
        _watch(tmp_path / "inside", lambda: does(tmp_path))


def test_the_watch_ends_what_takes_too_long(tmp_path):
    with pytest.raises(Hang):
        _watch(tmp_path, lambda: sum(1 for _ in itertools.count()), limit=0.1)


def _watch(folder, does, limit=5.0):
    with watched(folder, limit):
        does()


def test_a_report_that_was_cut_off_anywhere_is_never_taken_for_a_whole_one(report, tmp_path):
    raw, lines = report
    ends = [n for n, byte in enumerate(raw) if byte == ord("\n")]
    for at in {0, 1, *ends[:-1], *(end + 1 for end in ends[:-1]), *(end + 40 for end in ends[:-1]), len(raw) - 2}:
        with pytest.raises(ConsilienceError):
            read_record(_with(fresh(tmp_path / "r"), raw[:at]))
    # a report with lines lost in the middle, and a report with the end of another report
    rows = raw.splitlines(keepends=True)
    for k in range(1, len(rows) - 1):
        with pytest.raises(ConsilienceError, match=r"cut off|contradicts"):
            read_record(_with(fresh(tmp_path / "r"), b"".join(rows[:k] + rows[k + 1 :])))
    assert read_record(_with(fresh(tmp_path / "r"), raw)).footer == lines[-1]


def _with(folder, raw):
    (folder / "report.jsonl").write_bytes(raw)
    return folder


@given(st.binary(max_size=300))
@settings(max_examples=100, deadline=None, database=None)
def test_bytes_of_any_kind_are_no_case(tmp_path_factory, raw):
    folder = tmp_path_factory.mktemp("any")
    assert not swallow_case(raw, folder)


def _second_case(lines):
    lines[1:1] = [lines[1]]


def _answer_twice(lines):
    last = max(n for n, line in enumerate(lines) if line["record"] == "comparison")
    lines.insert(last, lines[last])


def _huge_integers(lines):
    judged = next(line for line in lines if line.get("levels"))
    judged["levels"][0]["difference"] = [10**40] * len(judged["times"])
    judged["levels"][0]["counters"] = {"steps": 10**40}
    return judged


CONTRADICTIONS = {
    "a case twice": (_second_case, "two cases have one name"),
    "an engine of nobody": (lambda lines: lines[0]["engines"].pop("mujoco"), "of no engine"),
    "a case of nobody": (lambda lines: lines[1].update(name="another"), "of no case"),
    "an answer twice": (_answer_twice, "of the same answer"),
    "more cells than anybody can open": (
        lambda lines: lines[0]["engines"].update({f"e{n}": lines[0]["engines"]["mujoco"] for n in range(20_001)}),
        "cases times engines",
    ),
    "a motion of no run": (
        lambda lines: [line["method"].update(softness=7.0) for line in lines if isinstance(line.get("method"), dict)],
        "no run holds",
    ),
}


@pytest.mark.parametrize(("change", "message"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_lines_that_contradict_one_another_are_refused(change, message, report, tmp_path):
    lines = copy.deepcopy(report[1])
    change(lines)
    kinds = [line["record"] for line in lines]
    lines[-1].update(cases=kinds.count("case"), runs=kinds.count("run"), comparisons=kinds.count("comparison"))
    with pytest.raises(ConsilienceError, match=message):
        read_record(_with(tmp_path, jsonl_bytes(lines)))


def test_whole_numbers_of_any_size_are_rendered(report, tmp_path):
    """Figures must take integers too large for int64 as numbers, not as NumPy objects."""
    lines = copy.deepcopy(report[1])
    _huge_integers(lines)
    assert swallow_report(jsonl_bytes(lines), tmp_path)
