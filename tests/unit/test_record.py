"""The record: causes, best methods, cells, failures and findings, and records of the earlier format."""

import gzip
import json
import re
from pathlib import Path

import jsonschema
import pytest

from consilience.case import load_case
from consilience.compare import Verdict
from consilience.engine import Question, Route
from consilience.engine.failures import FailureClass, failure_class
from consilience.engine.questions import defects
from consilience.errors import InvalidInput
from consilience.report.findings import known_findings, signs
from consilience.report.history.changes import changes
from consilience.report.pages import write_pages
from consilience.report.record import read_question, read_record
from consilience.report.recordschema import record_schema
from records import comparison, quantity, record_of

OLD = Path(__file__).parents[1] / "old_records"
FINDINGS = Path(__file__).parents[2] / "reports" / "findings"


def written(record, folder, form=3, drop=()):
    """Write a record as an earlier or the present version does; return its folder."""
    kept = [record.header | {"format": form}, *record.cases, *record.runs, *record.comparisons, *record.cells]
    kept = [{k: v for k, v in line.items() if k not in drop} for line in kept]
    found = [line for line in kept if form > 2 or line["record"] != "cell"]
    folder.mkdir(exist_ok=True)
    text = "".join(json.dumps(line) + "\n" for line in (*found, record.footer | {"record": "footer"}))
    (folder / "report.jsonl").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def two_integrators():
    """Record of one engine: its own integrator needs smaller steps or fails, that of the harness agrees."""
    coarse = {"verdict": str(Verdict.DISCRETISATION), "digits": 3.6, "rule": "steps"}
    return record_of(
        [
            comparison("one", "alpha", "model", digits=15.0),
            comparison("one", "alpha", "instant", digits=12.5),
            comparison("one", "alpha", "trajectory", method="Euler", **coarse),
            comparison("one", "alpha", "trajectory", method="ours", route=str(Route.HARNESS_INTEGRATOR), digits=11.0),
            comparison(
                "one", "alpha", "trajectory", Verdict.FAILED, method="broken", digits=None, why="no answer within 60 s"
            ),
            comparison(
                "one", "alpha", "trajectory", Verdict.MODEL, method="as it comes", profile="default", digits=9.0
            ),
        ],
        engines=("alpha",),
    )


def test_the_best_method_is_the_engines_own_though_the_harness_has_more_digits(two_integrators):
    assert [c["method"] for c in two_integrators.comparisons if c["best"]] == ["solve", "solve", "Euler"]


def test_a_cell_tells_model_and_motion_apart(two_integrators):
    (cell,) = two_integrators.cells
    assert (cell["verdict"], cell["cause"]) == ("failed", "time")
    assert (cell["model"], cell["motion"]) == ("agrees", "differs: discretisation")
    assert (cell["digits"], cell["digits_asked"], cell["method"], cell["own"]) == (3.6, 8.0, "Euler", True)


def test_digits_are_asked_by_the_bar_that_decides():
    bars = [quantity("accelerations", 5e-12, 1e-11), quantity("energy", 1e-15, 1e-12)]
    (c,) = record_of([comparison("one", "alpha", "instant", quantities=bars)]).comparisons
    assert (c["digits_asked"], c["cause"]) == (11.0, "bars met")


def test_a_refused_question_leaves_the_verdict_of_the_model():
    refused = comparison("one", "alpha", "trajectory", Verdict.UNSUPPORTED, method="", route=None, digits=None)
    (cell,) = record_of([comparison("one", "alpha", "instant"), refused]).cells
    assert (cell["verdict"], cell["model"], cell["motion"]) == ("unsupported", "agrees", "unsupported")


@pytest.mark.parametrize(
    ("reason", "expected"),
    [
        ("no answer within 60 s; the worker was stopped", FailureClass.TIME),
        ("out of memory: 5000 MiB, the limit is 4096 MiB", FailureClass.MEMORY),
        ("the worker died: signal SIGSEGV", FailureClass.CRASH),
        ("while it started, the worker died: exit code 1", FailureClass.CRASH),
        ("stopped before it answered", FailureClass.STOPPED),
        ("RuntimeError: the step was reduced 20 times", FailureClass.REFUSED),
        ("the answer is a str, not a ModelAnswer", FailureClass.MALFORMED),
        ("mass has shape (2,), not ()", FailureClass.MALFORMED),
        ("it answered job 3, not job 4", FailureClass.MALFORMED),
        ("the method names no substeps and no tolerances: no level to run", FailureClass.OTHER),
    ],
)
def test_failures_have_a_class_beside_their_text(reason, expected):
    assert failure_class(reason) is expected


def test_values_that_are_not_finite_are_a_class_of_their_own():
    """The text is that of the harness itself, about an answer of nan."""
    empty = Question.MODEL.answer(float("nan"), [0.0, float("inf"), 0.0], [[1.0] * 3] * 3, 1)
    (mass, com) = defects(empty, Question.MODEL, load_case("double_pendulum").mechanism, 1)
    assert failure_class(f"{mass}; {com}") is FailureClass.NOT_FINITE


