"""Motions at coprime steps, where levels in contact scatter: their limit may tell what the levels do not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from consilience.case import Case
from consilience.compare import Prospect, ReferenceMotion
from consilience.compare.coprime_steps import COUNT, RATIO, coprime_substeps
from consilience.compare.judge import ladder_of
from consilience.compare.softness import SCALES
from consilience.engine import Method, Question, Run

BUDGET = 10.0
"""Largest CPU time in s that the motions at one softness may take together: twice that of a further level."""

AskLevel = Callable[[Question, Method, int, float | None], Run]
"""Function that asks a question by a method at a level and its step in s."""


def coprime_runs(
    ask: AskLevel, case: Case, method: Method, ladder: Sequence[Run], motion: ReferenceMotion
) -> Iterator[Run]:
    """Ask for motions at coprime steps, and at another softness if there is one, if the levels decide nothing.

    Parameters
    ----------
    ask : callable
    case : Case
    method : Method
    ladder : sequence of Run
        Levels of the method, and runs at other softness.
    motion : ReferenceMotion

    Yields
    ------
    Run
    """
    mechanism, (levels, softer) = case.mechanism, ladder_of(case, ladder)
    acts = mechanism.contacts or mechanism.stops or mechanism.dry_frictions
    if not acts or not method.substeps or any(run.answer is None for run in (*levels, *softer)):
        return
    if (finest := finest_affordable(levels)) is None or not Prospect.of(mechanism, levels, motion, softer).scattered:
        return
    own = replace(method, softness=None if levels[-1].method is None else levels[-1].method.softness)
    softness = [replace(method, softness=method.softness * max(SCALES[method.profile]))] if method.softness else []
    for one in (own, *softness):
        for n, substeps in enumerate(coprime_substeps(case.sample / finest)):
            yield replace(ask(Question.TRAJECTORY, one, n, case.sample / substeps), coprime=True)


def finest_affordable(levels: Sequence[Run]) -> float | None:
    """Return the step of the finest level from which the others take no more than `BUDGET`; None if there is none."""
    together = sum(RATIO ** (-n / (COUNT - 1)) for n in range(COUNT))
    steps = [(run.step, run.cpu) for run in levels if run.step is not None]
    fit = (step for step, cpu in steps if RATIO * step <= steps[0][0] and together * cpu <= BUDGET)
    return min(fit, default=None)
