"""Fuzzing: random mechanisms, how answers are judged, how crashes are contained, and how findings are shrunk.

The planted disagreements are the mutants and faults of `plugins`, whose docstrings describe them.
"""

import json
import tomllib
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from consilience.audit.fuzz.campaign import EnginePanel, FuzzCampaign, JudgedMechanism, run_campaign
from consilience.audit.fuzz.findings import exit_code, shrink_disagreements
from consilience.audit.fuzz.judging import alarms, judge
from consilience.audit.fuzz.population import COMMON, SORTS, STATES, read_text, specimen
from consilience.audit.fuzz.reductions import AS_IS, Part, knobs, parts, simplified, without
from consilience.audit.fuzz.shrink import Shrinker
from consilience.audit.fuzz.summary import markdown, outcome
from consilience.audit.fuzz.workers import AnswerBatch, EngineStream
from consilience.case import Case
from consilience.case.file.reader import load_file
from consilience.case.file.writer import case_table, table_text
from consilience.cli.commands.fuzz import fuzz
from consilience.compare import Verdict
from consilience.compare.instants import Instants
from consilience.engine import Method, Profile, Question, Route, Unsupported
from consilience.engine.worker.requests import MethodAnswer
from consilience.errors import ConsilienceError
from consilience.mechanism import (
    Initial,
    characteristic_length,
    closing_rows,
    constraint_jacobian,
    constraint_residual,
    drawing_state,
)
from consilience.reference.engine import TIME_STEPPING, ReferenceEngine
from consilience.suite import run_suite
from mechanisms import chain
from pace import slowness

SEEDS = range(1, 61)
INSTANT, MODEL = Question.INSTANT, Question.MODEL


@pytest.fixture(scope="module")
def specimens():
    return [specimen(seed) for seed in SEEDS]


# ------------------------------------------------------------------ random mechanisms


def test_every_sort_occurs_as_often_as_it_should(specimens):
    found = Counter(s.sort for s in specimens)
    assert set(found) == set(SORTS)
    assert sum(sort.share for sort in SORTS.values()) == pytest.approx(1.0)
    for name, sort in SORTS.items():
        assert found[name] == pytest.approx(sort.share * len(specimens), abs=10)


def test_a_seed_is_a_case_and_the_case_is_its_file():
    one, again, other = specimen(7), specimen(7), specimen(8)
    assert one.text == again.text != other.text
    read = read_text(one.text, one.case.name)
    for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
        states, found = ([getattr(s, name) for s in case.states] for case in (one.case, read))
        np.testing.assert_array_equal(found, states)
    assert len(one.case.states) == STATES


def test_random_mechanisms_are_assembled_and_move(specimens):
    for s in specimens:
        for state in s.case.states:
            assert np.max(np.abs(constraint_residual(s.case.mechanism, state)), initial=0.0) < 1e-11
        speed = np.max(np.abs([state.v_WB_W for state in s.case.states]))
        assert speed > 0.01 * characteristic_length(s.case.mechanism), s.seed


def test_the_extremes_are_extreme(specimens):
    by_sort = {sort: [s.case.mechanism for s in specimens if s.sort == sort] for sort in SORTS}
    lengths = [len(m.bodies) for m in by_sort["long chain"]]
    assert min(lengths) > 12
    masses = [[b.mass for b in m.bodies] for m in by_sort["unequal masses"]]
    assert max(max(m) / min(m) for m in masses) > 1e4
    least = []
    for m in by_sort["near singular"]:
        singular = np.linalg.svd(constraint_jacobian(m, drawing_state(m)), compute_uv=False)
        kept = singular[singular > 1e-8 * singular[0]]
        least.append(kept[-1] / kept[0])
    assert 1e-7 < min(least) < 1e-3
    known = {f"{kind} joint" for kind in COMMON} | {"spring", "joint spring", "load"}
    for sort in set(SORTS) - {"all elements"}:
        assert all(set(m.features) <= known for m in by_sort[sort])
    assert not set.union(*(set(m.features) for m in by_sort["all elements"])) <= known


# ------------------------------------------------------------------ judgement of answers


@pytest.fixture(scope="module")
def case():
    """A mechanism with torques as large as its forces, so that an error in either is far above its bar."""
    return specimen(33).case


