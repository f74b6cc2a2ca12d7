"""Generalised-alpha method on the Lie group of poses, index 3, constant step h.

Poses q (positions and Euler parameters), velocities v = (v, w'), accelerations dv = (dv/dt, dw'/dt) and algorithmic
accelerations a of all bodies at t_n+1 = t_n + h follow from [Arnold & Brüls 2007; Brüls & Cardona 2010]

    M dv_n+1 = f(q_n+1, v_n+1, t_n+1) + Q^T lam_n+1,      g(q_n+1, t_n+1) = 0,
    q_n+1 = q_n exp(xi),   xi = h v_n + h^2 ((1/2 - beta) a_n + beta a_n+1),
    v_n+1 = v_n + h ((1 - gamma) a_n + gamma a_n+1),
    (1 - alpha_m) a_n+1 + alpha_m a_n = (1 - alpha_f) dv_n+1 + alpha_f dv_n,

    alpha_m = (2 rho - 1) / (rho + 1),   alpha_f = rho / (rho + 1),
    gamma = 1/2 + alpha_f - alpha_m,     beta = (gamma + 1/2)^2 / 4                        [Chung & Hulbert 1993].

Non-holonomic rows (rolling, skates) hold as ``Q v_n+1 = nu``; integrals of controllers follow the trapezoidal rule.
Order two in positions, velocities and multipliers. Velocity constraints are not imposed: ``Q v - nu`` is of order h^2
and does not grow. Each step multiplies unresolved oscillations by the spectral radius rho; for rho < 1 smooth motions
lose energy of order h^2.

**Start** [Arnold, Brüls & Cardona, Numer. Math. 129, 2015, 149-179]. a_n belongs to ``t_n + D h`` where
D = alpha_m - alpha_f: ``a_0 = dv_0 + D h dv_0'``. With exact velocities xi would differ from the true increment by
``h^3 (C dv' + (0, w' x dw'/dt) / 12)``, C = 1/6 - D/2 - beta. The constraints hold at both ends, so that the component
normal to the constraints must vanish: v has an offset of order h^2. v_0 gets this offset at the start; otherwise the
multipliers of the first steps would have errors of order h.

**Newton's method** solves for ``beta h^2 a`` and ``beta h^2 lam``, dynamic rows times ``beta h^2 M^-1``: the Jacobian
and rounding errors then do not depend on h [Bottasso, Bauchau & Cardona 2007]. The Jacobian is a difference quotient,
kept while iterations converge fast. With each Jacobian a set of independent rows is chosen by pivoted QR; only these
rows have equations and multipliers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State, quaternion_product
from consilience.reference.bodies.arrays import P, R, W, pack
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.bodies.lie_group import SPEEDS, displaced
from consilience.reference.formulations.body_terms import DaeMotion, Terms

_ITERATIONS = 12
_FAST = 5
"""Iterations above which the next step computes a new Jacobian."""

_ROUNDING = 4.0 * np.finfo(float).eps
_DIFFERENCE = 1e-7
"""Increment of difference quotients, m and rad: about the root of the rounding unit."""


class Coefficients(NamedTuple):
    """Coefficients of the method."""

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float

    @classmethod
    def of(cls, rho_inf: float) -> Coefficients:
        """Return the coefficients for a spectral radius at infinity, 0 to 1.

        Raises
        ------
        InvalidInput
            If the spectral radius is out of range.
        """
        if not 0.0 <= rho_inf <= 1.0:
            raise InvalidInput("rho_inf", f"{rho_inf} is out of range", "Choose 0 (most damping) to 1 (none).")
        alpha_m, alpha_f = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0), rho_inf / (rho_inf + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return cls(alpha_m, alpha_f, gamma, 0.25 * (gamma + 0.5) ** 2)


class _StepEnd(NamedTuple):
    """End of a step for given unknowns."""

    y: Array
    dv: Array
    terms: Terms
    residual: Array  # dynamic rows, then all constraint rows


class GeneralisedAlpha(DaeMotion):
    """Integrator of one motion, step by step.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at the time t.
    t, step : float, s
    rho_inf : float
        Spectral radius at infinity.

    Attributes
    ----------
    t : float, s
    y : ndarray, shape (n_b + n_e, 13)
        Packed state.
    dv : ndarray, shape (6 n_b,)
        Accelerations (dv/dt, dw'/dt).
    counters : dict
        ``steps``, ``evaluations`` of all terms, ``iterations`` of Newton's method, ``jacobians``.
    """

    def __init__(self, mechanism: Mechanism, state: State, t: float, step: float, rho_inf: float) -> None:
        self._h, self._c = step, Coefficients.of(rho_inf)
        super().__init__(mechanism, state, t, ("steps", "evaluations", "iterations", "jacobians"))
        self._factors: tuple[Array, Array] | None = None
        self._rows = np.zeros(0, dtype=np.int64)
        self._start()

    # ------------------------------------------------------------ start

    def _evaluate(self, t: float, y: Array, angles: Array) -> Terms:
        self.counters["evaluations"] += 1
        return self._terms.evaluate(t, y, angles)

    def _shifted(self, time: float, dv: Array, integral_rates: Array) -> Array:
        """Return the accelerations shortly after the start, on the Taylor polynomial of the motion, shape (6 n_b,)."""
        v = self.y[: self._n_b, SPEEDS].reshape(-1)
        y = displaced(self.y, self._n_b, time * v + 0.5 * time**2 * dv, v + time * dv)
        self._terms.integrals_of(y)[:] += time * integral_rates
        return self._terms.accelerations(self._evaluate(self.t + time, y, self._angles))[0]

    def _start(self) -> None:
        """Compute accelerations, algorithmic accelerations and the offset of the velocities."""
        h, (alpha_m, alpha_f, _, beta) = self._h, self._c
        terms = self._evaluate(self.t, self.y, self._angles)
        self.dv, lam = self._terms.accelerations(terms)
        self._lam, self._integral_rates = lam, terms.integral_rates
        Q = terms.Q.copy()
        short = 0.1 * h
        change = [self._shifted(s * short, self.dv, terms.integral_rates) for s in (1.0, -1.0)]
        jerk = (change[0] - change[1]) / (2.0 * short)
        D = alpha_m - alpha_f
        self._a = self.dv + D * h * jerk
        missed = (1.0 / 6.0 - 0.5 * D - beta) * jerk.reshape(-1, 6)
        missed[:, 3:] += np.cross(self.y[: self._n_b, W], self.dv.reshape(-1, 6)[:, 3:]) / 12.0
        wanted = Q @ missed.reshape(-1)
        wanted[self._terms.holonomic :] = 0.0
        L = np.linalg.cholesky(self._terms.mass)
        if len(Q):
            normal = np.linalg.lstsq(np.linalg.solve(L, Q.T).T, wanted, rcond=RANK_TOLERANCE)[0]
            self.y[: self._n_b, SPEEDS] += h**2 * np.linalg.solve(L.T, normal).reshape(-1, 6)

    # ------------------------------------------------------------ one step

    def _trial(self, a: Array, lam: Array) -> _StepEnd:
        """Evaluate the end of the step for algorithmic accelerations and multipliers of independent rows."""
        h, (alpha_m, alpha_f, gamma, beta) = self._h, self._c
        v = self.y[: self._n_b, SPEEDS].reshape(-1)
        dv = ((1.0 - alpha_m) * a + alpha_m * self._a - alpha_f * self.dv) / (1.0 - alpha_f)
        xi = h * v + h**2 * ((0.5 - beta) * self._a + beta * a)
        y = displaced(self.y, self._n_b, xi, v + h * ((1.0 - gamma) * self._a + gamma * a))
        t = self.t + h
        integrals = self._terms.integrals_of(y)
        if len(integrals):  # their rates depend on the pose alone
            rates = self._evaluate(t, y, self._angles).integral_rates
            integrals += 0.5 * h * (self._integral_rates + rates)
        terms = self._evaluate(t, y, self._angles)
        force = self._inverse_mass @ (terms.f + terms.Q[self._rows].T @ lam)
        rows = terms.value.copy()
        slip = slice(self._terms.holonomic, None)
        rows[slip] = beta * h / gamma * (terms.Q[slip] @ y[: self._n_b, SPEEDS].reshape(-1) - terms.rate[slip])
        residual = np.concatenate([beta * h**2 * (dv - force), rows])
        return _StepEnd(y, dv, terms, residual)

    def _linearise(self, a: Array, lam: Array) -> None:
        """Compute and factorise the Jacobian in (beta h^2 a, beta h^2 lam)."""
        n, scale = len(a), self._c.beta * self._h**2
        first = self._trial(a, lam)
        Q = first.terms.Q[self._rows].copy()
        equations = np.concatenate([np.arange(n), n + self._rows])
        J = np.zeros((len(equations), len(equations)))
        for k in range(n):
            moved = a.copy()
            moved[k] += _DIFFERENCE / scale
            J[:, k] = (self._trial(moved, lam).residual - first.residual)[equations] / _DIFFERENCE
        J[:n, n:] = -self._inverse_mass @ Q.T
        self._factors = lu_factor(J)
        self.counters["jacobians"] += 1

    def _newton(self, a: Array, lam: Array) -> tuple[_StepEnd, Array, Array, int] | None:
        """Solve a step; return its end, a, multipliers and iterations, or None without convergence."""
        n, scale, before = len(a), self._c.beta * self._h**2, np.inf
        equations = np.concatenate([np.arange(n), n + self._rows])
        for count in range(1, _ITERATIONS + 1):
            trial = self._trial(a, lam)
            self.counters["iterations"] += 1
            if not np.all(np.isfinite(trial.residual)):
                return None
            change = lu_solve(self._factors, -trial.residual[equations])
            a, lam = a + change[:n] / scale, lam + change[n:] / scale
            size = float(np.max(np.abs(change[:n])))
            extent = max(1.0, float(np.max(np.abs(trial.y[: self._n_b, R]))))
            # converged to rounding, or stagnating near it
            if size <= _ROUNDING * extent or (size < 1e-11 * extent and size > 0.3 * before):
                return self._trial(a, lam), a, lam, count
            if size > 2.0 * before:
                return None
            before = size
        return None

    def advance(self) -> None:
        """Take one step.

        Raises
        ------
        NumericalFailure
            If Newton's method does not converge.
        """
        found = None
        if self._factors is not None:
            found = self._newton(self._a, self._lam[self._rows])
        if found is None:
            terms = self._evaluate(self.t, self.y, self._angles)
            lam = self._terms.accelerations(terms)[1]
            self._rows = self._terms.independent_rows().copy()
            self._linearise(self._a, lam[self._rows])
            found = self._newton(self._a, lam[self._rows])
        if found is None:
            why = "Newton's method does not converge: shorten the step, or the motion runs into a singular pose"
            raise NumericalFailure(f"generalised-alpha, steps of {self._h:g} s: at t = {self.t:.6g} s {why}")
        trial, self._a, lam, count = found
        if count > _FAST:
            self._factors = None
        self.t, self.y, self.dv = self.t + self._h, trial.y, trial.dv
        self._end_step(trial.terms, self._rows, lam)
        self._integral_rates = trial.terms.integral_rates


def _rates(y: Array, dv: Array, n_b: int) -> Array:
    """Return the time derivative of the rows of bodies, shape (n_b, 13)."""
    w = np.hstack([np.zeros((n_b, 1)), y[:n_b, W]])
    return np.hstack([y[:n_b, 7:10], 0.5 * quaternion_product(y[:n_b, P], w), dv.reshape(n_b, 6)])


def generalised_alpha(
    mechanism: Mechanism, state: State, times: Array, step: float, rho_inf: float = 0.8
) -> TrajectoryAnswer:
    """Integrate the motion of a mechanism by the generalised-alpha method.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at ``times[0]``.
    times : ndarray, shape (n_t,), s
        Increasing. Samples between steps are cubic Hermite interpolants, of order four.
    step : float, s
        Constant step.
    rho_inf : float
        Spectral radius at infinity, 1 (no damping) to 0 (unresolved oscillations vanish in one step).

    Returns
    -------
    TrajectoryAnswer
        With the counters of `GeneralisedAlpha`.

    Raises
    ------
    InvalidInput
        Step not positive, rho_inf out of range, times that do not increase.
    NumericalFailure
        If Newton's method does not converge in a step.
    """
    if not 0.0 < step < np.inf:
        raise InvalidInput("step", f"{step} s is no length of a step", "Give a positive length.")
    times = sample_times(times)
    n_b, start = len(mechanism.bodies), pack(mechanism, state)
    motion = GeneralisedAlpha(mechanism, state, float(times[0]), step, rho_inf)
    samples = [start[:n_b]]
    while len(samples) < len(times):
        t, y, rates = motion.t, motion.y[:n_b], _rates(motion.y, motion.dv, n_b)
        motion.advance()
        after, rates_after = motion.y[:n_b], _rates(motion.y, motion.dv, n_b)
        while len(samples) < len(times) and times[len(samples)] <= motion.t + 1e-9 * step:
            x = (times[len(samples)] - t) / step
            blend = y + x**2 * (3.0 - 2.0 * x) * (after - y)
            blend = blend + step * x * (1.0 - x) * ((1.0 - x) * rates - x * rates_after)
            blend[:, P] /= np.linalg.norm(blend[:, P], axis=1)[:, None]
            samples.append(blend)
    return motion.answer(times, samples)
