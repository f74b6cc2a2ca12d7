"""Answers at given states: mass properties, accelerations, reactions and energies.

Accelerations of rigid bodies are solved by the harness from Exudyn's terms. Accelerations of kinematic trees, which
have no constraints, are the initial accelerations of Exudyn's own solver; kinematic trees have no reactions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from consilience.engine import InstantAnswer, ModelAnswer, nonlinear_part, numerical_rank, over_parts, solve_constrained
from consilience.mechanism import (
    GROUND,
    Array,
    Frame,
    Joint,
    Mechanism,
    State,
    euler_parameter_matrix,
    joint_spring_motion,
    reaction_in_F,
    rotation_from_quaternion,
)
from consilience_exudyn.contact_instant import contact_accelerations
from consilience_exudyn.contacts import is_unilateral
from consilience_exudyn.kinematic_tree import ACCELERATIONS, KinematicTree, build_tree, set_initial
from consilience_exudyn.library import QUIET, LoadPotentialEnergy, SystemEnergy, exu, simulation_settings
from consilience_exudyn.maximal import Maximal
from consilience_exudyn.terms import Terms


def model_answer(terms: Terms, state: State) -> ModelAnswer:
    """Compute mass properties from Exudyn's mass matrix, and the freedom from its constraint Jacobian.

    The block of a body about its origin is ``[[m 1, -m ~c], [m ~c, I + m (c.c 1 - c c^T)]]`` in world axes.
    """
    M = terms.mass_matrix(state)
    freedom = len(M) - numerical_rank(terms.constraint_jacobian(state))
    masses, centres, about_origin = [], [], []
    for i, body in enumerate(terms.model.bodies):
        block = M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6]
        moment = block[3:, :3]
        arm = np.array([moment[2, 1], moment[0, 2], moment[1, 0]]) / block[0, 0]
        origin = np.array(terms.model.system.GetObjectOutputBody(body, exu.OutputVariableType.Position))
        masses.append(block[0, 0])
        centres.append(origin + arm)
        about_origin.append(block[3:, 3:] - _steiner(block[0, 0], arm))
    mass = float(np.sum(masses))
    com = np.array(masses) @ np.array(centres) / mass
    shifted = [I + _steiner(m, c - com) for I, m, c in zip(about_origin, masses, centres, strict=True)]
    return ModelAnswer(mass=mass, com=com, inertia=np.sum(shifted, axis=0), freedom=freedom)


def _steiner(mass: float, c: Array) -> Array:
    return np.asarray(mass * ((c @ c) * np.eye(3) - np.outer(c, c)))


def instant_answer(terms: Terms, states: Sequence[State]) -> InstantAnswer:
    """Compute accelerations from Exudyn's terms by the harness's solver; reactions and energies are Exudyn's."""
    energy = SystemEnergy(terms.model.system)
    accelerations, reactions, energies, contact_forces = [], [], [], []
    for state in states:
        equations = terms.equations(state)
        if is_unilateral(terms.model.mechanism):
            a, mu, forces = contact_accelerations(terms, state, equations)
            contact_forces.append(forces)
        else:
            a, mu = solve_constrained(equations.M, equations.f, equations.J, equations.gamma)
        terms.set_multipliers(mu)
        accelerations.append(a.reshape(-1, 6))
        reactions.append([_reaction(terms.model, state, k) for k in range(len(terms.model.joints))])
        energies.append(_energies(terms.model, energy, state))
    a = np.array(accelerations)
    wrenches: Array = np.array(reactions).reshape(len(states), -1, 2, 3)
    kinetic, potential = np.array(energies).T
    return InstantAnswer(
        a_WB_W=a[:, :, :3],
        alpha_WB_W=a[:, :, 3:],
        force_F=wrenches[:, :, 0],
        torque_F=wrenches[:, :, 1],
        kinetic=kinetic,
        potential=potential,
        contact_force=_of_contacts(terms.model.mechanism, contact_forces),
    )


def _of_contacts(mechanism: Mechanism, forces: Sequence[Array]) -> Array | None:
    """Force of each contact at each state, from those of elementary contacts; None without contacts."""
    if not mechanism.contacts:
        return None
    return over_parts(mechanism, np.array(forces), lambda parts: np.asarray(parts.sum(axis=1)))


def joined(answers: Sequence[InstantAnswer]) -> InstantAnswer:
    """Return the answers at several states as one."""
    names = [one.name for one in fields(InstantAnswer)]
    return InstantAnswer(**{name: np.concatenate([getattr(answer, name) for answer in answers]) for name in names})


