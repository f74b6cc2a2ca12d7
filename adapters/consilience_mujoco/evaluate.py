"""Accelerations, reactions, energies and mass properties of a compiled model at the state of its data."""

from __future__ import annotations

import mujoco
import numpy as np

from consilience.engine import ModelAnswer, numerical_rank, solve_constrained
from consilience.mechanism import GROUND, Array, Mechanism, State, cross, reaction_in_F, spring_damper_law
from consilience_mujoco.actuators import load_name, load_wrench
from consilience_mujoco.callback import first_rows
from consilience_mujoco.messages import EngineWarningError
from consilience_mujoco.translate import Translation

_SOLVED = 1e-6
"""Largest relative residual of a solution. Converged solutions are below 1e-9, failed ones of order one; in between
reactions lose digits, but not the motion."""

_ROUNDING = 1e-14
"""Largest force at rest, over the largest bound of dry friction."""

_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def constraint_jacobian(translation: Translation) -> Array:
    """Return the Jacobian of all rows in MuJoCo's velocities, shape (rows, nv).

    MuJoCo leaves out welds between bodies that cannot move; the buffers are longer than the rows in use.
    """
    model, data = translation.model, translation.data
    rows, nv = data.nefc, model.nv
    if not mujoco.mj_isSparse(model):
        return np.array(data.efc_J[: rows * nv]).reshape(rows, nv)
    J = np.zeros((rows, nv))
    for row, start, count in zip(J, data.efc_J_rowadr[:rows], data.efc_J_rownnz[:rows], strict=True):
        row[data.efc_J_colind[start : start + count]] = data.efc_J[start : start + count]
    return J


def constraint_rank(translation: Translation) -> tuple[int, int]:
    """Return the rank and the number of rows of the Jacobian of the equalities."""
    J = constraint_jacobian(translation)[: translation.data.ne]
    return numerical_rank(J), len(J)


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the mass matrix of evaluated data, shape (nv, nv)."""
    M = np.zeros((model.nv, model.nv))
    if hasattr(data, "qM"):  # before MuJoCo 4
        mujoco.mj_fullM(model, M, data.qM)
    else:
        mujoco.mj_fullM(model, data, M)
    return M


def solve_by_harness(translation: Translation) -> None:
    """Replace accelerations and constraint forces of the data by the harness's solution of MuJoCo's equations."""
    model, data = translation.model, translation.data
    M = mass_matrix(model, data)
    J = constraint_jacobian(translation)
    # without stiffness and damping of the welds the reference acceleration is -J' v
    acceleration, force = solve_constrained(M, np.array(data.qfrc_smooth), J, np.array(data.efc_aref))
    data.qacc[:] = acceleration
    data.efc_force[:] = force


def check_solved(translation: Translation) -> None:
    """Refuse accelerations and constraint forces that do not satisfy ``M a = f + J^T lam``; none where all is at rest.

    MuJoCo's solvers do not report that they ran out of iterations, or lost all digits. Where dry friction holds springs
    at rest, which pull by rounding, they stop at once, and nothing moves.

    Raises
    ------
    EngineWarningError
        The relative residual is too large.
    """
    model, data = translation.model, translation.data
    inertial = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, inertial, data.qacc)
    constraint = constraint_jacobian(translation).T @ data.efc_force
    scale = max(np.max(np.abs(f), initial=0.0) for f in (inertial, constraint, data.qfrc_smooth))
    residual = np.max(np.abs(inertial - data.qfrc_smooth - constraint), initial=0.0)
    at_rest = max(np.max(np.abs(f), initial=0.0) for f in (inertial, data.qfrc_smooth))
    if at_rest <= _ROUNDING * np.max(data.efc_frictionloss, initial=0.0):
        return
    if residual > _SOLVED * scale:
        raise EngineWarningError(f"the constraint solver stopped at a relative residual of {residual / scale:.1e}")


def evaluate_bodies(translation: Translation) -> None:
    """Compute body accelerations and joint wrenches from `qacc` and `efc_force`.

    `mj_rnePostConstraint` counts forces of welds and tendons as external forces, but not those of actuators on sites:
    loads are given to it as applied wrenches. So are the constraint forces on guided bodies, which MuJoCo's function
    would take for forces along the tendons of which the rows are used.
    """
    model, data = translation.model, translation.data
    multipliers = np.array(data.efc_force)
    for load in translation.mechanism.loads:
        if load.body != GROUND:
            site, factor = data.site(load_name(load)), float(data.actuator(load_name(load)).force[0])
            wrench = factor * load_wrench(load).reshape(2, 3)
            force, torque = wrench @ site.xmat.reshape(3, 3).T if load.frame == "body" else wrench
            _apply(translation, model.site(load_name(load)).bodyid[0], force, torque, site.xpos)
    for guide in translation.rows.guides:
        rows = first_rows(data, np.array(guide.equalities))
        point, directions, _, _ = guide.place(model, data)
        _apply(translation, guide.body, multipliers[rows] @ directions, np.zeros(3), point)
        data.efc_force[rows] = 0.0
    mujoco.mj_rnePostConstraint(model, data)
    data.xfrc_applied[:] = 0.0
    data.efc_force[:] = multipliers


def _apply(translation: Translation, body: int, force: Array, torque: Array, point: Array) -> None:
    """Add a wrench about a point to the applied wrench of a body, which is about its centre of mass.

    Parameters
    ----------
    translation : Translation
    body : int
    force, torque : ndarray, shape (3,), N and N m
        In world axes.
    point : ndarray, shape (3,), m
        In world axes.
    """
    data = translation.data
    data.xfrc_applied[body, :3] += force
    data.xfrc_applied[body, 3:] += torque + cross(point - data.xipos[body], force)


def accelerations(translation: Translation) -> tuple[Array, Array]:
    """Return a_WB_W and alpha_WB_W, each shape (n_b, 3): MuJoCo's proper accelerations plus gravity."""
    t = translation
    both = np.zeros((len(t.body_site), 6))
    for row, site in zip(both, t.body_site, strict=True):
        mujoco.mj_objectAcceleration(t.model, t.data, mujoco.mjtObj.mjOBJ_SITE, site, row, 0)
    return both[:, 3:] + t.mechanism.gravity, both[:, :3]


