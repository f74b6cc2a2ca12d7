"""Bodies in contact whose motions have closed forms, in a turned world and with lumpy body frames.

A problem is stated in axes of its own, z out of the floor, and about the centre of mass with principal axes. `Lab`
places it in a turned and shifted world, with the body's frame somewhere in the body.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from consilience.mechanism import (
    GROUND,
    Body,
    DryFriction,
    Frame,
    Joint,
    Load,
    Mechanism,
    PointPlane,
    SpherePlane,
    State,
    Stop,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)

G = 9.81


def turned(*vector: float) -> np.ndarray:
    return rotation_from_quaternion(quaternion_from_rotation_vector(np.array(vector)))


@dataclass(frozen=True)
class Lab:
    """World axes of a problem, and the pose of its body's centre of mass with principal axes in the body's frame."""

    origin: np.ndarray = field(default_factory=lambda: np.array([0.3, -0.7, 0.4]))
    axes: np.ndarray = field(default_factory=lambda: turned(0.4, -0.3, 0.8))
    com: np.ndarray = field(default_factory=lambda: np.array([0.05, -0.08, 0.03]))
    principal: np.ndarray = field(default_factory=lambda: turned(-0.5, 0.9, 0.3))

    def free_body(self, mass, moments, gravity, contacts, loads=()) -> Mechanism:
        """Body on a free joint; contacts from functions of the lab, loads as forces at the centre of mass."""
        inertia = self.principal @ np.diag(moments) @ self.principal.T
        here = Frame(np.zeros(3), np.eye(3))
        body = Body("body", mass, self.com, 0.5 * (inertia + inertia.T), here)
        forces = tuple(
            Load(f"load {n}", "force", "body", self.axes @ np.array(force, dtype=float), "world", self.com)
            for n, force in enumerate(loads)
        )
        joint = Joint("free", "free", GROUND, "body", here, here)
        return Mechanism(
            "touching", self.axes @ np.array(gravity), (body,), (joint,), contacts=tuple(contacts), loads=forces
        )

    def in_body(self, point) -> np.ndarray:
        return self.com + self.principal @ np.array(point, dtype=float)

    def sphere(self, radius, name="ball", **law) -> SpherePlane:
        """Sphere about the centre of mass, on the floor."""
        return SpherePlane(name, "body", self.com, radius, GROUND, self.origin, self.axes[:, 2], **law)

    def points(self, points, **law) -> list[PointPlane]:
        """Points on the floor, from the centre of mass."""
        return [
            PointPlane(f"foot {n}", "body", self.in_body(p), GROUND, self.origin, self.axes[:, 2], **law)
            for n, p in enumerate(points)
        ]

    def state(self, position, velocity, spin=(0.0, 0.0, 0.0), turn=None) -> State:
        """State from position, velocity and spin of the centre of mass, and the rotation of the principal axes."""
        R = self.axes @ (np.eye(3) if turn is None else turn) @ self.principal.T
        w, arm = self.axes @ np.array(spin, dtype=float), R @ self.com
        p = self.origin + self.axes @ np.array(position, dtype=float) - arm
        v = self.axes @ np.array(velocity, dtype=float) - np.cross(w, arm)
        return State(p[None], quaternion_from_rotation(R)[None], v[None], w[None])

    def centre(self, answer, sample=-1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and spin of the centre of mass at a sample, in axes of the problem."""
        state = answer.state(sample)
        arm, w = state.R_WB[0] @ self.com, state.w_WB_W[0]
        p, v = state.p_WB[0] + arm - self.origin, state.v_WB_W[0] + np.cross(w, arm)
        return self.axes.T @ p, self.axes.T @ v, self.axes.T @ w

    def angle(self, answer, sample=-1) -> list[float]:
        """Angle of `pendulum` at a sample."""
        along = self.axes.T @ answer.state(sample).R_WB[0] @ self.principal[:, 2]
        return [float(np.arctan2(along[0], along[2]))]

    def acceleration(self, answer, state, n=0) -> tuple[np.ndarray, np.ndarray]:
        """Acceleration of the centre of mass and angular acceleration at an instant, in axes of the problem."""
        arm, w, alpha = state.R_WB[0] @ self.com, state.w_WB_W[0], answer.alpha_WB_W[n, 0]
        a = answer.a_WB_W[n, 0] + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))
        return self.axes.T @ a, self.axes.T @ alpha


