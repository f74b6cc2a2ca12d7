"""Whipple bicycle: the benchmark of Meijaard, Papadopoulos, Ruina & Schwab 2007; "Uncontrolled bicycle" of IFToMM.

Rear frame with the rigid rider B, front frame H, wheels R and F with sharp rims on level ground; x ahead, y to the
right, z down, the rear contact in the origin. For lean phi and steer delta, both positive to the right, upright and
straight ahead at the speed v

    M q'' + v C1 q' + (g K0 + v^2 K2) q = f,        q = (phi, delta).
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from consilience.mechanism import (
    GROUND,
    JointSpring,
    Load,
    Rolling,
    State,
    constant,
    free_directions,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)
from consilience.reference import accelerations
from oracles.benchmarks.build import X, Y, Z, body, mechanism

G, WHEELBASE, TRAIL, TILT = 9.81, 1.02, 0.08, np.pi / 10
REAR, FRONT = 0.3, 0.35
STEER_POINT = (WHEELBASE + TRAIL) * X
STEER_AXIS = np.array([np.sin(TILT), 0.0, np.cos(TILT)])
BODIES = (
    body("B", 85, (0.3, 0, -0.9), [(9.2, 0, 2.4), (0, 11, 0), (2.4, 0, 2.8)]),
    body("H", 4, (0.9, 0, -0.7), [(0.05892, 0, -0.00756), (0, 0.06, 0), (-0.00756, 0, 0.00708)]),
    body("R", 2, (0, 0, -REAR), (0.0603, 0.12, 0.0603)),
    body("F", 3, (WHEELBASE, 0, -FRONT), (0.1405, 0.28, 0.1405)),
)
JOINTS = (
    ("ride", "free", GROUND, "B", np.zeros(3), np.eye(3)),
    ("steer", "revolute", "B", "H", STEER_POINT, STEER_AXIS),
    ("rear_hub", "revolute", "B", "R", -REAR * Z, Y),
    ("front_hub", "revolute", "H", "F", WHEELBASE * X - FRONT * Z, Y),
)
ROLLINGS = (
    Rolling("rear", "R", np.zeros(3), Y, REAR, np.zeros(3), -Z),
    Rolling("front", "F", np.zeros(3), Y, FRONT, np.zeros(3), -Z),
)


def bicycle(lean_torque=0.0, steer_torque=0.0):
    """The mechanism; constant torques act on the rear frame about x, and between the frames about the steer axis."""
    plain = mechanism("bicycle", G * Z, BODIES, JOINTS, rollings=ROLLINGS)
    return replace(
        plain,
        loads=(Load("lean", "torque", "B", lean_torque * X, "world"),),
        joint_springs=(JointSpring("hands", "steer", "angle", 0.0, 0.0, 0.0, constant(steer_torque)),),
    )


def _about(axis, angle):
    return rotation_from_quaternion(quaternion_from_rotation_vector(angle * axis))


def _pose(lean, steer, pitch):
    """Rotations of both frames, and the vector between the wheel centres, rear to front."""
    B = _about(X, lean) @ _about(Y, pitch)
    H = B @ _about(STEER_AXIS, steer)
    hub = BODIES[3].drawing.p
    return B, H, B @ (STEER_POINT + REAR * Z) + H @ (hub - STEER_POINT)


def _above(axis, radius):
    """Height of the centre of a wheel above the ground; the wheel touches the ground."""
    return radius * np.sqrt(1 - axis[2] ** 2)


def _pitch(lean, steer):
    """Pitch angle at which both wheels touch the ground."""

    def gap(pitch):
        B, H, reach = _pose(lean, steer, pitch)
        return reach[2] + _above(H @ Y, FRONT) - _above(B @ Y, REAR)

    return brentq(gap, -0.3, 0.3, xtol=1e-17, rtol=1e-15)


def state(plain, speed, lean=0.0, steer=0.0, lean_rate=0.0, steer_rate=0.0):
    """State heading along x; the rear wheel spins at speed / radius relative to its frame."""
    B, H, reach = _pose(lean, steer, _pitch(lean, steer))
    rear = -_above(B @ Y, REAR) * Z
    steered = rear + B @ (STEER_POINT + REAR * Z)
    R = np.array([B, H, B, H])
    drawn = np.array([b.drawing.p for b in BODIES])
    centres = np.array([rear + B @ (drawn[0] + REAR * Z), steered + H @ (drawn[1] - STEER_POINT), rear, rear + reach])
    still = np.zeros((4, 3))
    placed = State(centres, quaternion_from_rotation(R), still, still)
    N = free_directions(plain, placed)
    v = (N @ np.linalg.solve(_rates(placed) @ N, [lean_rate, steer_rate, -speed / REAR])).reshape(-1, 6)
    return State(placed.p_WB, placed.quat_WB, v[:, :3], v[:, 3:])


def _rates(placed):
    """Rows that map velocities to lean rate (heading along x), steer rate and spin of the rear wheel in its frame."""
    B = rotation_from_quaternion(placed.quat_WB[0])
    rows = np.zeros((3, 4, 6))
    rows[0, 0, 3:] = X
    rows[1, 0, 3:], rows[1, 1, 3:] = -B @ STEER_AXIS, B @ STEER_AXIS
    rows[2, 0, 3:], rows[2, 2, 3:] = -B @ Y, B @ Y
    return rows.reshape(3, 24)


def lean_and_steer(R):
    """phi and delta from the rotations of the bodies, shape (..., 4, 3, 3)."""
    B, H = R[..., 0, :, :], R[..., 1, :, :]
    turn = np.swapaxes(B, -1, -2) @ H
    steer = np.arctan2(turn @ Y @ np.cross(STEER_AXIS, Y), turn @ Y @ Y)
    return np.arcsin(B[..., 2, 1]), steer


def lean_and_steer_accelerations(plain, states):
    """phi'' and delta'', shape (n, 2), of states that head along x.

    ``w_B = phi' x + theta' (0, cos phi, sin phi) + psi' z`` with x and y turning at psi'.
    """
    alpha = accelerations(plain, states).alpha_WB_W
    found = []
    for s, a in zip(states, alpha, strict=True):
        B, w = rotation_from_quaternion(s.quat_WB[0]), s.w_WB_W[0]
        lean = np.arcsin(B[2, 1])
        heading = w[2] - np.tan(lean) * w[1]
        found.append((a[0, 0] + heading * w[1], (a[1] - a[0]) @ (B @ STEER_AXIS)))
    return np.array(found)


def response(speed):
    """Linear parts of phi'' and delta'', upright and straight: in torques, angles and their rates, each shape (2, 2).

    phi'' and delta'' are linear in the torques, and odd in angles and rates by symmetry. Central differences at four
    step sizes leave an error of ninth order.
    """
    plain, columns = bicycle(), []
    upright = state(plain, speed)
    in_torques = [lean_and_steer_accelerations(bicycle(*torques), [upright])[0] / 100 for torques in 100 * np.eye(2)]
    weights = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    rate = 0.04 * max(speed, 1.0)
    for unit, step in zip(np.eye(4), (0.04, 0.01, rate, rate), strict=True):
        states = [state(plain, speed, *(n * step * unit)) for n in (1, 2, 3, 4, -1, -2, -3, -4)]
        a = lean_and_steer_accelerations(plain, states)
        columns.append(weights @ (a[:4] - a[4:]) / step)
    return np.array(in_torques).T, np.array(columns[:2]).T, np.array(columns[2:]).T
