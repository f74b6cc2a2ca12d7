"""Every engine on every case of the library: answers are within the bars, or the refusal names feature and reason."""

import functools
from dataclasses import replace

import pytest

from consilience.case import shipped_cases
from consilience.compare import Verdict, compare_instant, compare_model
from consilience.compare.instants import Instants
from consilience.engine import Profile, Question, load_engine
from oracles.shipped import TRAJECTORIES

CASES = {
    case.name: case if case.name in TRAJECTORIES else replace(case, instants=min(case.instants, 2))
    for case in shipped_cases()
}

KNOWN: dict[tuple[str, str], str] = {
    ("mujoco", "excavator_arm"): "constraints cannot be harder than an absolute floor, which forces of 4e4 N show"
}
"""Known differences at an instant, by engine and case, with the reason; a case that stops differing fails here."""


@functools.cache
def reference(name, question):
    case, engine = CASES[name], load_engine("reference")
    method = engine.methods(case.mechanism, question)[0]
    if question is Question.MODEL:
        return engine.model(case.mechanism, case.initial_state, method)
    return engine.instant(case.mechanism, case.states, method), Instants.of(case.mechanism, case.states)


def refused(engine, case, question):
    """Whether an engine refuses a question; every refusal must name the feature and the reason."""
    reasons = engine.unsupported(case.mechanism, question)
    assert all(r.feature and r.reason for r in reasons)
    return bool(reasons)


@pytest.mark.parametrize("name", CASES)
def test_model_agrees_or_is_refused(engine, name):
    case = CASES[name]
    if refused(engine, case, Question.MODEL):
        return
    for method in engine.methods(case.mechanism, Question.MODEL):
        answer = engine.model(case.mechanism, case.initial_state, method)
        comparison = compare_model(name, "engine", method, answer, reference(name, Question.MODEL), 1.0)
        assert comparison.verdict is Verdict.AGREES, comparison.why


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.group != "contact"])
def test_instant_agrees_or_is_refused_or_differs_for_a_known_reason(engine, engine_name, name):
    case = CASES[name]
    if refused(engine, case, Question.INSTANT):
        return
    verdicts = {}
    for method in engine.methods(case.mechanism, Question.INSTANT):
        if method.profile is Profile.MATCHED:
            answer = engine.instant(case.mechanism, case.states, method)
            comparison = compare_instant(name, "engine", method, answer, *reference(name, Question.INSTANT))
            verdicts[method.name] = f"{comparison.verdict}: {comparison.why}"
    differing = {m: text for m, text in verdicts.items() if not text.startswith(str(Verdict.AGREES))}
    assert verdicts
    assert bool(differing) == ((engine_name, name) in KNOWN), differing


def test_engines_represent_most_of_the_library(engine, engine_name):
    """Each engine represents the share of the library that is required of all engines together, contact apart."""
    smooth = [case for case in CASES.values() if "contact" not in case.tags]
    counts = {
        question: sum(not refused(engine, case, question) for case in smooth)
        for question in (Question.INSTANT, Question.TRAJECTORY)
    }
    assert counts[Question.INSTANT] >= 0.85 * len(smooth), counts
    assert counts[Question.TRAJECTORY] >= 0.80 * len(smooth), counts
