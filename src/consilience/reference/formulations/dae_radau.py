"""Radau IIA of order five for the descriptor form as a differential-algebraic system of index 2 or 3.

Unknowns are the velocities v = (v, w') of all bodies and the increments xi of their poses in a step,
``q = q_n exp(xi)`` [EXU; Hairer & Wanner, Solving Ordinary Differential Equations II, chapter VII]:

    index 3    xi' = T(xi)^-1 v,                    M v' = f + Q^T lam,    g = 0
    index 2    xi' = T(xi)^-1 (v + M^-1 Q^T mu),    M v' = f + Q^T lam,    g = 0,    Q v = nu

Index 2 follows Gear, Leimkuhler and Gupta [J. Comput. Appl. Math. 12-13, 1985, 77-90], with a second multiplier mu in
the mass metric that vanishes along the exact motion. Increments are local coordinates on the Lie group: no norm of
Euler parameters, no singular orientation. Non-holonomic rows (rolling, skates) are ``Q v = nu`` in both. The last stage
is the end of the step, where the constraints hold to rounding: g, and for index 2 ``Q v - nu``, too. Orders [Hairer,
Lubich & Roche 1989; Hairer & Wanner II, VII.4 to VII.6]:

=======  =========  ======  ===========
index    positions  speeds  multipliers
=======  =========  ======  ===========
2        5          5       3
3        5          3       2
=======  =========  ======  ===========

**Simplified Newton iteration**: one Jacobian of the right-hand side (difference quotients in xi, v and integrals; exact
in the multipliers, which enter linearly), then, after the transformation of RADAU5, one real and one complex
factorisation. Rows and columns of index 2 and 3 are scaled by h and h^2, so that condition numbers do not grow as h
shrinks. Convergence test and error estimate exclude the multipliers. With each Jacobian a set of independent rows is
chosen by pivoted QR; only these rows have equations.

**Error estimate** ``(gamma / h E - J)^-1 (F + E e Z / h)`` as in RADAU5, of order three, of increments and velocities;
for index 3 velocities get the factor h: positions meet the tolerance, velocities, of order three, do not.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array, Mechanism, State
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.bodies.lie_group import SPEEDS, displaced, increment_rates
from consilience.reference.formulations.body_terms import DaeMotion
from consilience.reference.integrators.tableaus import RADAU, Splitting, root_mean_square

Index = Literal[2, 3]

_ITERATIONS, _FAST = 15, 5
_GOAL = 1e-3
"""Newton's method ends when its correction is below this fraction of the tolerance."""

_ROUNDING = 1e-12
"""Stagnating corrections below this size are rounding errors, in m, rad, m/s, rad/s."""

_SAFETY, _SMALLEST, _LARGEST, _KEEP = 0.9, 0.2, 5.0, 1.2
_RESOLVED = 1e-12
_DIFFERENCE = 1e-7

_SPLIT = Splitting.of(RADAU)


class _Matrix(NamedTuple):
    """Factors for one step size."""

    h: float
    scale: Array  # of rows and columns
    real: Any
    pair: Any


