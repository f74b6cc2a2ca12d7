"""Full descriptor form, index 1, in positions and orientation coordinates x = (r, x_R) of bodies [C4 (4.84)-(4.97)].

With ``w = H_R x_R'``, ``dw/dt = H_R x_R'' + h`` [C4 (4.55)-(4.56)], ``H = diag(1, H_R)`` over all bodies and the rows
``Q_x = Q H``, ``Q_x x'' = gamma_x = gamma - Q (0, h)``:

    plain         M H x''     + q_v     = q_a       + Q^T lam       [C4 (4.59), (4.96)]
    symmetrised   H^T M H x'' + H^T q_v = H^T q_a   + Q_x^T lam     [C4 (4.68), (4.97)],    q_v = M (0, h) + (0, ~w I w)

Each form is one saddle-point system in (x'', lam): plain unsymmetric, symmetrised symmetric. Rotational lines are those
of the source times A^T, in body axes: ``A^T H_R`` for H_R, ``A^T h`` for h, and M = diag(m 1, I') is constant.

Euler parameters add a row ``p.p'' = -p'.p'`` per body [MASS (38)]. The plain form needs no multiplier for it; in the
symmetrised form, where p is in the null space of H^T M H, the row has a multiplier, which vanishes.

Only independent rows, found by a rank-revealing QR, enter the system. Accelerations do not depend on the choice;
multipliers are then converted to those of least norm.

Coordinates u: x of all bodies, x' of all bodies, integrals of controllers, and turns (the joint coordinates that
elements read).

Singular orientations: Euler and Bryant angles raise `SingularOrientation`. A rotation vector is replaced by its
complement beyond half a turn; Rodrigues parameters get a new reference orientation beyond a quarter turn
(``R_WB = R(g) R_reference``, still w = H g'). `chart` records both, and the rows that are kept within a step.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from consilience.engine import Unsupported
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    quaternion_from_rotation,
    quaternion_product,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)
from consilience.reference.bodies.arrays import P, R, V, W, pack, unpack
from consilience.reference.bodies.canonical import at_origins, joint_wrenches
from consilience.reference.formulations.body_terms import BodyTerms, Terms, least_norm_multipliers
from consilience.reference.formulations.orientations import NEAR_SINGULAR, ORIENTATIONS, switch_chart
from consilience.reference.formulations.row_selection import RowSelection
from consilience.reference.formulations.stabilisation import Stabilisation, right_hand_side

Chart = tuple[int, tuple[tuple[float, ...], ...], RowSelection]
"""Number of changes of orientation coordinates, Euler parameters of the reference orientations of Rodrigues parameters,
and the selected independent rows."""

_NEWTON_STEPS = 4
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


class Variant(NamedTuple):
    """Options of a descriptor form in orientation coordinates."""

    orientation: str  # key of `orientations.ORIENTATIONS`
    mass: Literal["plain", "symmetrised"]
    stabilisation: Stabilisation


VARIANTS: dict[str, Variant] = {
    **{f"descriptor_{kind}": Variant(kind, "symmetrised", "projection") for kind in ORIENTATIONS},
    **{f"descriptor_{kind}_plain": Variant(kind, "plain", "projection") for kind in ORIENTATIONS},
    "descriptor_baumgarte": Variant("euler_parameters", "symmetrised", "baumgarte"),
    "descriptor_unprojected": Variant("euler_parameters", "symmetrised", "none"),
}
"""Forms by name."""


def unsupported(_mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Return nothing: the forms represent every joint and element."""
    return ()


class _BodyMotion(NamedTuple):
    """Motion of all bodies at coordinates u."""

    A: Array  # (n_b, 3, 3)
    H: Array  # (n_b, 3, n) in w' = H x_R'
    h: Array  # (n_b, 3) in dw'/dt = H x_R'' + h
    y: Array  # (n_b + n_e, 13) packed, without Euler parameters
    turns: Array  # (n_c,)


