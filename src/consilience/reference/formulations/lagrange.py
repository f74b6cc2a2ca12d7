"""Lagrange's equations in joint coordinates, by algorithmic differentiation of T and V [C4 (4.111)-(4.116)].

Second kind, for the joint coordinates y of a spanning tree:

    T = sum 1/2 m v.v + 1/2 w'.I'w'                        (4.111)
    d/dt dT/dy' - dT/dy = q_gen                            (4.114)
    q_gen = - dV/dy - dD/dy' + sum_k t_k . dx_k/dy         (4.115), (4.116)

V: potential of gravity, springs and joint springs. D: Rayleigh's dissipation function of all dampers, 1/2 c L'^2 of a
linear one, 1/2 c v^2 + 1/3 c1 |v|^3 + 1/4 c2 v^4 of a joint.
Loads t_k = (f, l) act by their virtual work: a force on its point x, a torque on dw/dy'. Loops are cut; the rows
g(t, y) = 0 of cut joints hold with multipliers (first kind):

    [ M  Q^T ] [  y'' ]   [ q_gen - h ]      M = d2T/dy'2,   h = d/dt dT/dy' - M y'' - dT/dy,
    [ Q   0  ] [ -lam ] = [   gamma   ]      Q = dg/dy,      gamma = - d2g/dt2 + Q y''.

Dependent rows are found by the singular values of B = L^-1 Q^T (M = L L^T); lam is of least norm, y'' is unique. If the
tree satisfies all rows of cut joints, Q consists of rounding errors: singular values are compared with the motion of
the frames of cut joints, whose difference Q is, not with the largest singular value.

All derivatives, also v, w, a and alpha of the bodies from their poses, are by algorithmic differentiation (CasADi). No
row, force or acceleration is shared with other formulations, only the mechanism, its tree and joint coordinates.

The second kind eliminates the reactions of tree joints. Releasing the joints gives them back: with six virtual
displacements z of M relative to F in every joint, Lagrange's equations of z hold at z = 0 with the reaction as
generalised force [C. Lanczos, The Variational Principles of Mechanics, 1970, section III.5],

    (force_F, torque_F) = d/dt dT/dz' - dT/dz - q_gen,z - (dg/dz)^T lam,     cut joints: (dg/dz)^T lam.

Orientations are Bryant angles in moving charts, see `lagrange_kinematics`. Coordinates u: y, y', charts (constant
between calls of `settle`), and turns: the angles of cut joints with springs, from which full turns are counted.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtrs

from consilience.engine import Unsupported
from consilience.errors import InvalidInput
from consilience.mechanism import GROUND, RANK_TOLERANCE, Array, JointSpring, Mechanism, State, quaternion_from_rotation
from consilience.reference.formulations.lagrange_kinematics import (
    CHART_LIMIT,
    Compiled,
    Expression,
    Layout,
    Poses,
    ca,
    layout,
    unsupported_joints,
)
from consilience.reference.formulations.orientations import NEAR_SINGULAR, SingularOrientation

_POSITION_STEPS = 5

_NO_TERMS = ("frictions", "controls", "drives", "couplings", "rollings", "skates")
"""Elements that the formulation has no terms for."""


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """List the features of a mechanism that the formulation cannot represent, with reasons."""
    reason = "the Lagrangian form has terms for springs, joint springs and loads constant in time only"
    elements: list[Any] = [element for group in _NO_TERMS for element in getattr(mechanism, group)]
    elements += [load for load in mechanism.loads if load.history is not None]
    elements += [spring for spring in mechanism.springs if spring.actuator is not None]
    elements += [spring for spring in mechanism.joint_springs if spring.actuator is not None]
    return (*unsupported_joints(mechanism), *(Unsupported(f"element '{e.name}'", reason) for e in elements))


def _axial(S: Expression) -> Expression:
    """Return the vector a of a skew matrix ~a."""
    return ca.vertcat(S[2, 1], S[0, 2], S[1, 0])


class _LagrangianSystem:
    """Energies, generalised forces and motion of a mechanism, as expressions of time and coordinates."""

    def __init__(self, mechanism: Mechanism, arrangement: Layout, released: bool = False) -> None:
        self.mechanism, self.layout, self.released = mechanism, arrangement, released
        self.poses = Poses(mechanism, arrangement, released)
        self.p = ca.horzcat(*(pose.p for pose in self.poses.bodies))
        self.R = ca.horzcat(*(pose.R for pose in self.poses.bodies))
        self.v, R_dot = self.poses.rate(self.p), self.poses.rate(self.R)
        columns = [slice(3 * b, 3 * b + 3) for b in range(len(mechanism.bodies))]
        self.w = ca.horzcat(*(_axial(R_dot[:, c] @ self.R[:, c].T) for c in columns))
        self.w_body = ca.horzcat(*(_axial(self.R[:, c].T @ R_dot[:, c]) for c in columns))
        self.turning = _turning_springs(mechanism, arrangement)
        self.turns = ca.SX.sym("theta", len(self.turning))
        self.counted = ca.vertcat(*(self._extension(spring) for spring in self.turning))
        self.momentum = ca.gradient(self.kinetic, self.poses.x_dot)
        self.arguments = [self.poses.t, self.poses.x, self.poses.x_dot, self.poses.charts, self.turns]

    @cached_property
    def kinetic(self) -> Expression:
        """Kinetic energy T of all bodies (4.111)."""
        T = ca.SX(0)
        for b, body in enumerate(self.mechanism.bodies):
            v = self.poses.rate(self._point(body.name, body.com))
            w = self.w_body[:, b]
            T += 0.5 * body.mass * ca.dot(v, v) + 0.5 * ca.dot(w, ca.DM(body.inertia) @ w)
        return T

    def _point(self, body: str, point: Array) -> Expression:
        """Return the world position of a point given in body axes."""
        pose = self.poses.body(body)
        return pose.p + pose.R @ ca.DM(point)

    def _extension(self, spring: JointSpring) -> Expression:
        """Return the coordinate of a joint spring: from y for a tree joint, from the pose of M in F for a cut joint."""
        joint = self.mechanism.joint_index[spring.joint]
        if joint not in self.layout.cut:
            q = self.poses.x[self.layout.column(joint, spring.coordinate)]
            axis = self.layout.size + 6 * joint + (5 if spring.coordinate == "angle" else 2)
            return q + self.poses.x[axis] if self.released else q
        p, R = self.poses.relative(joint)
        if spring.coordinate == "distance":
            return p[2]
        angle = ca.arctan2(R[1, 0], R[0, 0])
        whole = ca.floor((self.turns[self.turning.index(spring)] - angle) / (2 * np.pi) + 0.5)
        return angle + 2 * np.pi * whole

    @cached_property
    def generalised_force(self) -> Expression:
        """Generalised forces q_gen of gravity, springs, dampers and loads, (4.115) and (4.116)."""
        x, x_dot = self.poses.x, self.poses.x_dot
        V, D = ca.SX(0), ca.SX(0)
        for body in self.mechanism.bodies:
            V -= body.mass * ca.dot(ca.DM(self.mechanism.gravity), self._point(body.name, body.com))
        for spring in self.mechanism.springs:
            start = self._point(spring.predecessor, spring.point_predecessor)
            L = ca.norm_2(self._point(spring.successor, spring.point_successor) - start)
            V += 0.5 * spring.stiffness * (L - spring.free_length) ** 2
            D += 0.5 * spring.damping * self.poses.rate(L) ** 2
        for joint_spring in self.mechanism.joint_springs:
            q = self._extension(joint_spring)
            V += joint_spring.potential(q)
            (c, c1, c2), rate = joint_spring.laws[1], self.poses.rate(q)
            D += 0.5 * c * rate**2 + c1 * ca.fabs(rate) ** 3 / 3.0 + c2 * rate**4 / 4.0
        return self._work_of_loads() - ca.gradient(V, x) - ca.gradient(D, x_dot)

    def _work_of_loads(self) -> Expression:
        """Return ``sum_k f.dx/dy + l.dw/dy'`` with constant vectors f, l (4.116)."""
        q = ca.SX.zeros(self.poses.x.shape[0])
        for load in self.mechanism.loads:
            if load.body == GROUND:
                continue
            vector = ca.DM(load.vector)
            if load.frame == "body":
                vector = self.poses.body(load.body).R @ vector
            if load.kind == "force":
                q += ca.jtimes(self._point(load.body, load.point), self.poses.x, vector, True)
            else:
                w = self.w[:, self.mechanism.body_index[load.body]]
                q += ca.jtimes(w, self.poses.x_dot, vector, True)
        return q

    @cached_property
    def frame_motion(self) -> Expression:
        """Norms of the motion of all frames of cut joints per unit of each coordinate, shape (n,)."""
        frames = [ca.SX.zeros(0, 1)]
        for k in self.layout.cut:
            joint = self.mechanism.joints[k]
            for name, frame in ((joint.predecessor, joint.F), (joint.successor, joint.M)):
                frames += [self._point(name, frame.p), ca.vec(self.poses.body(name).R)]
        return ca.sqrt(ca.sum1(ca.jacobian(ca.vertcat(*frames), self.poses.x) ** 2)).T

    def equations(self) -> Compiled:
        """Compile the function of (t, y, y', charts, turns) to the fields of `_LagrangianTerms`."""
        poses = self.poses
        h = poses.rate(self.momentum) - ca.gradient(self.kinetic, poses.x)
        g, g_dot = poses.closure, poses.rate(poses.closure)
        values = [
            ca.jacobian(self.momentum, poses.x_dot),
            self.generalised_force - h,
            g,
            ca.jacobian(g, poses.x),
            g_dot,
            -poses.rate(g_dot),
            self.frame_motion,
            self.counted,
            poses.rate(self.counted),
        ]
        return Compiled("equations", self.arguments, values)

    def motion(self) -> Compiled:
        """Compile the function of (t, y, y', charts, turns) to p_WB, R_WB, v_WB_W, w_WB_W and turns, side by side."""
        return Compiled("motion", self.arguments, [self.p, self.R, self.v, self.w, self.counted])

    def acceleration(self) -> Compiled:
        """Compile the function of (t, y, y', charts, turns, y'') to a_WB_W and alpha_WB_W, side by side."""
        x_ddot = ca.SX.sym("x_ddot", self.poses.x.shape[0])
        values = [self._second_rate(velocity, x_ddot) for velocity in (self.v, self.w)]
        return Compiled("acceleration", [*self.arguments, x_ddot], values)

    def reaction(self) -> Compiled:
        """Compile the function of (t, x, x', charts, turns, x'', lam) to the joint wrenches, shape (6, n_j)."""
        x, g = self.poses.x, self.poses.closure
        x_ddot, lam = ca.SX.sym("x_ddot", x.shape[0]), ca.SX.sym("lam", g.shape[0])
        inertial = self._second_rate(self.momentum, x_ddot) - ca.gradient(self.kinetic, x)
        residual = inertial - self.generalised_force - ca.jtimes(g, x, lam, True)
        wrench = ca.reshape(residual[self.layout.size :], 6, len(self.mechanism.joints))
        # T and V do not depend on z of a cut joint: its equation is -(dg/dz)^T lam
        signs = np.array([-1.0 if k in self.layout.cut else 1.0 for k in range(len(self.mechanism.joints))])
        return Compiled("reaction", [*self.arguments, x_ddot, lam], [wrench @ ca.diag(ca.DM(signs))])

    def _second_rate(self, expression: Expression, x_ddot: Expression) -> Expression:
        """Return the total time derivative of a function of t, x and x'."""
        poses = self.poses
        along = ca.vertcat(1, poses.x_dot, x_ddot)
        return ca.jtimes(expression, ca.vertcat(poses.t, poses.x, poses.x_dot), along)