def element_efforts(translation: Translation) -> Array:
    """Return the efforts of all elements in joint coordinates, in MuJoCo's velocities, shape (nv,)."""
    model, data, rows = translation.model, translation.data, translation.rows.joints
    efforts = np.zeros(model.nv)
    for joint in range(model.njnt):
        if model.jnt_type[joint] in _SCALAR:
            dof, at = model.jnt_dofadr[joint], model.jnt_qposadr[joint]
            deflection = data.qpos[at] - model.qpos_spring[at]
            spring = model.jnt_stiffness[joint], *model.jnt_stiffnesspoly[joint]
            damper = model.dof_damping[dof], *model.dof_dampingpoly[dof]
            efforts[dof] = spring_damper_law(deflection, data.qvel[dof], spring, damper)[0]
    for actuator in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT):
        dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
        efforts[dof] += model.actuator_gear[actuator, 0] * data.actuator_force[actuator]
    held = list(range(data.ne, data.ne + data.nf + data.nl))  # dry friction and stops
    if rows:
        held += first_rows(data, np.array([row.equality for row in rows])).tolist()
    if held:
        efforts += data.efc_force[held] @ constraint_jacobian(translation)[held]
    return efforts


def _without(
    translation: Translation, chain: list[int], efforts: Array, force: Array, torque: Array, point: Array
) -> None:
    """Subtract the efforts in the joints of a chain from a wrench about a point, in place.

    Parameters
    ----------
    translation : Translation
    chain : list of int
        MuJoCo joints.
    efforts : ndarray, shape (nv,)
    force, torque : ndarray, shape (3,), N and N m
        Wrench in world axes, which is changed.
    point : ndarray, shape (3,), m
        In world axes.
    """
    model, data = translation.model, translation.data
    for joint in chain:
        if model.jnt_type[joint] in _SCALAR:
            effort = efforts[model.jnt_dofadr[joint]] * data.xaxis[joint]
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                torque -= effort
            else:
                force -= effort
                torque -= cross(data.xanchor[joint] - point, effort)


def reactions(mechanism: Mechanism, translation: Translation, state: State) -> tuple[Array, Array]:
    """Return force_F and torque_F of all joints, each shape (n_j, 3).

    `cfrc_int` is the torque, then the force, of the parent on the body in world axes, about the centre of mass of the
    whole tree of the body. Efforts of elements in the joint's coordinates are subtracted; the effort of the thread of a
    screw is a part of the reaction. Axes are those of the given mechanism, whose rods may be turned in the translation.
    """
    t = translation
    both = np.zeros((len(mechanism.joints), 2, 3))
    efforts = element_efforts(t)
    for k, joint in enumerate(mechanism.joints):
        end = t.tree.reaction_link(k)
        body = t.link_body[end]
        torque, force = t.data.cfrc_int[body].reshape(2, 3).copy()
        point = t.data.subtree_com[t.model.body_rootid[body]]
        chain = [t.link_joint[i] for i, link in enumerate(t.tree.links) if link.joint == k and t.link_joint[i] >= 0]
        _without(t, chain, efforts, force, torque, point)
        both[k] = reaction_in_F(mechanism, state, joint, force, torque, point, t.tree.links[end].reversed)
    return both[:, 0], both[:, 1]


def energies(translation: Translation) -> tuple[float, float]:
    """Return kinetic and potential energy in J."""
    t = translation
    mujoco.mj_energyPos(t.model, t.data)
    mujoco.mj_energyVel(t.model, t.data)
    potential, kinetic = t.data.energy
    return float(kinetic), float(potential) + t.energy_offset


def model_answer(translation: Translation) -> ModelAnswer:
    """Return mass properties of the compiled model, and the freedom by the rank of MuJoCo's constraint Jacobian."""
    model, data = translation.model, translation.data
    masses, com = model.body_mass, np.array(data.subtree_com[0])
    R, c = data.ximat.reshape(-1, 3, 3), data.xipos - data.subtree_com[0]
    own = np.einsum("bij,bj,bkj->ik", R, model.body_inertia, R)
    shifted = np.einsum("b,bij->ij", masses, np.eye(3) * np.sum(c * c, 1)[:, None, None] - c[:, :, None] * c[:, None])
    rank, _ = constraint_rank(translation)
    return ModelAnswer(mass=float(masses.sum()), com=com, inertia=own + shifted, freedom=int(model.nv) - rank)
