"""`consilience mutate`: each mutant acts as described, is removed again and is caught; correct adapters pass.

The expected numbers are closed forms: an armature of a part e of the inertia divides the acceleration of a hinge by
1 + e; gravity too large by a part e makes every acceleration from rest larger by a part e.
"""

import json
import sys
from collections import Counter
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import consilience_mujoco.mutants
from consilience.audit.mutate import campaign, judge, plan, report, seams, summary, table
from consilience.audit.mutate.campaign import Alarm, MutationCampaign, MutationTask, TaskOutcome, perform, run_campaign
from consilience.audit.mutate.judge import GREEN, verdicts
from consilience.audit.mutate.mutants import TRAPS, UNPLANTED, Mutant
from consilience.audit.mutate.mutated import Mutated, SeamError
from consilience.audit.mutate.subjects import MutationSubject, random_subject, random_subjects
from consilience.audit.mutate.summary import MutantRow, Standing
from consilience.audit.mutate.synthetic import NAME, SyntheticEngine, host
from consilience.audit.mutate.table import HOSTS, MUTANTS
from consilience.cli.commands.mutate import mutate
from consilience.compare import Verdict
from consilience.engine import Question
from consilience.errors import InvalidInput
from consilience.mechanism import Initial, JointSpring, State, initial_state
from mechanisms import chain, states_of

PLANTED = [(mutant, name) for mutant in MUTANTS.values() for name in mutant.hosts]


def subject(*kinds, seed=1, rest=False):
    mechanism = chain(*kinds, seed=seed)
    states = states_of(mechanism, 2)
    if rest:
        zero = np.zeros_like(states[0].v_WB_W)
        states = [State(s.p_WB, s.quat_WB, zero, zero) for s in states]
    return MutationSubject("chain", mechanism, states)


def differences(name, magnitude, engine, about):
    """Differences by quantity of a mutant at `instant`, for the headline method."""
    with MUTANTS[name].plant(host(engine), magnitude) as mutant:
        found = verdicts(mutant, about, Question.INSTANT)[0]
    return {q.name: q.difference for q in found.quantities}


# ---------------------------------------------------------------- the table of mutants


def test_every_trap_is_planted_or_has_a_reason():
    planted = {mutant.trap for mutant in MUTANTS.values() if not mutant.harmless and not mutant.unseen}
    assert planted | set(UNPLANTED) == set(TRAPS)
    assert not planted & set(UNPLANTED)
    assert list(TRAPS) == list(range(1, 30))


def test_the_table_is_in_order():
    for mutant in MUTANTS.values():
        assert set(mutant.hosts) <= set(HOSTS)
        assert list(mutant.magnitudes) == sorted(mutant.magnitudes, reverse=True), mutant.name
        assert len(mutant.magnitudes) == 1 or mutant.unit or mutant.magnitudes[0] <= 1.0, mutant.name
        assert not mutant.unseen or mutant.remark


def test_an_adapter_brings_mutants_of_its_own():
    own = Mutant(1, "own", "changes nothing", (1.0,), "", Question.MODEL, seams.inside())
    found = table.table_of({"third": SimpleNamespace(MUTANTS=(own,))})
    assert found["own"].hosts == ("third",)
    assert found["gravity too large"].hosts == (NAME, "third")
    assert found["lower triangle"].hosts == ()  # without `SOLVER` an adapter does not say where it solves
    assert table.table_of({"third": SimpleNamespace(MUTANTS=(), SOLVER="x")})["lower triangle"].hosts == ("third",)
    with pytest.raises(ValueError, match="one name: own"):
        table.table_of({name: SimpleNamespace(MUTANTS=(own,)) for name in ("third", "fourth")})


def test_the_document_names_every_trap_and_mutant():
    text = (Path(__file__).parents[2] / "docs" / "detection.md").read_text(encoding="utf-8")
    assert [title for n, title in TRAPS.items() if f"**{n}. {title}.**" not in text] == []
    assert [m.name for m in MUTANTS.values() if f"| {m.trap} | {m.name} |" not in text] == []


