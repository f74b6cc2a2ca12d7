"""The neutral equations of motion of one state, how sensitive they are, and the bars that follow.

Newton-Euler for every body about its origin, in accelerations x of all bodies, with the constraint rows Q of
`consilience.mechanism.constraints` and multipliers mu (minus the constraint forces):

    M x + Q^T mu = b,   Q x = gamma

Lengths are counted in reaches of the mechanism, so that rows of forces and of torques, of points and of angles,
compare: a motion is ``(a, L alpha)``, a wrench ``(F, T / L)``.

Bars. Who rounds each number of these equations once, relative to its size, leaves a residual of up to
``eps (|M| |x| + |Q^T| |mu| + size(b))`` and ``eps (|Q| |x| + size(gamma))``, and moves the solution by up to the
inverse of the matrix, entry by entry in magnitude, times that [Bauer and Skeel; N. J. Higham, Accuracy and Stability
of Numerical Algorithms, 2nd ed., section 7.2]. An engine rounds more than once: `ROUNDINGS` times along each body
between the data and an answer. That number, eps, and the sizes are all there is in a bar. Sizes are those of this
module's own dense solution, never an engine's: an engine that is far off must not widen its own bar.
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
    centres_of_mass,
    characteristic_length,
    constraint_gamma,
    constraint_jacobian,
    cross,
    determinate_reactions,
    joint_frames,
    reaction_map,
    skew,
    world_inertias,
)

EPS = float(np.finfo(float).eps)

ROUNDINGS = 64
"""Roundings in series for each body. From one body to the next an engine turns and adds a pose, a velocity, an
acceleration, an inertia and a wrench; each is a chain of two rotations (five operations a component each) and a
product or two: some sixty."""

ROUTE_ERROR = {Route.EXTRAPOLATED: 1e-8}
"""Relative error of accelerations that a route states for itself (docs/verdicts.md), beyond rounding."""


@dataclass(frozen=True, eq=False)
class ScaledSolution:
    """A solution of the equations, scaled, with what bounds its errors.

    Attributes
    ----------
    x : ndarray, shape (6 n_b,)
    mu : ndarray, shape (q,)
    terms : ndarray, shape (6 n_b,)
        ``|M| |x| + |Q^T| |mu| + size(b)``: what a residual of the balance is in proportion to. Of each body the length
        of its six components: whoever turns axes mixes them.
    rows : ndarray, shape (q,)
        ``|Q| |x| + size(gamma)``, lengths by body as well.
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
        """Reach of the mechanism, m."""
        return characteristic_length(self.mechanism)

    @cached_property
    def motion_scale(self) -> Array:
        """Factors of ``(a, alpha)`` of each body, shape (6 n_b,); a wrench is divided by them."""
        return np.tile([1.0] * 3 + [self.length] * 3, len(self.mechanism.bodies))

    @cached_property
    def guard(self) -> float:
        """``eps`` times the roundings in series.

        Positions count from an origin that may be far: rounding them moves arms by that much more, and those who move
        the world may move it by another reach.
        """
        away = 2.0 + float(np.max(np.linalg.norm(self.state.p_WB, axis=1))) / self.length
        return ROUNDINGS * len(self.mechanism.bodies) * away * EPS

    def motion(self, linear: Array, angular: Array) -> Array:
        """Scaled vector, shape (6 n_b,), of linear and angular parts (n_b, 3)."""
        return np.hstack([linear, angular]).ravel() * self.motion_scale

    def unscaled(self, wrench: Array) -> Array:
        """Forces and torques about the origins, shape (n_b, 6), of a scaled wrench."""
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
    def _origin_inertias(self) -> Array:
        turned = world_inertias(self.mechanism, self.state)
        pairs = zip(self.mechanism.bodies, self.arms, strict=True)
        return np.array([I - b.mass * skew(c) @ skew(c) for I, (b, c) in zip(turned, pairs, strict=True)])

    @cached_property
    def M(self) -> Array:
        """Scaled mass matrix about the origins, shape (6 n_b, 6 n_b)."""
        n = len(self.mechanism.bodies)
        M = np.zeros((6 * n, 6 * n))
        for i, body in enumerate(self.mechanism.bodies):
            S = body.mass * skew(self.arms[i])
            block = [[body.mass * np.eye(3), -S], [S, self._origin_inertias[i]]]
            M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.block(block)
        scaled: Array = M / np.outer(self.motion_scale, self.motion_scale)
        return scaled

    @cached_property
    def _forces(self) -> Wrenches:
        """Applied forces and, as forces, what the velocities do."""
        sums = applied_wrenches(self.mechanism, self.state)
        for i, body in enumerate(self.mechanism.bodies):
            w, c = self.state.w_WB_W[i], self.arms[i]
            gyroscopic = cross(w, self._origin_inertias[i] @ w)
            centripetal = body.mass * cross(w, cross(w, c))
            sums.push(body.name, -centripetal, self.state.p_WB[i], -gyroscopic)
        return sums

    @cached_property
    def b(self) -> Array:
        """Right-hand side: applied forces less the terms of the velocities, scaled, shape (6 n_b,)."""
        return self._forces.total.ravel() / self.motion_scale

    @cached_property
    def size_b(self) -> Array:
        """Size of `b`, shape (6 n_b,)."""
        return np.repeat(self._forces.size, 3, axis=1).ravel() / self.motion_scale

    @cached_property
    def Q(self) -> Array:
        """Scaled constraint Jacobian, shape (q, 6 n_b)."""
        scaled: Array = constraint_jacobian(self.mechanism, self.state) / self.motion_scale
        return scaled

    @cached_property
    def gamma(self) -> Array:
        """Right-hand side of the constraint rows, shape (q,)."""
        return constraint_gamma(self.mechanism, self.state)

    @cached_property
    def size_gamma(self) -> Array:
        """Size of `gamma`: besides its value, what velocities of the size of the state's do across a reach."""
        size: Array = np.abs(self.gamma) + np.linalg.norm(self.Q, axis=1) * self.speed**2 / self.length
        return size

    @cached_property
    def N(self) -> Array:
        """Orthonormal free directions in scaled velocities, shape (6 n_b, freedom)."""
        if len(self.Q) == 0:
            return np.eye(self.Q.shape[1])
        _, singular, Vt = np.linalg.svd(self.Q)
        rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
        return np.ascontiguousarray(Vt[rank:].T)

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
        """Accelerations and multipliers, with the sizes of the terms they make; `load` is added to the right side."""
        size_b = self.size_b if load is None else self.size_b + np.abs(load)
        terms = by_body(np.abs(self.M) @ by_body(x) + np.abs(self.Q.T) @ np.abs(mu) + size_b)
        return ScaledSolution(x, mu, terms, np.linalg.norm(self.Q * by_body(x), axis=1) + self.size_gamma)

    def solve(self, load: Array | None = None) -> ScaledSolution:
        """Dense solution, with a scaled wrench added to the right side."""
        b = self.b if load is None else self.b + load
        x_b, x_gamma, mu_b, mu_gamma = self._inverse
        return self.sized(x_b @ b + x_gamma @ self.gamma, mu_b @ b + mu_gamma @ self.gamma, load)

    @cached_property
    def solution(self) -> ScaledSolution:
        """Dense solution of the mechanism as it is; for sizes only."""
        return self.solve()

    def acceleration_errors(self, solution: ScaledSolution, route: Route) -> Array:
        """Errors of the scaled accelerations that are no fault, shape (6 n_b,)."""
        x_b, x_gamma, _, _ = self._inverse
        rounding = np.abs(x_b) @ solution.terms + np.abs(x_gamma) @ solution.rows + np.abs(solution.x)
        errors: Array = self.guard * rounding + self.stated_error(solution, route)
        return errors

    def acceleration_error(self, solution: ScaledSolution, route: Route) -> float:
        """Largest error of a scaled acceleration that is no fault."""
        return largest(self.acceleration_errors(solution, route))

    def row_errors(self, solution: ScaledSolution, route: Route) -> Array:
        """Errors of ``Q x - gamma`` that are no fault, shape (q,).

        The rows are ours; an engine holds its own, and errors of accelerations that are no fault show in ours. Who
        sums up forces has an acceleration as a difference of what each would do alone, ``|M^-1| terms``: of a body
        that cannot move nothing but the rounding of that is left.
        """
        free = by_body(np.abs(np.linalg.inv(self.M)) @ solution.terms)
        rows = solution.rows + np.linalg.norm(self.Q * free, axis=1)
        errors: Array = self.guard * rows + np.abs(self.Q) @ self.acceleration_errors(solution, route)
        return errors

    @staticmethod
    def stated_error(solution: ScaledSolution, route: Route) -> float:
        """What the route itself states, as a scaled acceleration."""
        return ROUTE_ERROR.get(route, 0.0) * largest(solution.x)

    def reaction_error(self, solution: ScaledSolution) -> float:
        """Largest error of a scaled joint reaction that is no fault."""
        _, _, mu_b, mu_gamma = self._inverse
        errors = np.abs(mu_b) @ solution.terms + np.abs(mu_gamma) @ solution.rows + np.abs(solution.mu)
        return self.guard * largest(np.abs(self.reaction_map) @ errors)

    @cached_property
    def reaction_map(self) -> Array:
        """Scaled canonical reactions of all joints from ``-mu``, shape (6 n_j, q); other rows have none."""
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
        """Which components of the reactions equilibrium determines, shape (6 n_j,), bool."""
        return determinate_reactions(self.mechanism, self.state).ravel()

    def scaled_reactions(self, force_F: Array, torque_F: Array) -> Array:
        """Canonical reactions of all joints as one scaled vector, shape (6 n_j,)."""
        return np.hstack([force_F, torque_F / self.length]).ravel()

    def joint_wrenches(self, force_F: Array, torque_F: Array, ground_only: bool = False) -> Wrenches:
        """What canonical reactions do to the bodies."""
        sums = Wrenches(self.mechanism, self.state)
        for joint, force, torque in zip(self.mechanism.joints, force_F, torque_F, strict=True):
            if ground_only and GROUND not in (joint.predecessor, joint.successor):
                continue
            frames = joint_frames(self.mechanism, self.state, joint)
            origin = np.zeros(3) if joint.successor == GROUND else self._origin(joint.successor)
            point, F, T = origin + frames.s_j, frames.U @ force, frames.U @ torque
            sums.push(joint.successor, F, point, T)
            sums.push(joint.predecessor, -F, point, -T)
        return sums

    def _origin(self, body: str) -> Array:
        origin: Array = self.state.p_WB[self.mechanism.body_index[body]]
        return origin

    @cached_property
    def potential_size(self) -> float:
        """Sum of the magnitudes that a potential energy is made of, in a world that may be moved by a reach, J."""
        mechanism = self.mechanism
        far = self.length + float(np.max(np.linalg.norm(self.state.p_WB, axis=1)))
        weight = sum(b.mass for b in mechanism.bodies) * float(np.linalg.norm(mechanism.gravity))
        springs = sum(abs(s.stiffness) * (far + abs(s.free_length)) ** 2 for s in mechanism.springs)
        widest = {"distance": far, "angle": np.pi}
        turned = sum(abs(s.stiffness) * (widest[s.coordinate] + abs(s.rest)) ** 2 for s in mechanism.joint_springs)
        return weight * 2.0 * far + springs + turned

    def rows_without_reactions(self) -> Array:
        """Rows of Q whose multipliers no engine reports: drives, couplings, contacts, skates."""
        rows: Array = self.Q[sum(len(joint.rows) for joint in self.mechanism.joints) :]
        return rows


def by_body(vector: Array) -> Array:
    """Each component replaced by the length of its body's six, shape (6 n_b,)."""
    return np.repeat(np.linalg.norm(vector.reshape(-1, 6), axis=1), 6)


def largest(values: Array) -> float:
    """Largest magnitude; zero of nothing."""
    return float(np.max(np.abs(values), initial=0.0))