class DescriptorDae(DaeMotion):
    """Integrator of one motion, step by step.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at the time t.
    t : float, s
    index : int
        2 or 3.
    tolerance : float
        Bound on the scaled error estimate of a step.

    Attributes
    ----------
    t : float, s
    y : ndarray, shape (n_b + n_e, 13)
        Packed state.
    counters : dict
        ``steps``, ``rejected``, ``evaluations``, ``jacobians``, ``factorisations``.
    """

    def __init__(self, mechanism: Mechanism, state: State, t: float, index: Index, tolerance: float) -> None:
        counters = ("steps", "rejected", "evaluations", "jacobians", "factorisations")
        super().__init__(mechanism, state, t, counters)
        self._index, self._tolerance, self._n = index, tolerance, 6 * self._n_b
        terms = self._terms.evaluate(t, self.y, self._angles)
        self._acceleration, self._lam = self._terms.accelerations(terms)
        self._rows = self._terms.independent_rows()
        self._limit, self._force = len(self._rows), terms.Q.T @ self._lam
        self._Q = terms.Q.copy()
        self._fresh, self._slow, self._J = False, False, np.empty((0, 0))
        self._last: tuple[float, Array] | None = None
        self._matrix: _Matrix | None = None
        self._partition()

    def _partition(self) -> None:
        """Partition the unknowns: increments, velocities, integrals (differential), lam, mu; find holonomic rows."""
        self._holonomic = self._rows[self._rows < self._terms.holonomic]
        mu = len(self._holonomic) if self._index == 2 else 0
        self._parts = np.cumsum([self._n, self._n, self._terms.integrals, len(self._rows), mu])
        self._differential = np.arange(self._parts[-1]) < self._parts[2]

    # ------------------------------------------------------------ right-hand side

    def _right(self, t: float, z: Array) -> Array:
        """Return rates of increments, velocities and integrals, then constraint residuals, as many as multipliers."""
        self.counters["evaluations"] += 1
        a, b, c, d, _ = self._parts
        xi, v, lam, mu = z[:a], z[a:b], z[c:d], z[d:]
        y = displaced(self.y, self._n_b, xi, v)
        self._terms.integrals_of(y)[:] = z[b:c]
        terms = self._terms.evaluate(t, y, self._angles)
        Q = terms.Q[self._rows]
        speeds, slip = v, Q @ v - terms.rate[self._rows]
        if self._index == 2:
            speeds = v + self._inverse_mass @ (terms.Q[self._holonomic].T @ mu)
            rows = [slip, terms.value[self._holonomic]]
        else:
            rows = [np.where(self._rows < self._terms.holonomic, terms.value[self._rows], slip)]
        rates = self._inverse_mass @ (terms.f + Q.T @ lam)
        return np.concatenate([increment_rates(xi, speeds), rates, terms.integral_rates, *rows])

    def _start(self) -> Array:
        """Return the unknowns at the start of a step."""
        v = self.y[: self._n_b, SPEEDS].reshape(-1)
        mu = np.zeros(self._parts[4] - self._parts[3])
        return np.concatenate([np.zeros(self._n), v, self._terms.integrals_of(self.y), self._lam[self._rows], mu])

    def _linearise(self) -> None:
        """Compute the Jacobian at the start of a step, with a new set of independent rows."""
        terms = self._terms.evaluate(self.t, self.y, self._angles)
        self._lam = self._terms.accelerations(terms, self._limit)[1]
        self._rows = self._terms.independent_rows(self._limit)
        self._partition()
        z = self._start()
        first = self._right(self.t, z)
        J = np.zeros((len(z), len(z)))
        for k in range(self._parts[2]):
            moved = z.copy()
            moved[k] += _DIFFERENCE * max(1.0, abs(z[k]))
            J[:, k] = (self._right(self.t, moved) - first) / (moved[k] - z[k])
        # multipliers enter linearly; T = 1 at xi = 0
        Q, (a, b, c, d, _) = self._terms.evaluate(self.t, self.y, self._angles).Q, self._parts
        J[a:b, c:d] = self._inverse_mass @ Q[self._rows].T
        if self._index == 2:
            J[:a, d:] = self._inverse_mass @ Q[self._holonomic].T
        self._J, self._matrix, self._fresh = J, None, True
        self.counters["jacobians"] += 1

    def _factorise(self, h: float) -> _Matrix:
        """Scale and factorise the Newton matrices for the step size h."""
        if self._matrix is None or abs(self._matrix.h - h) > 1e-10 * h:
            a, _, c, d, end = self._parts
            scale = np.ones(end)
            if self._index == 3:
                scale[a : self._parts[1]] = 1.0 / h
                scale[c:d] = 1.0 / h**2
            else:
                scale[c:] = 1.0 / h
            E = np.diag(self._differential.astype(float))
            # columns scale the unknowns; rows are scaled by their largest entry for partial pivoting
            matrices = [(eigenvalue / h * E - self._J) * scale for eigenvalue in (_SPLIT.gamma, _SPLIT.pair)]
            rows = 1.0 / np.max(np.abs(matrices[0]), axis=1)
            factors = [lu_factor(rows[:, None] * matrix) for matrix in matrices]
            self._matrix = _Matrix(h, np.vstack([scale, rows]), *factors)
            self.counters["factorisations"] += 2
        return self._matrix

    # ------------------------------------------------------------ one step

    def _weights(self, z: Array) -> Array:
        """Return the error tolerances of the differential unknowns."""
        return self._tolerance * (1.0 + np.abs(z[: self._parts[2]]))

    def _stages(self, z: Array, h: float) -> tuple[Array, bool] | None:
        """Solve the stages: increments Z, shape (3, n), and whether convergence was slow; None without convergence."""
        matrix = self._factorise(h)
        scale, rows = matrix.scale
        weights, c = self._weights(z), self._parts[2]
        Z, before = self._guess(h, len(z)), 0.0
        # velocities of index 3 are difference quotients of positions
        floor = _ROUNDING if self._index == 2 else max(_ROUNDING, 0.1 * _ROUNDING / h)
        for n in range(_ITERATIONS):
            F = np.array([self._right(self.t + x * h, z + part) for x, part in zip(RADAU.c, Z, strict=True)])
            residual = F - _SPLIT.A_inverse @ (Z * self._differential) / h
            if not np.all(np.isfinite(residual)):
                return None
            real = scale * lu_solve(matrix.real, rows * (_SPLIT.row_real @ residual))
            pair = scale * lu_solve(matrix.pair, rows * (_SPLIT.row_pair @ residual))
            change = _SPLIT.back(real, pair)
            Z = Z + change
            size = root_mean_square(change[:, :c] / weights)
            rounding = n > 0 and size > 0.3 * before and size * self._tolerance < floor
            if size <= _GOAL or rounding:
                self._last = h, Z
                return Z, n > _FAST
            if n and size > 2.0 * before:
                return None
            before = size
        return None

    def _guess(self, h: float, count: int) -> Array:
        """Extrapolate the collocation polynomial of the last step to the stages, shape (3, n)."""
        if self._last is None or self._last[1].shape[1] != count:
            return np.zeros((3, count))
        before, Z = self._last
        nodes = np.concatenate([[0.0], RADAU.c])
        at = 1.0 + RADAU.c * h / before
        weights = np.array([np.prod([(at - m) / (n - m) for m in nodes if m != n], axis=0) for n in nodes[1:]])
        return weights.T @ Z - Z[-1]

    def attempt(self, h: float) -> tuple[Array | None, float]:
        """Try a step of size h; return its end and scaled error, or None and infinity without convergence."""
        if not self._J.size:
            self._linearise()
        z = self._start()
        found = self._stages(z, h)
        if found is None and not self._fresh:
            self._linearise()
            z = self._start()
            found = self._stages(z, h)
        if found is None:
            return None, np.inf
        Z, self._slow = found
        matrix, c = self._factorise(h), self._parts[2]
        scale, rows = matrix.scale
        right = self._right(self.t, z) + self._differential * (RADAU.e @ Z) / h
        right[c:] = 0.0
        error = scale * lu_solve(matrix.real, rows * right)
        if self._index == 3:
            error[self._n : 2 * self._n] *= h
        return z + Z[-1], root_mean_square(error[:c] / self._weights(np.maximum(np.abs(z), np.abs(z + Z[-1]))))

    def accept(self, h: float, z: Array) -> None:
        """Accept a step of size h with the end z."""
        a, b, c, d, _ = self._parts
        self.y = displaced(self.y, self._n_b, z[:a], z[a:b])
        self._terms.integrals_of(self.y)[:] = z[b:c]
        self.t += h
        terms = self._terms.evaluate(self.t, self.y, self._angles)
        self._end_step(terms, self._rows, z[c:d])
        self._fresh = False
        if self._slow:
            self._J = np.empty((0, 0))

    def advance(self, target: float, h: float) -> float:
        """Integrate to the time `target` with step size control, from the step size h; return the next step size.

        Raises
        ------
        NumericalFailure
            If the step size falls below the resolution of the time.
        """
        grow = _LARGEST
        while self.t < target:
            left = target - self.t
            length = left if h >= left else min(h, 0.5 * left)
            if length < _RESOLVED * max(1.0, abs(self.t)):
                why = "the step size fell below what the time resolves: the motion runs into a singular pose"
                raise NumericalFailure(f"Radau IIA, index {self._index}: at t = {self.t:.6g} s {why}")
            z, error = self.attempt(length)
            factor = _SAFETY * error**-0.25 if 0.0 < error < np.inf else (_LARGEST if error == 0.0 else 0.5)
            if z is None or error > 1.0:
                self.counters["rejected"] += 1
                h, grow = length * max(_SMALLEST, min(factor, 1.0)), 1.0
                continue
            self.accept(length, z)
            factor, grow = min(factor, grow), _LARGEST
            longer = length if 1.0 <= factor < _KEEP else length * max(_SMALLEST, factor)
            h = max(h, longer) if length < h else longer
            if length == left:
                self.t = target
        return h