def incline(degrees: float) -> np.ndarray:
    """Gravity on an incline whose normal is z, with x down the slope."""
    angle = np.radians(degrees)
    return G * np.array([np.sin(angle), 0.0, -np.cos(angle)])


LEVEL = np.array([0.0, 0.0, -G])


def pendulum(lab, bound=0.0, stop=None) -> Mechanism:
    """Slender rod of 1 m and 1 kg about y of the lab, hanging at the angle 0, with dry friction and a stop."""
    inertia = lab.principal @ np.diag([1.0 / 12.0, 1.0 / 12.0, 1e-3]) @ lab.principal.T
    R = lab.axes @ lab.principal.T
    end = lab.in_body([0.0, 0.0, 0.5])
    body = Body("rod", 1.0, lab.com, 0.5 * (inertia + inertia.T), Frame(lab.origin - R @ end, R))
    axes = lab.axes[:, [2, 0, 1]]  # z of the joint is y of the lab
    joint = Joint("hinge", "revolute", GROUND, "rod", Frame(lab.origin, axes), Frame(end, R.T @ axes))
    dry = (DryFriction("brake", "hinge", "angle", bound=bound),) if bound else ()
    stops = () if stop is None else (Stop("stop", "hinge", "angle", **stop),)
    return Mechanism("pendulum", lab.axes @ LEVEL, (body,), (joint,), dry_frictions=dry, stops=stops)


def stop_torque(q: float) -> float:
    """Effort of a stop on which the rod of `pendulum` rests, N m."""
    return 0.5 * G * np.sin(q)


FEET = np.array([[0.3 * np.cos(a), 0.3 * np.sin(a), -0.1] for a in (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)])
"""Feet of a tripod below its centre of mass, m."""

BALL = (0.008, 0.008, 0.008)
"""Principal moments of a homogeneous ball of 2 kg and 0.1 m, kg m^2."""


def close(values, truth, bar):
    """Require that no number of the values is further than the bar from that of the truth."""
    found, wanted = (np.concatenate([np.ravel(one) for one in many]) for many in (values, truth))
    assert np.max(np.abs(found - wanted)) < bar


def ball(lab, mu, load) -> Mechanism:
    """A ball of 2 kg on the floor, pushed at its centre."""
    return lab.free_body(2.0, BALL, LEVEL, [lab.sphere(0.1, friction=mu)], [load])


def rolling_ball(lab) -> tuple[Mechanism, State, tuple]:
    """A ball that rolls, ``v = w x r n``: a = F / (m (1 + 2/5)), and the floor holds back 2/7 of the push."""
    a = np.array([3.0, 1.0, 0.0]) / 2.8
    truth = a, np.cross([0, 0, 1.0], a) / 0.1, [-0.8 * a[0], -0.8 * a[1], 2.0 * G]
    return ball(lab, 0.5, (3.0, 1.0, 0.0)), lab.state([0, 0, 0.1], [1.0, 0.5, 0.0], [-5.0, 10.0, 3.0]), truth


def sliding_ball(lab) -> tuple[Mechanism, State, tuple]:
    """A ball that slides: friction against the slip of the point that touches."""
    u = np.array([3.0, 1.0, 0.0]) + np.cross([2.0, 5.0, 7.0], [0.0, 0.0, -0.1])
    friction = -0.5 * 2.0 * G * u / np.linalg.norm(u)
    floor = friction + np.array([0, 0, 2.0 * G])
    truth = friction / 2.0 + [0.0, 1.0, 0.0], np.cross([0, 0, -0.1], friction) / 0.008, floor
    return ball(lab, 0.5, (0.0, 2.0, 0.0)), lab.state([0, 0, 0.1], [3.0, 1.0, 0.0], [2.0, 5.0, 7.0]), truth


