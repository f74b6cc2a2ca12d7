"""Mechanisms drawn in the world, and disguises: the same mechanism with other axes and origins."""

from dataclasses import dataclass, replace

import numpy as np

from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Initial,
    JointSpring,
    Mechanism,
    State,
    initial_state,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_with_z_axis,
)
from consilience.reference import simulate
from mechanisms import drawn_joint, rotation

X, Y, Z = np.eye(3)


def body(name, mass, com, inertia, at=None, R=None):
    """Body whose centre of mass `com` is given in the world of the drawing.

    Parameters
    ----------
    inertia : array_like, shape (3,) or (3, 3), kg m^2
        About the centre of mass, in the axes `R`.
    at, R : array_like, optional
        Origin (else the centre of mass) and axes (else those of the world) in the drawing.
    """
    com = np.asarray(com, dtype=float)
    at = com if at is None else np.asarray(at, dtype=float)
    R = np.eye(3) if R is None else R
    inertia = np.asarray(inertia, dtype=float)
    tensor = np.diag(inertia) if inertia.ndim == 1 else inertia
    return Body(name, float(mass), R.T @ (com - at), tensor, Frame(at, R))


def thin_rod(name, mass, ends, moment, thickness=0.0, lateral=None):
    """Rod between two points; `moment` is its transverse moment about the centre of mass, `thickness` the axial moment.

    The body's x axis runs along the rod. In a planar problem the axial moment has no effect; unless given, it is set to
    the transverse moment.
    """
    ends = np.asarray(ends, dtype=float)
    along = ends[1] - ends[0]
    R = np.roll(rotation_with_z_axis(along, lateral), 1, axis=1)
    return body(name, mass, ends.mean(axis=0), (thickness or moment, moment, moment), at=ends[0], R=R)


def mechanism(name, gravity, bodies, joints, **forces):
    """Mechanism from bodies and from joints (name, kind, predecessor, successor, point, axis or frame[, end])."""
    named = {b.name: b for b in bodies}
    drawn = []
    for label, kind, i, j, at, axes, *end in joints:
        frame = rotation_with_z_axis(axes) if np.ndim(axes) == 1 else np.asarray(axes, dtype=float)
        to = np.asarray(end[0], dtype=float) if end else None
        drawn.append(drawn_joint(label, kind, named, i, j, np.asarray(at, dtype=float), frame, to))
    return Mechanism(name, np.asarray(gravity, dtype=float), tuple(bodies), tuple(drawn), **forces)


def damper(joint, damping, stiffness=0.0, rest=0.0, coordinate="angle"):
    return JointSpring(f"spring_{joint}", joint, coordinate, stiffness, damping, rest)


def started(mechanism, rates=None, coordinates=None, velocities=None):
    """Consistent state near the drawing; a scalar is the value of a joint with one coordinate."""

    def named(values):
        names = {"revolute": "angle", "prismatic": "distance"}
        kinds = {j.name: j.kind for j in mechanism.joints}
        return {n: v if isinstance(v, dict) else {names[kinds[n]]: v} for n, v in (values or {}).items()}

    return initial_state(
        mechanism, Initial(coordinates=named(coordinates), rates=named(rates), velocities=velocities or {})
    )


def placed(mechanism, velocities):
    """State in the pose of the drawing with the given velocities of origins and angular velocities, not projected."""
    frames = [b.drawing for b in mechanism.bodies]
    v, w = (np.array([velocities[b.name][k] for b in mechanism.bodies], dtype=float) for k in (0, 1))
    return State(np.array([f.p for f in frames]), quaternion_from_rotation([f.R for f in frames]), v, w)


@dataclass(frozen=True)
class Motion:
    """Poses and velocities of all bodies at the sample times: p, v, w (n_t, n_b, 3) and R (n_t, n_b, 3, 3)."""

    mechanism: Mechanism
    p: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray

    def point(self, name, drawn):
        """World positions (n_t, 3) of the point of a body that is drawn at the world position `drawn`."""
        i = self.mechanism.body_index[name]
        drawing = self.mechanism.bodies[i].drawing
        return self.p[:, i] + self.R[:, i] @ (drawing.R.T @ (np.asarray(drawn, dtype=float) - drawing.p))

    def point_velocity(self, name, drawn):
        i = self.mechanism.body_index[name]
        return self.v[:, i] + np.cross(self.w[:, i], self.point(name, drawn) - self.p[:, i])

    def turn(self, name):
        """Rotations (n_t, 3, 3) of a body relative to the drawing, in world axes."""
        i = self.mechanism.body_index[name]
        return self.R[:, i] @ self.mechanism.bodies[i].drawing.R.T

    def spin(self, name):
        return self.w[:, self.mechanism.body_index[name]]

    def state(self, n):
        return State(self.p[n], quaternion_from_rotation(self.R[n]), self.v[n], self.w[n])


