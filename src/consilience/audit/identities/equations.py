"""Neutral equations of motion at one state, their sensitivity to rounding, and the bars that follow.

Newton-Euler equations of every body about its origin, in accelerations x of all bodies, with the constraint rows Q of
`consilience.mechanism.constraints` and multipliers mu (minus the constraint forces):

    M x + Q^T mu = b,   Q x = gamma

Vectors are scaled by the characteristic length L of the mechanism, so that forces compare with torques and points with
angles: a motion is ``(a, L alpha)``, a wrench ``(F, T / L)``, all in axes of the world.

Bars. Rounding each number of these equations once, relative to its size, leaves residuals of up to
``eps (|M| |x| + |Q^T| |mu| + size(b))`` and ``eps (|Q| |x| + size(gamma))``, and moves the solution by up to the
inverse of the matrix, entry by entry in magnitude, times these residuals [Bauer and Skeel; N. J. Higham, Accuracy and
Stability of Numerical Algorithms, 2nd ed., section 7.2]. An engine rounds `ROUNDINGS` times along each body between the
data and an answer. A bar consists of that number, eps and the sizes alone. Sizes are those of this module's dense
solution, never an engine's: a wrong engine must not widen its own bar.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from consilience.engine import Route
from consilience.mechanism import (
    GROUND,
    RANK_TOLERANCE,
    Array,
    Mechanism,
    State,
    Wrenches,
    applied_wrenches,
    body_point,
    centres_of_mass,
    characteristic_length,
    constraint_gamma,
    constraint_jacobian,
    cross,
    determinate_reactions,
    joint_frames,
    mass_matrix,
    null_space,
    reaction_map,
)

EPS = float(np.finfo(float).eps)

ROUNDINGS = 64
"""Roundings in series for each body. From one body to the next an engine rotates and adds a pose, a velocity, an
acceleration, an inertia and a wrench: each two rotations (five operations a component each) and a product or two, some
sixty operations in all."""

ROUTE_ERROR = {Route.EXTRAPOLATED: 1e-8}
"""Relative error of accelerations that a route declares (docs/verdicts.md), beyond rounding."""


@dataclass(frozen=True, eq=False)
class ScaledSolution:
    """A scaled solution of the equations, with the sizes that bound its errors.

    Attributes
    ----------
    x : ndarray, shape (6 n_b,)
    mu : ndarray, shape (q,)
    terms : ndarray, shape (6 n_b,)
        ``|M| |x| + |Q^T| |mu| + size(b)``, the size of a residual of the balance: for each body the length of its six
        components, because rotations of axes mix them.
    rows : ndarray, shape (q,)
        ``|Q| |x| + size(gamma)``, with lengths by body as well.
    """

    x: Array
    mu: Array
    terms: Array
    rows: Array


@dataclass(frozen=True, eq=False)
class Equations:
    """Scaled equations of a mechanism in a consistent state."""

    mechanism: Mechanism
    state: State

    @cached_property
    def length(self) -> float:
        """Characteristic length L of the mechanism, m."""
        return characteristic_length(self.mechanism)

    @cached_property
    def motion_scale(self) -> Array:
        """Factors of ``(a, alpha)`` of each body, shape (6 n_b,); wrenches are divided by these factors."""
        return np.tile([1.0] * 3 + [self.length] * 3, len(self.mechanism.bodies))

    @cached_property
    def guard(self) -> float:
        """``eps`` times the roundings in series.

        Positions count from an origin that may be far, and their rounding moves arms by that much more; another
        description may move the world by another length L.
        """
        away = 2.0 + float(np.max(np.linalg.norm(self.state.p_WB, axis=1))) / self.length
        return ROUNDINGS * len(self.mechanism.bodies) * away * EPS

    def motion(self, linear: Array, angular: Array) -> Array:
        """Return the scaled vector (6 n_b,) of linear and angular parts (n_b, 3)."""
        return np.hstack([linear, angular]).ravel() * self.motion_scale

    def unscaled(self, wrench: Array) -> Array:
        """Return forces and torques about the origins, shape (n_b, 6), of a scaled wrench."""
        return (wrench * self.motion_scale).reshape(-1, 6)

    @cached_property
    def velocity(self) -> Array:
        """Scaled velocities, shape (6 n_b,)."""
        return self.motion(self.state.v_WB_W, self.state.w_WB_W)

    @cached_property
    def speed(self) -> float:
        """Largest scaled speed of a body, m/s."""
        return float(np.max(np.linalg.norm(self.velocity.reshape(-1, 3), axis=1)))

    @cached_property
    def arms(self) -> Array:
        """From origins to centres of mass, world axes, shape (n_b, 3)."""
        return centres_of_mass(self.mechanism, self.state)[0] - self.state.p_WB

    @cached_property
    def _mass_matrix(self) -> Array:
        return mass_matrix(self.mechanism, self.state)

    @cached_property
    def M(self) -> Array:
        """Scaled mass matrix about the origins, shape (6 n_b, 6 n_b)."""
        return np.asarray(self._mass_matrix / np.outer(self.motion_scale, self.motion_scale))

    @cached_property
    def _forces(self) -> Wrenches:
        """Applied forces, and the terms of the velocities as forces."""
        sums = applied_wrenches(self.mechanism, self.state)
        for i, body in enumerate(self.mechanism.bodies):
            w, c = self.state.w_WB_W[i], self.arms[i]
            inertia = self._mass_matrix[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6]
            gyroscopic = cross(w, inertia @ w)
            centripetal = body.mass * cross(w, cross(w, c))
            sums.push(body.name, -centripetal, self.state.p_WB[i], -gyroscopic)
        return sums

    @cached_property
    def b(self) -> Array:
        """Scaled right-hand side: applied forces less the terms of the velocities, shape (6 n_b,)."""
        return self._forces.total.ravel() / self.motion_scale

    @cached_property
    def size_b(self) -> Array:
        """Size of `b`, shape (6 n_b,)."""
        return np.repeat(self._forces.size, 3, axis=1).ravel() / self.motion_scale

    @cached_property
    def Q(self) -> Array:
        """Scaled constraint Jacobian, shape (q, 6 n_b)."""
        return np.asarray(constraint_jacobian(self.mechanism, self.state) / self.motion_scale)

    @cached_property
    def gamma(self) -> Array:
        """Right-hand side of the constraint rows, shape (q,)."""
        return constraint_gamma(self.mechanism, self.state)

    @cached_property
    def size_gamma(self) -> Array:
        """Size of `gamma`: its value, and the acceleration of a turn of radius L at the largest speed of the state."""
        return np.asarray(np.abs(self.gamma) + np.linalg.norm(self.Q, axis=1) * self.speed**2 / self.length)

    @cached_property
    def N(self) -> Array:
        """Orthonormal free directions in scaled velocities, shape (6 n_b, freedom)."""
        return null_space(self.Q)

    @cached_property
    def reduced_inverse(self) -> Array:
        """``(N^T M N)^-1``: the mobility in the free directions, shape (freedom, freedom)."""
        return np.linalg.inv(self.N.T @ self.M @ self.N)

    @cached_property
    def _inverse(self) -> tuple[Array, Array, Array, Array]:
        """Blocks of the inverse: x from b, x from gamma, mu from b, mu from gamma (least norm)."""
        pinv = np.linalg.pinv(self.Q, rcond=RANK_TOLERANCE)
        mobility = self.N @ self.reduced_inverse @ self.N.T
        from_gamma = pinv - mobility @ (self.M @ pinv)
        return mobility, from_gamma, pinv.T - pinv.T @ self.M @ mobility, -pinv.T @ self.M @ from_gamma

    def sized(self, x: Array, mu: Array, load: Array | None = None) -> ScaledSolution:
        """Return accelerations and multipliers with the sizes of their terms; `load` adds to the right-hand side."""
        size_b = self.size_b if load is None else self.size_b + np.abs(load)
        terms = by_body(np.abs(self.M) @ by_body(x) + np.abs(self.Q.T) @ np.abs(mu) + size_b)
        return ScaledSolution(x, mu, terms, np.linalg.norm(self.Q * by_body(x), axis=1) + self.size_gamma)

    def solve(self, load: Array | None = None) -> ScaledSolution:
        """Return the dense solution, with a scaled wrench added to the right-hand side."""
        b = self.b if load is None else self.b + load
        x_b, x_gamma, mu_b, mu_gamma = self._inverse
        return self.sized(x_b @ b + x_gamma @ self.gamma, mu_b @ b + mu_gamma @ self.gamma, load)

    @cached_property
    def solution(self) -> ScaledSolution:
        """Dense solution without a load; for sizes only."""
        return self.solve()

    def acceleration_errors(self, solution: ScaledSolution, route: Route) -> Array:
        """Return the allowed errors of the scaled accelerations, shape (6 n_b,)."""
        x_b, x_gamma, _, _ = self._inverse
        rounding = np.abs(x_b) @ solution.terms + np.abs(x_gamma) @ solution.rows + np.abs(solution.x)
        return np.asarray(self.guard * rounding + self.stated_error(solution, route))

    def acceleration_error(self, solution: ScaledSolution, route: Route) -> float:
        """Return the largest allowed error of a scaled acceleration."""
        return largest(self.acceleration_errors(solution, route))

    def row_errors(self, solution: ScaledSolution, route: Route) -> Array:
        """Return the allowed errors of ``Q x - gamma``, shape (q,).

        An engine satisfies rows of its own, and allowed errors of its accelerations show in the rows here. An engine
        that sums forces has the acceleration as a difference of ``|M^-1| terms``: of a body that cannot move, the
        rounding of these terms remains.
        """
        free = by_body(np.abs(np.linalg.inv(self.M)) @ solution.terms)
        rows = solution.rows + np.linalg.norm(self.Q * free, axis=1)
        return np.asarray(self.guard * rows + np.abs(self.Q) @ self.acceleration_errors(solution, route))

    @staticmethod
    def stated_error(solution: ScaledSolution, route: Route) -> float:
        """Return the error that a route declares, as a scaled acceleration."""
        return ROUTE_ERROR.get(route, 0.0) * largest(solution.x)

    def reaction_error(self, solution: ScaledSolution) -> float:
        """Return the largest allowed error of a scaled joint reaction."""
        _, _, mu_b, mu_gamma = self._inverse
        errors = np.abs(mu_b) @ solution.terms + np.abs(mu_gamma) @ solution.rows + np.abs(solution.mu)
        return self.guard * largest(np.abs(self.reaction_map) @ errors)

    @cached_property
    def reaction_map(self) -> Array:
        """Map of ``-mu`` to scaled reactions of all joints, shape (6 n_j, q); rows of elements have no reaction."""
        full = np.zeros((6 * len(self.mechanism.joints), len(self.gamma)))
        start = 0
        scale = np.repeat([1.0, 1.0 / self.length], 3)[:, None]
        for k, joint in enumerate(self.mechanism.joints):
            rows = slice(start, start + len(joint.rows))
            start = rows.stop
            full[6 * k : 6 * k + 6, rows] = scale * reaction_map(self.mechanism, self.state, joint)
        return full

    @cached_property
    def determined(self) -> Array:
        """Components of the reactions that equilibrium determines, shape (6 n_j,), bool."""
        return determinate_reactions(self.mechanism, self.state).ravel()

    def scaled_reactions(self, force_F: Array, torque_F: Array) -> Array:
        """Return canonical reactions of all joints as one scaled vector, shape (6 n_j,)."""
        return np.hstack([force_F, torque_F / self.length]).ravel()

    def joint_wrenches(self, force_F: Array, torque_F: Array, ground_only: bool = False) -> Wrenches:
        """Return the wrenches on the bodies of canonical reactions, of joints at the ground alone if `ground_only`."""
        sums = Wrenches(self.mechanism, self.state)
        for joint, force, torque in zip(self.mechanism.joints, force_F, torque_F, strict=True):
            if ground_only and GROUND not in (joint.predecessor, joint.successor):
                continue
            frames = joint_frames(self.mechanism, self.state, joint)
            point = body_point(self.mechanism, self.state, joint.successor, joint.M.p)[0]
            F, T = frames.U @ force, frames.U @ torque
            sums.push(joint.successor, F, point, T)
            sums.push(joint.predecessor, -F, point, -T)
        return sums

    @cached_property
    def potential_size(self) -> float:
        """Sum of the magnitudes of the terms of a potential energy, in a world that may be moved by L, J."""
        mechanism = self.mechanism
        far = self.length + float(np.max(np.linalg.norm(self.state.p_WB, axis=1)))
        weight = sum(b.mass for b in mechanism.bodies) * float(np.linalg.norm(mechanism.gravity))
        springs = sum(abs(s.stiffness) * (far + abs(s.free_length)) ** 2 for s in mechanism.springs)
        widest = {"distance": far, "angle": np.pi}
        turned = 0.0
        for s in mechanism.joint_springs:
            (k, k1, k2), reach = s.laws[0], widest[s.coordinate] + abs(s.rest)
            turned += (abs(k) + (abs(k1) + abs(k2) * reach) * reach) * reach**2
        return weight * 2.0 * far + springs + turned

    def rows_without_reactions(self) -> Array:
        """Return the rows of Q whose multipliers no engine reports: drives, couplings, contacts, skates."""
        return np.asarray(self.Q[sum(len(joint.rows) for joint in self.mechanism.joints) :])


def by_body(vector: Array) -> Array:
    """Replace each component by the length of the six components of its body, shape (6 n_b,)."""
    return np.repeat(np.linalg.norm(vector.reshape(-1, 6), axis=1), 6)


def largest(values: Array) -> float:
    """Return the largest magnitude; zero of an empty array."""
    return float(np.max(np.abs(values), initial=0.0))
