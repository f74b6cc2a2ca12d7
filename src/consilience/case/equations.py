"""Accelerations and reactions at a sample of a motion, by Newton-Euler equations of all bodies in plain NumPy.

``M a = f + Q^T lam``, ``Q a = gamma``, in accelerations of the origins of the bodies [MASS]. Angles of joints are
counted over full turns along the motion, so that springs, controls and couplings have the coordinate that they have in
the motion. Integrals of controllers are zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.engine import TrajectoryAnswer, solve_constrained
from consilience.mechanism import (
    AXIS_COORDINATES,
    JOINT_KINDS,
    Array,
    Function,
    Joint,
    Mechanism,
    applied_wrenches,
    centres_of_mass,
    constraint_gamma,
    constraint_jacobian,
    cross,
    joint_coordinates,
    joint_rates,
    mass_matrix,
    reaction_map,
    relative_motion,
    with_full_turns,
    world_inertias,
)

_TURN = 2.0 * np.pi


def unwrapped(mechanism: Mechanism, motion: TrajectoryAnswer, joint: Joint, coordinate: str, n: int) -> float:
    """Return a joint coordinate at sample n; an angle is continuous along the motion, from (-pi, pi] at its start.

    Parameters
    ----------
    mechanism : Mechanism
    motion : TrajectoryAnswer
        With n + 1 samples or more.
    joint : Joint
    coordinate : str
        Name of a coordinate of the joint.
    n : int

    Returns
    -------
    float, m or rad
    """
    if not coordinate.startswith("angle") or joint.pitch:
        return float(joint_coordinates(joint, relative_motion(mechanism, motion.state(n), joint))[coordinate])
    samples = [relative_motion(mechanism, motion.state(k), joint) for k in range(n + 1)]
    angle, rate = (
        np.array([told(joint, one)[coordinate] for one in samples]) for told in (joint_coordinates, joint_rates)
    )
    return float(with_full_turns(angle, rate, motion.time[: n + 1])[-1])


def later_equations(mechanism: Mechanism, motion: TrajectoryAnswer, n: int) -> dict[str, Array]:
    """Return ``a_WB_W, alpha_WB_W`` of all bodies, ``force_F, torque_F`` of all joints at sample n of a motion.

    Reactions are those of least norm where equilibrium leaves them open.
    """
    state, t = motion.state(n), float(motion.time[n])
    named = {spring.joint for spring in mechanism.joint_springs} | {drive.joint for drive in mechanism.drives}
    named |= {control.joint for control in mechanism.controls}
    named |= {name for coupling in mechanism.couplings for name in (coupling.joint, coupling.driver_joint)}
    angles = {
        joint.name: unwrapped(mechanism, motion, joint, "angle", n)
        for joint in mechanism.joints
        if joint.name in named and "angle" in AXIS_COORDINATES.get(joint.kind, ())
    }
    f = applied_wrenches(_counted(mechanism, motion, n, angles), state, t).total
    arms = centres_of_mass(mechanism, state)[0] - state.p_WB
    for i, (body, inertia) in enumerate(zip(mechanism.bodies, world_inertias(mechanism, state), strict=True)):
        w, c = state.w_WB_W[i], arms[i]
        force = body.mass * cross(w, cross(w, c))
        f[i, :3] -= force
        f[i, 3:] -= cross(w, inertia @ w) + cross(c, force)
    Q = constraint_jacobian(mechanism, state, t=t, angles=angles)
    gamma = constraint_gamma(mechanism, state, t=t, angles=angles)
    a, multipliers = solve_constrained(mass_matrix(mechanism, state), f.ravel(), Q, gamma)
    wrenches, row = [], 0
    for joint in mechanism.joints:
        held = len(JOINT_KINDS[joint.kind].rows)
        wrenches.append(reaction_map(mechanism, state, joint) @ multipliers[row : row + held])
        row += held
    a, both = a.reshape(-1, 6), np.array(wrenches)
    return {"a_WB_W": a[:, :3], "alpha_WB_W": a[:, 3:], "force_F": both[:, :3], "torque_F": both[:, 3:]}


def _counted(mechanism: Mechanism, motion: TrajectoryAnswer, n: int, angles: dict[str, float]) -> Mechanism:
    """Mechanism whose springs and controls act on angles within half a turn as they do on the counted ones."""
    turns = {}
    for name, angle in angles.items():
        joint = mechanism.joints[mechanism.joint_index[name]]
        within = float(joint_coordinates(joint, relative_motion(mechanism, motion.state(n), joint))["angle"])
        turns[name, "angle"] = _TURN * round((angle - within) / _TURN)
    springs = (replace(s, rest=s.rest - turns.get((s.joint, s.coordinate), 0.0)) for s in mechanism.joint_springs)
    controls = (
        replace(c, target=_lowered(c.target, turns.get((c.joint, c.coordinate), 0.0))) for c in mechanism.controls
    )
    return replace(mechanism, joint_springs=tuple(springs), controls=tuple(controls))


def _lowered(law: Function, by: float) -> Function:
    powers = np.array(law.polynomial if len(law.polynomial) else [0.0])
    powers[0] -= by
    return replace(law, polynomial=powers)
