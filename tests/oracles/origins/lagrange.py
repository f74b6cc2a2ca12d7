"""Origin of a mechanism without loops: Lagrange's equations in joint coordinates, from positions alone, by CasADi.

Every body is displaced from the drawing joint by joint. With ``c`` its centre of mass, ``R`` its rotation and
``J = tr(I) / 2 - I`` the second moments of its mass, ``T = m c'.c' / 2 + tr(R' J R'^T) / 2``. CasADi takes all
derivatives: no angular velocity, constraint row or gyroscopic term is written by hand.

Orientations are ``R0 Rx(a) Ry(b) Rz(c)`` with the initial orientation R0: accurate while ``|b|`` stays well below a
quarter turn, hence early in the motion. Reactions are the rates of change of linear and angular momentum of all bodies
beyond the joint, minus gravity.
"""

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from consilience.case import read_motion, read_start
from consilience.case.published import REACTIONS
from consilience.engine import InstantAnswer, TrajectoryAnswer
from consilience.mechanism import GROUND, quaternion_from_rotation, rotation_from_quaternion, rotation_with_z_axis
from oracles.integrate import integrate
from oracles.planar import drawn_frame


def _turn(axis, angle):
    """Elementary rotation about x, y or z (0, 1, 2)."""
    c, s = ca.cos(angle), ca.sin(angle)
    R = ca.SX.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


@dataclass
class _Coordinates:
    """Symbols of the coordinates, and initial values and rates."""

    q: list = field(default_factory=list)
    start: list = field(default_factory=list)
    rates: list = field(default_factory=list)
    named: dict = field(default_factory=dict)

    def add(self, joint, name, values, rates):
        symbols = [ca.SX.sym(f"{joint}_{name}_{k}") for k in range(len(values))]
        self.q += symbols
        self.start += list(values)
        self.rates += list(rates)
        self.named[joint, name] = symbols[0]
        return ca.vertcat(*symbols)


class _Asked:
    """Values and rates at which a case holds a joint; zero where it holds none."""

    def __init__(self, case, joint, coordinates):
        self.joint, self.all = joint.name, coordinates
        self.values = case.initial.coordinates.get(joint.name, {})
        self.rates = case.initial.rates.get(joint.name, {})

    def scalar(self, name):
        return self.all.add(self.joint, name, [float(self.values.get(name, 0.0))], [float(self.rates.get(name, 0.0))])

    def position(self):
        zero = np.zeros(3)
        return self.all.add(self.joint, "position", self.values.get("position", zero), self.rates.get("position", zero))

    def orientation(self):
        R0 = rotation_from_quaternion(np.asarray(self.values.get("orientation", (1.0, 0.0, 0.0, 0.0)), dtype=float))
        rates = R0.T @ np.asarray(self.rates.get("orientation", np.zeros(3)))
        return chart(R0, self.all.add(self.joint, "orientation", np.zeros(3), rates))


def chart(R0, angles):
    return ca.DM(R0) @ _turn(0, angles[0]) @ _turn(1, angles[1]) @ _turn(2, angles[2])


def _along(s):
    return ca.vertcat(0, 0, s)


def _screw(asked, joint):
    angle = asked.scalar("angle")
    return _turn(2, angle), _along(joint.pitch * angle / (2 * np.pi))


# rotation and displacement of M relative to F
MOTIONS = {
    "revolute": lambda a, j: (_turn(2, a.scalar("angle")), ca.SX.zeros(3)),
    "prismatic": lambda a, j: (ca.SX.eye(3), _along(a.scalar("distance"))),
    "cylindrical": lambda a, j: (_turn(2, a.scalar("angle")), _along(a.scalar("distance"))),
    "universal": lambda a, j: (_turn(2, a.scalar("angle1")) @ _turn(0, a.scalar("angle2")), ca.SX.zeros(3)),
    "spherical": lambda a, j: (a.orientation(), ca.SX.zeros(3)),
    "planar": lambda a, j: (_turn(2, a.scalar("angle")), ca.vertcat(a.scalar("x"), a.scalar("y"), 0)),
    "rigid": lambda a, j: (ca.SX.eye(3), ca.SX.zeros(3)),
    "free": lambda a, j: (a.orientation(), a.position()),
    "screw": _screw,
    "point_on_line": lambda a, j: (a.orientation(), _along(a.scalar("distance"))),
    "point_in_plane": lambda a, j: (a.orientation(), ca.vertcat(a.scalar("x"), a.scalar("y"), 0)),
    "parallel_axes": lambda a, j: (_turn(2, a.scalar("angle")), a.position()),
}