def _turning_springs(mechanism: Mechanism, arrangement: Layout) -> list[JointSpring]:
    """Return the joint springs about cut joints, whose full turns are counted."""
    cut = {mechanism.joints[k].name for k in arrangement.cut}
    return [s for s in mechanism.joint_springs if s.joint in cut and s.coordinate == "angle"]


class _LagrangianTerms(NamedTuple):
    """Terms of the equations at one instant."""

    M: Array  # (n, n)
    f: Array  # (n,) q_gen - h
    g: Array  # (q,)
    Q: Array  # (q, n)
    g_dot: Array  # (q,)
    gamma: Array  # (q,)
    frame_motion: Array  # (n,)
    counted: Array  # (n_theta,) angles of sprung cut joints, full turns counted
    counted_rate: Array  # (n_theta,)


class _Factors:
    """Factors of the mixed form: ``M = L L^T`` and singular values of ``B = L^-1 Q^T``."""

    def __init__(self, values: _LagrangianTerms) -> None:
        Q = values.Q
        self._L = np.linalg.cholesky(values.M)
        B = self.forward(Q.T) if len(Q) else Q.T
        U, s, Vt = np.linalg.svd(B, full_matrices=False)
        size = np.linalg.norm(self.forward(np.diag(values.frame_motion))) if len(s) else 0.0
        rank = int(np.sum(s > RANK_TOLERANCE * size))
        self._B, self._U, self._s, self._Vt = B, U[:, :rank], s[:rank], Vt[:rank]

    def forward(self, x: Array) -> Array:
        """Solve ``L^-1 x``."""
        return np.asarray(dtrtrs(self._L, x, lower=1)[0])

    def back(self, x: Array) -> Array:
        """Solve ``L^-T x``."""
        return np.asarray(dtrtrs(self._L, x, lower=1, trans=1)[0])

    def least(self, rows: Array) -> tuple[Array, Array]:
        """Return zeta of least norm with ``B^T zeta = rows``, and lam of least norm with ``B lam = zeta``."""
        along = self._Vt @ rows / self._s
        return self._U @ along, self._Vt.T @ (along / self._s)

    def step(self, rows: Array) -> Array:
        """Return the change of y or y' of least M-norm with ``Q step = rows``."""
        return self.back(self.least(rows)[0])

    def solve(self, f: Array, gamma: Array) -> tuple[Array, Array]:
        """Solve the mixed form for y'' and lam."""
        free = self.forward(f)
        zeta, lam = self.least(gamma - self._B.T @ free)
        return self.back(free + zeta), lam