@pytest.fixture(scope="module")
def honest(case):
    engine = ReferenceEngine()
    return {
        question: MethodAnswer(question, method, answer)
        for question, method, answer in (
            (MODEL, Method("m", Route.NATIVE), engine.model(case.mechanism, case.states[0], None)),
            (
                INSTANT,
                Method("i", Route.NATIVE),
                engine.instant(case.mechanism, case.states, Method("descriptor", Route.REFERENCE)),
            ),
        )
    }


def off(said, name="off", by=1e-6, field="a_WB_W", **method):
    """The same answer under another method name, with one field changed."""
    changed = replace(said.answer, **{field: getattr(said.answer, field) * (1.0 + by)})
    return replace(said, method=replace(said.method, name=name, **method), answer=changed)


def entries_of(case, honest, *said, unsupported=(), reference=()):
    sheets = {"reference": AnswerBatch((*honest.values(), *reference)), "x": AnswerBatch(said, unsupported)}
    return [e for e in judge(case, sheets) if e.engine == "x"]


def test_what_is_right_agrees(case, honest):
    found = entries_of(case, honest, *honest.values())
    assert [e.verdict for e in found] == [Verdict.AGREES] * 2
    assert [e.digits for e in found] == [16.0] * 2
    assert not alarms(found)


@pytest.mark.parametrize(
    ("question", "field", "quantity"),
    [
        (INSTANT, "a_WB_W", "accelerations"),
        (INSTANT, "alpha_WB_W", "accelerations"),
        (INSTANT, "torque_F", "reactions"),
        (INSTANT, "kinetic", "kinetic energy"),
        (MODEL, "mass", "total mass"),
        (MODEL, "inertia", "inertia of the whole"),
    ],
)
def test_what_differs_from_the_reference_is_an_alarm(case, honest, question, field, quantity):
    (found,) = alarms(entries_of(case, honest, off(honest[question], field=field)))
    assert (found.verdict, found.quantity, found.against) == (Verdict.MODEL, quantity, "reference")
    assert found.excess > 1e3
    assert found.why.startswith(quantity)


def test_a_method_that_differs_raises_one_alarm(case, honest):
    """One alarm, against the reference; the two methods are also compared, but add no second alarm."""
    found = entries_of(case, honest, honest[INSTANT], off(honest[INSTANT]))
    assert [(e.method, e.against) for e in found if e.verdict is Verdict.MODEL] == [("off", "reference"), ("i", "off")]
    assert [e.against for e in alarms(found)] == ["reference"]


def test_methods_that_differ_are_an_alarm_without_a_reference(case, honest):
    """Without an answer of the reference, the difference between two methods of the engine is the alarm."""
    sheets = {
        "reference": AnswerBatch((MethodAnswer(INSTANT, None, None, "lost"),)),
        "x": AnswerBatch((honest[INSTANT], off(honest[INSTANT]))),
    }
    found = judge(case, sheets)
    assert [(e.engine, e.verdict) for e in found if e.against == "reference"] == [
        ("reference", Verdict.FAILED),
        ("x", Verdict.UNRESOLVED),
        ("x", Verdict.UNRESOLVED),
    ]
    assert [(e.engine, e.against) for e in alarms(found)] == [("reference", "reference"), ("x", "off")]


def test_a_reference_that_differs_from_itself_judges_nobody(case, honest):
    sheets = {
        "reference": AnswerBatch((*honest.values(), off(honest[INSTANT]))),
        "x": AnswerBatch((off(honest[INSTANT]),)),
    }
    found = judge(case, sheets)
    assert [(e.engine, e.verdict) for e in found] == [("reference", Verdict.MODEL), ("x", Verdict.UNRESOLVED)]


def test_the_defaults_are_judged_among_themselves_alone(case, honest):
    soft = off(honest[INSTANT], "soft", 0.1, profile=Profile.DEFAULT)
    found = entries_of(case, honest, honest[INSTANT], soft, replace(soft, method=replace(soft.method, name="as soft")))
    assert [(e.method, e.against, e.verdict) for e in found if e.profile is Profile.DEFAULT] == [
        ("soft", "reference", Verdict.MODEL),
        ("as soft", "reference", Verdict.MODEL),
        ("soft", "as soft", Verdict.AGREES),
    ]
    assert not alarms(found)
    softer = off(honest[INSTANT], "softer", 0.2, profile=Profile.DEFAULT)
    (found,) = alarms(entries_of(case, honest, honest[INSTANT], soft, softer))
    assert (found.method, found.against) == ("soft", "softer")


