"""Joint reactions by Pinocchio's inverse dynamics, with a check of the balance of joint efforts."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from consilience.engine import Profile
from consilience.mechanism import Array, Mechanism, State, reaction_in_F
from consilience_pinocchio.dynamics import Solution
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.translate import Translation, link_inertia

BALANCE_TOLERANCE = 1e-8
"""Largest joint effort that inverse dynamics may leave unbalanced, relative to the largest wrench. Rounding stays three
digits below this tolerance, a wrong constraint force lies far above."""


def reactions(
    mechanism: Mechanism,
    translation: Translation,
    elements: Elements,
    solution: Solution,
    state: State,
    profile: Profile = Profile.MATCHED,
) -> tuple[Array, Array]:
    """Compute the reactions of all joints by inverse dynamics: on the successor, at the origin of M, in axes of F.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with the joint frames of the answer; start frames of rods may be turned in `translation`.
    translation : Translation
    elements : Elements
    solution : Solution
    state : State
    profile : Profile
        The balance is not checked for the profile ``default``, nor in trees, which have no constraint forces: what the
        accelerations there lose to rounding is seen in the accelerations.

    Returns
    -------
    force_F, torque_F : ndarray, shape (n_j, 3), N and N m

    Raises
    ------
    ArithmeticError
        The joint efforts of inverse dynamics are not those of the elements: the constraint forces are wrong.
    """
    tree, data = translation.tree, translation.data
    defect, largest = _inverse_dynamics(translation, solution), _largest_wrench(translation)
    constrained = bool(translation.welds) or elements.rows.count > 0
    if constrained and profile is Profile.MATCHED and not defect <= BALANCE_TOLERANCE * largest:
        raise ArithmeticError(f"joint efforts of inverse dynamics off by {defect:.1e}, largest wrench {largest:.1e}")
    force_F, torque_F = np.zeros((2, len(mechanism.joints), 3))
    for k, joint in enumerate(mechanism.joints):
        index = tree.reaction_link(k)
        link, seat = tree.links[index], translation.seats[index]
        if link.elementary == "W":
            wrench = _welded_wrench(translation, solution, index)
        else:
            wrench = data.f[seat.joint].vector - elements.efforts.wrench(k, solution.tau)
        placement = data.oMi[seat.joint]
        R = placement.rotation
        force_F[k], torque_F[k] = reaction_in_F(
            mechanism, state, joint, R @ wrench[:3], R @ wrench[3:], placement.translation, link.reversed
        )
    return force_F, torque_F


def _inverse_dynamics(translation: Translation, solution: Solution) -> float:
    """Compute the joint wrenches ``data.f``, and return the largest joint effort that stays unbalanced."""
    model, data = translation.model, translation.data
    per_joint = np.zeros((model.njoints, 6))
    for seat, wrench in zip(translation.seats, solution.wrenches[:-1], strict=True):
        per_joint[seat.joint] += wrench
    external = pin.StdVec_Force()
    for wrench in per_joint:
        external.append(pin.Force(wrench))
    pin.forwardKinematics(model, data, solution.q, solution.v, solution.a)
    tau = pin.rnea(model, data, solution.q, solution.v, solution.a, external)
    return float(np.max(np.abs(tau - solution.tau), initial=0.0))


def _largest_wrench(translation: Translation) -> float:
    """Largest component of joint wrenches, inertial wrenches and weights; joint wrenches of free bodies are zero."""
    model, data = translation.model, translation.data
    moving = list(zip(model.inertias, data.v, data.a_gf, strict=True))
    wrenches = [f.vector for f in data.f]
    wrenches += [(inertia * a).vector for inertia, _, a in moving] + [
        inertia.vxiv(v).vector for inertia, v, _ in moving
    ]
    wrenches += [inertia.mass * model.gravity.linear for inertia, _, _ in moving]
    return max(float(np.max(np.abs(w))) for w in wrenches)


def _welded_wrench(translation: Translation, solution: Solution, index: int) -> Array:
    """Wrench on a welded link through its weld, shape (6,), in the frame of the joint that carries it, by Newton-Euler.

    Pinocchio merges a welded link into its parent and has no wrench between them. The wrench is the inertial wrench of
    the link and of all links welded to it, less applied wrenches, plus the wrenches on links behind further joints.
    """
    data, tree = translation.data, translation.tree
    joint = translation.seats[index].joint
    v, a = data.v[joint], data.a_gf[joint]  # a_gf: spatial acceleration less gravity
    cluster = {index}
    total = np.zeros(6)
    for n, (link, seat) in enumerate(zip(tree.links, translation.seats, strict=True)):
        if n != index and link.parent not in cluster:
            continue
        if n != index and link.elementary != "W":
            total += data.liMi[seat.joint].act(data.f[seat.joint]).vector
            continue
        cluster.add(n)
        inertia = seat.placement.act(link_inertia(link))
        total += (inertia * a).vector + inertia.vxiv(v).vector - solution.wrenches[n]
    return total