def _on_rod(case, joint, coordinates):
    """Rotation and displacement from the drawing of a body on a rod to the ground; its initial pose is given."""
    body = case.mechanism.bodies[case.mechanism.body_index[joint.successor]]
    pose = case.initial.poses.get(body.name, body.drawing)
    v, w = (np.asarray(x, dtype=float) for x in case.initial.velocities.get(body.name, (np.zeros(3), np.zeros(3))))
    at = drawn_frame(case.mechanism, joint)[0]
    end = pose.p + pose.R @ joint.M.p
    Q0 = np.roll(rotation_with_z_axis(end - at), 1, axis=1)  # x along the rod
    rates = Q0.T @ (v + np.cross(w, end - pose.p)) / joint.length
    a, b = ca.vertsplit(coordinates.add(joint.name, "swing", np.zeros(2), rates[1:]))
    tip = at + joint.length * ca.DM(Q0) @ ca.vertcat(ca.cos(b) * ca.cos(a), ca.cos(b) * ca.sin(a), ca.sin(b))
    R0 = pose.R @ body.drawing.R.T
    R = chart(R0, coordinates.add(joint.name, "orientation", np.zeros(3), R0.T @ w))
    return R, tip - R @ (body.drawing.p + body.drawing.R @ joint.M.p)


def _displacements(case, coordinates):
    """Rotation and displacement of every body from the drawing, by name."""
    mechanism = case.mechanism
    placed = {GROUND: (ca.SX.eye(3), ca.SX.zeros(3))}
    for joint in mechanism.joints:
        assert joint.successor not in placed, "a loop"
        R, t = placed[joint.predecessor]
        if joint.kind == "rod":
            placed[joint.successor] = _on_rod(case, joint, coordinates)
            continue
        at, U = drawn_frame(mechanism, joint)
        turn, shift = MOTIONS[joint.kind](_Asked(case, joint, coordinates), joint)
        own = ca.DM(U) @ turn @ ca.DM(U.T)
        placed[joint.successor] = (R @ own, R @ (at - own @ at + ca.DM(U) @ shift) + t)
    return placed