def test_a_solver_beside_right_terms_is_no_alarm(case, honest):
    """Unresolved against the reference and against the engine's own terms; far off, it is a difference of the model."""
    terms = replace(honest[INSTANT], method=replace(honest[INSTANT].method, name="terms", route=Route.HARNESS_SOLVE))
    bar = 1e-11 * float(np.max(Instants.of(case.mechanism, case.states).rounding))
    found = entries_of(case, honest, terms, off(honest[INSTANT], "solver", 20.0 * bar))
    assert [(e.method, e.verdict) for e in found if e.verdict is not Verdict.AGREES] == [
        ("solver", Verdict.UNRESOLVED),
        ("terms", Verdict.UNRESOLVED),
    ]
    assert not alarms(found)
    assert [e.against for e in alarms(entries_of(case, honest, terms, off(honest[INSTANT])))] == ["reference"]


def test_a_pair_has_the_bars_of_the_more_lenient_method(case, honest):
    rough = off(honest[INSTANT], "rough", 1e-9, route=Route.EXTRAPOLATED)
    assert not alarms(entries_of(case, honest, honest[INSTANT], rough))
    (found,) = alarms(entries_of(case, honest, off(honest[INSTANT], "rough", 1e-9)))
    assert found.method == "rough"


def test_a_method_without_reactions_is_compared_in_the_rest(case, honest):
    bare = honest[INSTANT].answer
    bare = replace(bare, force_F=None, torque_F=None)
    without_them = replace(honest[INSTANT], answer=bare, method=Method("bare", Route.NATIVE))
    for ways in ((honest[INSTANT], without_them), (without_them, honest[INSTANT])):
        found = entries_of(case, honest, *ways)
        assert {e.verdict for e in found} == {Verdict.AGREES}


def test_bars_grow_with_the_condition_and_no_further(case, honest, monkeypatch):
    """A difference of 1e-9 is an error at a condition number of 1 and rounding at 1e7: 4 eps cond = 9e-9."""
    said = off(honest[INSTANT], by=1e-9)
    verdicts = []
    for kappa in (1.0, 1e7):
        monkeypatch.setattr("consilience.compare.instants.worst_condition", lambda *_, k=kappa: k)
        verdicts.append(entries_of(case, honest, said)[0].verdict)
        reactions = off(honest[INSTANT], by=1e-8, field="force_F")
        verdicts.append(entries_of(case, honest, reactions)[0].verdict)
    assert verdicts == [Verdict.MODEL, Verdict.MODEL, Verdict.AGREES, Verdict.AGREES]


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        (MethodAnswer(INSTANT, Method("i", Route.NATIVE), None, "KeyError: 'b7'"), "KeyError"),
        (MethodAnswer(INSTANT, None, None, "the worker died: signal SIGSEGV"), "the worker died"),
        (MethodAnswer(INSTANT, Method("i", Route.NATIVE), "42"), "the answer is a str, not a InstantAnswer"),
    ],
)
def test_no_sound_answer_is_a_failure(case, honest, said, kind):
    (found,) = alarms(entries_of(case, honest, said))
    assert (found.verdict, found.quantity) == (Verdict.FAILED, kind)


def test_what_is_unsupported_is_no_alarm(case, honest):
    refusal = Unsupported("joint 'j'", "no screws")
    (found,) = entries_of(case, honest, unsupported=(refusal,))
    assert (found.verdict, found.why) == (Verdict.UNSUPPORTED, "no screws")
    (at_state,) = entries_of(case, honest, MethodAnswer(INSTANT, Method("i", Route.NATIVE), refusal))
    assert (at_state.verdict, at_state.why) == (Verdict.UNSUPPORTED, "joint 'j': no screws")
    assert not alarms([found, at_state])


# ------------------------------------------------------------------ workers


def task(name, seed):
    mechanism = replace(chain("revolute", "spherical", seed=seed), name=name)
    return Case(name, f"{name}.toml", name, mechanism, Initial(rates={"j0": {"angle": 1.0}}), 0.2, 0.05, 8, 3, 1)


