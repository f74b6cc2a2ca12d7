"""Stated power: errors of three times the stated size are caught, those of 0.3 times and correct engines are passed."""

from dataclasses import replace

import pytest
from typer.testing import CliRunner

from consilience.audit.mutate import false_verdicts, stated_power
from consilience.audit.mutate.false_verdicts import LEAST, MOST, random_trials
from consilience.audit.mutate.stated_power import FACTORS, PowerTrial, share, table, trials
from consilience.case import load_case
from consilience.cli.main import app
from consilience.compare import Power, Verdict
from consilience.engine import Question
from consilience.mechanism.perturbation import AXIS, COEFFICIENT, GRAVITY, INERTIA, MASS, PLACE
from harness import power

CASES = {
    "double_pendulum": {GRAVITY, MASS, INERTIA, PLACE, AXIS},
    "four_bar": {GRAVITY, MASS, INERTIA, PLACE},
    "adams_rot_spring": {GRAVITY, MASS, INERTIA, PLACE, AXIS, COEFFICIENT},
}
"""Kinds of parameters that act on the motion of each case."""


@pytest.mark.parametrize(
    ("name", "engine"),
    [
        ("double_pendulum", "mujoco"),
        ("double_pendulum", "pinocchio"),
        pytest.param("four_bar", "mujoco", marks=pytest.mark.slow),
        pytest.param("adams_rot_spring", "pinocchio", marks=pytest.mark.slow),
    ],
)
def test_planted_errors_are_caught_and_passed_as_stated(name, engine):
    case = replace(load_case(name), instants=3).with_span(0.5, 0.05)
    found = list(trials([case], engine))
    motions = [t for t in found if t.question is Question.TRAJECTORY]
    assert {t.stated.kind for t in motions} == CASES[name]
    assert {t.question for t in found} == set(Question)
    assert len(found) % len(FACTORS) == 0
    assert all(t.right for t in found), table(found)


def trial(factor, verdict):
    stated = Power("gravity", "gravity", 2e-5)
    return PowerTrial("c", "e", Question.INSTANT, "m", stated, factor, verdict, "", "because")


def test_an_error_that_is_missed_or_seen_too_early_is_wrong():
    found = [trial(3.0, v) for v in Verdict] + [trial(0.3, v) for v in Verdict]
    right = [t.verdict for t in found if t.right]
    passed = [Verdict.AGREES, Verdict.DISCRETISATION, Verdict.REGULARISATION]
    assert right == [v for v in Verdict if v not in passed] + passed
    assert share(found) == 0.5
    assert stated_power.exit_code(found) == 1
    assert stated_power.exit_code([t for t in found if t.right]) == 0
    assert stated_power.exit_code([]) == 3
    assert "| e | instant | 14 | 50.0 % |" in table(found)
    assert "| c | e | instant | m | gravity | 2e-05 | 3 | agrees | because |" in table(found)


def test_the_command_writes_its_table(tmp_path, monkeypatch):
    monkeypatch.setattr(stated_power, "trials", lambda cases, engine, limit: [trial(0.3, Verdict.AGREES)])
    found = CliRunner().invoke(app, ["mutate", "--power", "double_pendulum", "-e", "mujoco", "-o", str(tmp_path)])
    assert found.exit_code == 0, found.output
    assert "| e | instant | 1 | 100.0 % |" in (tmp_path / "power.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_random_mechanisms_get_no_false_verdict_and_errors_that_do_not_arrive_are_missed(monkeypatch):
    seeds = range(60_001, 60_003)
    found = list(random_trials(seeds, ["mujoco"]))
    planted = [t for t in found if t.error]
    assert {t.seed for t in found} == set(seeds)
    assert 0 < len(planted) < len(found)
    assert all(LEAST <= t.factor <= MOST for t in planted)
    assert all(t.right for t in found), found

    def lost(self, request):
        if request.mechanism is not None:
            self.parameter.perturbed(request.mechanism, request.states, self.size)  # is a mechanism, whatever the size
        return self.handle.ask(request)

    monkeypatch.setattr(false_verdicts.PlantedEngine, "ask", lost)
    monkeypatch.setattr(false_verdicts, "MOST", 1e12)
    again = list(random_trials(seeds, ["mujoco"]))
    assert [t.right for t in again] == [not t.error for t in found]


@pytest.mark.slow
def test_the_campaign_over_the_library_fails_where_errors_do_not_arrive(monkeypatch):
    asked = ["double_pendulum", "-e", "pinocchio"]
    assert power.main(asked) == 0
    monkeypatch.setattr(stated_power.PlantedEngine, "ask", lambda self, request: self.handle.ask(request))
    assert power.main(asked) == 1
