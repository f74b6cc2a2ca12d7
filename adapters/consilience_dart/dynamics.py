"""Accelerations and reactions at the present state of the skeleton.

Trees are solved by DART's articulated-body algorithm, with drives as acceleration actuators. Loops and other
constraints are solved from DART's mass matrix, inverse dynamics and Jacobians by the harness's solver of the
saddle-point system.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import numerical_rank, solve_constrained
from consilience.mechanism import Array, Joint, Mechanism, State, reaction_in_F
from consilience_dart.constraints import push, rows
from consilience_dart.drives import command_accelerations
from consilience_dart.loads import Forces
from consilience_dart.translation import Model


def forward_dynamics(model: Model, forces: Forces, t: float = 0.0) -> Array:
    """Compute generalised accelerations by DART's articulated-body algorithm; they stay in the skeleton.

    The body forces that belong to them stay there too.
    """
    forces.apply(t)
    command_accelerations(model, t)
    model.skeleton.computeForwardDynamics()
    return np.asarray(model.skeleton.getAccelerations())


def constraint_rank(model: Model) -> int:
    """Return the rank of all constraint rows at the present state, by DART's own Jacobians."""
    model.skeleton.setAccelerations(np.zeros(model.skeleton.getNumDofs()))
    return numerical_rank(rows(model, 0.0)[0])


def constrained_terms(model: Model, forces: Forces, t: float) -> tuple[Array, Array, Array, Array]:
    """Return M, f, J and gamma of ``M a = f + J^T lam``, ``J a = gamma`` by DART; coefficients of contacts are ours."""
    skeleton = model.skeleton
    f = forces.apply(t)
    skeleton.setAccelerations(np.zeros(skeleton.getNumDofs()))
    skeleton.computeInverseDynamics(True, True, True)  # with external, damping and spring forces
    f = f - np.asarray(skeleton.getForces())
    return (np.asarray(skeleton.getMassMatrix()), f, *rows(model, t))


def constrained_dynamics(model: Model, forces: Forces, t: float = 0.0) -> tuple[Array, Array]:
    """Solve DART's terms for generalised accelerations and multipliers by the harness's solver."""
    return solve_constrained(*constrained_terms(model, forces, t))


def impose(model: Model, a: Array, multipliers: Array) -> None:
    """Set accelerations and constraint wrenches, and let DART's inverse dynamics compute the body forces."""
    push(model, multipliers)
    model.skeleton.setAccelerations(a)
    model.skeleton.computeInverseDynamics(True, True, True)


def body_accelerations(model: Model) -> tuple[Array, Array]:
    """Return ``a_WB_W, alpha_WB_W`` of all bodies at the skeleton's accelerations, each shape (n_b, 3)."""
    carried = [(model.nodes[i], model.tree.links[i].body_frame.p) for i in model.carriers]
    return (
        np.array([node.getLinearAcceleration(origin) for node, origin in carried]),
        np.array([node.getAngularAcceleration() for node, _ in carried]),
    )


def _without_efforts(joint: Joint, force: Array, torque: Array) -> tuple[Array, Array]:
    """Remove the part that does work in the joint's coordinates from a wrench at the joint axis, z along the axis.

    Constraint forces do no work in the coordinates of their joint. The removed part is that of springs, actuators,
    friction, control, drives and couplings; in a free joint it is rounding.
    """
    if joint.kind == "free":
        return np.zeros(3), np.zeros(3)
    force, torque = force.copy(), torque.copy()
    if joint.kind in ("prismatic", "cylindrical"):
        force[2] = 0.0
    if joint.kind in ("revolute", "cylindrical", "screw"):
        torque[2] = -joint.pitch / (2.0 * np.pi) * force[2]  # the pitch is zero but for a screw
    return force, torque


def reactions(mechanism: Mechanism, model: Model, state: State) -> tuple[Array, Array]:
    """Return ``force_F, torque_F`` of all joints from DART's body forces, each shape (n_j, 3).

    A body force is the torque, then the force, on the node through its parent joint, about the origin and in the axes
    of the node. Efforts in the joint are included. Axes are those of the given mechanism, whose rods may be turned in
    the model.
    """
    forces, torques = [], []
    for k, joint in enumerate(mechanism.joints):
        i = model.tree.reaction_link(k)
        wrench = np.asarray(model.nodes[i].getBodyForce())
        force, torque = _without_efforts(joint, wrench[3:], wrench[:3])
        T = model.nodes[i].getWorldTransform()
        R = T.rotation()
        force, torque = reaction_in_F(
            mechanism, state, joint, R @ force, R @ torque, T.translation(), on_predecessor=model.tree.links[i].reversed
        )
        forces.append(force)
        torques.append(torque)
    return np.array(forces), np.array(torques)