@pytest.fixture(scope="module")
def tasks(answers_kept):
    """Three mechanisms; the honest answers to them are kept, so that no worker has to load the reference solver."""
    found = [task("a", 1), task("first", 2), task("b", 3)]
    with EngineStream("honest", 600.0) as member:
        member.collect(member.submit_cases(found))
    return found


@pytest.mark.parametrize(
    ("engine", "evidence"),
    [
        ("aborts", "the worker died: signal SIGABRT"),
        ("hangs", "no answer within {limit:g} s; the worker was stopped"),
        ("raises_two_parts", "TwoPartError: 7: no licence"),
        ("gives_lambda", "cannot be sent: it holds a function"),
        ("cannot_plan", "KeyError: 'spherical'"),
        ("silent", "no method"),
    ],
)
def test_a_fault_costs_its_mechanism_and_no_other(engine, evidence, tasks):
    """The faults show at the mechanism called ``first``, which stands in the middle of the message."""
    limit = 3.0 * slowness()
    with EngineStream(engine, limit) as member:
        sheets = member.collect(member.submit_cases(tasks))
        again = member.collect(member.submit_cases(tasks[:1]))
    bad = [[said.reason for said in sheet.answers if said.reason] for sheet in (*sheets, *again)]
    assert [len(reasons) > 0 for reasons in bad] == [False, True, False, False]
    assert evidence.format(limit=limit) in bad[1][0]
    for sheet in (sheets[0], sheets[2], again[0]):
        assert {said.question for said in sheet.answers if said.answer is not None} == {MODEL, INSTANT}


def test_what_is_declared_unsupported_is_said_and_not_asked():
    with EngineStream("selective", 60.0) as member:
        tasks = [task("first", 1), task("second", 2)]
        refused, asked = member.collect(member.submit_cases(tasks))
    assert [u.reason for u in refused.unsupported] == ["this engine knows no spherical joints"]
    assert not [said for said in refused.answers if said.question is INSTANT]
    assert not asked.unsupported


# ------------------------------------------------------------------ shrinking


@pytest.fixture(scope="module")
def drawn(specimens):
    """Case tables and mechanisms of short specimens."""
    short = [s for s in specimens if len(s.case.mechanism.bodies) <= 8][:20]
    return [(tomllib.loads(s.text), s.case.mechanism) for s in short]


def names(table, group):
    return [entry["name"] for entry in table.get(group, [])]


def test_any_part_can_go_and_what_is_left_is_assembled(drawn):
    rng = np.random.default_rng(1)
    left = Counter()
    for table, mechanism in drawn:
        found = parts(table, mechanism)
        assert {p.name for p in found if p.group == "body"} == {b.name for b in mechanism.bodies}
        for _ in range(4):
            gone = [part for part in found if rng.random() < 0.4]
            new = without(table, mechanism, gone)
            if not new["body"]:
                continue
            smaller = read_text(table_text(new), "smaller").mechanism
            assert names(new, "body") == [n for n in names(table, "body") if Part("body", n) not in gone]
            residual = constraint_residual(replace(smaller, drives=(), couplings=()), drawing_state(smaller))
            # a rolling body that now hangs on another body may have left its plane: skip the rows of rolling
            assert np.max(np.abs(residual[: len(residual) - len(smaller.rollings)]), initial=0.0) < 1e-9
            left[len(smaller.bodies)] += 1
    assert sum(left.values()) > 40


def test_the_joints_of_a_body_that_goes_hang_on_the_one_before_it():
    mechanism = chain("revolute", "spherical", "prismatic", seed=3)
    case = Case("c", "c.toml", "c", mechanism, Initial(), 1.0, 0.1, 6, 1, 1)
    first, second, third = mechanism.joints
    new = without(case_table(case), mechanism, [Part("body", second.predecessor)])
    assert [(j["name"], j["predecessor"], j["successor"]) for j in new["joint"]] == [
        (second.name, "ground", second.successor),
        (third.name, third.predecessor, third.successor),
    ]
    assert first.name not in names(new, "joint")


