"""False verdicts on random mechanisms: errors of random size are planted in half of the cells, none in the others.

A planted error above twice the stated one must not be passed over; of an engine without a planted error a run must not
say ``differs: model``. Duration, sample interval and with them the steps, and the digits asked are drawn as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from consilience.audit.fuzz.population import specimen
from consilience.audit.mutate.stated_power import PASSED, JudgedEngine, PlantedEngine
from consilience.case import Case
from consilience.compare import Comparison, Verdict
from consilience.compare.judge import REFERENCE, reference_motion
from consilience.compare.other_methods import reconsidered
from consilience.compare.power import MEASURED
from consilience.engine import Method, Profile, Question
from consilience.engine.worker.client import InProcessEngine, Worker
from consilience.mechanism import physical_parameters
from consilience.suite.engine_runs import EngineCase, ask_case, open_plan

LEAST, MOST = 2.0, 200.0
"""Bounds of the size of a planted error over the stated one; its logarithm is uniform between them."""

LARGEST_ERROR = 0.4
"""Largest planted error: a mass or a moment that is off by its own size is none of a body."""


@dataclass(frozen=True)
class RandomTrial:
    """One cell of a random mechanism.

    Attributes
    ----------
    seed : int
    error : str
        Parameter that is off; empty where none is.
    factor : float
        Size of the error over the stated one.
    verdict : Verdict
    why : str
        Reason of the verdict.
    """

    seed: int
    engine: str
    question: Question
    method: str
    error: str
    factor: float
    verdict: Verdict
    why: str

    @property
    def right(self) -> bool:
        """Whether the error is not passed over, or no other model is seen where there is no error."""
        return self.verdict not in PASSED if self.error else self.verdict is not Verdict.MODEL


def random_case(seed: int, rng: np.random.Generator) -> Case:
    """Draw a mechanism of the fuzz, with a duration, a sample interval and digits of its own."""
    duration = float(rng.choice((0.25, 0.5, 1.0)))
    case = replace(specimen(seed).case, digits=int(rng.integers(3, 10)), instants=2)
    return case.with_span(duration, duration / int(rng.integers(5, 41)))


def random_trials(seeds: Sequence[int], engines: Sequence[str], limit: float = 60.0) -> Iterator[RandomTrial]:
    """Yield one trial for each mechanism, engine and question that the engine answers by a matched method.

    Parameters
    ----------
    seeds : sequence of int
    engines : sequence of str
    limit : float, s
        Time limit of one answer.
    """
    reference = InProcessEngine(REFERENCE)
    with ExitStack() as ended:
        workers = [ended.enter_context(Worker(engine, limit)) for engine in engines]
        for seed in seeds:
            rng = np.random.default_rng([seed, 2])
            case = random_case(seed, rng)
            runs = list(ask_case(reference, case, MEASURED))
            motion = reference_motion(case, runs)
            for worker in workers:
                plan, drawn = open_plan(worker, case), deepcopy(rng)
                if isinstance(plan, str):
                    continue
                judged = JudgedEngine(EngineCase(worker, case, plan, reference_motion=motion), runs)
                for question in MEASURED:
                    yield from _trial(seed, judged, question, drawn)


def _in_a_run(judged: JudgedEngine, question: Question, method: Method) -> Comparison:
    """Compare a method in the light of all methods at `instant`, as a run does."""
    instants = judged.asked.plan.methods.get(Question.INSTANT, ())
    asked = [judged.compared(Question.INSTANT, m) for m in instants]
    settled = reconsidered([c for c in asked if c is not None])
    if question is Question.INSTANT:
        return next(c for c in settled if c.method == method.name)
    found = replace(judged, before=settled).compared(question, method)
    assert found is not None
    return found


def _trial(seed: int, judged: JudgedEngine, question: Question, rng: np.random.Generator) -> Iterator[RandomTrial]:
    """Yield the trial of one question, by a method that is drawn; none where nothing can be judged."""
    case, worker = judged.asked.case, judged.asked.worker
    methods = [m for m in judged.asked.plan.methods.get(question, ()) if m.profile is Profile.MATCHED]
    if not methods:
        return
    method = methods[int(rng.integers(len(methods)))]
    found = judged.compared(question, method)
    if found is None:
        return
    if found.verdict is Verdict.MODEL:  # in a run the other methods may show that a solver is to blame
        found = _in_a_run(judged, question, method)
    stated, error, factor = [p for p in found.power if not p.missed], "", 0.0
    if found.verdict in PASSED and stated and rng.random() < 0.5:
        power = stated[int(rng.integers(len(stated)))]
        most = min(MOST, LARGEST_ERROR / power.limit)
        error, factor = power.of, float(np.exp(rng.uniform(np.log(LEAST), np.log(most))))
        (parameter,) = [p for p in physical_parameters(case.mechanism, case.initial_state) if p.of == error]
        planted = PlantedEngine(worker, parameter, factor * power.limit, worker.engine)
        found = judged.compared(question, method, planted)
        assert found is not None
    yield RandomTrial(seed, worker.engine, question, method.name, error, factor, found.verdict, found.why)