@pytest.mark.parametrize(("mutant", "name"), PLANTED, ids=lambda x: getattr(x, "name", x))
def test_a_mutant_finds_its_seam_and_leaves_nothing_behind(mutant, name):
    engine = host(name)
    package = type(engine).__module__.partition(".")[0]
    homes = [m for n, m in sys_modules() if n.startswith(f"{package}.")]
    before = {(m.__name__, key): value for m in homes for key, value in vars(m).items()}
    tables = {key: dict(value) for key, value in before.items() if isinstance(value, dict)}
    own = set(vars(engine))
    with mutant.plant(engine, mutant.magnitudes[0]):
        pass
    after = {(m.__name__, key): value for m in homes for key, value in vars(m).items()}
    assert all(after[key] is value for key, value in before.items())
    assert all(after[key] == value for key, value in tables.items() if key[1] not in ("__builtins__",))
    assert set(vars(engine)) == own


def sys_modules():
    return [(n, m) for n, m in sys.modules.items() if m is not None]


def test_a_seam_is_put_back_after_an_error():
    table, engine = {"a": 1}, SyntheticEngine()
    with pytest.raises(KeyError, match="2"), seams.replaced(table, "a", lambda n: n + 1):
        raise KeyError(table["a"])
    assert table == {"a": 1}
    with seams.replaced(engine, "info", lambda _: None):
        assert engine.info is None
    assert engine.info().name == NAME
    for owner in (engine, table):
        with pytest.raises(SeamError, match="no_such_name"), seams.replaced(owner, "no_such_name", lambda n: n):
            pass


# ---------------------------------------------------------------- effect of a mutant


@pytest.mark.parametrize("engine", ["mujoco", "pinocchio"])
@pytest.mark.parametrize("e", [0.1, 1e-3])
def test_an_armature_divides_the_acceleration_of_a_hinge(engine, e):
    name = {"mujoco": "armature, MuJoCo", "pinocchio": "armature, Pinocchio"}[engine]
    about = subject("revolute", rest=True)
    # at rest, the two accelerations are parallel: the relative difference is 1 - 1/(1 + e)
    assert differences(name, e, engine, about)["accelerations"] == pytest.approx(e / (1.0 + e), rel=1e-9)


@pytest.mark.parametrize("engine", HOSTS)
def test_gravity_too_large_shows_as_it_is(engine):
    about = subject("revolute", "revolute", rest=True)
    found = differences("gravity too large", 1e-3, engine, about)
    assert found["accelerations"] == pytest.approx(1e-3, rel=1e-8)
    assert found["reactions"] == pytest.approx(1e-3, rel=1e-8)


@pytest.mark.parametrize("engine", HOSTS)
@pytest.mark.parametrize("name", ["higher coefficients lost", "rest of a spring lost"])
def test_what_a_spring_loses_shows_in_the_acceleration_of_a_slide(engine, name):
    """At 0.1 m, with the rest at -0.1 m, the stretch s is 0.2 m, and ``40 s + 50 s^2 + 1000 s^3`` is 8 + 2 + 8 N."""
    spring = JointSpring("s", "j0", "distance", 40.0, 0.0, -0.1, higher_stiffness=(50.0, 1000.0))
    mechanism = replace(chain("prismatic", seed=1), joint_springs=(spring,), gravity=np.zeros(3))
    state = initial_state(mechanism, Initial({"j0": {"distance": 0.1}}))
    e = 1e-3
    s = 0.2 - 0.1 * e  # without this part of the rest
    left = {"higher coefficients lost": 18.0 - 10.0 * e, "rest of a spring lost": 40.0 * s + 50.0 * s**2 + 1e3 * s**3}
    found = differences(name, e, engine, MutationSubject("slide", mechanism, [state]))
    assert found["accelerations"] == pytest.approx(1.0 - left[name] / 18.0, rel=1e-8)


