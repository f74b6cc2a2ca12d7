"""Compute reactions of the joints and violation of their constraints along a motion, by one method for all engines.

The Newton-Euler equations ``M a = f + Q^T lam`` and the constraints ``Q a = gamma`` are solved densely at states of
the motion. (Reactions given by the engine itself belong to the question `instant`.)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.engine import TrajectoryAnswer, solve_constrained
from consilience.errors import InvalidInput
from consilience.mechanism import (
    Angles,
    Array,
    Mechanism,
    State,
    applied_wrenches,
    centres_of_mass,
    constraint_gamma,
    constraint_jacobian,
    constraint_residual,
    count_turns,
    cross,
    determinate_reactions,
    mass_matrix,
    reaction_map,
    skew,
    world_inertias,
)

LARGEST = 12
"""Largest number of bodies for which reactions are plotted: the cost of a dense solution is cubic."""


def can_be_told(mechanism: Mechanism) -> bool:
    """Whether a state determines the reactions (`_depend_on`), and there are few bodies."""
    held = bool(mechanism.joints) and any(joint.rows for joint in mechanism.joints)
    small = len(mechanism.bodies) <= LARGEST and len(mechanism.joints) <= 2 * LARGEST
    return held and small and not _depend_on(mechanism)


def _depend_on(mechanism: Mechanism) -> list[str]:
    """Return the elements whose forces, which act on the reactions, the state alone does not determine."""
    found = [f"control '{c.name}'" for c in mechanism.controls if c.integral]
    for what, elements in (
        ("contact", mechanism.contacts),
        ("stop", mechanism.stops),
        ("dry friction", mechanism.dry_frictions),
    ):
        found += [f"{what} '{element.name}'" for element in elements]
    return found


def reactions_over_time(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> Array:
    """Return magnitudes of force and torque of every joint at samples, shape (n_samples, n_j, 2), N and N m.

    On the successor, the torque about the origin of M, of the components that equilibrium determines; nan where
    equilibrium determines none.
    """
    sure = determinate_reactions(mechanism, answer.state(int(samples[0])))
    turns = _turns(mechanism, answer, samples)
    found = [
        np.where(sure, reactions(mechanism, answer.state(k), answer.time[k], angles), 0.0)
        for k, angles in zip(samples, turns, strict=True)
    ]
    lengths = np.linalg.norm(np.array(found).reshape(len(samples), -1, 2, 3), axis=3)
    return np.where(sure.reshape(-1, 2, 3).any(axis=2), lengths, np.nan)


def reactions_over_samples(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Return force and torque of every joint on its successor at all samples, shape (n_t, n_j, 6), as `reactions`.

    Raises
    ------
    InvalidInput
        States do not determine the reactions.
    """
    more = _depend_on(mechanism)
    if more:
        what = f"they depend on more than the state: {more[0]}"
        remedy = "Ask for those of mechanisms without integral controllers, contacts, stops and dry friction."
        raise InvalidInput("reactions", what, remedy)
    turns = _turns(mechanism, answer, np.arange(len(answer.time)))
    times = enumerate(zip(answer.time, turns, strict=True))
    return np.array([reactions(mechanism, answer.state(k), t, angles) for k, (t, angles) in times])


def _turns(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> list[Angles]:
    """Return the angles of joints that drive couplings at samples, rad, with full turns counted along the motion."""
    angles: Angles = {}
    counted: list[Angles] = []
    for k in range(int(samples[-1]) + 1 if mechanism.couplings else 0):
        angles = count_turns(mechanism, answer.state(k), angles)
        counted.append(angles)
    return [counted[k] if counted else {} for k in samples]


def reactions(mechanism: Mechanism, state: State, t: float, angles: Angles | None = None) -> Array:
    """Return force and torque of every joint on its successor, about the origin of M, axes of F, shape (n_j, 6).

    `angles` are angles of joints that drive couplings, with full turns, as in `mechanism.constraint_residual`.
    """
    sums = applied_wrenches(mechanism, state, t)
    arms = centres_of_mass(mechanism, state)[0] - state.p_WB
    for i, (body, inertia) in enumerate(zip(mechanism.bodies, world_inertias(mechanism, state), strict=True)):
        w, c = state.w_WB_W[i], arms[i]
        at_origin = inertia - body.mass * skew(c) @ skew(c)
        sums.push(body.name, -body.mass * cross(w, cross(w, c)), state.p_WB[i], -cross(w, at_origin @ w))
    _, lam = solve_constrained(
        mass_matrix(mechanism, state),
        sums.total.ravel(),
        constraint_jacobian(mechanism, state, t=t, angles=angles),
        constraint_gamma(mechanism, state, t=t, angles=angles),
    )
    own = np.split(lam, np.cumsum([len(joint.rows) for joint in mechanism.joints]))
    # after the rows of the joints come those of the elements
    return np.array([reaction_map(mechanism, state, j) @ f for j, f in zip(mechanism.joints, own, strict=False)])


def drift_over_time(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> Array:
    """Return the largest violation of a constraint row of a joint at samples, shape (n_samples,), m, rad or 1."""
    jointed = replace(mechanism, drives=(), couplings=(), rollings=(), skates=())
    return np.array([np.max(np.abs(constraint_residual(jointed, answer.state(k))), initial=0.0) for k in samples])