def test_every_sign_is_of_a_finding_with_a_script_and_of_its_engine():
    names = {one.name: engine for engine, found in known_findings().items() for one in found}
    assert signs()
    for sign in signs():
        assert (FINDINGS / sign.finding / "show.py").is_file()
        assert sign.engine == names[sign.finding]


def test_a_finding_is_matched_by_what_the_run_shows():
    sign = signs()[0]
    how = {"method": sign.method.replace("*", ""), "profile": sign.profile, "route": "native"}
    seen = comparison(
        "one", sign.engine, "instant", Verdict.FAILED, why="a_WB_W has 9 values that are not finite", **how
    )
    record = record_of([seen, comparison("one", sign.engine, "model")], engines=(sign.engine,))
    assert [c["finding"] for c in record.comparisons] == [None, None]  # its case has no dependent rows
    record.cases[0]["undetermined"] = {"pin": [0, 0, 3, 3, 0, 0]}
    again = record.annotated(record.header, record.cases, record.runs, record.comparisons, record.footer)
    assert [c["finding"] for c in again.comparisons] == [sign.finding, None]
    assert again.cells[0]["findings"] == [sign.finding]


def test_a_record_of_the_earlier_format_is_annotated_when_it_is_read(two_integrators, tmp_path):
    fresh = ("cause", "best", "digits_asked", "finding", "failure")
    old = read_record(written(two_integrators, tmp_path / "old", form=2, drop=fresh))
    new = read_record(written(two_integrators, tmp_path / "new"))
    assert old.cells == new.cells
    assert [{k: c[k] for k in fresh[:4]} for c in old.comparisons] == [
        {k: c[k] for k in fresh[:4]} for c in new.comparisons
    ]
    assert [run["failure"] for run in old.runs] == [None] * 4 + ["time", None]


@pytest.fixture
def earlier(tmp_path):
    """Return the folders of records that versions of formats 1 and 2 wrote, of one case and one engine."""
    folders = [tmp_path / f"format_{form}" for form in (1, 2)]
    for folder in folders:
        folder.mkdir()
        packed = (OLD / f"{folder.name}.jsonl.gz").read_bytes()
        (folder / "report.jsonl").write_bytes(gzip.decompress(packed))
    return folders


def test_records_that_earlier_versions_wrote_open_render_and_are_compared(earlier):
    records = [read_record(folder) for folder in earlier]
    assert [record.header["format"] for record in records] == [1, 2]
    for folder, record in zip(earlier, records, strict=True):
        (cell,) = [line for line in record.cells if line["engine"] == "mujoco"]
        # the verdicts that stand in the file
        assert [cell[name] for name in ("verdict", "model", "method")] == ["agrees", "agrees", "RK4"]
        assert cell["digits"] == pytest.approx(11.2, abs=0.05)
        assert read_question(folder)["cases"] == {"double_pendulum"}
        write_pages(folder)
        for name in ("report.html", "report.md"):
            assert "1 of 1 cell agrees at model and instant" in (folder / name).read_text(encoding="utf-8")
    assert all(c["profile"] == "matched" for c in records[0].comparisons)
    found = changes(*records)
    # version 2 also asked at defaults, and the reference by a further integrator; all else agreed as before
    added = [c.where.rpartition(", trajectory, ")[2] for c in found if c.kind == "answer"]
    assert added == ["Euler, defaults", "null_space, Radau IIA"]
    assert not [c for c in found if c.effect]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda record: record.cells[0].update(verdict="agrees"), "cells are not those"),
        (lambda record: record.cells.append(record.cells[0]), "cells are not those"),
        (lambda record: record.cells.clear(), "cells are not those"),
        (lambda record: record.comparisons[0].pop("best"), "has no cause, or does not say"),
    ],
)
def test_cells_that_contradict_their_comparisons_are_refused(two_integrators, tmp_path, spoil, message):
    spoil(two_integrators)
    with pytest.raises(InvalidInput, match=re.escape(message)):
        read_record(written(two_integrators, tmp_path / "spoilt"))


def test_every_line_follows_the_published_schema(two_integrators, tmp_path):
    lines = (written(two_integrators, tmp_path / "r") / "report.jsonl").read_text(encoding="utf-8").splitlines()
    validator = jsonschema.Draft202012Validator(record_schema())
    for line in map(json.loads, lines):
        validator.validate(line)
        with pytest.raises(jsonschema.ValidationError):
            validator.validate({k: v for k, v in line.items() if k != "record"})
        if line["record"] == "cell":
            with pytest.raises(jsonschema.ValidationError):
                validator.validate(line | {"model": "differs: colour"})


def test_a_format_from_the_future_is_refused(two_integrators, tmp_path):
    with pytest.raises(InvalidInput, match="not of format 1 or 2 or 3"):
        read_record(written(two_integrators, tmp_path / "future", form=4))