def integrate_dae(
    mechanism: Mechanism, state: State, times: Array, tolerance: float = 1e-10, index: Index = 2
) -> TrajectoryAnswer:
    """Integrate the motion of a mechanism by Radau IIA on its equations of index 2 or 3.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at ``times[0]``.
    times : ndarray, shape (n_t,), s
        Increasing; steps end on them.
    tolerance : float
        Bound on the scaled error estimate of a step, 1e-12 to 1e-3.
    index : int
        2 (Gear, Leimkuhler and Gupta) or 3.

    Returns
    -------
    TrajectoryAnswer
        With the counters of `DescriptorDae`.

    Raises
    ------
    InvalidInput
        Tolerance or index out of range, times that do not increase.
    NumericalFailure
        If the step size falls below the resolution of the time.
    """
    if not 1e-12 <= tolerance <= 1e-3:
        raise InvalidInput("tolerance", f"{tolerance} is out of range", "Choose 1e-12 to 1e-3.")
    if index not in (2, 3):
        raise InvalidInput("index", f"{index}", "Choose 2 or 3.")
    times = sample_times(times)
    motion = DescriptorDae(mechanism, state, float(times[0]), index, tolerance)
    samples, h = [motion.y], tolerance**0.25 * 0.1
    for target in times[1:]:
        h = motion.advance(float(target), h)
        samples.append(motion.y)
    return motion.answer(times, samples)
