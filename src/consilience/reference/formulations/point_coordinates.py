"""Point coordinates: particles instead of rigid bodies, momentum equations along chains [ATTIA].

Coordinates are the Cartesian coordinates of particles; there are none for rotation. Every body is replaced by ten
particles of the same inertia (`particles`), of which only 1, 2, 4 stay, and neighbours share particles where the joint
between them allows (`particle_chain`). The equations, for the second rates x'' of the own particles:

For each joint of the spanning tree, linear and angular momentum of **all bodies further out**, projected on the
directions along and about which the joint transmits nothing,

    e . sum_b sum_k m_k r_k''             = e . R            [ATTIA (16), (22), (25)]
    e . sum_b sum_k (r_k - c) x m_k r_k'' = e . G            [ATTIA (17), (20), (24)]

with the external forces R and their moments G about the origin c of the joint frame M (particle 1 of the body, unless
the tree passes the joint backwards). For example three moments at a ball, one about the axis of a revolute joint, one
force along a prismatic one; a floating body has all six, about its particle 1. These are as many equations as the tree
has freedoms, and forces inside the chain, those of its joints included, do not appear in them. The rest are the
constraints: distances of particles in a body, and rows of tree joints that sharing leaves [ATTIA (4), (21), (23)].

Loops are opened at cut joints. Their rows hold as constraints, too, and the momentum equations get their multipliers,

    A x'' = b + C lam,    Q x'' = gamma.

Rows may be dependent, C then has less than full column rank. With Z an orthonormal basis of the directions orthogonal
to all its columns,

    Z^T A x'' = Z^T b,    Q x'' = gamma

determines x'' whatever the rank; dependent rows of Q agree with one another, and least squares takes them all.
``C lam = A x'' - b`` gives the multipliers of least norm. No matrix ``Q M^-1 Q^T`` is formed, whose condition is a
square. The joint forces of the tree follow from the same momentum equations of all bodies further out, all six this
time [ATTIA, equation for N_P behind (17)].

A rod leaves two forces in directions of its own; it is counted as a cut joint, and a body that hangs on nothing but
rods as a floating one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.linalg import lstsq

from consilience.engine import Unsupported
from consilience.errors import InvalidInput
from consilience.mechanism import (
    RANK_TOLERANCE,
    Array,
    Mechanism,
    State,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from consilience.reference.bodies import forces
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.formulations.particle_chain import (
    VECTORS,
    ChainMotion,
    chain_model,
    combine,
    constraint_rows,
    generator_motion,
    motion,
    multiplier_wrenches,
)
from consilience.reference.formulations.particles import angular_rate, orientation

_NEWTON_STEPS = 4

_KNOWN = {"name", "gravity", "bodies", "joints", "springs", "joint_springs", "loads", "frictions", "controls"}
"""Fields of a mechanism that have a place in the equations; whatever else a mechanism may have is refused."""


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """What of a mechanism has no equation between particles here."""
    found = []
    for joint in mechanism.joints:
        if not set(joint.rows) <= set(VECTORS):
            reason = "its constraints are not all products of vectors between particles"
            found.append(Unsupported(f"joint '{joint.name}': kind {joint.kind}", reason))
    for field in fields(mechanism):
        if field.name not in _KNOWN and getattr(mechanism, field.name):
            reason = "they have no place in the momentum equations and constraints here"
            found.append(Unsupported(field.name.replace("_", " "), reason))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class _PointSolution:
    """Second rates and multipliers, with what they come from."""

    motion: ChainMotion
    xdd: Array  # (n_x,)
    wrenches: Array  # (n_c, 2, 6) of the cut joints, multiplied by their multipliers
    chain: Array  # (n_b, 6) force and moment about the world's origin that the inner side exerts on all further out


class PointCoordinates:
    """Equations of motion in coordinates of particles; see the head of this module.

    The vector u holds the positions of the own particles (n_x), their velocities (n_x), the joint coordinates that
    springs, friction and controllers read (n_c), whose angles are counted over full turns by it, and the integrals of
    controllers, zero at first.

    Raises
    ------
    InvalidInput
        If `unsupported` names anything.
    """

    name = "point_coordinates"

    def __init__(self, mechanism: Mechanism) -> None:
        for refusal in unsupported(mechanism):
            raise InvalidInput(refusal.feature, refusal.reason, "Choose another formulation.")
        self.mechanism = mechanism
        self.model = chain_model(mechanism)
        self._flat = flatten(mechanism)
        self._ws = workspace(self._flat)

    # ---------------------------------------------------------------- coordinates

    def coordinates(self, state: State) -> Array:
        """Coordinates u of a consistent state; angles of joints within half a turn of zero."""
        R = rotation_from_quaternion(state.quat_WB)
        drawn = self.model.drawn[:-1]
        local = np.stack([drawn[:, 0], drawn[:, 0] + drawn[:, 1], drawn[:, 0] + drawn[:, 2]], axis=1)
        arms = np.einsum("bij,bnj->bni", R, local)
        r = state.p_WB[:, None] + arms
        v = state.v_WB_W[:, None] + np.cross(state.w_WB_W[:, None], arms)
        own = [(b, n) for b in self.model.order for n in range(self.model.shared[b], 3)]
        pick = tuple(np.array(own, dtype=np.int64).reshape(-1, 2).T)
        read, _ = self._read(state, np.zeros(len(self._flat.coordinate)))
        return np.concatenate([r[pick].ravel(), v[pick].ravel(), read, np.zeros(len(self._flat.control))])

    def state(self, u: Array) -> State:
        """Poses from the triads of particles 1, 2, 4, and velocities of the bodies."""
        n_x = self.model.size
        return self._state(*generator_motion(self.model, u[:n_x], u[n_x : 2 * n_x]))

    def _state(self, G: Array, DG: Array) -> State:
        quat = quaternion_from_rotation(orientation(G[:-1], self.model.drawn[:-1]))
        v = DG[:-1, :, :, -2]
        return State(self._at_origins(G[:-1]), quat, self._at_origins(v), angular_rate(G[:-1], v))

    def _at_origins(self, values: Array) -> Array:
        """Positions (rates) of the bodies' origins from generators (their rates), shape (n_b, 3)."""
        return np.einsum("bg,bgk->bk", self.model.origin, values)

    def settle(self, t: float, u: Array) -> Array:
        """Bring distances, joints and closures back to their values, then velocities; count turns of joint angles.

        Steps of least norm in the coordinates, by Newton's method for positions.
        """
        n_x = self.model.size
        x, rate, extra = u[:n_x].copy(), u[n_x : 2 * n_x].copy(), u[2 * n_x :]
        if n_x:
            for _ in range(_NEWTON_STEPS):
                rows = constraint_rows(self.model, motion(self.model, x, rate))
                step = _least_norm(rows.D[:, :n_x], rows.value)
                x -= step
                if np.max(np.abs(step)) < 1e-10 * max(1.0, float(np.max(np.abs(x)))):
                    break  # quadratic convergence: the next step would be below rounding
            rows = constraint_rows(self.model, motion(self.model, x, rate))
            rate -= _least_norm(rows.D[:, :n_x], rows.D[:, n_x])
        settled = np.concatenate([x, rate, extra])
        read = slice(2 * n_x, 2 * n_x + len(self._flat.coordinate))
        settled[read], _ = self._read(self.state(settled), u[read])
        return settled

    # ---------------------------------------------------------------- motion

    def derivative(self, t: float, u: Array) -> Array:
        """Time derivative of u."""
        n_x = self.model.size
        m = motion(self.model, u[:n_x], u[n_x : 2 * n_x])
        state = self._state(m.G, m.DG)
        solution = self._solve(t, m, state, u[2 * n_x :])
        return np.concatenate([u[n_x : 2 * n_x], solution.xdd, self._extra_rates(t, state, u[2 * n_x :])])

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Accelerations a_WB_W of body origins, m/s^2, and alpha_WB_W, rad/s^2, world axes, each shape (n_b, 3)."""
        solution = self._at(state, t)
        DG = solution.motion.DG[:-1]
        second = DG[..., : self.model.size] @ solution.xdd + DG[..., -1]
        return self._at_origins(second), angular_rate(solution.motion.G[:-1], second)

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Joint forces (N) and torques (N m) on the successors, at the origin of M, axes of F, each shape (n_j, 3).

        Where dependent rows leave them open, multipliers of cut joints are of least norm and the tree balances them.
        """
        solution = self._at(state, t)
        model, m = self.model, solution.motion
        n_j = len(model.outer)
        wrench = np.zeros((n_j + 1, 6))
        np.add.at(wrench, model.rows[model.multiplied, 0], solution.wrenches[:, 1])
        tree = np.flatnonzero(model.outer >= 0)
        sign = np.where(model.reversed[tree], -1.0, 1.0)
        wrench[tree] = sign[:, None] * solution.chain[model.outer[tree]]
        force, at_M = wrench[:n_j, :3], m.marks[:n_j, 1, 0]
        moment = wrench[:n_j, 3:] - np.cross(at_M, force)
        axes = m.marks[:n_j, 0, 1:]
        return np.einsum("jak,jk->ja", axes, force), np.einsum("jak,jk->ja", axes, moment)

    def _at(self, state: State, t: float) -> _PointSolution:
        u, n_x = self.coordinates(state), self.model.size
        return self._solve(t, motion(self.model, u[:n_x], u[n_x : 2 * n_x]), state, u[2 * n_x :])

    # ---------------------------------------------------------------- equations

    def _solve(self, t: float, m: ChainMotion, state: State, extra: Array) -> _PointSolution:
        """Solve ``A x'' = b + C lam``, ``Q x'' = gamma``, and balance all bodies further out than each one."""
        model, n_x = self.model, self.model.size
        rows = constraint_rows(model, m)
        on_joints = multiplier_wrenches(model, m)
        rates = self._momentum_rates(m)
        cut = self._on_bodies(on_joints)
        outside = self._applied(t, state, extra) - rates[..., -1]
        balance = np.concatenate([rates[..., :n_x], -cut, -outside[..., None]], axis=2)  # [A | -C | -b]
        balance = np.tensordot(model.outboard, balance, 1)
        system = self._project(m, balance)
        A, C, b = system[:, :n_x], -system[:, n_x:-1], -system[:, -1]
        Z, lam_of = _split(C)
        xdd = _least_squares(np.vstack([Z.T @ A, rows.D[:, :n_x]]), np.concatenate([Z.T @ b, -rows.D[:, -1]]))
        lam = lam_of @ (A @ xdd - b)
        chain = balance @ np.concatenate([xdd, lam, [1.0]])
        return _PointSolution(m, xdd, lam[:, None, None] * on_joints, chain)

    def _momentum_rates(self, m: ChainMotion) -> Array:
        """D array of linear and angular momentum about the world's origin, shape (n_b, 6, n_x + 2) [ATTIA (5)-(8)].

        The column before the last holds the momenta themselves.
        """
        r = self.model.primary @ m.G[:-1]
        Dr = combine(self.model.primary, m.DG[:-1])
        A = self.model.mass @ r
        mbar = self.model.mass.sum(axis=1)
        linear = combine(mbar[:, None], Dr)[:, 0]
        angular = np.cross(A[..., None], Dr, axis=2).sum(axis=1)
        return np.concatenate([linear, angular], axis=1)

    def _project(self, m: ChainMotion, balance: Array) -> Array:
        """Momentum equations, each divided by its size, shape (d, columns of `balance`)."""
        model = self.model
        e, c = m.S[model.equation_joint, model.equation_vector], m.marks[model.equation_joint, 1, 0]
        floating = model.equation_joint == len(model.outer)
        c[floating] = m.G[model.equation_body[floating], 0]
        # e . (moment - c x force) about c, or e . force
        moment = model.equation_moment[:, None]
        onto = np.where(moment, np.hstack([np.cross(c, e), e]), np.hstack([e, np.zeros_like(e)]))
        system = (onto[:, None] @ balance[model.equation_body])[:, 0]
        return system / np.linalg.norm(system[:, : model.size], axis=1, keepdims=True)

    def _on_bodies(self, wrenches: Array) -> Array:
        """Wrenches of multipliers on the bodies they act on, shape (n_b, 6, n_c)."""
        model = self.model
        on = np.zeros((len(model.parent) + 1, len(wrenches), 6))
        bodies = model.frame_body[model.rows[model.multiplied, 0]]
        np.add.at(on, (bodies, np.arange(len(wrenches))[:, None]), wrenches)
        return np.swapaxes(on[:-1], 1, 2)

    # ---------------------------------------------------------------- applied forces, by the compiled kernels

    def _applied(self, t: float, state: State, extra: Array) -> Array:
        """Applied forces and their moments about the world's origin, R and G of ATTIA, shape (n_b, 6).

        The compiled forces act at the centre of mass, moments in body axes and with ``-w' x I' w'``; the particles
        bring that term themselves.
        """
        y, turns = self._packed(state, extra)
        forces.evaluate(self._flat, t, y, turns, self._ws)
        r, w = y[: len(self.mechanism.bodies), :3], y[: len(self.mechanism.bodies), 10:13]
        wrench = self._ws.f.reshape(-1, 6)
        Iw = np.einsum("bij,bj->bi", self._flat.inertia, w)
        torque = np.einsum("bij,bj->bi", self._ws.A, wrench[:, 3:] + np.cross(w, Iw))
        return np.hstack([wrench[:, :3], torque + np.cross(r, wrench[:, :3])])

    def _packed(self, state: State, extra: Array) -> tuple[Array, Array]:
        """State y of the compiled kernels, rotation matrices in the workspace, and joint coordinates that they read."""
        n_b, n_c = len(self.mechanism.bodies), len(self._flat.coordinate)
        y = pack(self.mechanism, state)
        y[n_b:].reshape(-1)[: len(extra) - n_c] = extra[n_c:]
        self._ws.A[:] = rotation_from_quaternion(state.quat_WB)
        return y, extra[:n_c]

    def _read(self, state: State, near: Array) -> tuple[Array, Array]:
        """Joint coordinates that elements read, angles within half a turn of `near`, and their rates, each (n_c,)."""
        y, _ = self._packed(state, near)
        value, rate = np.empty(len(near)), np.empty(len(near))
        forces.read(self._flat, y, self._ws.A, near, value, rate)
        return value, rate

    def _extra_rates(self, t: float, state: State, extra: Array) -> Array:
        """Rates of the joint coordinates, and control errors, which the controllers integrate."""
        y, turns = self._packed(state, extra)
        errors = np.zeros_like(y)
        forces.control_errors(self._flat, t, y, turns, self._ws, errors)
        count, n_b = len(self._flat.control), len(self.mechanism.bodies)
        return np.concatenate([self._read(state, turns)[1], errors[n_b:].reshape(-1)[:count]])


def _least_squares(rows: Array, values: Array) -> Array:
    """Solution of a system of full column rank with consistent, perhaps dependent rows."""
    if rows.shape[0] == rows.shape[1]:
        return np.linalg.solve(rows, values)
    return lstsq(rows, values, lapack_driver="gelsy", check_finite=False)[0]


def _least_norm(rows: Array, values: Array) -> Array:
    """Solution of least norm; rows may be dependent."""
    return lstsq(rows, values, cond=RANK_TOLERANCE, lapack_driver="gelsy", check_finite=False)[0]


def _split(C: Array) -> tuple[Array, Array]:
    """Basis Z of the complement of the columns of C, shape (d, d - r), and its pseudoinverse, shape (n_c, d)."""
    U, s, Vt = np.linalg.svd(C)
    r = int(np.sum(s > RANK_TOLERANCE * np.max(s, initial=0.0)))
    return U[:, r:], Vt[:r].T @ (U[:, :r] / s[:r]).T
