"""The report kept in `reports/agreement`: what has moved, and that its cells are those of its version."""

import json

import pytest

import agreement
from records import comparison, record_of


def kept(digits=8.0, verdict="agrees", version="1.2.3"):
    record = record_of([comparison("arm", "alpha", "trajectory", verdict, digits=digits)])
    record.header["engines"]["alpha"]["version"] = version
    return agreement.kept_of(record, "0123456789abcdef")


@pytest.mark.parametrize(
    ("now", "told"),
    [
        (kept(), []),
        (kept(digits=7.1), []),
        (kept(digits=6.9), ["arm on alpha, digits: 8.0 -> 6.9"]),
        (kept(verdict="differs: model"), ["arm on alpha, motion: agrees -> differs: model"]),
        (kept(digits=2.0, version="1.3"), []),
    ],
)
def test_a_cell_has_moved_by_a_verdict_or_a_digit_in_the_same_version(now, told):
    assert list(agreement.moved(kept(), now)) == told


def test_rounding_does_not_move_a_cell():
    assert list(agreement.moved(kept(digits=15.6), kept(digits=13.1))) == []


def test_what_is_kept_is_read_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(agreement, "FOLDER", tmp_path)
    monkeypatch.setattr(agreement, "git", lambda *words: "" if words[0] == "status" else "0123456789abcdef")
    record = record_of([comparison("arm", "alpha", "trajectory")])
    monkeypatch.setattr(agreement, "read_record", lambda run: record)
    run = tmp_path / "run"
    run.mkdir()
    (run / "report.html").write_text("page")
    (run / "report.md").write_text("page")
    agreement.keep(run)
    assert json.loads((tmp_path / "cells.json").read_text())["cells"][0]["case"] == "arm"
    assert "| commit | `0123456789abcdef` |" in (tmp_path / "README.md").read_text()
    choice = json.loads((tmp_path / "choice.json").read_text())
    assert choice["points"] == [["alpha", "tree", "arm", "RK4", 50.0, 6.0, True]]  # 100 s of CPU time for 2 s
    assert choice["rows"][0][:2] == ["alpha", "tree"]
    assert agreement.check(run) == 0
    record.cells[0]["motion"] = "failed"
    assert agreement.check(run) == 1
    assert "arm on alpha, motion: agrees -> failed" in capsys.readouterr().out
