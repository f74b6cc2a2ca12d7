"""Answers of the reference about mechanisms with one parameter off, from which the power of every comparison follows.

Of each kind of parameter (`mechanism.perturbation`) one is asked about: that which changes the accelerations most, in
the pose of the start, at rest and moving. An answer to a question over time is asked again at another size if its
change is not linear, or is not far above rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from consilience.case import Case
from consilience.compare.motion import TINY
from consilience.compare.power import LEAST, LINEAR, SIZE, STATES, largest_difference
from consilience.engine import Method, Question, Run
from consilience.mechanism import (
    Mechanism,
    ParameterEffects,
    Perturbation,
    PhysicalParameter,
    State,
    physical_parameters,
    states_in_motion,
)
from consilience.mechanism.perturbation import INERTIA, MASS

TRIED = 3
"""Number of parameters of a kind that are tried: an axis that is tilted may lock the mechanism."""

AIM = 1e-5
"""Change of a motion to aim for: above its rounding as far as below the end of linearity."""


ATTEMPTS = 3
"""Largest number of motions for a parameter."""

SMALLEST, GREATEST = 1e-10, 1e-2
"""Range of the size of an error."""


Subject = tuple[Mechanism, Sequence[State]]
AskReference = Callable[[Question, Method, int, float | None, Subject], Run]
"""Function that asks the reference a question by a method, at a level and its step, about a mechanism at states."""


def sensitive_parameters(ask: AskReference, case: Case, method: Method) -> list[PhysicalParameter]:
    """Return the parameter of each kind that changes the accelerations most; the method answers to `instant`."""
    mechanism, start = case.mechanism, case.initial_state
    kinds: dict[str, list[PhysicalParameter]] = {}
    for parameter in physical_parameters(mechanism, start):
        kinds.setdefault(parameter.kind, []).append(parameter)
    states = states_in_motion(mechanism, start, case.seed, case.speed)
    answer = ask(Question.INSTANT, method, 0, None, (mechanism, states)).answer
    if answer is None:
        return []
    effects = ParameterEffects(mechanism, states, answer.a_WB_W, answer.alpha_WB_W, answer.force_F)
    found = []
    for parameters in kinds.values():
        best = sorted(parameters, key=effects.of, reverse=True)[:TRIED]
        found += [p for p in best if p.perturbed(mechanism, [start], SIZE) is not None][:1]
    return found


def perturbed_runs(
    ask: AskReference, case: Case, headline: Sequence[Run], parameters: Sequence[PhysicalParameter]
) -> Iterator[Run]:
    """AskReference the reference a question about the mechanism with one parameter off, once for each parameter.

    Parameters
    ----------
    ask : callable
    case : Case
    headline : sequence of Run
        Answers of the reference to the question by its headline method, coarse to fine, one at least.
    parameters : sequence of PhysicalParameter
    """
    undisturbed = headline[-2:][0]
    for parameter in parameters:
        if undisturbed.question is Question.MODEL and parameter.kind not in (MASS, INERTIA):
            continue
        run = (_motion if undisturbed.question.over_time else _answer)(ask, case, undisturbed, parameter)
        if run is not None:
            yield run


def _answer(
    ask: AskReference, case: Case, undisturbed: Run, parameter: PhysicalParameter, size: float = SIZE
) -> Run | None:
    """Ask once, at the states of the case, of which few are assembled again; None if there is no such mechanism.

    Parameters
    ----------
    ask : callable
    case : Case
    undisturbed : Run
        Answer without an error, by the same method at the same level.
    parameter : PhysicalParameter
    size : float
        Size of the error.
    """
    some = STATES if parameter.moves else None
    states = case.states[:some] if undisturbed.question.at_states else [case.initial_state]
    subject = parameter.perturbed(case.mechanism, states, size)
    if subject is None or undisturbed.method is None:
        return None
    run = ask(undisturbed.question, undisturbed.method, undisturbed.level, undisturbed.step, subject)
    return replace(run, perturbation=Perturbation(parameter.kind, parameter.of, size))


def _motion(ask: AskReference, case: Case, undisturbed: Run, parameter: PhysicalParameter) -> Run | None:
    """AskReference for a motion, with a larger or smaller error if the first shows no sensitivity."""
    size, run = SIZE, None
    for _ in range(ATTEMPTS):
        run = _answer(ask, case, undisturbed, parameter, size)
        if run is None or run.answer is None:
            break
        change = largest_difference(case.mechanism, run.answer, undisturbed.answer)
        if LEAST < change < LINEAR:
            break
        size = float(np.clip(size * AIM / max(change, TINY), SMALLEST, GREATEST))
    return run
