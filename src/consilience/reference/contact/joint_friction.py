"""Dry friction whose bound is a joint reaction: bounds and forces solved together.

The bound of a set is ``mu |F|``, F being the reaction across the axis, which depends on the forces of all rows and so
on the friction itself:

    F = constant + linear f,      offset = |F|,

a quadratic equation for one joint that slides. In given modes the forces are affine in the offsets, so Newton's method
needs one linear solution per joint. Where ``d|F|/d offset`` reaches one, the joint locks itself (Painleve).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.decision import ModeDecision
from consilience.reference.contact.mode_system import solve_with_modes
from consilience.reference.contact.problem import ContactProblem, Modes

_STEPS = 30

_SOLVED = 1e-14
"""Change of the bounds at which they are solved, relative to the largest."""


@dataclass(frozen=True, eq=False)
class JointReaction:
    """Reaction that bounds a friction set.

    Attributes
    ----------
    constant : ndarray, shape (k,), N
    linear : ndarray, shape (k, m)
        Its change with the forces of the rows.
    """

    constant: Array
    linear: Array


def with_offsets(problem: ContactProblem, offsets: Mapping[int, float]) -> ContactProblem:
    """Return a problem with other offsets of some friction sets."""
    sets = (replace(f, offset=offsets.get(j, f.offset)) for j, f in enumerate(problem.friction))
    return replace(problem, friction=tuple(sets))


def decide_with_reactions(
    problem: ContactProblem, reactions: Mapping[int, JointReaction], decide: Callable[[ContactProblem], ModeDecision]
) -> tuple[ContactProblem, ModeDecision]:
    """Decide the modes of a problem in which some bounds are reactions.

    Parameters
    ----------
    problem : ContactProblem
    reactions : mapping of int to JointReaction
        For those friction sets; their offsets are not read.
    decide : callable
        `consilience.reference.contact.decision.decide`, with whatever else it is to know.

    Returns
    -------
    ContactProblem
        With the offsets found.
    ModeDecision

    Raises
    ------
    NumericalFailure
        A joint locks itself, its reaction is undetermined, or modes alternate.
    """
    offsets = {j: float(np.linalg.norm(reaction.constant)) for j, reaction in reactions.items()}
    for _ in range(_STEPS):
        problem = with_offsets(problem, offsets)
        decision = decide(problem)
        for j, reaction in reactions.items():
            if np.max(np.abs(reaction.linear @ decision.undetermined), initial=0.0) > 1e-9 * np.max(
                np.abs(reaction.linear)
            ):
                raise NumericalFailure(
                    f"{problem.friction[j].name}: the reaction that bounds it is not determined by the laws of contact"
                )
        following = offsets_in_modes(problem, decision.modes, reactions, decision.force)
        change = max(abs(following[j] - offsets[j]) for j in offsets)
        offsets = following
        if change <= _SOLVED * max(offsets.values()):
            return problem, decision
    names = ", ".join(problem.friction[j].name for j in reactions)
    raise NumericalFailure(f"{names}: no bound of the friction agrees with the reaction that it brings about")


def offsets_in_modes(
    problem: ContactProblem, modes: Modes, reactions: Mapping[int, JointReaction], force: Array | None = None
) -> dict[int, float]:
    """Return the offsets that agree with the reactions in given modes.

    Parameters
    ----------
    force : ndarray, shape (m,), optional
        Forces for the offsets of the problem, for what sticks; of least norm if left out.

    Raises
    ------
    NumericalFailure
        A joint locks itself.
    """
    keys = list(reactions)
    start = np.array([problem.friction[j].offset for j in keys])
    base = solve_with_modes(problem, modes).force
    changes = []
    for j in keys:
        more = with_offsets(problem, {j: problem.friction[j].offset + 1.0})
        changes.append(solve_with_modes(more, modes).force - base)
    slopes = np.array(changes).T
    at = base if force is None else force
    offsets = start
    for _ in range(_STEPS):
        F = [reactions[j].constant + reactions[j].linear @ (at + slopes @ (offsets - start)) for j in keys]
        size = np.array([np.linalg.norm(one) for one in F])
        rates = [
            (one / length if length > 0.0 else np.zeros(len(one))) @ reactions[j].linear @ slopes
            for j, one, length in zip(keys, F, size, strict=True)
        ]
        system = np.eye(len(keys)) - np.array(rates)
        if np.linalg.det(system) <= 0.0:
            names = ", ".join(problem.friction[j].name for j in keys)
            raise NumericalFailure(
                f"{names}: the joint locks itself, its friction raises its reaction faster than its bound"
            )
        step = np.linalg.solve(system, size - offsets)
        offsets = np.maximum(offsets + step, 0.0)
        if np.max(np.abs(step)) <= 0.1 * _SOLVED * max(float(np.max(offsets)), np.finfo(float).tiny):
            break
    return dict(zip(keys, offsets.tolist(), strict=True))
