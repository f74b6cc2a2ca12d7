"""Single bodies of Project Chrono's joint tests: 1 kg, released at rest, gravity 9.80665 along -z."""

import numpy as np

from consilience.mechanism import GROUND, JointSpring, Spring, quaternion_from_rotation_vector, rotation_from_quaternion
from oracles.benchmarks.build import X, Y, Z, body, mechanism
from oracles.closed_forms.pendulum import Pendulum
from oracles.integrate import integrate

G = 9.80665
ROD = np.array([0.04, 0.1, 0.1])
HERE, THERE = np.zeros(3), np.array([1.0, 2.0, 3.0])


def turned(axis, degrees):
    axis = np.asarray(axis, dtype=float)
    vector = np.radians(degrees) * axis / np.linalg.norm(axis)
    return rotation_from_quaternion(quaternion_from_rotation_vector(vector))


PLACES = {
    "Revolute_01": ("revolute", HERE, turned(X, -90)),
    "Revolute_02": ("revolute", THERE, turned(X, -45)),
    "Spherical_01": ("spherical", HERE, np.eye(3)),
    "Spherical_02": ("spherical", THERE, turned(X, -45)),
    "Prismatic_01": ("prismatic", HERE, np.eye(3)),
    "Prismatic_02": ("prismatic", THERE, turned(X, -45)),
    "Prismatic_03": ("prismatic", HERE, turned(X, -90)),
    "Cylindrical_01": ("cylindrical", HERE, np.eye(3)),
    "Cylindrical_02": ("cylindrical", HERE, turned(X, -90)),
    "Cylindrical_03": ("cylindrical", THERE, turned(X, -45)),
}
UNIVERSALS = {"Universal_01": turned(X, 90), "Universal_02": turned(Y, 90), "Universal_03": turned((1, -1, 0), 90)}


def pendulum(case, **forces):
    """A rod with its centre of mass 2 m along x of the joint's frame."""
    kind, at, R = PLACES[case]
    return mechanism(
        case, -G * Z, [body("rod", 1, at + 2 * R[:, 0], ROD, R=R)], [("joint", kind, GROUND, "rod", at, R)], **forces
    )


def pendulum_motion(case, times):
    """Centres of mass (n_t, 3) and angular velocities (n_t, 3): free fall along the axis, a pendulum about the axis.

    A ball joint acts as a revolute joint about the horizontal line perpendicular to the rod: released at rest, the rod
    stays in its vertical plane.
    """
    kind, at, R = PLACES[case]
    gravity, t = -G * Z, np.asarray(times)[:, None]
    axis, across = R[:, 2], R[:, 0]
    if kind == "spherical":
        axis = np.cross(across, gravity) / np.linalg.norm(np.cross(across, gravity))
    fall = np.zeros((len(t), 3)) if kind in ("revolute", "spherical") else (gravity @ axis) * axis * t**2 / 2
    pull = gravity - (gravity @ axis) * axis
    size = np.linalg.norm(pull)
    if kind == "prismatic" or size < 1e-12:
        return at + fall + 2 * across, np.zeros((len(t), 3))
    down = pull / size
    # the rod starts level: the angle from `down` starts at pi / 2 and decreases
    moment = 4 + 0.1
    angle, rate = Pendulum(np.sqrt(2 * size / moment), np.pi / 2, 0.0).solve(times)
    r = 2 * (np.sin(angle)[:, None] * across + np.cos(angle)[:, None] * down)
    return at + fall + r, rate[:, None] * np.cross(down, across)


def universal(case):
    """A rod that hangs 2 m along -z of the cross; joint axes: x of R on the ground, y of R on the rod."""
    R = UNIVERSALS[case]
    frame = np.column_stack([R[:, 1], R[:, 2], R[:, 0]])  # z of the joint frame is fixed to the ground, x to the rod
    rod = body("rod", 1, -2 * R[:, 2], (0.1, 0.1, 0.04), R=R)
    return mechanism(case, -G * Z, [rod], [("joint", "universal", GROUND, "rod", HERE, frame)])


def universal_motion(case, times):
    """Centres of mass and angular velocities by Lagrange's equations in the angles a, b of ``R Rx(a) Ry(b)``.

    ``T = A (a'^2 cos^2 b + b'^2) / 2 + C a'^2 sin^2 b / 2``; the centre of mass is at -2 m along the rod's z axis.
    """
    R = UNIVERSALS[case]
    gx, gy, gz = R.T @ (-G * Z)
    A, C = 4.1, 0.04

    def rhs(y):
        a, b, a_dot, b_dot = y
        ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
        # V = 2 (gx sin b - gy sin a cos b + gz cos a cos b)
        V_a = 2 * (-gy * ca * cb - gz * sa * cb)
        V_b = 2 * (gx * cb + gy * sa * sb - gz * ca * sb)
        inertia = A * cb * cb + C * sb * sb
        slope = 2 * (C - A) * sb * cb
        return np.array([a_dot, b_dot, (-V_a - slope * a_dot * b_dot) / inertia, (slope * a_dot**2 / 2 - V_b) / A])

    a, b, a_dot, b_dot = integrate(rhs, np.zeros(4), times).T
    r = -2 * np.column_stack([np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)])
    w = np.column_stack([a_dot, b_dot * np.cos(a), b_dot * np.sin(a)])
    return r @ R.T, w @ R.T


def torsion():
    """Mechanism of test Revolute_01 with a torsion spring of 200 N m/rad and 10 N m s/rad."""
    return pendulum("Revolute_01", joint_springs=(JointSpring("k", "joint", "angle", 200.0, 10.0, 0.0),))


def torsion_motion(times):
    """Angle below the horizontal and its rate, shape (n_t, 2)."""

    def rhs(y):
        return np.array([y[1], (2 * G * np.cos(y[0]) - 200 * y[0] - 10 * y[1]) / 4.1])

    return integrate(rhs, np.zeros(2), times)


def held_by_spring(start, stiffness, damping, length):
    """A free rod with a spring from the origin to its centre of mass; the centre of mass starts at `start`."""
    spring = Spring("k", GROUND, "rod", HERE, HERE, stiffness, damping, length)
    joints = [("f", "free", GROUND, "rod", HERE, np.eye(3))]
    return mechanism("spring", -G * Z, [body("rod", 1, start, ROD)], joints, springs=(spring,))


def distance(com, R):
    """A rod, and a massless rod (constant distance) from the origin to the point of the rod drawn at (0, 2, 0)."""
    at = np.column_stack([X, -Z, Y])
    return mechanism(
        "distance", -G * Z, [body("rod", 1, com, ROD, R=R)], [("link", "rod", GROUND, "rod", HERE, at, 2 * Y)]
    )
