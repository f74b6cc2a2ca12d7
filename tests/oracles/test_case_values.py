"""Expected values of the case library: each has a checked origin, and the reference reproduces it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from consilience.case import shipped_cases
from consilience.compare.instants import Instants
from consilience.compare.motion import Scales
from consilience.compare.published import measure_motion, measure_start
from consilience.engine import Question, load_engine
from oracles.origins import all_origins

CASES = {case.name: case for case in shipped_cases()}
ORIGINS = all_origins()
REFERENCE = 1e-9
"""Uncertainty we allow the reference itself, relative to the size of the motion."""

THROUGH_EVENTS = 1e-10
"""Largest difference of the reference to closed forms of contact, over the value where that is above one."""


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


@cache
def from_origins(name):
    """Return the values of a case by each of its origins."""
    return [np.asarray(origin(CASES[name], derived(CASES[name]))) for origin in ORIGINS.get(name, ())]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if derived(case)])
def test_origins_give_the_values_within_their_uncertainty(name):
    asked = derived(CASES[name])
    for n, found in enumerate(from_origins(name)):
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
        found += measure_start(mechanism, case.published, answer, Instants.of(mechanism, [start]))
    if any(not known.at_start for known in case.published):
        last = max(known.time for known in case.published)
        times = case.times[: round(last / case.sample) + 1]
        method = engine.methods(mechanism, Question.TRAJECTORY)[0]
        motion = engine.trajectory(mechanism, start, times, method, 1e-13)
        assert Scales.of(mechanism, motion).size > 0
        found += measure_motion(mechanism, case.published, [motion], np.full(len(times), REFERENCE))
    told = [one.quantity for one in found]
    assert [f"{q.name}: {q.remark}: off {q.difference:.2g}, bar {q.bar:.2g}" for q in told if not q.met] == []
    if "contact" in case.tags:
        exact = {
            id(known): replace(known, value=float(v))
            for v, known in zip(from_origins(name)[0], derived(case), strict=True)
        }
        far = [(one, exact[id(one.known)]) for one in found if id(one.known) in exact]
        assert [
            (known.name, known.off(one.value))
            for one, known in far
            if known.off(one.value) > THROUGH_EVENTS * max(1.0, abs(known.value))
        ] == []
