"""Page of expected values: missed values are marked, and the exit code of the command shows them."""

import json
from dataclasses import replace

import pytest
from typer import Exit

from consilience.case import load_case
from consilience.cli.commands import values
from consilience.cli.options import OutputFormat


def test_a_value_that_is_missed_is_marked_and_ends_with_one(monkeypatch, tmp_path):
    case = replace(load_case("simple_pendulum-small"), duration=10.0)
    wrong = replace(case.published[0], value=case.published[0].value + 1e-3)
    found = list(values.found_values(replace(case, published=(wrong, *case.published[1:]))))
    assert [one.met for one in found] == [False] + [True] * (len(case.published) - 1)
    assert found[0].measured.off == pytest.approx(1e-3, rel=1e-6)
    rows = values.table(found).splitlines()
    assert "**missed**" in rows[2]
    assert not any("**missed**" in row for row in rows[3:])
    monkeypatch.setattr(values, "chosen_cases", lambda _: [replace(case, published=(wrong,))])
    with pytest.raises(Exit) as ended:
        values.values(["simple_pendulum-small"], tmp_path / "values.md")
    assert ended.value.exit_code == 1
    assert (tmp_path / "values.md").read_text(encoding="utf-8").startswith("# Expected values")


def test_values_are_written_in_the_format_that_is_asked_for(capsys):
    known = load_case("simple_pendulum-small").published
    with pytest.raises(Exit) as ended:
        values.values(["simple_pendulum-small"], None, OutputFormat.JSON)
    assert ended.value.exit_code == 0
    told = json.loads(capsys.readouterr().out)
    assert told["missed"] == 0
    assert [one["expected"] for one in told["values"]] == [one.value for one in known]
    assert all(abs(one["ours"] - one["expected"]) <= one["uncertainty"] + 1e-9 for one in told["values"])
    with pytest.raises(Exit):
        values.values(["simple_pendulum-small"], None, OutputFormat.MARKDOWN)
    printed = capsys.readouterr().out
    assert printed.count("| simple_pendulum-small |") == len(known)
    assert f"{len(known)} values of 1 cases, 0 missed" in printed


def test_values_of_the_start_are_read_from_accelerations():
    found = list(values.found_values(load_case("incline")))
    assert {one.measured.known.at_start for one in found} == {True, False}
    assert all(one.met for one in found)
