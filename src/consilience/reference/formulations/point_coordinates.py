"""Point coordinates: particles instead of rigid bodies, momentum equations along chains [ATTIA].

Coordinates are Cartesian coordinates of particles; there are no rotational coordinates. Every body is replaced by ten
particles of the same inertia (`particles`), of which 1, 2, 4 remain; neighbours share particles of the joint between
them (`particle_chain`). Equations for the second rates x'' of the coordinates:

For each tree joint, rates of linear and angular momentum of **all outboard bodies**, projected on the directions e in
which the joint transmits no force or moment,

    e . sum_b sum_k m_k r_k''             = e . R            [ATTIA (16), (22), (25)]
    e . sum_b sum_k (r_k - c) x m_k r_k'' = e . G            [ATTIA (17), (20), (24)]

with the external forces R and their moments G about the origin c of the joint frame M (particle 1 of the body, unless
the tree passes the joint from successor to predecessor): three moments at a spherical joint, one about the axis of a
revolute joint, one force along a prismatic joint; a floating body has all six, about its particle 1. There are as many
equations as degrees of freedom of the tree; internal and joint forces of the chain do not appear. The other equations
are constraints: distances of particles of a body, and rows of tree joints not satisfied by sharing [ATTIA (4), (21),
(23)].

Loops are cut. The rows of cut joints are constraints, too, and their multipliers enter the momentum equations,

    A x'' = b + C lam,    Q x'' = gamma.

For dependent rows C does not have full column rank. With an orthonormal basis Z of the complement of its columns,

    Z^T A x'' = Z^T b,    Q x'' = gamma

determines x'' for any rank; dependent rows of Q are consistent, and least squares includes all. ``C lam = A x'' - b``
gives the multipliers of least norm. ``Q M^-1 Q^T``, whose condition number is a square, is not formed. Reactions of
tree joints follow from all six momentum equations of the outboard bodies [ATTIA, equation for N_P after (17)].

Off the manifold, in the stages of a step, dependent rows look independent. Ranks follow there from the freedom f that
the last projection found: n_x - f of Q, and d - f of C for d momentum equations.

A rod is a cut joint, since its free directions are not axes of F or M; a body on rods alone is a floating body.
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
from consilience.reference.bodies.arrays import P, R, W, pack
from consilience.reference.formulations.body_terms import BodyTerms, Terms
from consilience.reference.formulations.particle_chain import (
    VECTORS,
    ChainConstraints,
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
"""Fields of a mechanism that the equations represent; other fields are refused."""


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """List the features of a mechanism that the formulation cannot represent, with reasons."""
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
    """Second rates, multiplier wrenches and chain wrenches at a motion."""

    motion: ChainMotion
    xdd: Array  # (n_x,)
    wrenches: Array  # (n_c, 2, 6) of the multipliers, on predecessor and successor
    chain: Array  # (n_b, 6) force and moment about the world origin on each body and its outboard bodies


class PointCoordinates:
    """Formulation in coordinates of particles, see the module docstring.

    Coordinates u: positions (n_x) and velocities (n_x) of the particles that are not shared, turns (n_c), the joint
    coordinates that elements read, and the integrals of controllers, initially zero.

    Attributes
    ----------
    chart : int
        Freedom of the coordinates; `coordinates` and `settle` change it.

    Raises
    ------
    InvalidInput
        If `unsupported` lists a feature.
    """

    name = "point_coordinates"

    def __init__(self, mechanism: Mechanism) -> None:
        for refusal in unsupported(mechanism):
            raise InvalidInput(refusal.feature, refusal.reason, "Choose another formulation.")
        self.mechanism = mechanism
        self.model = chain_model(mechanism)
        self._terms = BodyTerms(mechanism)
        self.chart = self.model.size

    # ---------------------------------------------------------------- coordinates

    def coordinates(self, state: State) -> Array:
        """Return coordinates u of a consistent state, shape (n_u,); turns within half a turn of zero."""
        R = rotation_from_quaternion(state.quat_WB)
        drawn = self.model.drawn[:-1]
        local = np.stack([drawn[:, 0], drawn[:, 0] + drawn[:, 1], drawn[:, 0] + drawn[:, 2]], axis=1)
        arms = np.einsum("bij,bnj->bni", R, local)
        r = state.p_WB[:, None] + arms
        v = state.v_WB_W[:, None] + np.cross(state.w_WB_W[:, None], arms)
        own = [(b, n) for b in self.model.order for n in range(self.model.shared[b], 3)]
        pick = tuple(np.array(own, dtype=np.int64).reshape(-1, 2).T)
        turns = self._turns(state, np.zeros(self._terms.turns))
        x, rate = r[pick].ravel(), v[pick].ravel()
        self.chart = self._freedom(constraint_rows(self.model, motion(self.model, x, rate)))
        return np.concatenate([x, rate, turns, np.zeros(self._terms.integrals)])

    def state(self, u: Array) -> State:
        """Return the canonical state of u: poses from the triads of particles 1, 2, 4."""
        n_x = self.model.size
        return self._state(*generator_motion(self.model, u[:n_x], u[n_x : 2 * n_x]))

    def _state(self, G: Array, DG: Array) -> State:
        quat = quaternion_from_rotation(orientation(G[:-1], self.model.drawn[:-1]))
        v = DG[:-1, :, :, -2]
        return State(self._at_origins(G[:-1]), quat, self._at_origins(v), angular_rate(G[:-1], v))

    def _at_origins(self, values: Array) -> Array:
        """Return positions (or rates) of the body origins from generators (or their rates), shape (n_b, 3)."""
        return np.einsum("bg,bgk->bk", self.model.origin, values)

    def settle(self, t: float, u: Array) -> Array:
        """Project u onto the constraints: positions by Newton's method, then velocities; count full turns.

        Corrections are of least Euclidean norm in the coordinates.
        """
        n_x = self.model.size
        x, rate, extra = u[:n_x].copy(), u[n_x : 2 * n_x].copy(), u[2 * n_x :]
        if n_x:
            for _ in range(_NEWTON_STEPS):
                rows = constraint_rows(self.model, motion(self.model, x, rate))
                step = _least_norm(rows.D[:, :n_x], rows.value, n_x - self.chart)
                x -= step
                if np.max(np.abs(step)) < 1e-10 * max(1.0, float(np.max(np.abs(x)))):
                    break  # quadratic convergence: the next step is below rounding
            rows = constraint_rows(self.model, motion(self.model, x, rate))
            self.chart = self._freedom(rows)
            rate -= _least_norm(rows.D[:, :n_x], rows.D[:, n_x], n_x - self.chart)
        settled = np.concatenate([x, rate, extra])
        turns = slice(2 * n_x, 2 * n_x + self._terms.turns)
        settled[turns] = self._turns(self.state(settled), u[turns])
        return settled

    # ---------------------------------------------------------------- motion

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt`` at the time t, shape (n_u,)."""
        n_x = self.model.size
        m = motion(self.model, u[:n_x], u[n_x : 2 * n_x])
        y, terms = self._evaluate(t, self._state(m.G, m.DG), u[2 * n_x :])
        solution = self._solve(m, self._applied(y, terms))
        return np.concatenate([u[n_x : 2 * n_x], solution.xdd, terms.turn_rates, terms.integral_rates])

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3)."""
        solution = self._at(state, t)
        DG = solution.motion.DG[:-1]
        second = DG[..., : self.model.size] @ solution.xdd + DG[..., -1]
        return self._at_origins(second), angular_rate(solution.motion.G[:-1], second)

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return joint reactions on the successor, at the origin of M, axes of F, each shape (n_j, 3).

        Multipliers of dependent rows are of least norm; reactions of tree joints balance them.
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
        """Solve the equations at a state."""
        u, n_x = self.coordinates(state), self.model.size
        applied = self._applied(*self._evaluate(t, state, u[2 * n_x :]))
        return self._solve(motion(self.model, u[:n_x], u[n_x : 2 * n_x]), applied)

    # ---------------------------------------------------------------- equations

    def _solve(self, m: ChainMotion, applied: Array) -> _PointSolution:
        """Solve ``A x'' = b + C lam``, ``Q x'' = gamma``; balance the outboard bodies of every tree joint."""
        model, n_x = self.model, self.model.size
        rows = constraint_rows(model, m)
        on_joints = multiplier_wrenches(model, m)
        rates = self._momentum_rates(m)
        cut = self._on_bodies(on_joints)
        outside = applied - rates[..., -1]
        balance = np.concatenate([rates[..., :n_x], -cut, -outside[..., None]], axis=2)  # [A | -C | -b]
        balance = np.tensordot(model.outboard, balance, 1)
        system = self._project(m, balance)
        A, C, b = system[:, :n_x], -system[:, n_x:-1], -system[:, -1]
        Z, lam_of = _split(C, len(C) - self.chart)
        xdd = _least_squares(np.vstack([Z.T @ A, rows.D[:, :n_x]]), np.concatenate([Z.T @ b, -rows.D[:, -1]]))
        lam = lam_of @ (A @ xdd - b)
        chain = balance @ np.concatenate([xdd, lam, [1.0]])
        return _PointSolution(m, xdd, lam[:, None, None] * on_joints, chain)

    def _freedom(self, rows: ChainConstraints) -> int:
        """Return the freedom of the coordinates, from the rank of consistent rows."""
        n_x = self.model.size
        return n_x - _rank(np.linalg.svd(rows.D[:, :n_x], compute_uv=False), n_x)

    def _momentum_rates(self, m: ChainMotion) -> Array:
        """Return the D array of linear and angular momentum about the world origin, (n_b, 6, n_x + 2) [ATTIA (5)-(8)].

        The column before the last holds the momenta.
        """
        r = self.model.primary @ m.G[:-1]
        Dr = combine(self.model.primary, m.DG[:-1])
        A = self.model.mass @ r
        mbar = self.model.mass.sum(axis=1)
        linear = combine(mbar[:, None], Dr)[:, 0]
        angular = np.cross(A[..., None], Dr, axis=2).sum(axis=1)
        return np.concatenate([linear, angular], axis=1)

    def _project(self, m: ChainMotion, balance: Array) -> Array:
        """Project the balance on the momentum equations, each divided by its norm, shape (d, columns of `balance`)."""
        model = self.model
        body, joint, vector, angular = model.equation.T
        e, c = m.S[joint, vector], m.marks[joint, 1, 0]
        floating = joint == len(model.outer)
        c[floating] = m.G[body[floating], 0]
        # e . (moment - c x force) about c, or e . force
        onto = np.where(angular[:, None], np.hstack([np.cross(c, e), e]), np.hstack([e, np.zeros_like(e)]))
        system = (onto[:, None] @ balance[body])[:, 0]
        return system / np.linalg.norm(system[:, : model.size], axis=1, keepdims=True)

    def _on_bodies(self, wrenches: Array) -> Array:
        """Distribute the wrenches of multipliers to the bodies, shape (n_b, 6, n_c)."""
        model = self.model
        on = np.zeros((len(model.parent) + 1, len(wrenches), 6))
        bodies = model.frame_body[model.rows[model.multiplied, 0]]
        np.add.at(on, (bodies, np.arange(len(wrenches))[:, None]), wrenches)
        return np.swapaxes(on[:-1], 1, 2)

    # ---------------------------------------------------------------- applied forces, by the compiled kernels

    def _evaluate(self, t: float, state: State, extra: Array) -> tuple[Array, Terms]:
        """Evaluate the terms of the bodies at a state; return the packed state, too."""
        y = pack(self.mechanism, state)
        self._terms.integrals_of(y)[:] = extra[self._terms.turns :]
        return y, self._terms.evaluate(t, y, extra[: self._terms.turns], state.R_WB)

    def _applied(self, y: Array, terms: Terms) -> Array:
        """Return applied forces and moments about the world origin, R and G of ATTIA, shape (n_b, 6).

        The gyroscopic term ``-w' x I' w'`` of the compiled torques is removed: particles have none.
        """
        r, w = y[: len(self.mechanism.bodies), R], y[: len(self.mechanism.bodies), W]
        wrench = terms.f.reshape(-1, 6)
        Iw = np.einsum("bij,bj->bi", self._terms.inertia, w)
        torque = np.einsum("bij,bj->bi", rotation_from_quaternion(y[: len(r), P]), wrench[:, 3:] + np.cross(w, Iw))
        return np.hstack([wrench[:, :3], torque + np.cross(r, wrench[:, :3])])

    def _turns(self, state: State, near: Array) -> Array:
        """Return the joint coordinates that elements read, angles within half a turn of `near`, shape (n_c,)."""
        return self._terms.read(pack(self.mechanism, state), state.R_WB, near)


def _least_squares(rows: Array, values: Array) -> Array:
    """Solve a system of full column rank whose rows are consistent and may be dependent."""
    if rows.shape[0] == rows.shape[1]:
        return np.linalg.solve(rows, values)
    return lstsq(rows, values, lapack_driver="gelsy", check_finite=False)[0]


def _rank(singular_values: Array, limit: int) -> int:
    """Return the numerical rank, at most `limit`."""
    return min(limit, int(np.sum(singular_values > RANK_TOLERANCE * np.max(singular_values, initial=0.0))))


def _least_norm(rows: Array, values: Array, rank: int) -> Array:
    """Return the solution of least norm of rows of a rank."""
    U, s, Vt = np.linalg.svd(rows, full_matrices=False)
    r = _rank(s, rank)
    solution: Array = Vt[:r].T @ (U[:, :r].T @ values / s[:r])
    return solution


def _split(C: Array, rank: int) -> tuple[Array, Array]:
    """Return a basis Z of the complement of the columns of C, (d, d - r), and the pseudoinverse of C, (n_c, d)."""
    U, s, Vt = np.linalg.svd(C)
    r = _rank(s, rank)
    return U[:, r:], Vt[:r].T @ (U[:, :r] / s[:r]).T