def test_choices_as_it_is_change_nothing_and_all_others_give_a_case_or_bad_input(drawn):
    rng = np.random.default_rng(2)
    read = 0
    for table, _ in drawn:
        count = len(knobs(table))
        assert simplified(table, [AS_IS] * count) == table
        for _ in range(5):
            try:
                read_text(table_text(simplified(table, rng.integers(0, AS_IS + 1, size=count).tolist())), "simpler")
                read += 1
            except ConsilienceError:
                continue
    assert read > 50


def test_the_simplest_choices_are_simple():
    mechanism = chain("cylindrical", "spherical", seed=3)
    table = case_table(Case("c", "c.toml", "c", mechanism, Initial(), 1.0, 0.1, 6, 2, 1))
    simple = simplified(table, [0] * len(knobs(table)))
    assert simple["gravity"] == [0.0, 0.0, 0.0]
    assert {j["kind"] for j in simple["joint"]} == {"revolute"}
    assert all(b["mass"] == 1.0 and b["com"] == [0.0] * 3 and "orientation" not in b for b in simple["body"])
    assert simple["instant"]["states"] == 1


@pytest.mark.parametrize("seed", [3, 5])
def test_shrinking_finds_the_one_part_it_is_about(seed):
    """Synthetic disagreement: the mechanism has a joint of the given kind, and one body heavier than 1 kg."""
    s = specimen(seed)
    kind = s.case.mechanism.joints[-1].kind

    def shows(text):
        mechanism = read_text(text, "x").mechanism
        return any(j.kind == kind for j in mechanism.joints) and max(b.mass for b in mechanism.bodies) > 1.0

    shrinker = Shrinker(s.text, shows)
    found = read_text(shrinker.shrink(), "found").mechanism
    assert shows(shrinker.text)
    assert len(found.bodies) == 1
    assert len(found.joints) <= 2
    assert found.bodies[0].mass == 2.0  # the simplest mass above 1 kg with one digit


def test_a_disagreement_that_does_not_show_again_is_kept_as_it_was():
    text = specimen(3).text
    assert Shrinker(text, lambda _: False).shrink() == text


def test_shrinking_stops_when_its_time_is_over():
    shrinker = Shrinker(specimen(3).text, lambda _: True, limit=0.0)
    assert shrinker.shrink() == specimen(3).text
    assert shrinker.tried == 0


def test_a_disagreement_that_shows_only_sometimes_is_kept_as_it_was():
    """The disagreement shows only once: Hypothesis then has no example to start from, which must not raise an error."""
    asked = []

    def shows(text):
        asked.append(text)
        return len(asked) == 1

    text = specimen(3).text + "# written by hand: not to the letter what is written again\n"
    shrinker = Shrinker(text, shows)
    assert shrinker.shrink() == text
    assert len(asked) > 1


# ------------------------------------------------------------------ campaigns

