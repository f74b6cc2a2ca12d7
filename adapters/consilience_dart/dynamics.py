"""Accelerations and reactions at a state that was sent to the skeleton.

Trees by DART's articulated-body algorithm; loops by DART's mass matrix, inverse dynamics and Jacobians with the
harness's solution of the saddle-point system.
"""

from __future__ import annotations

import numpy as np

from consilience.harness import solve_constrained
from consilience.kinematics import RANK_TOLERANCE, reaction_in_F
from consilience.mechanism import State
from consilience.spatial import Array
from consilience_dart.loads import Apply
from consilience_dart.translation import Model, sprung


def apply_forces(model: Model, appliers: list[Apply]) -> None:
    """Replace the external forces by those of the springs and loads at the present state."""
    model.skeleton.clearExternalForces()
    for apply in appliers:
        apply()


def forward_dynamics(model: Model, appliers: list[Apply]) -> Array:
    """Generalised accelerations by DART's articulated-body algorithm; the skeleton keeps them and its body forces."""
    apply_forces(model, appliers)
    model.skeleton.computeForwardDynamics()
    return np.asarray(model.skeleton.getAccelerations())


def _weld_terms(model: Model) -> tuple[Array, Array]:
    """Jacobian (6 per weld, n) of the copy's motion relative to the original, and its bias at zero accelerations.

    Rows: angular velocity, then velocity of the body's origin, world axes. The skeleton's accelerations must be zero.
    """
    links, nodes, skeleton = model.tree.links, model.nodes, model.skeleton
    jacobian = np.zeros((6 * len(model.tree.welds), skeleton.getNumDofs()))
    bias = np.zeros(len(jacobian))
    for n, weld in enumerate(model.tree.welds):
        rows = slice(6 * n, 6 * n + 6)
        for i, sign in ((weld.copy, 1.0), (weld.original, -1.0)):
            node, origin = nodes[i], links[i].body_frame.p
            # explicit halves: DART's six-row Jacobian stacks angular over linear, in axes of its own choice
            jacobian[rows] += sign * np.vstack(
                [skeleton.getAngularJacobian(node), skeleton.getLinearJacobian(node, origin)]
            )
            bias[rows] += sign * np.concatenate([node.getAngularAcceleration(), node.getLinearAcceleration(origin)])
    return jacobian, bias


def constraint_rank(model: Model) -> int:
    """Rank of the weld rows at the present state, by DART's own Jacobians."""
    model.skeleton.setAccelerations(np.zeros(model.skeleton.getNumDofs()))
    singular = np.linalg.svd(_weld_terms(model)[0], compute_uv=False)
    return int(np.sum(singular > RANK_TOLERANCE * singular[0])) if len(singular) else 0


def constrained_dynamics(model: Model, appliers: list[Apply]) -> tuple[Array, Array]:
    """Generalised accelerations and weld multipliers from DART's terms and the harness's solve."""
    skeleton = model.skeleton
    apply_forces(model, appliers)
    skeleton.setAccelerations(np.zeros(skeleton.getNumDofs()))
    skeleton.computeInverseDynamics(True, True, True)  # with external, damping and spring forces
    f = -np.asarray(skeleton.getForces())
    J, bias = _weld_terms(model)
    return solve_constrained(np.asarray(skeleton.getMassMatrix()), f, J, -bias)


def impose(model: Model, a: Array, multipliers: Array) -> None:
    """Give the skeleton accelerations and weld wrenches, and let DART's inverse dynamics find the body forces."""
    for n, weld in enumerate(model.tree.welds):
        torque, force = multipliers[6 * n : 6 * n + 3], multipliers[6 * n + 3 : 6 * n + 6]
        for i, sign in ((weld.copy, 1.0), (weld.original, -1.0)):
            model.nodes[i].addExtForce(sign * force, model.tree.links[i].body_frame.p, False, True)
            model.nodes[i].addExtTorque(sign * torque, False)
    model.skeleton.setAccelerations(a)
    model.skeleton.computeInverseDynamics(True, True, True)


def body_accelerations(model: Model) -> tuple[Array, Array]:
    """``a_WB_W, alpha_WB_W`` of all bodies at the skeleton's accelerations, each shape (n_b, 3)."""
    carried = [(model.nodes[i], model.tree.links[i].body_frame.p) for i in model.carriers]
    return (
        np.array([node.getLinearAcceleration(origin) for node, origin in carried]),
        np.array([node.getAngularAcceleration() for node, _ in carried]),
    )


def _spring_efforts(model: Model) -> dict[int, tuple[Array, Array]]:
    """Force and torque of the joint springs along z of the last link of each sprung joint, by joint."""
    efforts: dict[int, tuple[Array, Array]] = {}
    for i in sprung(model.mechanism, model.tree):
        joint, link = model.joints[i], model.tree.links[i]
        stretch = joint.getPosition(0) - joint.getRestPosition(0)
        effort = -joint.getSpringStiffness(0) * stretch - joint.getDampingCoefficient(0) * joint.getVelocity(0)
        force, torque = efforts.setdefault(link.joint, (np.zeros(3), np.zeros(3)))
        (force if link.elementary == "P" else torque)[2] += effort
    return efforts


def reactions(model: Model, state: State) -> tuple[Array, Array]:
    """``force_F, torque_F`` of all joints from DART's body forces, each shape (n_j, 3).

    A body force is torque then force on the node through its parent joint, about the node's origin in its axes, the
    efforts of joint springs included; these are taken out again.
    """
    forces, torques = [], []
    efforts = _spring_efforts(model)
    for k, joint in enumerate(model.mechanism.joints):
        i = model.tree.reaction_link(k)
        wrench = np.asarray(model.nodes[i].getBodyForce())
        spring_force, spring_torque = efforts.get(k, (0.0, 0.0))
        T = model.nodes[i].getWorldTransform()
        R = T.rotation()
        force, torque = reaction_in_F(
            model.mechanism,
            state,
            joint,
            R @ (wrench[3:] - spring_force),
            R @ (wrench[:3] - spring_torque),
            T.translation(),
            on_predecessor=model.tree.links[i].reversed,
        )
        forces.append(force)
        torques.append(torque)
    return np.array(forces), np.array(torques)
