"""Accelerations and reactions at a state that was sent to the skeleton.

Trees by DART's articulated-body algorithm, drives as its acceleration actuators; loops and other constraints by DART's
mass matrix, inverse dynamics and Jacobians with the harness's solution of the saddle-point system.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import solve_constrained
from consilience.mechanism import RANK_TOLERANCE, Array, Joint, State, reaction_in_F
from consilience_dart.constraints import push, rows, weld_terms
from consilience_dart.drives import command_accelerations
from consilience_dart.loads import Forces
from consilience_dart.translation import Model

_weld_terms = weld_terms  # by which tests of profiles scale the velocity term


def apply_forces(model: Model, forces: Forces, t: float = 0.0) -> Array:
    """Replace the forces on the skeleton by those of the elements at its state and the time t; those of the joints."""
    return forces.apply(t)


def forward_dynamics(model: Model, forces: Forces, t: float = 0.0) -> Array:
    """Generalised accelerations by DART's articulated-body algorithm; the skeleton keeps them and its body forces."""
    apply_forces(model, forces, t)
    command_accelerations(model, t)
    model.skeleton.computeForwardDynamics()
    return np.asarray(model.skeleton.getAccelerations())


def constraint_rank(model: Model) -> int:
    """Rank of all constraint rows at the present state, by DART's own Jacobians."""
    model.skeleton.setAccelerations(np.zeros(model.skeleton.getNumDofs()))
    singular = np.linalg.svd(rows(model, 0.0)[0], compute_uv=False)
    return int(np.sum(singular > RANK_TOLERANCE * singular[0])) if len(singular) else 0


def constrained_terms(model: Model, forces: Forces, t: float) -> tuple[Array, Array, Array, Array]:
    """M, f, J and gamma of ``M a = f + J^T lam``, ``J a = gamma``, all of DART but for coefficients of contacts."""
    skeleton = model.skeleton
    f = apply_forces(model, forces, t)
    skeleton.setAccelerations(np.zeros(skeleton.getNumDofs()))
    skeleton.computeInverseDynamics(True, True, True)  # with external, damping and spring forces
    f = f - np.asarray(skeleton.getForces())
    return (np.asarray(skeleton.getMassMatrix()), f, *rows(model, t))


def constrained_dynamics(model: Model, forces: Forces, t: float = 0.0) -> tuple[Array, Array]:
    """Generalised accelerations and multipliers from DART's terms and the harness's solve."""
    return solve_constrained(*constrained_terms(model, forces, t))


def impose(model: Model, a: Array, multipliers: Array) -> None:
    """Give the skeleton accelerations and constraint wrenches, and let DART's inverse dynamics find the body forces."""
    push(model, multipliers)
    model.skeleton.setAccelerations(a)
    model.skeleton.computeInverseDynamics(True, True, True)


def body_accelerations(model: Model) -> tuple[Array, Array]:
    """``a_WB_W, alpha_WB_W`` of all bodies at the skeleton's accelerations, each shape (n_b, 3)."""
    carried = [(model.nodes[i], model.tree.links[i].body_frame.p) for i in model.carriers]
    return (
        np.array([node.getLinearAcceleration(origin) for node, origin in carried]),
        np.array([node.getAngularAcceleration() for node, _ in carried]),
    )


def _without_efforts(joint: Joint, force: Array, torque: Array) -> tuple[Array, Array]:
    """Constraint part of a wrench through a joint, in axes with z along its axis, on which the origin lies.

    Efforts act along or about the axis, and constraint forces do no work in the joint's coordinates: the part that
    would is that of springs, actuators, friction, control, drives and couplings; in a free joint it is rounding.
    """
    if joint.kind == "free":
        return np.zeros(3), np.zeros(3)
    force, torque = force.copy(), torque.copy()
    if joint.kind in ("prismatic", "cylindrical"):
        force[2] = 0.0
    if joint.kind in ("revolute", "cylindrical", "screw"):
        torque[2] = -joint.pitch / (2.0 * np.pi) * force[2]  # the pitch is zero but for a screw
    return force, torque


def reactions(model: Model, state: State) -> tuple[Array, Array]:
    """``force_F, torque_F`` of all joints from DART's body forces, each shape (n_j, 3).

    A body force is torque then force on the node through its parent joint, about the node's origin in its axes, the
    efforts in the joint included.
    """
    forces, torques = [], []
    for k, joint in enumerate(model.mechanism.joints):
        i = model.tree.reaction_link(k)
        wrench = np.asarray(model.nodes[i].getBodyForce())
        force, torque = _without_efforts(joint, wrench[3:], wrench[:3])
        T = model.nodes[i].getWorldTransform()
        R = T.rotation()
        force, torque = reaction_in_F(
            model.mechanism,
            state,
            joint,
            R @ force,
            R @ torque,
            T.translation(),
            on_predecessor=model.tree.links[i].reversed,
        )
        forces.append(force)
        torques.append(torque)
    return np.array(forces), np.array(torques)