class Lagrange:
    """Formulation by Lagrange's equations in joint coordinates.

    Parameters
    ----------
    mechanism : Mechanism

    Raises
    ------
    InvalidInput
        If `unsupported` lists a feature, or CasADi is not installed.
    """

    name = "lagrange"

    def __init__(self, mechanism: Mechanism) -> None:
        refused = unsupported(mechanism)
        if refused:
            raise InvalidInput(refused[0].feature, refused[0].reason, "Choose another formulation.")
        self._mechanism, self._layout = mechanism, layout(mechanism)
        self._system = _LagrangianSystem(mechanism, self._layout)
        self._equations, self._motion = self._system.equations(), self._system.motion()
        self._acceleration = self._system.acceleration()

    @cached_property
    def _reaction(self) -> Compiled:
        """Function of the joint wrenches, built at first use: the released system is several times as large."""
        return _LagrangianSystem(self._mechanism, self._layout, released=True).reaction()

    def coordinates(self, state: State) -> Array:
        """Return coordinates u of a consistent state, shape (n_u,): charts centred there, angles in (-pi, pi]."""
        y, y_dot, charts = self._layout.read(self._mechanism, state)
        *_, angles = self._motion(0.0, y, y_dot, charts, np.zeros(len(self._system.turning)))
        return np.concatenate([y, y_dot, charts.T.ravel(), angles[:, 0]])

    def state(self, u: Array) -> State:
        """Return the canonical state of coordinates u."""
        p, R, v, w, _ = self._motion(0.0, *self._split(u))
        quat = quaternion_from_rotation(R.reshape(3, -1, 3).transpose(1, 0, 2))
        return State(p.T, quat, v.T, w.T)

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt`` at the time t, shape (n_u,); charts are constant.

        Raises
        ------
        SingularOrientation
            If an orientation has left its chart within a step.
        """
        y, y_dot, charts, turns = self._split(u)
        values = self._evaluate(t, y, y_dot, charts, turns)
        y_ddot, _ = self._solve(y, values)
        return np.concatenate([y_dot, y_ddot, np.zeros(charts.size), values.counted_rate])

    def settle(self, t: float, u: Array) -> Array:
        """Project u onto the loop constraints in the metric of M, count turns, and change charts where due."""
        y, y_dot, charts, turns = self._split(u)
        settled = u
        if self._layout.cut:
            y, y_dot, turns = self._project(t, y, y_dot, charts, turns)
            settled = np.concatenate([y, y_dot, charts.T.ravel(), turns])
        far = [s for s in self._layout.charted if abs(np.cos(s.beta(y))) < np.cos(CHART_LIMIT)]
        if far:
            centred = self._layout.read(self._mechanism, self.state(settled))
            y, y_dot, charts = y.copy(), y_dot.copy(), charts.copy()
            for slot in far:
                y[slot.columns], y_dot[slot.columns] = centred[0][slot.columns], centred[1][slot.columns]
                charts[:, slot.chart] = centred[2][:, slot.chart]
            settled = np.concatenate([y, y_dot, charts.T.ravel(), turns])
        return settled

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3)."""
        y, y_dot, charts, turns = self._split(self.coordinates(state))
        y_ddot, _ = self._solve(y, self._evaluate(t, y, y_dot, charts, turns))
        a, alpha = self._acceleration(t, y, y_dot, charts, turns, y_ddot)
        return a.T, alpha.T

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return joint reactions on the successor, at the origin of M, axes of F, each shape (n_j, 3)."""
        y, y_dot, charts, turns = self._split(self.coordinates(state))
        y_ddot, lam = self._solve(y, self._evaluate(t, y, y_dot, charts, turns))
        z = np.zeros(6 * len(self._mechanism.joints))
        x, x_dot, x_ddot = (np.concatenate([part, z]) for part in (y, y_dot, y_ddot))
        (wrench,) = self._reaction(t, x, x_dot, charts, turns, x_ddot, lam)
        return wrench[:3].T, wrench[3:].T

    def _split(self, u: Array) -> tuple[Array, Array, Array, Array]:
        """Return y, y', charts (4, n_c) and turns of u."""
        n, c = self._layout.size, 4 * len(self._layout.charted)
        return u[:n], u[n : 2 * n], u[2 * n : 2 * n + c].reshape(-1, 4).T, u[2 * n + c :]

    def _evaluate(self, t: float, *coordinates: Array) -> _LagrangianTerms:
        """Evaluate the terms at the time t and the parts of u (see `_split`)."""
        M, f, g, Q, *rest = self._equations(t, *coordinates)
        return _LagrangianTerms(M, f[:, 0], g[:, 0], Q, *(value[:, 0] for value in rest))

    def _solve(self, y: Array, values: _LagrangianTerms) -> tuple[Array, Array]:
        """Solve for y'' and lam; NaN if the terms are not finite."""
        for slot in self._layout.charted:
            beta = slot.beta(y)
            if abs(np.cos(beta)) < NEAR_SINGULAR:
                name = self._mechanism.joints[slot.joint].name
                nearest = (np.floor(beta / np.pi) + 0.5) * np.pi
                raise SingularOrientation(f"joint '{name}'", "Bryant angles x-y-z in a chart", "beta", beta, nearest)
        if not (np.isfinite(values.M).all() and np.isfinite(values.Q).all()):
            return np.full(len(y), np.nan), np.full(len(values.g), np.nan)
        return _Factors(values).solve(values.f, values.gamma)

    def _project(self, t: float, y: Array, y_dot: Array, charts: Array, turns: Array) -> tuple[Array, Array, Array]:
        """Project y by Newton's method onto ``g = 0``, then y' onto ``g' = 0``, with least M-norm.

        Parameters
        ----------
        t : float, s
        y, y_dot : ndarray, shape (n,)
        charts : ndarray, shape (4, n_c)
        turns : ndarray, shape (n_theta,), rad
        """
        values = self._evaluate(t, y, y_dot, charts, turns)
        factors = _Factors(values)
        for _ in range(_POSITION_STEPS):
            moved = y + factors.step(-values.g)
            trial = self._evaluate(t, moved, y_dot, charts, turns)
            if np.max(np.abs(trial.g)) >= 0.5 * np.max(np.abs(values.g)):
                break
            y, values, factors = moved, trial, _Factors(trial)
        return y, y_dot + factors.step(-values.g_dot), values.counted
