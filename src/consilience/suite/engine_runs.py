"""Ask one engine everything about one case: questions, methods, levels, and what three levels leave in doubt.

An answer that a store has is not asked for again. A job that fails is one failed run, and is not kept.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from consilience.case import Case
from consilience.compare import Prospect, Yardstick
from consilience.compare.horizon import PERTURBATION
from consilience.compare.judge import DISPLACED_START, REFERENCE
from consilience.compare.softness import SCALES
from consilience.compare.uncertainty import needs_another_level
from consilience.engine import (
    EngineInfo,
    InstantAnswer,
    Method,
    ModelAnswer,
    Question,
    Run,
    Status,
    TrajectoryAnswer,
    defects,
)
from consilience.engine.worker.client import EngineHandle, Plan, Request, replayable_job
from consilience.mechanism import State, displaced_states
from consilience.suite.store import Kept, Store

_LOG = logging.getLogger(__name__)

MOST_LEVELS = 6
LEVEL_BUDGET = 5.0
"""Levels of a ladder at most, and CPU time in s that one more of them may take."""

DISPLACED = 3
"""Displaced motions of the reference: one would miss growth in directions it does not have."""

_NO_METHOD = "the adapter supports the question and offers no method"
_NO_LEVEL = "the method names no substeps and no tolerances: no level to run"


@dataclass(frozen=True)
class Thoroughness:
    """How thoroughly a suite asks.

    Attributes
    ----------
    methods, reference_methods : int or None
        Ways of an engine to answer a question, and of the reference, the headline first; None: all.
    states : int or None
        States of the question `instant` at most.
    samples : int or None
        Sample intervals of a motion at most.
    closer : bool
        Whether to go on where three levels leave doubt: more levels, other softness; displaced initial states.
    """

    methods: int | None = None
    reference_methods: int | None = None
    states: int | None = None
    samples: int | None = None
    closer: bool = True

    def case(self, case: Case) -> Case:
        """What is asked of a case."""
        if self.states is not None:
            case = replace(case, instants=min(case.instants, self.states))
        if self.samples is not None and len(case.times) > self.samples + 1:
            case = case.with_span(self.samples * case.sample, None)
        return case

    def some(self, methods: Sequence[Method], engine: str) -> Sequence[Method]:
        """Methods that are asked."""
        return methods[: self.reference_methods if engine == REFERENCE else self.methods]


FULL = Thoroughness()

QUICK = Thoroughness(methods=1, reference_methods=2, states=3, samples=5, closer=False)
"""The first quarter of a second or so by the headline of each engine alone: enough to see that something is wrong."""


def open_plan(worker: EngineHandle, case: Case) -> Plan | str:
    """What an engine says about a case before it is asked, or why it says nothing."""
    reply = worker.ask(Request(case.mechanism))
    return reply.value if isinstance(reply.value, Plan) else reply.reason


def levels_of(case: Case, question: Question, method: Method) -> list[float | None]:
    """Step sizes or tolerances of a method, coarse to fine; one None where a question has none."""
    if question is not Question.TRAJECTORY:
        return [None]
    return [case.sample / n for n in method.substeps] or list(method.tolerances)


@dataclass(frozen=True, eq=False)
class EngineCase:
    """An engine that is asked about a case, with what it said of it.

    Parameters
    ----------
    store : Store, optional
        Where answers are looked up and kept.
    info : EngineInfo, optional
        The engine's own; an answer of another version is another answer.
    yard : Yardstick, optional
        The reference's motion. Where it is known, a ladder ends as soon as its levels decide the verdict.
    """

    worker: EngineHandle
    case: Case
    plan: Plan
    effort: Thoroughness = FULL
    store: Store | None = None
    info: EngineInfo | None = None
    yard: Yardstick | None = None

    def question(self, question: Question) -> Iterator[Run]:
        """Every method and level; a question without any is a failed run, so that it cannot vanish from the record."""
        case, worker, plan = self.case, self.worker, self.plan
        if plan.unsupported[question]:
            reason = "; ".join(f"{u.feature}: {u.reason}" for u in plan.unsupported[question])
            yield Run(case.name, worker.engine, question, None, 0, None, Status.UNSUPPORTED, reason=reason)
            return
        methods = self.effort.some(plan.methods[question], worker.engine)
        if not methods:
            yield self._failed(question, None, _NO_METHOD)
        for method in methods:
            levels = levels_of(case, question, method)
            if not levels:
                yield self._failed(question, method, _NO_LEVEL)
            else:
                yield from self.ladder(question, method, levels)
        if worker.engine == REFERENCE and question is Question.TRAJECTORY and self.effort.closer:
            yield from self._displaced(methods[0])

    def finest(self, question: Question) -> Run:
        """The headline at its finest level alone."""
        for method in self.plan.methods[question][:1]:
            levels = levels_of(self.case, question, method)
            if levels:
                return self.once(question, method, len(levels) - 1, levels[-1])
            return self._failed(question, method, _NO_LEVEL)
        return self._failed(question, None, _NO_METHOD)

    def ladder(self, question: Question, method: Method, levels: Sequence[float | None]) -> Iterator[Run]:
        """Every level of a method; closer: finer ones until the order settles, the finest at other softness."""
        runs: list[Run] = []
        for level, step in enumerate(levels):
            runs.append(self.once(question, method, level, step))
            yield runs[-1]
        if not self.effort.closer or any(run.answer is None for run in runs):
            return
        while not (prospect := self._prospect(runs)).decided and (step := self._finer(method, runs, prospect)):
            runs.append(self.once(question, method, len(runs), step))
            yield runs[-1]
            if runs[-1].answer is None:
                return
        if method.softness is not None and not prospect.decided:
            for scale in SCALES[method.profile]:
                softer = replace(method, softness=scale * method.softness)
                yield self.once(question, softer, runs[-1].level, runs[-1].step)

    def _prospect(self, runs: Sequence[Run]) -> Prospect:
        """What more levels would do; as if nothing were decided where there is no yardstick."""
        if self.yard is None or runs[0].question is not Question.TRAJECTORY:
            return Prospect(decided=False, next_agrees=False)
        return Prospect.of(self.case.mechanism, runs, self.yard)

    @staticmethod
    def _finer(method: Method, runs: Sequence[Run], prospect: Prospect) -> float | None:
        """The next step of a ladder, if it would say more and can be afforded."""
        last = runs[-1].step
        if last is None or not method.substeps or len(runs) >= MOST_LEVELS or 2.0 * runs[-1].cpu >= LEVEL_BUDGET:
            return None
        answers = [run.answer for run in runs if isinstance(run.answer, TrajectoryAnswer)]
        more = prospect.next_agrees or needs_another_level(answers, method, [run.step for run in runs])
        return last / 2.0 if more else None

    def _displaced(self, method: Method) -> Iterator[Run]:
        """The reference from displaced initial states, for the horizon."""
        case = self.case
        states = displaced_states(case.mechanism, case.initial_state, PERTURBATION, DISPLACED, case.seed)
        for n, state in enumerate(states):
            name = f"{method.name}, {DISPLACED_START} {n + 1}"
            run = self.once(Question.TRAJECTORY, method, 0, method.tolerances[-2], state)
            yield replace(run, method=replace(method, name=name, settings={"displaced": PERTURBATION}))

    def once(
        self, question: Question, method: Method, level: int, step: float | None, start: State | None = None
    ) -> Run:
        """One run: out of the store if it is there."""
        case = self.case
        states = case.states if question is Question.INSTANT else [start or case.initial_state]
        request = Request(case.mechanism, question, method, states, case.times, step or 0.0)
        key = self.store.key(self.info, request) if self.store is not None and self.info is not None else ""
        kept = self.store.find(key) if self.store is not None and key else None
        run = Run(case.name, self.worker.engine, question, method, level, step, Status.ANSWERED)
        if kept is not None:
            _LOG.debug("%s: %s, %s, %s: kept", self.worker.engine, case.name, question, method.name)
            return replace(run, answer=kept.answer, cpu=kept.cpu, log=kept.log, manifest=self.plan.manifest)
        run = self._perform(run, request)
        if self.store is None or not key:
            return run
        if run.answer is None:
            return replace(run, log=_with_job(run.log, self.store, key, self.worker.engine, request))
        self.store.keep(key, Kept(run.answer, run.cpu, run.log))
        return run

    def _perform(self, run: Run, request: Request) -> Run:
        """Let the worker do a job."""
        count = {Question.MODEL: 1, Question.INSTANT: len(request.states), Question.TRAJECTORY: len(self.case.times)}
        reply = self.worker.ask(request)
        reason = reply.reason
        if reply.returned:
            reason = "; ".join(defects(reply.value, run.question, self.case.mechanism, count[run.question]))
        value = reply.value
        answer = value if isinstance(value, ModelAnswer | InstantAnswer | TrajectoryAnswer) and not reason else None
        return replace(
            run,
            status=Status.FAILED if answer is None else Status.ANSWERED,
            answer=answer,
            reason=reason,
            manifest=self.plan.manifest,
            cpu=reply.cpu,
            log=reply.log,
        )

    def _failed(self, question: Question, method: Method | None, reason: str) -> Run:
        return Run(self.case.name, self.worker.engine, question, method, 0, None, Status.FAILED, reason=reason)


def _with_job(log: str, store: Store, key: str, engine: str, request: Request) -> str:
    """What an engine printed before it failed, and how to do the job again; the job is written down."""
    job = store.keep_job(key, replayable_job(engine, request))
    lines = [log.rstrip("\n")] if log.strip() else []
    return "\n".join([*lines, f"to do it again: python -m consilience.engine.worker {job}"])


def ask_case(
    worker: EngineHandle,
    case: Case,
    questions: Sequence[Question],
    effort: Thoroughness = FULL,
    store: Store | None = None,
    info: EngineInfo | None = None,
    yard: Yardstick | None = None,
) -> Iterator[Run]:
    """All runs of an engine about a case; `yard` as in `EngineCase`."""
    request = Request(case.mechanism)
    reply = worker.ask(request)
    if isinstance(reply.value, Plan):
        asked = EngineCase(worker, case, reply.value, effort, store, info, yard)
        for question in questions:
            yield from asked.question(question)
        return
    log = reply.log
    if store is not None and info is not None:
        log = _with_job(log, store, store.key(info, request), worker.engine, request)
    for question in questions:
        failed = Run(case.name, worker.engine, question, None, 0, None, Status.FAILED)
        yield replace(failed, reason=reply.reason, log=log)


def ask_ladder(
    worker: EngineHandle, case: Case, plan: Plan, method: Method, steps: Sequence[float] | None = None
) -> Iterator[Run]:
    """Runs of a trajectory method at every level and at other softness; at the given steps alone, if any are given."""
    asked = EngineCase(worker, case, plan)
    if steps is None:
        yield from asked.ladder(Question.TRAJECTORY, method, levels_of(case, Question.TRAJECTORY, method))
        return
    for level, step in enumerate(steps):
        yield asked.once(Question.TRAJECTORY, method, level, step)