class DescriptorForm:
    """Full descriptor form of one mechanism in orientation coordinates.

    Parameters
    ----------
    mechanism : Mechanism
    name : str
        Key of `VARIANTS`.

    Attributes
    ----------
    chart : Chart
        Chart of the orientation coordinates in u, and the rows; `coordinates` and `settle` change it.
    """

    def __init__(self, mechanism: Mechanism, name: str) -> None:
        self.name, self._variant = name, VARIANTS[name]
        self.chart: Chart = (0, ((1.0, 0.0, 0.0, 0.0),) * len(mechanism.bodies), ())
        self._mechanism = mechanism
        self._orientation = ORIENTATIONS[self._variant.orientation]
        self._normed = self._orientation.size == 4
        self._terms = BodyTerms(mechanism)
        self._names = [b.name for b in mechanism.bodies]
        self._n_b, self._k = len(mechanism.bodies), 3 + self._orientation.size
        self._n = self._n_b * self._k
        # H of all bodies but for the blocks H_R
        self._identity = np.zeros((self._n_b, 6, self._n_b, self._k))
        for b in range(self._n_b):
            self._identity[b, :3, b, :3] = np.eye(3)

    # ------------------------------------------------------------ coordinates

    def coordinates(self, state: State) -> Array:
        """Return the coordinates u of a state, shape (n_u,), turns within half a turn of zero.

        Raises
        ------
        SingularOrientation
            If the orientation of a body is singular in the coordinates.
        """
        y = pack(self._mechanism, state)
        x_R = [self._orientation.from_quaternion(self._relative(b, y[b, P]), n) for b, n in enumerate(self._names)]
        turns = self._terms.count_turns(y, np.zeros(self._terms.turns))
        self._terms.evaluate(0.0, y, turns)
        self.chart = (*self.chart[:2], tuple(self._terms.independent_rows().tolist()))
        return self._from_packed(y, np.array(x_R), turns)

    def _relative(self, b: int, quat: Array) -> Array:
        """Return the Euler parameters of body b relative to its reference orientation."""
        reference = self.chart[1][b]
        if reference[0] == 1.0:
            return quat
        return quaternion_product(quat, _CONJUGATE * reference)

    def _from_packed(self, y: Array, x_R: Array, turns: Array) -> Array:
        """Return u of a packed state y, orientation coordinates x_R and turns."""
        n_b = self._n_b
        x, x_dot = np.empty((n_b, self._k)), np.empty((n_b, self._k))
        A = rotation_from_quaternion(y[:n_b, P])
        w = np.einsum("bij,bj->bi", A, y[:n_b, W])
        x[:, :3], x[:, 3:], x_dot[:, :3] = y[:n_b, R], x_R, y[:n_b, V]
        for b, name in enumerate(self._names):
            x_dot[b, 3:] = self._orientation.rates(x_R[b], w[b], name)
        return np.concatenate([x.ravel(), x_dot.ravel(), self._terms.integrals_of(y), turns])

    def _positions(self, u: Array) -> Array:
        return u[: self._n].reshape(self._n_b, self._k)

    def _speeds(self, u: Array) -> Array:
        return u[self._n : 2 * self._n].reshape(self._n_b, self._k)

    def _rotations(self, x: Array) -> Array:
        """Return the rotation matrices R_WB of all bodies, shape (n_b, 3, 3)."""
        x_R = x[:, 3:]
        if self._normed:  # within a step the norm differs from one by the local error
            return rotation_from_quaternion(x_R / np.linalg.norm(x_R, axis=1)[:, None])
        A = np.array([self._orientation.rotation(part) for part in x_R])
        return A if self.chart[0] == 0 else A @ rotation_from_quaternion(self.chart[1])

    def _motion(self, u: Array) -> _BodyMotion:
        """Evaluate the motion of all bodies at u, rotational quantities in body axes."""
        n_b, kind = self._n_b, self._orientation
        x, x_dot = self._positions(u), self._speeds(u)
        H, h = np.empty((n_b, 3, kind.size)), np.empty((n_b, 3))
        for b in range(n_b):
            x_R = x[b, 3:]
            H[b], h[b] = kind.H(x_R), kind.h(x_R, x_dot[b, 3:])
        A = self._rotations(x)
        H, h = np.swapaxes(A, 1, 2) @ H, np.einsum("bji,bj->bi", A, h)
        integrals = u[2 * self._n : 2 * self._n + self._terms.integrals]
        y = np.zeros((n_b + -(-len(integrals) // 13), 13))
        y[:n_b, R], y[:n_b, V] = x[:, :3], x_dot[:, :3]
        y[:n_b, W] = np.einsum("bij,bj->bi", H, x_dot[:, 3:])
        self._terms.integrals_of(y)[:] = integrals
        return _BodyMotion(A, H, h, y, u[2 * self._n + len(integrals) :])

    def _packed(self, u: Array) -> tuple[Array, Array]:
        """Return the packed state of u with unit Euler parameters, and the turns."""
        motion, x_R = self._motion(u), self._positions(u)[:, 3:]
        y = motion.y
        y[: self._n_b, P] = (
            x_R / np.linalg.norm(x_R, axis=1)[:, None] if self._normed else quaternion_from_rotation(motion.A)
        )
        return y, motion.turns

    def state(self, u: Array) -> State:
        """Return the canonical state of coordinates u."""
        return State(*unpack(self._mechanism, self._packed(u)[0]))

    # ------------------------------------------------------------ equations

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt`` at the time t, shape (n_u,); NaN at a singular orientation, so that the step is rejected."""
        distances = [self._orientation.distance_to_singularity(x_R) for x_R in self._positions(u)[:, 3:]]
        if not min(distances) >= NEAR_SINGULAR:
            return np.full(len(u), np.nan)
        motion = self._motion(u)
        terms = self._terms.evaluate(t, motion.y, motion.turns, motion.A)
        second = self._solve(u, motion, terms)[0]
        return np.concatenate([u[self._n : 2 * self._n], second, terms.integral_rates, terms.turn_rates])

    def _solve(self, u: Array, motion: _BodyMotion, terms: Terms) -> tuple[Array, Array]:
        """Solve for x'', shape (n,), and the constraint force ``Q^T lam = M (H x'' + h) - f``, shape (6 n_b,)."""
        n_b, n = self._n_b, self._n
        blocks = self._identity.copy()
        for b in range(n_b):
            blocks[b, 3:, b, 3:] = motion.H[b]
        H, h = blocks.reshape(6 * n_b, n), np.hstack([np.zeros((n_b, 3)), motion.h]).reshape(-1)
        rows = list(self.chart[2]) or self._terms.independent_rows()
        Q = terms.Q[rows]
        velocity = motion.y[:n_b, 7:].reshape(-1)
        drift, residual = Q @ velocity - terms.rate[rows], terms.value[rows]
        gamma = right_hand_side(self._variant.stabilisation, terms.gamma[rows] - Q @ h, drift, residual)
        Q_x, MH, f = Q @ H, self._terms.mass @ H, terms.f - self._terms.mass @ h
        norm, norm_right = self._norm_rows(u)
        if self._variant.mass == "plain":
            force = np.vstack([Q.T, np.zeros((len(norm), len(rows)))])
            second = _saddle_point(np.vstack([MH, norm]), force, np.concatenate([f, norm_right]), Q_x, gamma)
        else:
            Q_x, gamma = np.vstack([Q_x, norm]), np.concatenate([gamma, norm_right])
            second = _saddle_point(H.T @ MH, Q_x.T, H.T @ f, Q_x, gamma)
        return second, MH @ second - f

    def _norm_rows(self, u: Array) -> tuple[Array, Array]:
        """Return the rows ``p.p'' = -p'.p'`` of Euler parameters, stabilised like all rows."""
        if not self._normed:
            return np.zeros((0, self._n)), np.zeros(0)
        p, p_dot = self._positions(u)[:, 3:], self._speeds(u)[:, 3:]
        rows = np.zeros((self._n_b, self._n_b, self._k))
        for b in range(self._n_b):
            rows[b, b, 3:] = p[b]
        rate, value = np.sum(p * p_dot, axis=1), 0.5 * (np.sum(p * p, axis=1) - 1.0)
        right = right_hand_side(self._variant.stabilisation, -np.sum(p_dot * p_dot, axis=1), rate, value)
        return rows.reshape(self._n_b, self._n), right

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3)."""
        motion, second, _, _ = self._at(state, t)
        x_ddot = second.reshape(self._n_b, self._k)
        a = np.hstack([x_ddot[:, :3], np.einsum("bij,bj->bi", motion.H, x_ddot[:, 3:]) + motion.h])
        return at_origins(self._mechanism, pack(self._mechanism, state), a)

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return joint reactions of least norm on the successor, at the origin of M, axes of F, each shape (n_j, 3)."""
        _, _, force, terms = self._at(state, t)
        wrenches = joint_wrenches(self._mechanism, state, least_norm_multipliers(terms.Q, force))
        return wrenches[:, :3], wrenches[:, 3:]

    def _at(self, state: State, t: float) -> tuple[_BodyMotion, Array, Array, Terms]:
        """Evaluate motion, x'', constraint force and terms at a state."""
        u = self.coordinates(state)
        motion = self._motion(u)
        terms = self._terms.evaluate(t, motion.y, motion.turns, motion.A)
        return motion, *self._solve(u, motion, terms), terms

    # ------------------------------------------------------------ after a step

    def settle(self, t: float, u: Array) -> Array:
        """Return u after an accepted step as a new array: projected (if chosen), turns counted, charts changed.

        Raises
        ------
        SingularOrientation
            If the orientation of a body has become singular in the coordinates.
        """
        for b, name in enumerate(self._names):
            self._orientation.rates(self._positions(u)[b, 3:], np.zeros(3), name)
        y, turns = self._packed(u)
        if self._variant.stabilisation == "projection":
            rows = self._terms.project(t, y, turns)
            u = self._from_packed(y, self._continued(u, y), turns)
        else:
            u = u.copy()
            self._terms.evaluate(t, y, turns)
            rows = self._terms.independent_rows(len(self.chart[2]) or None)
        self.chart = (*self.chart[:2], self._terms.kept_rows(rows, self.chart[2]))
        u[len(u) - len(turns) :] = self._terms.count_turns(y, turns)
        return self._change_charts(u, y)

    def _continued(self, u: Array, y: Array) -> Array:
        """Return the orientation coordinates of y nearest to those of u, continuous over full turns, shape (n_b, size).

        Newton's method from u: the remaining rotation is an angular velocity acting for a unit of time.
        """
        if self._normed:
            return y[: self._n_b, P]
        x, wanted = self._positions(u).copy(), rotation_from_quaternion(y[: self._n_b, P])
        for _ in range(_NEWTON_STEPS):
            left = wanted @ np.swapaxes(self._rotations(x), 1, 2)
            rotations = [rotation_vector_from_quaternion(quaternion_from_rotation(part)) for part in left]
            for b, name in enumerate(self._names):
                x[b, 3:] += self._orientation.rates(x[b, 3:], rotations[b], name)
            if np.max(np.abs(rotations)) < 1e-8:  # quadratic convergence: the next step is below rounding
                break
        return x[:, 3:]

    def _change_charts(self, u: Array, y: Array) -> Array:
        """Change the charts of rotation vectors and Rodrigues parameters that approach their singularity."""
        x, x_dot = self._positions(u), self._speeds(u)
        references, count = list(self.chart[1]), 0
        for b in range(self._n_b):
            if self._variant.orientation == "rotation_vector":
                new, x_dot[b, 3:] = switch_chart(x[b, 3:], x_dot[b, 3:])
                count += int(not np.array_equal(new, x[b, 3:]))
                x[b, 3:] = new
            elif self._variant.orientation == "rodrigues_parameters" and x[b, 3:] @ x[b, 3:] > 1.0:
                w = self._orientation.H(x[b, 3:]) @ x_dot[b, 3:]
                references[b] = tuple(y[b, P].tolist())
                x[b, 3:], x_dot[b, 3:] = 0.0, 0.5 * w
                count += 1
        if count:
            self.chart = (self.chart[0] + count, tuple(references), self.chart[2])
        return u


def _saddle_point(top: Array, force: Array, right: Array, rows: Array, gamma: Array) -> Array:
    """Solve ``[top  -force; rows  0] [x''; lam] = [right; gamma]`` for x'', shape (n,); independent rows.

    Parameters
    ----------
    top : ndarray, shape (n, n)
    force : ndarray, shape (n, q)
    right : ndarray, shape (n,)
    rows : ndarray, shape (q, n)
    gamma : ndarray, shape (q,)
    """
    n, q = len(right), len(gamma)
    K = np.zeros((n + q, n + q))
    K[:n, :n], K[:n, n:], K[n:, :n] = top, -force, rows
    return np.linalg.solve(K, np.concatenate([right, gamma]))[:n]