def run(mechanism, state, times, tolerance=1e-13, formulation="descriptor"):
    """Motion by the reference solver from a state at time zero; the times need not include zero."""
    times = np.asarray(times, dtype=float)
    first = int(times[0] > 0)
    answer = simulate(mechanism, state, np.concatenate([np.zeros(first), times]), tolerance, formulation)
    rows = slice(first, None)
    R = rotation_from_quaternion(answer.quat_WB[rows])
    return Motion(mechanism, answer.p_WB[rows], R, answer.v_WB_W[rows], answer.w_WB_W[rows])


class Disguise:
    """The same mechanism in a turned and shifted world, with other body frames and with turned joint frames."""

    def __init__(self, mechanism, seed):
        rng = np.random.default_rng(seed)
        self.plain = mechanism
        self.world = Frame(rng.normal(size=3), rotation(rng))
        self.frames = {b.name: Frame(rng.normal(scale=0.3, size=3), rotation(rng)) for b in mechanism.bodies}
        rolls = {j.name: self._rolls(j, rng) for j in mechanism.joints}
        self.mechanism = replace(
            mechanism,
            gravity=self.world.R @ mechanism.gravity,
            bodies=tuple(self._body(b) for b in mechanism.bodies),
            joints=tuple(
                replace(
                    j,
                    F=self._frame(j.predecessor, j.F, rolls[j.name][0]),
                    M=self._frame(j.successor, j.M, rolls[j.name][1]),
                )
                for j in mechanism.joints
            ),
            springs=tuple(
                replace(
                    s,
                    point_predecessor=self._point(s.predecessor, s.point_predecessor),
                    point_successor=self._point(s.successor, s.point_successor),
                )
                for s in mechanism.springs
            ),
            loads=tuple(
                replace(
                    load,
                    point=self._point(load.body, load.point),
                    vector=(self.world.R if load.frame == "world" else self.frames[load.body].R.T) @ load.vector,
                )
                for load in mechanism.loads
            ),
            rollings=tuple(
                replace(
                    r,
                    center=self._point(r.body, r.center),
                    axis=self.frames[r.body].R.T @ r.axis,
                    point=self._point(GROUND, r.point),
                    normal=self.world.R @ r.normal,
                )
                for r in mechanism.rollings
            ),
        )

    @staticmethod
    def _rolls(joint, rng):
        """Rotations of the frames F and M that leave the joint, and the angle of a one-axis joint, unchanged."""
        a, b = rng.uniform(-2, 2, size=2)
        about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1.0]])
        if joint.kind == "universal":
            return about_z, np.array([[1.0, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
        return about_z, about_z

    def _body(self, b):
        new = self.frames[b.name]
        drawing = Frame(
            self.world.p + self.world.R @ (b.drawing.p + b.drawing.R @ new.p), self.world.R @ b.drawing.R @ new.R
        )
        return Body(b.name, b.mass, new.R.T @ (b.com - new.p), _even(new.R.T @ b.inertia @ new.R), drawing)

    def _point(self, name, p):
        if name == GROUND:
            return self.world.p + self.world.R @ p
        new = self.frames[name]
        return new.R.T @ (p - new.p)

    def _frame(self, name, frame, roll):
        axes = self.world.R if name == GROUND else self.frames[name].R.T
        return Frame(self._point(name, frame.p), axes @ frame.R @ roll)

    def state(self, state):
        """The same state for the disguised mechanism."""
        new = [self.frames[b.name] for b in self.plain.bodies]
        R = rotation_from_quaternion(state.quat_WB)
        arms = np.array([R_i @ f.p for R_i, f in zip(R, new, strict=True)])
        turned = np.array([self.world.R @ R_i @ f.R for R_i, f in zip(R, new, strict=True)])
        Rw = self.world.R.T
        return State(
            self.world.p + (state.p_WB + arms) @ Rw,
            quaternion_from_rotation(turned),
            (state.v_WB_W + np.cross(state.w_WB_W, arms)) @ Rw,
            state.w_WB_W @ Rw,
        )

    def undo(self, motion):
        """Motion of the original mechanism from the motion of the disguised one."""
        new_p = np.array([self.frames[b.name].p for b in self.plain.bodies])
        new_R = np.array([self.frames[b.name].R for b in self.plain.bodies])
        R = self.world.R.T @ motion.R @ np.swapaxes(new_R, 1, 2)
        arms = np.einsum("tbij,bj->tbi", R, new_p)
        w = motion.w @ self.world.R
        p = (motion.p - self.world.p) @ self.world.R - arms
        return Motion(self.plain, p, R, motion.v @ self.world.R - np.cross(w, arms), w)


def _even(tensor):
    return (tensor + tensor.T) / 2


def run_disguised(mechanism, state, times, seed, tolerance=1e-13, formulation="descriptor"):
    """As `run`, but simulates the disguised mechanism."""
    disguise = Disguise(mechanism, seed)
    return disguise.undo(run(disguise.mechanism, disguise.state(state), times, tolerance, formulation))