@pytest.mark.parametrize("engine", HOSTS)
def test_a_reaction_turned_round_is_off_by_twice_itself(engine):
    about = subject("revolute")
    found = differences("sign of one reaction", 1.0, engine, about)
    assert found["reactions"] == pytest.approx(2.0, rel=1e-9)
    assert found["accelerations"] < 1e-11


@pytest.mark.parametrize("engine", HOSTS)
def test_without_an_error_a_mutated_engine_is_its_host(engine):
    about = subject("universal", "revolute")
    for question in (Question.MODEL, Question.INSTANT):
        found = verdicts(Mutated(host(engine), 1.0), about, question)
        assert found
        assert {c.verdict for c in found} == {Verdict.AGREES}


# ---------------------------------------------------------------- judgement and campaign


def test_what_an_adapter_raises_is_a_failed_comparison():
    with MUTANTS["name gone"].plant(host(NAME), 1.0) as mutant:
        (found,) = verdicts(mutant, subject("revolute"), Question.INSTANT)
    assert found.verdict is Verdict.FAILED
    assert "accelerations_of_old" in found.why
    with MUTANTS["array transposed"].plant(host(NAME), 1.0) as mutant:
        (found,) = verdicts(mutant, subject("revolute"), Question.INSTANT)
    assert found.verdict is Verdict.FAILED
    assert "a_WB_W has shape" in found.why


@pytest.mark.parametrize("name", ["defects", "compare_instant"])
def test_an_error_of_ours_is_no_evidence_about_an_engine(monkeypatch, name):
    def fails(*_):
        raise ZeroDivisionError("ours")

    monkeypatch.setattr(judge, name, fails)
    with pytest.raises(ZeroDivisionError, match="ours"):
        verdicts(host(NAME), subject("revolute"), Question.INSTANT)


def test_model_failed_and_unresolved_are_not_green():
    assert {v for v in Verdict if v not in GREEN} >= {Verdict.MODEL, Verdict.FAILED, Verdict.UNRESOLVED}


def test_a_mutant_is_not_judged_where_its_host_differs_already(monkeypatch):
    seed = next(iter(random_subjects(1)))
    task = MutationTask("gravity too large", NAME, 1e-2, (seed,))
    assert perform(task).judged == 1
    wrong = random_subject(seed).instant_answer
    monkeypatch.setitem(vars(random_subject(seed)), "instant_answer", wrong_by_a_tenth(wrong))
    campaign._baseline.cache_clear()
    try:
        assert perform(task).judged == 0
    finally:
        campaign._baseline.cache_clear()


def wrong_by_a_tenth(answer):
    return replace(answer, a_WB_W=1.1 * answer.a_WB_W)


def test_a_smaller_error_is_caught_on_no_more_mechanisms():
    keys = ("double_pendulum", *random_subjects(3))
    counts = [perform(MutationTask("inertia rotated", NAME, e, keys)) for e in (1e-2, 1e-8, 1e-15)]
    assert [o.caught for o in counts] == [4, 4, 0]
    assert 0.0 < counts[2].largest_missed < 1.0 or counts[2].unchanged == 4


def test_a_short_task_ends_with_the_first_mechanism_that_catches_the_mutant():
    task = MutationTask("gravity too large", NAME, 1e-2, ("double_pendulum", *random_subjects(2)))
    for until_caught, judged in ((False, 3), (True, 1)):
        found = perform(replace(task, until_caught=until_caught))
        assert (found.judged, found.caught) == (judged, judged)
    missed = perform(replace(task, mutant="other sign", magnitude=1.0, until_caught=True))
    assert (missed.judged, missed.caught) == (3, 0)


class Pool:
    """Pool of workers that ends each job as given: with an exception, or with a value."""

    def __init__(self, *ends):
        self.ends, self.asked = list(ends), []

    def schedule(self, job, args, timeout):
        self.asked.append(job)
        future, end = Future(), self.ends.pop(0)
        future.set_exception(end) if isinstance(end, Exception) else future.set_result(end)
        return future