class Tree:
    """Equations of motion of a case, compiled by CasADi."""

    def __init__(self, case):
        m = self.mechanism = case.mechanism
        for others in (m.loads, m.frictions, m.controls, m.drives, m.couplings, m.rollings, m.skates):
            assert not others
        coordinates = _Coordinates()
        placed = _displacements(case, coordinates)
        q = ca.vertcat(*coordinates.q)
        v = ca.SX.sym("v", q.numel())
        self.start = np.array([*coordinates.start, *coordinates.rates], dtype=float)

        def rate(x):
            return ca.jtimes(x, q, v)

        T = V = power = 0
        bodies = []
        for body in m.bodies:
            turn, shift = placed[body.name]
            R, p = turn @ body.drawing.R, turn @ body.drawing.p + shift
            c = p + R @ body.com
            J = ca.DM(np.trace(body.inertia) / 2 * np.eye(3) - body.inertia)
            R_dot = ca.reshape(rate(ca.vec(R)), 3, 3)
            T += body.mass * ca.sumsqr(rate(c)) / 2 + ca.trace(R_dot @ J @ R_dot.T) / 2
            V -= body.mass * ca.dot(m.gravity, c)
            bodies.append((p, R, rate(p), R_dot, c, R @ J @ R_dot.T))

        def point(name, p):
            turn, shift = placed[name]
            drawn = p if name == GROUND else (b := m.bodies[m.body_index[name]]).drawing.p + b.drawing.R @ p
            return turn @ drawn + shift

        # elongation, stiffness and damping of each element that stores or dissipates energy
        stretches = [
            (
                ca.norm_2(point(s.successor, s.point_successor) - point(s.predecessor, s.point_predecessor))
                - s.free_length,
                s,
            )
            for s in m.springs
        ]
        stretches += [(coordinates.named[s.joint, s.coordinate] - s.rest, s) for s in m.joint_springs]
        for stretch, s in stretches:
            assert s.actuator is None
            V += s.stiffness * stretch**2 / 2
            power += s.damping * rate(stretch) ** 2 / 2
        momenta = ca.gradient(T, v)
        M = ca.jacobian(momenta, v)
        rhs = ca.gradient(T - V, q) - rate(momenta)
        if m.springs or m.joint_springs:
            rhs -= ca.gradient(power, v)
        self.equations = ca.Function("equations", [q, v], [M, rhs])
        self.observe = ca.Function("observe", [q, v], [ca.horzcat(*x) for x in zip(*bodies, strict=True)])
        a = ca.SX.sym("a", q.numel())
        seconds = [
            (
                rate(p_dot) + ca.jtimes(p_dot, v, a),
                R_dot,
                ca.reshape(rate(ca.vec(R_dot)) + ca.jtimes(ca.vec(R_dot), v, a), 3, 3),
                rate(rate(c)) + ca.jtimes(rate(c), v, a),
                ca.reshape(rate(ca.vec(S)) + ca.jtimes(ca.vec(S), v, a), 3, 3),
            )
            for p, R, p_dot, R_dot, c, S in bodies
        ]
        self.seconds = ca.Function("seconds", [q, v, a], [ca.horzcat(*x) for x in zip(*seconds, strict=True)])

    def accelerations(self, y):
        """Accelerations of the coordinates."""
        q, v = np.split(y, 2)
        M, rhs = self.equations(q, v)
        return np.linalg.solve(np.array(M), np.array(rhs).ravel())

    def motion(self, times):
        """Poses and velocities of the bodies."""

        def rhs(y):
            return np.concatenate([np.split(y, 2)[1], self.accelerations(y)])

        answers = [[np.array(x) for x in self.observe(*np.split(y, 2))] for y in integrate(rhs, self.start, times)]
        p, R, v, R_dot, _, _ = (np.array(x) for x in zip(*answers, strict=True))
        p, v = np.swapaxes(p, 1, 2), np.swapaxes(v, 1, 2)
        R, R_dot = _apart(R), _apart(R_dot)
        w = _axial(R_dot @ np.swapaxes(R, -1, -2))
        return TrajectoryAnswer(np.asarray(times), p, quaternion_from_rotation(R), v, w)

    def first(self):
        """Accelerations of the origins and reactions of the joints at the start."""
        m, (q, v) = self.mechanism, np.split(self.start, 2)
        a, R_dot, R_ddot, c_ddot, S_dot = (np.array(x) for x in self.seconds(q, v, self.accelerations(self.start)))
        p, R, _, _, c, _ = (np.array(x) for x in self.observe(q, v))
        turn, R_dot, R_ddot, S_dot = (_apart(x) for x in (R, R_dot, R_ddot, S_dot))
        alpha = _axial(R_ddot @ np.swapaxes(turn, -1, -2))
        moments = np.stack([S_dot[:, 1, 2], S_dot[:, 2, 0], S_dot[:, 0, 1]], axis=-1)
        moments -= np.stack([S_dot[:, 2, 1], S_dot[:, 0, 2], S_dot[:, 1, 0]], axis=-1)
        forces, torques = np.zeros((2, len(m.joints), 3))
        for n, joint in enumerate(m.joints):
            F = self._frame(joint.predecessor, joint.F, p, turn)
            origin = self._frame(joint.successor, joint.M, p, turn)[0]
            for i in self._carried(joint):
                force = m.bodies[i].mass * (c_ddot[:, i] - m.gravity)
                forces[n] += F[1].T @ force
                torques[n] += F[1].T @ (moments[i] + np.cross(c[:, i] - origin, force))
        return InstantAnswer(a.T[None], alpha[None], forces[None], torques[None], np.zeros(1), np.zeros(1))

    def _frame(self, name, frame, p, R):
        if name == GROUND:
            return frame.p, frame.R
        i = self.mechanism.body_index[name]
        return p[:, i] + R[i] @ frame.p, R[i] @ frame.R

    def _carried(self, joint):
        """Indices of the bodies beyond a joint."""
        beyond = {joint.successor}
        for other in self.mechanism.joints:
            if other.predecessor in beyond:
                beyond.add(other.successor)
        return [self.mechanism.body_index[name] for name in sorted(beyond)]


def _apart(side_by_side):
    """Matrices (..., n, 3, 3) from matrices side by side, (..., 3, 3 n)."""
    count = side_by_side.shape[-1] // 3
    return np.stack(np.split(side_by_side, count, axis=-1), axis=-3)


def _axial(tilde):
    """Axial vector of the antisymmetric part of a matrix."""
    odd = (tilde - np.swapaxes(tilde, -1, -2)) / 2
    return np.stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]], axis=-1)


def values(case, published):
    """Expected values of a case, in the order of `published`."""
    tree = Tree(case)
    motion = tree.motion(sorted({0.0, *(known.time for known in published)}))
    start = tree.first() if any(known.at_start for known in published) else None
    if any(known.observable in REACTIONS for known in published):
        assert not [*case.mechanism.springs, *case.mechanism.joint_springs], "springs share the load"
    return np.array(
        [
            read_start(case.mechanism, known, start)[known.component]
            if known.at_start
            else read_motion(case.mechanism, known, motion)
            for known in published
        ]
    )