def _reaction(model: Maximal, state: State, k: int) -> tuple[Array, Array]:
    """Wrench of joint k in the harness's convention, from Exudyn's ReactionForces at the current multipliers.

    ReactionForces are ``Cq^T lam`` in the coordinates of the joined bodies, on the left-hand side of the equations of
    motion: the joint exerts their negative. A torque gives the generalised forces ``Q = 2 G^T tau_B`` along the Euler
    parameters, so ``tau_B = 1/2 G Q``.
    """
    joint: Joint = model.mechanism.joints[k]
    if not model.joints[k]:
        return np.zeros(3), np.zeros(3)
    on_predecessor = joint.successor == GROUND
    i = model.mechanism.body_index[joint.predecessor if on_predecessor else joint.successor]
    data = model.system.systemData
    generalised = np.zeros(7 * len(model.bodies))
    for index in model.joints[k]:
        forces = model.system.ComputeItem(index, exu.ComputeItemType.ReactionForces)
        np.add.at(generalised, data.GetObjectLTGODE2(index), -np.array(forces))
    own = generalised[data.GetObjectLTGODE2(model.bodies[i])]
    quat = state.quat_WB[i]
    torque = rotation_from_quaternion(quat) @ (0.5 * euler_parameter_matrix(quat) @ own[3:])
    return reaction_in_F(model.mechanism, state, joint, own[:3], torque, state.p_WB[i], on_predecessor)


def _energies(model: Maximal, energy: Any, state: State) -> tuple[float, float]:
    """Kinetic energy, and potential energy of gravity and springs, of the current configuration, that of a state.

    Exudyn's potential of gravity is zero in the reference configuration, where every body is at the world's origin. The
    mechanism's loads are not part of the harness's potential energy. User functions have no energy.
    """
    kinetic, springs, _, _ = energy.ComputeSystemEnergies()
    mechanism = model.mechanism
    weight = sum(LoadPotentialEnergy(model.system, load) for load in model.gravity)
    reference = -sum(body.mass * float(mechanism.gravity @ body.com) for body in mechanism.bodies)
    return kinetic, springs + weight + reference + _nonlinear_energy(mechanism, state)


def _nonlinear_energy(mechanism: Mechanism, state: State) -> float:
    """Potential energy of joint springs without their linear parts, J."""
    return sum(
        float(nonlinear_part(s).potential(joint_spring_motion(mechanism, state, s.joint, s.coordinate)[0]))
        for s in mechanism.joint_springs
        if not s.is_linear
    )


def tree_instant_answer(mechanism: Mechanism, states: Sequence[State]) -> InstantAnswer:
    """Compute energies of a kinematic tree, and its accelerations as the initial accelerations of Exudyn's solver."""
    model = build_tree(mechanism, states[0], ACCELERATIONS)
    solver, settings = exu.MainSolverImplicitSecondOrder(), simulation_settings(QUIET)
    energy, offset = SystemEnergy(model.system), _potential_where_it_is_zero(model)
    accelerations, energies = [], []
    for state in states:
        set_initial(model, state)
        solver.InitializeSolver(model.system, settings)
        accelerations.append([[model.system.GetSensorValues(s) for s in pair] for pair in model.sensors])
        kinetic, potential, _, _ = energy.ComputeSystemEnergies()
        energies.append((kinetic, potential + offset + _nonlinear_energy(mechanism, state)))
    a = np.array(accelerations)
    kinetic, potential = np.array(energies).T
    return InstantAnswer(a[:, :, 0], a[:, :, 1], None, None, kinetic, potential)


def _potential_where_it_is_zero(model: KinematicTree) -> float:
    """Potential energy in the harness's convention where all joint coordinates are zero, as is Exudyn's energy.

    The energy of a joint spring is ``k q^2 / 2 - k q0 q`` in Exudyn, ``k (q - q0)^2 / 2`` in the harness.
    """
    poses: list[Frame] = []
    for link in model.tree.links:
        p, R = (poses[link.parent].p, poses[link.parent].R) if link.parent >= 0 else (np.zeros(3), np.eye(3))
        poses.append(Frame(p + R @ link.placement.p, R @ link.placement.R))
    pairs = zip(model.tree.links, poses, strict=True)
    weight = -sum(link.mass * float(model.mechanism.gravity @ (at.p + at.R @ link.com)) for link, at in pairs)
    return weight + sum(0.5 * s.stiffness * s.rest**2 for s in model.mechanism.joint_springs)