def test_a_task_without_a_result_is_repeated_and_blamed_on_the_error_alone():
    task, right = MutationTask("gravity too large", NAME, 1e-2, ()), outcome("gravity too large", 1e-2, 4, 4)
    late, words = FutureTimeoutError(), "no answer within the time limit"
    assert campaign.repeated(pool := Pool({}, right), task, 1.0) is right
    assert pool.asked == [campaign.unplanted, perform]
    twice = campaign.repeated(Pool({}, late), task, 1.0)
    assert twice.broken == words
    assert twice.noticed
    assert MutantRow(MUTANTS[twice.mutant], NAME, (twice,)).by == words
    slow = campaign.repeated(Pool(late), task, 1.0)
    assert slow.unusable == f"without the error, too: {words}"
    assert MutantRow(MUTANTS[slow.mutant], NAME, (slow,)).standing is Standing.NOT_JUDGED


@pytest.mark.slow
def test_a_campaign_repeats_what_the_time_limit_ended():
    task = MutationTask("gravity too large", NAME, 1e-2, ("double_pendulum",))
    (found,) = run_campaign([task], [], limit=0.05).outcomes
    assert "without the error, too" in found.unusable
    assert not found.noticed


@pytest.fixture(scope="module")
def short():
    chosen = plan.mutants_named([])
    tasks, alarms = plan.short(chosen, list(HOSTS))
    return run_campaign(tasks, list(HOSTS[1:]), alarms, jobs=1, limit=600.0)  # each process would load all engines


@pytest.mark.slow
def test_the_short_campaign_catches_every_mutant_and_nothing_else(short):
    rows = summary.rows_of(short)
    assert {row.mutant.name for row in rows} == set(MUTANTS)
    bad = {(row.mutant.name, row.host): row.standing for row in rows}
    good = (Standing.CAUGHT, Standing.SILENT, Standing.UNSEEN)
    assert {key: s for key, s in bad.items() if s not in good} == {}
    assert short.alarms == []
    assert set(short.judged) == set(HOSTS[1:])
    assert summary.traps_caught(rows) == (len(TRAPS) - len(UNPLANTED),) * 2
    assert summary.exit_code(short) == 0


@pytest.mark.slow
def test_no_mutant_is_caught_by_a_fault_of_its_own(short):
    faults = ("AttributeError", "KeyError", "TypeError", "NameError", "IndexError")
    own = {o.mutant: o.example for o in short.outcomes if any(f in o.example for f in faults)}
    assert set(own) == {"name gone"}


def test_a_mutant_that_does_not_fit_is_not_judged(monkeypatch):
    lost = replace(MUTANTS["armature, MuJoCo"], plant=seams.inside(("translate", "no_such_name", lambda f, e: f)))
    other = seams.on_result(
        consilience_mujoco.mutants._damping
    )  # `_damping` needs a result with a `model`, which principal_inertia does not return
    late = replace(lost, plant=seams.inside(("translate", "principal_inertia", other)))
    for mutant, words in ((lost, "no_such_name"), (late, "has no attribute 'model'")):
        monkeypatch.setitem(MUTANTS, mutant.name, mutant)
        found = perform(MutationTask(mutant.name, "mujoco", 1e-1, ("double_pendulum",)))
        assert words in found.unusable
        assert not found.noticed
        row = MutantRow(mutant, "mujoco", (found,))
        assert row.standing is Standing.NOT_JUDGED
        assert words in row.why_missed


@pytest.mark.slow
def test_small_errors_are_caught_too(short):
    caught = Counter(o.mutant for o in short.outcomes if o.noticed and o.magnitude <= 1e-4)
    assert len(caught) > 30


# ---------------------------------------------------------------- summary, report, command


def outcome(mutant, magnitude, judged, caught, **more):
    by = Counter({"instant: accelerations": caught} if caught else {})
    return TaskOutcome(mutant, NAME, magnitude, judged=judged, caught=caught, by=by, **more)


