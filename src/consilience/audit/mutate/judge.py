"""The comparisons of the suite, in this process: one engine object, one subject, one question.

Nothing is judged here: answers go to `compare_model`, `compare_instant` and `compare_trajectory` as they go in a run.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from consilience.audit.mutate.mutated import SeamError
from consilience.audit.mutate.subjects import MutationSubject
from consilience.compare import Comparison, Verdict, compare_instant, compare_model, compare_trajectory
from consilience.compare.softness import SCALES
from consilience.engine import Engine, InstantAnswer, Method, ModelAnswer, Profile, Question, Run, Status, defects
from consilience.engine.worker.requests import Raised, attempt, offer

_T = TypeVar("_T")

GREEN = (Verdict.AGREES, Verdict.DISCRETISATION, Verdict.UNSUPPORTED)
"""Verdicts that a run passes over, with the exit code 0. Every other one is noticed."""


_MUTANTS = ("seams.py", "mutants.py")
"""Files with the code of mutants: here, and in an adapter."""


def _raised_by_the_mutant(error: Exception) -> bool:
    """Whether an error comes out of the code of a mutant, which then no longer fits its adapter."""
    frames = traceback.extract_tb(error.__traceback__)
    return isinstance(error, SeamError) or (bool(frames) and Path(frames[-1].filename).name in _MUTANTS)


def verdicts(engine: Engine, subject: MutationSubject, question: Question, methods: str = "") -> list[Comparison]:
    """Judge what an engine says, by every method of the matched profile whose name has the text `methods` in it.

    What a user of the defaults gets may differ, and says nothing about the adapter. What an engine raises is one
    failed comparison.

    Raises
    ------
    SeamError
        If the mutant itself is at fault.
    """
    offered = attempt(offer, engine, subject.mechanism, question)
    if isinstance(offered, Raised):
        return [_failed(subject, question, None, offered.error)]
    found = []
    for method in offered[1]:
        if methods not in method.name or method.profile is not Profile.MATCHED:
            continue
        ask, compare = _QUESTIONS[question]
        try:
            answer = ask(engine, subject, method)
        except _UnusableAnswerError as none:
            found.append(_failed(subject, question, method, none.reason))
        else:
            found.append(compare(subject, method, answer))
    return found


class DefectiveAnswerError(Exception):
    """An answer of the wrong form."""


class _UnusableAnswerError(Exception):
    """An engine gave no answer that can be compared; an error of ours is none, and goes its way."""

    def __init__(self, reason: Exception) -> None:
        super().__init__(str(reason))
        self.reason = reason


def _sound(answer: _T | Raised, question: Question, subject: MutationSubject, count: int) -> _T:
    if isinstance(answer, Raised):
        raise _UnusableAnswerError(answer.error)
    wrong = defects(answer, question, subject.mechanism, count)
    if wrong:
        raise _UnusableAnswerError(DefectiveAnswerError("; ".join(wrong)))
    return answer


def _model(engine: Engine, subject: MutationSubject, method: Method) -> ModelAnswer:
    answer = attempt(engine.model, subject.mechanism, subject.states[0], method)
    return _sound(answer, Question.MODEL, subject, 1)


def _compare_model(subject: MutationSubject, method: Method, answer: ModelAnswer) -> Comparison:
    return compare_model(subject.name, "", method, answer, subject.model_answer, subject.size)


def _instant(engine: Engine, subject: MutationSubject, method: Method) -> InstantAnswer:
    answer = attempt(engine.instant, subject.mechanism, subject.states, method)
    return _sound(answer, Question.INSTANT, subject, len(subject.states))


def _compare_instant(subject: MutationSubject, method: Method, answer: InstantAnswer) -> Comparison:
    return compare_instant(subject.name, "", method, answer, subject.instant_answer, subject.instants)


def _run(engine: Engine, subject: MutationSubject, method: Method, level: int, step: float) -> Run:
    answer = attempt(engine.trajectory, subject.mechanism, subject.states[0], subject.times, method, step)
    sound = _sound(answer, Question.TRAJECTORY, subject, len(subject.times))
    return Run(subject.name, "", Question.TRAJECTORY, method, level, step, Status.ANSWERED, sound)


def _trajectory(engine: Engine, subject: MutationSubject, method: Method) -> tuple[list[Run], list[Run]]:
    """All levels, and the finest again at other softnesses where the engine has one."""
    assert subject.case is not None
    steps = [subject.case.sample / n for n in method.substeps] or list(method.tolerances)
    runs = [_run(engine, subject, method, level, step) for level, step in enumerate(steps)]
    scales = SCALES[method.profile] if method.softness is not None else ()
    softer = [_run(engine, subject, replace(method, softness=s), len(steps) - 1, steps[-1]) for s in scales]
    return runs, softer


def _compare_trajectory(subject: MutationSubject, _: Method, answer: tuple[list[Run], list[Run]]) -> Comparison:
    runs, softer = answer
    return compare_trajectory(subject.mechanism, runs, subject.yardstick, softer)


_QUESTIONS: dict[Question, tuple[Callable[..., Any], Callable[..., Comparison]]] = {
    Question.MODEL: (_model, _compare_model),
    Question.INSTANT: (_instant, _compare_instant),
    Question.TRAJECTORY: (_trajectory, _compare_trajectory),
}
"""How an engine is asked, and how its answer is compared."""


def _failed(subject: MutationSubject, question: Question, method: Method | None, error: Exception) -> Comparison:
    if _raised_by_the_mutant(error):
        raise SeamError(f"{type(error).__name__}: {error}") from error
    return Comparison(
        case=subject.name,
        engine="",
        question=question,
        method=method.name if method else "",
        route=method.route if method else None,
        verdict=Verdict.FAILED,
        why=f"{type(error).__name__}: {error}",
    )
