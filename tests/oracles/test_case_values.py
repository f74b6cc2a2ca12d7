"""Expected values of the case library: each has a checked origin, and the reference reproduces it."""

import numpy as np
import pytest

from consilience.case import shipped_cases
from consilience.compare.instants import Instants
from consilience.compare.motion import Scales
from consilience.compare.published import against_published, start_against_published
from consilience.engine import Question, load_engine
from oracles.origins import all_origins

CASES = {case.name: case for case in shipped_cases()}
ORIGINS = all_origins()
REFERENCE = 1e-9
"""Uncertainty we allow the reference itself, relative to the size of the motion."""


def derived(case):
    return [known for known in case.published if known.origin != "printed"]


@pytest.mark.parametrize("name", CASES)
def test_every_case_expects_something_of_known_origin(name):
    case = CASES[name]
    assert case.published
    assert case.sources
    assert case.remarks
    assert case.tags
    if derived(case):
        kinds = {known.origin for known in derived(case)}
        assert len(ORIGINS.get(name, ())) >= (2 if "computed" in kinds else 1)


def test_every_origin_belongs_to_a_case():
    assert set(ORIGINS) <= set(CASES)


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if derived(case)])
def test_origins_give_the_values_within_their_uncertainty(name):
    case = CASES[name]
    asked = derived(case)
    for n, origin in enumerate(ORIGINS[name]):
        found = np.asarray(origin(case, asked))
        assert found.shape == (len(asked),)
        for known, value in zip(asked, found, strict=True):
            assert known.off(float(value)) <= known.uncertainty, (n, known.name, known.value, float(value))


@pytest.mark.parametrize("name", CASES)
def test_the_reference_meets_the_values(name):
    case = CASES[name]
    mechanism, start, engine = case.mechanism, case.initial_state, load_engine("reference")
    found = []
    if any(known.at_start for known in case.published):
        answer = engine.instant(mechanism, [start], engine.methods(mechanism, Question.INSTANT)[0])
        found += start_against_published(mechanism, case.published, answer, Instants.of(mechanism, [start]))
    if any(not known.at_start for known in case.published):
        last = max(known.time for known in case.published)
        times = case.times[: round(last / case.sample) + 1]
        method = engine.methods(mechanism, Question.TRAJECTORY)[0]
        motion = engine.trajectory(mechanism, start, times, method, 1e-13)
        assert Scales.of(mechanism, motion).size > 0
        found += against_published(mechanism, case.published, [motion], np.full(len(times), REFERENCE))
    assert [f"{q.name}: {q.remark}: off {q.difference:.2g}, bar {q.bar:.2g}" for q in found if not q.met] == []
