"""Dry friction whose bound is a joint reaction: bounds and forces solved together.

The bound of a set is ``mu |F|``, F being the reaction across the axis, which depends on the forces of all rows and so
on the friction itself:

    F = constant + linear f,      offset = |F|,

a quadratic equation for one joint that slides. In given modes the forces are affine in the offsets, so Newton's method
needs one linear solution per joint. Where ``d|F|/d offset`` reaches one, the joint locks itself (Painleve).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import GROUND, Array
from consilience.reference.bodies.arrays import Workspace
from consilience.reference.contact.decision import ModeDecision
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.mode_system import solve_with_modes
from consilience.reference.contact.problem import ContactProblem, Modes

LOCKED = "the joint locks itself, its friction raises its reaction faster than its bound"

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

    def on(self, rows: Array, given: Array) -> JointReaction:
        """Return the reaction as of the forces of some rows alone; the forces of all are `given` besides."""
        return JointReaction(self.constant + self.linear @ given, self.linear[:, rows])


def reacting_joints(layout: RowLayout) -> dict[int, int]:
    """Return the joints whose reactions bound friction sets."""
    joints, dry = layout.mechanism.joint_index, enumerate(layout.dry)
    return {j: joints[one.joint] for j, one in dry if one is not None and one.coefficient is not None}


def reaction_across(layout: RowLayout, joint: int, ws: Workspace) -> Array:
    """Return what the multipliers of a joint's rows contribute to its force across its axis, shape (3, r).

    The rows of `ws` are those of the state; world axes, on the successor, or on the predecessor of the ground.
    """
    one, model = layout.mechanism.joints[joint], layout.model
    side, frame = (one.successor, one.M) if one.successor != GROUND else (one.predecessor, one.F)
    body = layout.mechanism.body_index[side]
    axis = ws.A[body] @ frame.R[:, 2]
    force = ws.Q[model.first_row[joint] : model.first_row[joint + 1], 6 * body : 6 * body + 3].T
    return np.asarray(force - np.outer(axis, axis @ force))


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
    start = [problem.friction[j].offset for j in keys]
    base = solve_with_modes(problem, modes).force
    changes = []
    for j in keys:
        more = with_offsets(problem, {j: problem.friction[j].offset + 1.0})
        changes.append(solve_with_modes(more, modes).force - base)
    at = base if force is None else force
    found = agreeing_offsets([reactions[j] for j in keys], at, np.array(changes).T, np.array(start))
    if found is None:
        names = ", ".join(problem.friction[j].name for j in keys)
        raise NumericalFailure(f"{names}: {LOCKED}")
    return dict(zip(keys, found.tolist(), strict=True))


def agreeing_offsets(reactions: Sequence[JointReaction], force: Array, slopes: Array, start: Array) -> Array | None:
    """Return the offsets that agree with the reactions, where forces are affine in them; None if a joint locks itself.

    Parameters
    ----------
    reactions : sequence of JointReaction, length r
    force : ndarray, shape (m,)
        For the offsets `start`.
    slopes : ndarray, shape (m, r)
        Change of the forces with each offset.
    start : ndarray, shape (r,)
    """
    offsets = start
    for _ in range(_STEPS):
        F = [one.constant + one.linear @ (force + slopes @ (offsets - start)) for one in reactions]
        size = np.array([np.linalg.norm(one) for one in F])
        rates = [
            (one / length if length > 0.0 else np.zeros(len(one))) @ reaction.linear @ slopes
            for reaction, one, length in zip(reactions, F, size, strict=True)
        ]
        system = np.eye(len(reactions)) - np.array(rates)
        if np.linalg.det(system) <= 0.0:
            return None
        step = np.linalg.solve(system, size - offsets)
        offsets = np.maximum(offsets + step, 0.0)
        if np.max(np.abs(step)) <= 0.1 * _SOLVED * max(float(np.max(offsets)), np.finfo(float).tiny):
            break
    return offsets