PLANTED = ("dropped_product", "reaction_axes")
"""Errors of the model and of the reactions; `test_mutants` shows that every error is seen."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    with EnginePanel(["honest", *PLANTED], 180.0) as panel:
        found = run_campaign(panel, range(1, 9))
        return found, shrink_disagreements(found, panel, folder, 60.0), folder


@pytest.mark.slow
def test_the_correct_engine_raises_no_alarm(campaign):
    found, findings, _ = campaign
    assert len(found.judged) == 8
    assert "honest" not in {f.entry.engine for f in findings}
    assert {e.verdict for j in found.judged for e in j.entries if e.engine == "honest"} == {Verdict.AGREES}


@pytest.mark.slow
@pytest.mark.parametrize("engine", PLANTED)
def test_a_planted_disagreement_is_found_and_shrunk_to_three_bodies_at_most(campaign, engine):
    _, findings, folder = campaign
    own = [f for f in findings if f.entry.engine == engine]
    assert own
    for f in own:
        assert f.bodies <= 3
        assert len(load_file(folder / f.file)[0].mechanism.bodies) == f.bodies
        assert f.shown.signature == f.entry.signature


@pytest.mark.slow
def test_the_smallest_cases_show_it_again(campaign):
    """As the commands in the first lines of the files: by a suite that reads the files alone."""
    _, findings, folder = campaign
    chosen = [next(f for f in findings if (f.entry.engine, f.entry.verdict) == (e, Verdict.MODEL)) for e in PLANTED]
    for f in chosen:
        text = (folder / f.file).read_text(encoding="utf-8")
        assert f"#     consilience run {f.file} -e {f.entry.engine} -q {f.entry.question}\n" in text
        assert f"#     consilience fuzz --seed {f.seed} --mechanisms 1 -e {f.entry.engine}\n" in text
    cases = [case for f in chosen for case in load_file(folder / f.file)]
    results = run_suite(cases, PLANTED, [MODEL, INSTANT])
    for f, case in zip(chosen, cases, strict=True):
        asked = (case.name, f.entry.engine, f.entry.question)
        verdicts = {c.verdict for c in results.comparisons if (c.case, c.engine, c.question) == asked}
        assert Verdict.MODEL in verdicts, f.file


@pytest.mark.slow
def test_the_seed_of_a_finding_meets_it_again(campaign):
    found, findings, _ = campaign
    f = findings[0]
    (before,) = [j for j in found.judged if j.specimen.seed == f.seed]
    assert specimen(f.seed).text == before.specimen.text
    assert f.entry.signature in [e.signature for e in before.entries]


@pytest.mark.slow
def test_the_outcome_has_everything_in_it(campaign):
    found, findings, _ = campaign
    data = json.loads(json.dumps(outcome(found, findings), allow_nan=False))
    assert data["exit_code"] == 1
    assert set(data["engines"]) == {"reference", "honest", *PLANTED}
    assert data["engines"]["honest"]["judged"] == 8
    assert data["engines"]["honest"]["worst_digits"] > 11
    assert data["engines"]["dropped_product"]["differs"] >= 7
    assert len(data["findings"]) == len(findings)
    page = markdown(data)
    assert page.startswith("# Differential fuzzing\n\n8 mechanisms (")
    for f in findings:
        assert f"`consilience run {f.file} -e {f.entry.engine} -q {f.entry.question}`" in page


# ------------------------------------------------------------------ contacts


def test_mechanisms_with_contacts_are_cases_in_which_nothing_approaches():
    """Closed contacts at the states of a case neither approach nor part, whatever was drawn; the file says the same."""
    again = specimen(3, contacts=True)
    assert again.text == specimen(3, contacts=True).text != specimen(3).text
    touching = 0
    for seed in range(1, 9):
        case = specimen(seed, contacts=True).case
        for state in case.states:
            rows = closing_rows(case.mechanism, state)
            rates = rows @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
            touching += len(rates)
            assert np.max(np.abs(rates), initial=0.0) < 1e-10
    assert touching > 8


@pytest.fixture(scope="module")
def contact_campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("contacts")
    with EnginePanel(["honest", "halved_friction"], 180.0) as panel:
        found = run_campaign(panel, range(1, 7), contacts=True)
        return found, shrink_disagreements(found, panel, folder, 20.0), folder


@pytest.mark.slow
def test_halved_friction_is_found_and_shrunk_to_one_contact(contact_campaign):
    found, findings, folder = contact_campaign
    assert {e.verdict for j in found.judged for e in j.entries if e.engine == "honest" and e.digits} == {Verdict.AGREES}
    smallest = [f for f in findings if f.entry.engine == "halved_friction" and f.entry.verdict is Verdict.MODEL]
    assert smallest
    for f in smallest:
        case = load_file(folder / f.file)[0]
        assert len(case.mechanism.bodies) <= 2
        assert len(case.mechanism.contacts) == 1
        assert f"--seed {f.seed} --mechanisms 1 --contacts -e" in (folder / f.file).read_text(encoding="utf-8")


@pytest.mark.slow
def test_halved_friction_shows_in_motions_too(contact_campaign):
    """Among them of mechanisms whose instants agree, where nothing slides yet."""
    found, findings, folder = contact_campaign
    moved = [e for j in found.judged for e in j.entries if e.question is Question.TRAJECTORY]
    assert {e.verdict for e in moved if e.engine in ("honest", "reference")} <= {Verdict.AGREES, Verdict.UNRESOLVED}
    assert sum(e.verdict is Verdict.AGREES for e in moved if e.method == TIME_STEPPING.name) >= 4
    own = [f for f in findings if f.entry.engine == "halved_friction" and f.entry.question is Question.TRAJECTORY]
    assert own
    for f in own:
        assert f.shown.signature == f.entry.signature
        assert f.bodies <= f.met
        assert f.command == f"consilience run {f.file} -e halved_friction -q trajectory"
        assert load_file(folder / f.file)[0].times[-1] == pytest.approx(0.2)
    data = outcome(found, findings)
    row = next(m for m in data["methods"] if (m["engine"], m["question"]) == ("halved_friction", "trajectory"))
    assert row["differs"] == len({s for f in own for s in f.seeds})
    assert "## Motions\n" in markdown(data)


def test_another_law_of_contact_that_a_method_declares_is_no_alarm(case, honest):
    (differs,) = alarms(entries_of(case, honest, off(honest[INSTANT])))
    assert not alarms([replace(differs, question=Question.TRAJECTORY, quantity="impact law")])
    assert alarms([replace(differs, question=Question.TRAJECTORY, quantity="impacts elsewhere")])


def test_a_reference_that_finds_the_laws_open_is_unresolved_and_judges_nobody(case, honest):
    reason = "NumericalFailure: contact at t = 0 s: the laws of contact and friction allow several accelerations"
    open_ = MethodAnswer(INSTANT, Method("i", Route.REFERENCE), None, reason)
    refused = AnswerBatch((replace(open_, reason="RuntimeError: no set of closed contacts fits"),))
    batches = {"reference": AnswerBatch((open_,)), "e": AnswerBatch((honest[INSTANT],)), "refuses": refused}
    assert [(e.engine, e.verdict) for e in judge(case, batches)] == [(e, Verdict.UNRESOLVED) for e in batches]
    failed = replace(open_, reason="NumericalFailure: the mass matrix is singular")
    assert judge(case, {"reference": AnswerBatch((failed,))})[0].verdict is Verdict.FAILED


def test_a_contact_solver_that_is_inexact_is_no_alarm_and_one_that_is_wrong_is():
    """Stops go through the solver of contacts: 1e-8 off is no other model there, 1e-5 off is."""
    touching = specimen(14, contacts=True).case
    engine = ReferenceEngine()
    method = engine.methods(touching.mechanism, INSTANT)[0]
    right = MethodAnswer(INSTANT, method, engine.instant(touching.mechanism, touching.states, method))
    for by, verdict in ((1e-8, Verdict.UNRESOLVED), (1e-5, Verdict.MODEL)):
        own = off(replace(right, method=Method("i", Route.NATIVE)), by=by)
        entries = judge(touching, {"reference": AnswerBatch((right,)), "e": AnswerBatch((own,))})
        assert [e.verdict for e in entries if e.engine == "e"] == [verdict]


def synthetic(case, *entries):
    campaign = FuzzCampaign()
    campaign.judged = [JudgedMechanism(replace(specimen(8), case=case), list(entries))]
    return campaign


def test_exit_codes(case, honest):
    agrees, differs = (entries_of(case, honest, said)[0] for said in (honest[INSTANT], off(honest[INSTANT])))
    failed = replace(agrees, verdict=Verdict.FAILED)
    soft = replace(differs, profile=Profile.DEFAULT)
    unresolved = replace(agrees, verdict=Verdict.UNRESOLVED)
    refused = replace(agrees, verdict=Verdict.UNSUPPORTED)
    assert exit_code(synthetic(case, agrees, refused, soft)) == 0
    assert exit_code(synthetic(case, agrees, failed)) == 3
    assert exit_code(synthetic(case, unresolved)) == 3
    assert exit_code(synthetic(case, failed, differs)) == 1
    for field in ("missing", "undrawn"):
        campaign = synthetic(case, agrees)
        getattr(campaign, field)["x"] = "why"
        assert exit_code(campaign) == 3


@pytest.mark.slow
def test_the_command_writes_its_outcome_and_ends_with_the_code(tmp_path):
    app = typer.Typer()
    app.command()(fuzz)
    app.command("other")(lambda: None)
    options = ["--mechanisms", "3", "--seed", "1", "-e", "honest", "-e", "broken_import", "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["fuzz", *options])
    assert result.exit_code == 3, result.output
    data = json.loads((tmp_path / "out" / "fuzz.json").read_text(encoding="utf-8"))
    assert data["seeds"] == [1, 2, 3]
    assert "libengine.so.3" in data["missing"]["broken_import"]
    assert (tmp_path / "out" / "fuzz.md").read_text(encoding="utf-8").startswith("# Differential fuzzing")
    assert "3 mechanisms" in result.output
