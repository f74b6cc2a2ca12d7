"""Observables of a state by Pinocchio: poses and twists of bodies, mass properties, energies, freedom."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from consilience.engine import numerical_rank
from consilience.mechanism import Array
from consilience_pinocchio.dynamics import all_rows
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.translate import WORLD_AXES, Translation, as_matrix


def poses(translation: Translation) -> tuple[Array, Array, Array, Array]:
    """Return poses and velocities of the bodies from Pinocchio's current placements and velocities.

    Returns
    -------
    p_WB, v_WB_W, w_WB_W : ndarray, shape (n_b, 3)
    quat_WB : ndarray, shape (n_b, 4)
        Second of the four; scalar first.
    """
    model, data = translation.model, translation.data
    n = len(translation.mechanism.bodies)
    p, v, w = np.zeros((3, n, 3))
    quat = np.zeros((n, 4))
    for b in range(n):
        seat = translation.body_seat(b)
        placement = data.oMi[seat.joint] * seat.placement
        xyzw = pin.Quaternion(placement.rotation).coeffs()
        p[b], quat[b] = placement.translation, np.roll(xyzw / np.linalg.norm(xyzw), 1)
        twist = pin.getFrameVelocity(model, data, seat.joint, seat.placement, WORLD_AXES)
        v[b], w[b] = twist.linear, twist.angular
    return p, quat, v, w


def accelerations(translation: Translation) -> tuple[Array, Array]:
    """Return classical accelerations of body origins and angular accelerations, world axes, each shape (n_b, 3).

    Pinocchio's `data` must hold the accelerations (`pinocchio.forwardKinematics` with a).
    """
    model, data = translation.model, translation.data
    seats = [translation.body_seat(b) for b in range(len(translation.mechanism.bodies))]
    rows = [pin.getFrameClassicalAcceleration(model, data, s.joint, s.placement, WORLD_AXES) for s in seats]
    return np.array([row.linear for row in rows]), np.array([row.angular for row in rows])


def composite_inertia(translation: Translation, q: Array) -> Any:
    """Return the `pinocchio.Inertia` of all bodies in the world frame.

    Pinocchio's own sums leave out bodies welded to the ground.
    """
    model, data = translation.model, translation.data
    pin.forwardKinematics(model, data, q)
    total = pin.Inertia.Zero()
    for placement, inertia in zip(data.oMi, model.inertias, strict=True):
        total = total + placement.act(inertia)
    return total


def energies(translation: Translation, q: Array, v: Array) -> tuple[float, float]:
    """Return the kinetic energy, and the potential energy of gravity (zero at the world origin), in J."""
    model, data = translation.model, translation.data
    kinetic = pin.computeKineticEnergy(model, data, q, v)
    on_ground = model.inertias[0]  # computePotentialEnergy leaves out bodies welded to the universe
    constant = -on_ground.mass * float(model.gravity.linear @ on_ground.lever)
    return float(kinetic), float(pin.computePotentialEnergy(model, data, q)) + constant


def freedom(translation: Translation, elements: Elements, q: Array, v: Array) -> int:
    """Return nv less the rank of Pinocchio's constraint Jacobian, or of all rows where elements have rows."""
    model, data = translation.model, translation.data
    if model.nv == 0 or not (translation.welds or elements.rows.count):
        return int(model.nv)
    if elements.rows.count:
        J, _ = all_rows(translation, elements, q, v, 0.0)
    else:
        pin.computeJointJacobians(model, data, q)
        held = translation.constraints, translation.constraint_data
        J = as_matrix(pin.getConstraintsJacobian(model, data, *held), model)
    return int(model.nv) - numerical_rank(J)
