"""The comparisons of the suite, in this process: one engine object, one subject, one question.

Nothing is judged here: answers go to `compare_model`, `compare_instant` and `compare_trajectory` as they go in a run.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from consilience.compare import Comparison, Verdict, compare_instant, compare_model, compare_trajectory
from consilience.compare.softness import SCALES
from consilience.engine import Engine
from consilience.mutate.mutated import SeamError
from consilience.mutate.subjects import Subject
from consilience.run import (
    InstantAnswer,
    Method,
    ModelAnswer,
    Profile,
    Question,
    Run,
    Status,
    defects,
)

GREEN = (Verdict.AGREES, Verdict.DISCRETISATION, Verdict.UNSUPPORTED)
"""Verdicts that a run passes over, with the exit code 0. Every other one is noticed."""


def _raised_by_the_mutant(error: Exception) -> bool:
    """Whether an error comes out of the code of a seam, which then no longer fits its adapter."""
    frames = traceback.extract_tb(error.__traceback__)
    return isinstance(error, SeamError) or (bool(frames) and Path(frames[-1].filename).name.startswith("seams"))


def verdicts(engine: Engine, subject: Subject, question: Question, methods: str = "") -> list[Comparison]:
    """Judge what an engine says, by every method of the matched profile whose name has the text `methods` in it.

    What a user of the defaults gets may differ, and says nothing about the adapter. What an engine raises is one
    failed comparison.

    Raises
    ------
    SeamError
        If the mutant itself is at fault.
    """
    try:
        if engine.unsupported(subject.mechanism, question):
            return []
        offered = engine.methods(subject.mechanism, question)
        chosen = [m for m in offered if methods in m.name and m.profile is Profile.MATCHED]
    except Exception as error:  # noqa: BLE001 - whatever an engine or its adapter raises is evidence about that engine
        return [_failed(subject, question, None, error)]
    found = []
    for method in chosen:
        ask, compare = _QUESTIONS[question]
        try:
            answer = ask(engine, subject, method)
        except Exception as error:  # noqa: BLE001 - as above
            found.append(_failed(subject, question, method, error))
        else:
            found.append(compare(subject, method, answer))  # an error of ours is no evidence about an engine
    return found


class DefectiveAnswerError(Exception):
    """An answer of the wrong form."""


def _checked(answer: object, question: Question, subject: Subject, count: int) -> None:
    wrong = defects(answer, question, subject.mechanism, count)
    if wrong:
        raise DefectiveAnswerError("; ".join(wrong))


def _model(engine: Engine, subject: Subject, method: Method) -> ModelAnswer:
    answer: ModelAnswer = engine.model(subject.mechanism, subject.states[0], method)
    _checked(answer, Question.MODEL, subject, 1)
    return answer


def _compare_model(subject: Subject, method: Method, answer: ModelAnswer) -> Comparison:
    return compare_model(subject.name, "", method, answer, subject.model_answer, subject.size)


def _instant(engine: Engine, subject: Subject, method: Method) -> InstantAnswer:
    answer: InstantAnswer = engine.instant(subject.mechanism, subject.states, method)
    _checked(answer, Question.INSTANT, subject, len(subject.states))
    return answer


def _compare_instant(subject: Subject, method: Method, answer: InstantAnswer) -> Comparison:
    return compare_instant(subject.name, "", method, answer, subject.instant_answer, subject.instants)


def _run(engine: Engine, subject: Subject, method: Method, level: int, step: float) -> Run:
    answer = engine.trajectory(subject.mechanism, subject.states[0], subject.times, method, step)
    _checked(answer, Question.TRAJECTORY, subject, len(subject.times))
    return Run(subject.name, "", Question.TRAJECTORY, method, level, step, Status.ANSWERED, answer)


def _trajectory(engine: Engine, subject: Subject, method: Method) -> tuple[list[Run], list[Run]]:
    """All levels, and the finest again at other softnesses where the engine has one."""
    assert subject.case is not None
    steps = [subject.case.sample / n for n in method.substeps] or list(method.tolerances)
    runs = [_run(engine, subject, method, level, step) for level, step in enumerate(steps)]
    scales = SCALES[method.profile] if method.softness is not None else ()
    softer = [_run(engine, subject, replace(method, softness=s), len(steps) - 1, steps[-1]) for s in scales]
    return runs, softer


def _compare_trajectory(subject: Subject, _: Method, answer: tuple[list[Run], list[Run]]) -> Comparison:
    runs, softer = answer
    return compare_trajectory(subject.mechanism, runs, subject.yardstick, softer)


_QUESTIONS: dict[Question, tuple[Callable[..., Any], Callable[..., Comparison]]] = {
    Question.MODEL: (_model, _compare_model),
    Question.INSTANT: (_instant, _compare_instant),
    Question.TRAJECTORY: (_trajectory, _compare_trajectory),
}
"""How an engine is asked, and how its answer is compared."""


def _failed(subject: Subject, question: Question, method: Method | None, error: Exception) -> Comparison:
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
