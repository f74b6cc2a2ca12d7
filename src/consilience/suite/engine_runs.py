"""Runs of one engine about one case: questions, methods, levels; more levels where three leave the verdict open.

Answers that are in the store are not asked for again. A job that fails is one failed run, and is not stored.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from consilience.case import Case
from consilience.compare import Prospect, ReferenceMotion, Verdict
from consilience.compare.horizon import PERTURBATION
from consilience.compare.judge import DISPLACED_START, FAULTS_OF_A_CASE, REFERENCE, STABLE, stable_levels, unstable
from consilience.compare.power import MEASURED
from consilience.compare.reference_motion import up_to_shortest
from consilience.compare.softness import SCALES
from consilience.compare.uncertainty import MOST_LEVELS, affordable, needs_another_level
from consilience.engine import EngineInfo, Method, Question, Run, Status, Unsupported, defects, load_named
from consilience.engine.failures import AT_A_STATE, failure_class
from consilience.engine.worker.client import EngineHandle
from consilience.engine.worker.requests import NO_METHOD, Plan, Request
from consilience.mechanism import Array, Mechanism, PhysicalParameter, State, displaced_states
from consilience.suite.coarser_runs import coarser_runs
from consilience.suite.coprime_runs import coprime_runs
from consilience.suite.perturbed_runs import perturbed_runs, sensitive_parameters
from consilience.suite.store import Store, StoredAnswer, with_job
from consilience.suite.thoroughness import FULL, Thoroughness

_LOG = logging.getLogger(__name__)

MOST_STEPS = 100_000
"""Largest number of steps of the first level of a ladder that begins where a method is stable."""

DISPLACED = 3
"""Number of displaced motions of the reference: a single direction would miss growth in the others."""

_NO_LEVEL = "the method names no substeps and no tolerances: no level to run"


def open_plan(worker: EngineHandle, case: Case) -> Plan | str:
    """Return the plan of an engine for a case, or why there is none."""
    reply = worker.ask(_planning(case))
    return reply.value if isinstance(reply.value, Plan) else reply.reason


def _planning(case: Case) -> Request:
    """Return the request for a plan; the start of the case tells the unit of time of its motion."""
    try:
        return Request(case.mechanism, states=[case.initial_state])
    except FAULTS_OF_A_CASE:  # the answers will say what it is
        return Request(case.mechanism)


def levels_of(case: Case, question: Question, method: Method) -> list[float | None]:
    """Return the step sizes or tolerances of a method, coarse to fine; one None for a question without levels."""
    if not question.at_levels:
        return [None]
    return [case.sample / n for n in method.substeps] or list(method.tolerances)


@dataclass(frozen=True, eq=False)
class EngineCase:
    """An engine that is asked about a case.

    Parameters
    ----------
    worker : EngineHandle
    case : Case
    plan : Plan
        Plan of the engine for the case.
    thoroughness : Thoroughness
    store : Store, optional
        Store of answers.
    info : EngineInfo, optional
        Description of the engine, part of the key of its answers in the store.
    reference_motion : ReferenceMotion, optional
        If known, no more levels are asked for once the levels decide the verdict.
    """

    worker: EngineHandle
    case: Case
    plan: Plan
    thoroughness: Thoroughness = FULL
    store: Store | None = None
    info: EngineInfo | None = None
    reference_motion: ReferenceMotion | None = None

    def question(self, question: Question) -> Iterator[Run]:
        """Ask a question by all methods at all levels; yield one failed run for the record where there is no level."""
        case, worker, plan = self.case, self.worker, self.plan
        if refusals := plan.refusals(question):
            reason = "; ".join(map(str, refusals))
            yield Run(case.name, worker.engine, question, None, 0, None, Status.UNSUPPORTED, reason=reason)
            return
        methods = self.thoroughness.some(plan.methods[question], worker.engine, question)
        if not methods:
            yield self._failed(question, None, NO_METHOD)
        headline: Sequence[Run] = []
        for method in methods:
            levels = levels_of(case, question, method)
            if not levels:
                yield self._failed(question, method, _NO_LEVEL)
                continue
            ladder = []
            for run in self.ladder(question, method, levels):
                ladder.append(run)
                yield run
            headline = headline or ladder
            if question.over_time and self.reference_motion is not None:
                yield from self._other_steps(method, ladder, self.reference_motion)
        if worker.engine == REFERENCE and methods:
            if question.over_time and self.thoroughness.closer:
                yield from self._displaced(methods[0])
            if question in MEASURED and headline and all(run.answer is not None for run in headline):
                yield from perturbed_runs(self.once, case, headline, self.sensitive_parameters)

    def _other_steps(self, method: Method, ladder: Sequence[Run], motion: ReferenceMotion) -> Iterator[Run]:
        """Ask for motions at steps that are no levels: longer ones, and coprime ones if the levels scatter."""
        yield from coarser_runs(partial(self._motion, method), self.case.mechanism, method, ladder[0], motion)
        if self.thoroughness.closer:
            yield from coprime_runs(self._level, self.case, method, ladder, motion)

    @cached_property
    def sensitive_parameters(self) -> list[PhysicalParameter]:
        """Parameter of each kind whose error is easiest to see, asked of the reference."""
        methods = self.plan.methods.get(Question.INSTANT, ())
        return sensitive_parameters(self.once, self.case, methods[0]) if methods else []

    def finest(self, question: Question) -> Run:
        """Ask a question by the headline method at its finest level alone."""
        if not self.plan.methods[question]:
            return self._failed(question, None, NO_METHOD)
        method = self.plan.methods[question][0]
        levels = levels_of(self.case, question, method)
        if not levels:
            return self._failed(question, method, _NO_LEVEL)
        return self.once(question, method, len(levels) - 1, levels[-1])

    def ladder(self, question: Question, method: Method, levels: Sequence[float | None]) -> Iterator[Run]:
        """Ask at all levels of a method; if `closer`, also at finer ones until the order settles, and softer."""
        runs: list[Run] = []
        motion = self.reference_motion
        if method.soft_at_rest and motion is not None and motion.slides_or_hits(self.case.mechanism):
            method = replace(method, softness=None)
        for level, step in enumerate(levels):
            runs.append(self._level(question, method, level, step))
            yield runs[-1]
        if not self.thoroughness.closer:
            return
        for step in self._stable_steps(method, runs):
            if len(runs) > len(levels) and not affordable(runs[-1].cpu):
                break
            runs.append(self._level(question, method, len(runs), step))
            yield runs[-1]
        asked, runs = len(runs), stable_levels(self.case, runs)
        if any(run.answer is None for run in runs):
            return
        yield from self._closer(question, method, runs, asked)

    def _closer(self, question: Question, method: Method, runs: list[Run], asked: int) -> Iterator[Run]:
        """Ask at finer levels until the verdict is decided, and with other softness.

        Where steps move the answer by a small share of its difference, other softness is asked first.

        Parameters
        ----------
        runs : list of Run
            Answered levels of the last ladder; the finer ones are appended.
        asked : int
            Number of the next level.
        """
        softer: list[Run] = []
        while not (prospect := self._prospect(runs, softer)).decided:
            if prospect.steady and not softer and method.softness is not None:
                softer = list(self._softer(question, method, runs[-1]))
                yield from softer
                continue
            if (step := self._finer(method, runs, prospect)) is None:
                break
            runs.append(self._level(question, method, asked, step))
            asked += 1
            yield runs[-1]
            if runs[-1].answer is None:
                return
        if not prospect.decided and all(run.step != runs[-1].step for run in softer):
            yield from self._softer(question, method, runs[-1])

    def _softer(self, question: Question, method: Method, run: Run) -> Iterator[Run]:
        """Ask at the level of a run with other softness; nothing of a method without one."""
        for softness in [method.softness * s for s in SCALES[method.profile]] if method.softness is not None else ():
            yield self._level(question, replace(method, softness=softness), run.level, run.step)

    def _level(self, question: Question, method: Method, level: int, step: float | None) -> Run:
        """Ask at one level; for a motion that fails once more, up to the first singular pose of the reference."""
        run = self.once(question, method, level, step)
        if not question.over_time or failure_class(run.reason) not in AT_A_STATE or self._before_singular < 2:
            return run
        again = self.once(question, method, level, step, times=self.case.times[: self._before_singular])
        return run if again.answer is None else replace(again, log=f"{again.log}to the end: {run.reason}\n{run.log}")

    @cached_property
    def _before_singular(self) -> int:
        """Number of samples before the first singular pose of the reference motion; zero if there is none."""
        motion = self.reference_motion
        return (motion and motion.first_singular(self.case.mechanism)) or 0

    def _stable_steps(self, method: Method, runs: Sequence[Run]) -> list[float]:
        """Return steps of a second ladder, if no step of the first is stable, or none resolves the fastest rate.

        The new ladder begins at the first halving that is stable, and has as many levels; none if it takes more than
        `MOST_STEPS`.
        """
        first, last = runs[0].step, runs[-1]
        if not method.substeps or first is None:
            return []
        if last.answer is None:
            rate = self.case.fastest_rate if unstable(self.case, last) else 0.0
        else:
            answered = stable_levels(self.case, runs)
            rate = 0.0 if any(run.answer is None for run in answered) else self._prospect(answered).rate
        if not 0.0 < rate < np.inf:
            return []
        halvings = max(0, math.ceil(math.log2(first * rate / STABLE)))
        start = first / 2.0**halvings
        if self.case.duration / start > MOST_STEPS:
            return []
        return [start * step / first for step in (run.step for run in runs) if step is not None]

    def _motion(self, method: Method, level: int, step: float, times: Array) -> Run:
        """Ask for a motion at other samples than those of the case."""
        return self.once(Question.TRAJECTORY, method, level, step, times=times)

    def _prospect(self, runs: Sequence[Run], softer: Sequence[Run] = ()) -> Prospect:
        """Return the effect of more levels; without a reference motion the verdict counts as open."""
        if self.reference_motion is None or not runs[0].question.over_time:
            return Prospect(Verdict.UNRESOLVED, decided=False, finer=False)
        tried = [run for run in softer if run.step == runs[-1].step and run.answer is not None]
        return Prospect.of(self.case.mechanism, runs, self.reference_motion, tried)

    @staticmethod
    def _finer(method: Method, runs: Sequence[Run], prospect: Prospect) -> float | None:
        """Return the next step size; None where a further level would show nothing new or take too long."""
        last, steps = runs[-1].step, [run.step for run in runs]
        if last is None or not method.substeps or len(runs) >= MOST_LEVELS or not affordable(runs[-1].cpu):
            return None
        open_ = not prospect.steady and needs_another_level(up_to_shortest([r.answer for r in runs]), method, steps)
        return last / 2.0 if prospect.finer or open_ else None

    def _displaced(self, method: Method) -> Iterator[Run]:
        """Ask the reference for motions from displaced initial states, for the horizon."""
        case = self.case
        states = displaced_states(case.mechanism, case.initial_state, PERTURBATION, DISPLACED, case.seed)
        for n, state in enumerate(states):
            name = f"{method.name}, {DISPLACED_START} {n + 1}"
            run = self.once(Question.TRAJECTORY, method, 0, method.tolerances[-2], (case.mechanism, [state]))
            yield replace(run, method=replace(method, name=name, settings={"displaced": PERTURBATION}))

    def once(
        self,
        question: Question,
        method: Method,
        level: int,
        step: float | None,
        subject: tuple[Mechanism, Sequence[State]] | None = None,
        times: Array | None = None,
    ) -> Run:
        """Return one run, from the store if the answer is there.

        Parameters
        ----------
        question : Question
        method : Method
        level : int
            Index of the level.
        step : float or None
            Step size in s, or tolerance; None for a question without levels.
        subject : tuple of Mechanism and states, optional
            Default: mechanism of the case, with its states or its initial state.
        times : ndarray, s, optional
            Sample times of a motion; default: those of the case.
        """
        case = self.case
        mechanism, states = subject or (case.mechanism, case.states if question.at_states else [case.initial_state])
        parameters = load_named(question.parameters)(case) if question.parameters else {}
        samples = case.times if times is None else times
        request = Request(mechanism, question, method, states, samples, step or 0.0, parameters=parameters)
        key = self.store.key(self.info, request) if self.store is not None and self.info is not None else ""
        kept = self.store.find(key) if self.store is not None and key else None
        run = Run(case.name, self.worker.engine, question, method, level, step, Status.ANSWERED)
        if kept is not None:
            _LOG.debug("%s: %s, %s, %s: kept", self.worker.engine, case.name, question, method.name)
            return replace(run, answer=kept.answer, cpu=kept.cpu, log=kept.log, manifest=self.plan.manifest)
        run = self._perform(run, request)
        if self.store is None or not key or run.status is Status.UNSUPPORTED:
            return run
        if run.answer is None:
            return replace(run, log=with_job(run.log, self.store, key, self.worker.engine, request))
        self.store.keep(key, StoredAnswer(run.answer, run.cpu, run.log))
        return run

    def _perform(self, run: Run, request: Request) -> Run:
        """Let the worker do a job, and check the form of the answer."""
        reply, wrong = self.worker.ask(request), ""
        if isinstance(reply.value, Unsupported):
            return replace(run, status=Status.UNSUPPORTED, reason=str(reply.value), cpu=reply.cpu, log=reply.log)
        if reply.returned:
            count = run.question.sample_count(len(request.states), 0 if request.times is None else len(request.times))
            wrong = "; ".join(defects(reply.value, run.question, self.case.mechanism, count))
        run = replace(run, reason=wrong or reply.reason, manifest=self.plan.manifest, cpu=reply.cpu, log=reply.log)
        if not reply.returned or wrong:
            return replace(run, status=Status.FAILED)
        return replace(run, answer=reply.value)

    def _failed(self, question: Question, method: Method | None, reason: str) -> Run:
        return Run(self.case.name, self.worker.engine, question, method, 0, None, Status.FAILED, reason=reason)


def ask_case(
    worker: EngineHandle,
    case: Case,
    questions: Sequence[Question],
    thoroughness: Thoroughness = FULL,
    store: Store | None = None,
    info: EngineInfo | None = None,
    reference_motion: ReferenceMotion | None = None,
) -> Iterator[Run]:
    """Ask an engine questions about a case.

    Parameters
    ----------
    worker : EngineHandle
    case : Case
    questions : sequence of Question
    thoroughness, store, info, reference_motion
        As in `EngineCase`.
    """
    request = _planning(case)
    reply = worker.ask(request)
    if isinstance(reply.value, Plan):
        engine_case = EngineCase(worker, case, reply.value, thoroughness, store, info, reference_motion)
        for question in questions:
            try:
                yield from engine_case.question(question)
            except FAULTS_OF_A_CASE as error:
                yield Run(case.name, worker.engine, question, None, 0, None, Status.FAILED, reason=str(error))
        return
    log = reply.log
    if store is not None and info is not None:
        log = with_job(log, store, store.key(info, request), worker.engine, request)
    for question in questions:
        yield Run(case.name, worker.engine, question, None, 0, None, Status.FAILED, reason=reply.reason, log=log)


def ask_ladder(
    worker: EngineHandle, case: Case, plan: Plan, method: Method, steps: Sequence[float] | None = None
) -> Iterator[Run]:
    """Ask for motions by a method at all levels and with other softness, or at the given steps alone.

    Parameters
    ----------
    worker : EngineHandle
    case : Case
    plan : Plan
        Plan of the engine for the case.
    method : Method
    steps : sequence of float, s, optional
        Step sizes or tolerances in place of those of the method.
    """
    engine_case = EngineCase(worker, case, plan)
    if steps is None:
        yield from engine_case.ladder(Question.TRAJECTORY, method, levels_of(case, Question.TRAJECTORY, method))
        return
    for level, step in enumerate(steps):
        yield engine_case.once(Question.TRAJECTORY, method, level, step)