def test_standings():
    def standing(name, *outcomes):
        return MutantRow(MUTANTS[name], NAME, outcomes).standing

    g, h, u = "gravity too large", "other sign", "fields as a step leaves them"
    assert standing(g, outcome(g, 1e-2, 4, 4), outcome(g, 1e-8, 4, 0)) is Standing.CAUGHT
    assert standing(g, outcome(g, 1e-2, 4, 0)) is Standing.MISSED
    assert standing(g, outcome(g, 1e-2, 0, 0)) is Standing.NOT_JUDGED
    assert standing(g, outcome(g, 1e-2, 0, 0, broken="the worker died")) is Standing.CAUGHT
    assert standing(h, outcome(h, 1.0, 4, 0)) is Standing.SILENT
    assert standing(h, outcome(h, 1.0, 4, 1)) is Standing.FALSE_ALARM
    assert standing(u, outcome(u, 1.0, 4, 0)) is Standing.UNSEEN


def test_the_smallest_magnitude_and_why_the_next_was_missed():
    g = "gravity too large"
    found = [outcome(g, 1e-2, 4, 4), outcome(g, 1e-8, 4, 4), outcome(g, 1e-10, 4, 3, largest_missed=0.5)]
    row = MutantRow(MUTANTS[g], NAME, (*found, outcome(g, 1e-12, 4, 0, largest_missed=0.25)))
    assert row.smallest.magnitude == 1e-10
    assert row.smallest_everywhere.magnitude == 1e-8
    assert row.why_missed == "1e-12: 0.25 of the bar at most"
    silent = MutantRow(MUTANTS[g], NAME, (outcome(g, 1e-12, 4, 0, unchanged=4),))
    assert silent.why_missed == "1e-12: changes no number of any answer"


@pytest.mark.parametrize(
    ("outcomes", "alarms", "missing", "code"),
    [
        ([("gravity too large", 4)], [], {}, 0),
        ([("gravity too large", 0)], [], {}, 1),
        ([("other sign", 1)], [], {}, 1),
        ([("gravity too large", 4)], [Alarm("dart", "seed 1", "instant", "", "differs: model", "")], {}, 1),
        ([("gravity too large", 4)], [], {"dart": "ImportError"}, 3),
    ],
)
def test_exit_codes(outcomes, alarms, missing, code):
    found = MutationCampaign([outcome(name, 1.0, 4, caught) for name, caught in outcomes], alarms, missing=missing)
    assert summary.exit_code(found) == code


def test_the_report_tells_what_was_found(tmp_path):
    g = "gravity too large"
    alarm = Alarm("dart", "seed 7", "instant", "World.step", "differs: model", "accelerations: difference 1")
    found = MutationCampaign(
        [outcome(g, 1e-2, 4, 4), outcome(g, 1e-12, 4, 0, unchanged=4)], [alarm], Counter(dart=300), 300
    )
    report.write_report(found, tmp_path)
    text = (tmp_path / "detection.md").read_text(encoding="utf-8")
    assert "| gravity too large | synthetic | caught | 0.01 of gravity (4 of 4) |" in text
    assert "| dart | seed 7 | instant | World.step | differs: model | accelerations: difference 1 |" in text
    data = json.loads((tmp_path / "detection.json").read_text(encoding="utf-8"))
    assert data["exit_code"] == 1
    assert data["mutants"][0]["smallest_caught"] == 1e-2
    assert data["mutants"][0]["magnitudes"][1]["unchanged"] == 4
    assert data["correct_adapters_judged"] == {"dart": 300}


@pytest.mark.slow
def test_the_command_writes_a_report_and_refuses_unknown_names(tmp_path):
    app = typer.Typer()
    app.command()(mutate)
    runner = CliRunner()
    out = tmp_path / "found"
    result = runner.invoke(app, ["25", "-e", NAME, "--short", "-o", str(out), "-j", "1"])
    assert result.exit_code == 0, result.output
    assert json.loads((out / "detection.json").read_text(encoding="utf-8"))["exit_code"] == 0
    for arguments in (["no such mutant"], ["25", "-e", "no such engine"], ["25", "-o", __file__]):
        refused = runner.invoke(app, arguments)
        assert isinstance(refused.exception, InvalidInput)
