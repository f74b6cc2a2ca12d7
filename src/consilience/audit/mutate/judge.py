"""Comparisons of the suite in this process: one engine object, one subject, one question.

Answers go to `compare_model`, `compare_instant` and `compare_trajectory`, as in a run; this module judges nothing.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from consilience.audit.mutate.mutated import SeamError
from consilience.audit.mutate.subjects import MutationSubject
from consilience.compare import Comparison, Verdict, compare_instant, compare_model, compare_trajectory
from consilience.compare.judges import method_of
from consilience.compare.softness import SCALES
from consilience.engine import Engine, Method, Profile, Question, Run, Status, defects
from consilience.engine.worker.requests import Raised, Request, attempt, offer, perform
from consilience.suite.engine_runs import levels_of

GREEN = (Verdict.AGREES, Verdict.DISCRETISATION, Verdict.UNSUPPORTED)
"""Verdicts without a difference that is not of steps. Every other verdict catches a mutant."""

PASSED = (*GREEN, Verdict.REGULARISATION)
"""Verdicts that a run passes over, with the exit code 0."""

_MUTANTS = ("seams.py", "mutants.py")
"""Files with the code of mutants: in this package, and in an adapter."""


class _UnusableAnswerError(Exception):
    """An engine gave no answer that can be compared. Errors of the harness have other types, and are not caught."""


def verdicts(engine: Engine, subject: MutationSubject, question: Question, methods: str = "") -> list[Comparison]:
    """Compare the answers of an engine by every matched method whose name contains the text `methods`.

    Methods at the engine's default settings may differ without an error of the adapter, and are left out. An exception
    of the engine is one failed comparison.

    Raises
    ------
    SeamError
        If the mutant itself is at fault.
    """
    offered = attempt(offer, engine, subject.mechanism, question)
    if isinstance(offered, Raised):
        return [_failed(subject, question, None, _words(offered.error))]
    chosen = [m for m in offered[1] if methods in m.name and m.profile is Profile.MATCHED]
    return [_verdict(engine, subject, question, method) for method in chosen]


def _verdict(engine: Engine, subject: MutationSubject, question: Question, method: Method) -> Comparison:
    """Ask by one method at all its levels, and at the finest with other softness if the engine has any; compare."""
    steps = levels_of(subject.case, question, method) if subject.case is not None else [None]
    scales = SCALES[method.profile] if question.at_levels and method.softness is not None else ()
    try:
        runs = [_run(engine, subject, question, method, level, step) for level, step in enumerate(steps)]
        softer = [
            _run(engine, subject, question, replace(method, softness=s), len(steps) - 1, steps[-1]) for s in scales
        ]
    except _UnusableAnswerError as reason:
        return _failed(subject, question, method, str(reason))
    return _COMPARISONS[question](subject, runs, softer)


def _run(
    engine: Engine, subject: MutationSubject, question: Question, method: Method, level: int, step: float | None
) -> Run:
    """Ask once.

    Parameters
    ----------
    engine : Engine
    subject : MutationSubject
    question : Question
    method : Method
    level : int
        Number of the step size or tolerance.
    step : float or None
        Step size in s, or tolerance; None for a question without levels.
    """
    request = Request(subject.mechanism, question, method, subject.states, subject.times, step or 0.0)
    answer = attempt(perform, engine, request)
    if isinstance(answer, Raised):
        raise _UnusableAnswerError(_words(answer.error))
    count = question.sample_count(len(subject.states), len(subject.times))
    wrong = defects(answer, question, subject.mechanism, count)
    if wrong:
        raise _UnusableAnswerError(f"DefectiveAnswerError: {'; '.join(wrong)}")
    return Run(subject.name, "", question, method, level, step, Status.ANSWERED, answer)


def _words(error: Exception) -> str:
    """Return type and message of an exception of the engine; raise it if the code of a mutant raised it.

    An exception from the code of a mutant means that the mutant no longer fits its adapter.
    """
    words = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    if isinstance(error, SeamError) or (frames and Path(frames[-1].filename).name in _MUTANTS):
        raise SeamError(words) from error
    return words


def _model(subject: MutationSubject, runs: list[Run], _: list[Run]) -> Comparison:
    (run,) = runs
    return compare_model(subject.name, "", method_of(run), run.answer, subject.model_answer, subject.size)


def _instant(subject: MutationSubject, runs: list[Run], _: list[Run]) -> Comparison:
    (run,) = runs
    return compare_instant(subject.name, "", method_of(run), run.answer, subject.instant_answer, subject.instants)


def _trajectory(subject: MutationSubject, runs: list[Run], softer: list[Run]) -> Comparison:
    return compare_trajectory(subject.mechanism, runs, subject.yardstick, softer)


_COMPARISONS: dict[Question, Callable[[MutationSubject, list[Run], list[Run]], Comparison]] = {
    Question.MODEL: _model,
    Question.INSTANT: _instant,
    Question.TRAJECTORY: _trajectory,
}
"""Comparison of the runs at all levels, and of those with other softness, with the reference."""


def _failed(subject: MutationSubject, question: Question, method: Method | None, why: str) -> Comparison:
    name, route = (method.name, method.route) if method else ("", None)
    return Comparison(subject.name, "", question, name, route, Verdict.FAILED, why)