def turning_feet(lab) -> tuple[Mechanism, State, tuple]:
    """A tripod that slides and turns: three unknown normal forces from Newton and Euler."""
    u = np.array([1.2, 0.3, 0.0]) + np.cross([0, 0, 8.0], FEET)
    along = -0.35 * u / np.linalg.norm(u, axis=1)[:, None] + [0, 0, 1.0]
    wrenches = np.hstack([along, np.cross(FEET, along)]).T
    N = np.linalg.solve(wrenches[[2, 3, 4]], [2.0 * G, 0.0, 0.0])
    moving = (wrenches @ N - [0, 0, 2.0 * G, 0, 0, 0]) / [2.0, 2.0, 2.0, 0.02, 0.02, 0.04]
    mechanism = lab.free_body(2.0, (0.02, 0.02, 0.04), LEVEL, lab.points(FEET, friction=0.35))
    return mechanism, lab.state([0, 0, 0.1], [1.2, 0.3, 0.0], [0, 0, 8.0]), (moving[:3], moving[3:], along * N[:, None])


def fallen_rod(lab, th, rate) -> tuple[Mechanism, State, float, float]:
    """Rod of 1 m and 1 kg, its lower end on a smooth floor; its angular acceleration and the normal force.

    With the angle th from the vertical the centre is at ``1/2 cos th``: ``1/12 th'' = 1/2 N sin th`` and
    ``N - g = -1/2 (th'' sin th + th'^2 cos th)``.
    """
    mechanism = lab.free_body(1.0, (1.0 / 12.0, 1.0 / 12.0, 1e-3), LEVEL, lab.points([(0.0, 0.0, -0.5)]))
    sine, cosine = np.sin(th), np.cos(th)
    N = (G - 0.5 * rate**2 * cosine) / (1.0 + 3.0 * sine**2)
    state = lab.state([0, 0, 0.5 * cosine], [0, 0, -0.5 * sine * rate], [0, rate, 0], turned(0.0, th, 0.0))
    return mechanism, state, 6.0 * N * sine, N


def stacked(lab, push, upper=True) -> tuple[Mechanism, State]:
    """Box of 3 kg on the floor (mu 0.2), pushed along x, with one of 1 kg on it (mu 0.35), both on four feet.

    Origins are at the centres of mass. Without `upper` only the lower box has contacts.
    """
    R = lab.axes
    turns = lab.principal, turned(0.2, 0.5, -0.7)
    bodies, rows = [], []
    for name, mass, Q, z in (("lower", 3.0, turns[0], 0.1), ("upper", 1.0, turns[1], 0.3)):
        inertia = Q @ np.diag([0.02, 0.03, 0.04]) @ Q.T
        at = Frame(lab.origin + z * R[:, 2], R @ Q.T)
        bodies.append(Body(name, mass, np.zeros(3), 0.5 * (inertia + inertia.T), at))
        rows.append(at)
    here = Frame(np.zeros(3), np.eye(3))
    joints = tuple(Joint(f"free {b.name}", "free", GROUND, b.name, here, here) for b in bodies)
    feet = [np.array([x, y, -0.1]) for x in (0.2, -0.2) for y in (0.2, -0.2)]
    contacts = [
        PointPlane(f"lower {n}", "lower", turns[0] @ p, GROUND, lab.origin, R[:, 2], friction=0.2)
        for n, p in enumerate(feet)
    ]
    if upper:
        top, normal = turns[0] @ np.array([0.0, 0.0, 0.1]), turns[0][:, 2]
        contacts += [
            PointPlane(f"upper {n}", "upper", turns[1] @ p, "lower", top, normal, friction=0.35)
            for n, p in enumerate(feet)
        ]
    loads = (Load("push", "force", "lower", push * R[:, 0], "world"),)
    mechanism = Mechanism("stacked", R @ LEVEL, tuple(bodies), joints, contacts=tuple(contacts), loads=loads)
    quats = np.array([quaternion_from_rotation(at.R) for at in rows])
    return mechanism, State(np.array([at.p for at in rows]), quats, np.zeros((2, 3)), np.zeros((2, 3)))
