"""Runge-Kutta methods: coefficients, and single steps with their dense output.

An explicit method of s stages advances ``u' = f(t, u)`` as in `coefficients`. The dense output of every method has the
nested form of Hairer, Norsett and Wanner, section II.6, in x = (time - t) / h,

    u(x) = u + x (F_0 + (1 - x) (F_1 + x (F_2 + (1 - x) (F_3 + x (...))))),
    F_0 = u_1 - u,    F_1 = h f - F_0,    F_2 = 2 F_0 - h (f + f_1),    F_3.. = h sum_i D_i k_i,

where k continues with f_1 = f(t + h, u_1) and with stages for the dense output alone. F_0 to F_2 alone are cubic
Hermite interpolation.

The collocation method solves ``U_i = u + h sum_j A_ij f(t + c_j h, U_j)`` by Newton's method, with the Jacobian J of an
earlier instant, in ``Z_i = U_i - u``. The eigenvectors of the inverse of A split the 3 n_u equations into a real and a
complex system of n_u. Its dense output is the quartic with the derivatives f, k_1, k_2, k_3 at 0, c_1, c_2, 1; at the
nodes of Radau its value at 1 is u_1.

Sources: Fehlberg, NASA TR R-315, 1969, and Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd
ed., 1993, table II.5.1 (Runge-Kutta-Fehlberg 4(5)); Hairer, Wanner: Solving Ordinary Differential Equations II, 2nd
ed., 1996, table IV.5.6 and section IV.8 (Radau IIA of order 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from consilience.mechanism import Array
from consilience.reference.integrators.coefficients import Explicit
from consilience.reference.integrators.dense import Nested

Derivative = Callable[[float, Array], Array]


class InitialValueProblem(Protocol):
    """Right-hand side f of ``u' = f(t, u)``, bound on the scaled local error of a step, and counters to update."""

    tolerance: float
    counters: dict[str, int]

    def derivative(self, t: float, u: Array) -> Array:
        """Return f, shape (n_u,)."""

    def jacobian(self, t: float, u: Array, f: Array) -> Array:
        """Return the Jacobian of f, shape (n_u, n_u)."""


def _quartic(b: Array, x: float) -> tuple[Array, Array]:
    """Return the stage at `x` on the cubic through both ends of a step, and the weights of F_3 from its derivative.

    The error of the cubic, and of its stage, is O(h^4); the quartic with this derivative is in error by O(h^5).
    """
    s = len(b)
    ends = np.eye(s + 2)
    step, first, last, at = np.concatenate([b, [0.0, 0.0]]), ends[0], ends[s], ends[s + 1]
    F0, F1, F2 = step, first - step, 2 * step - first - last
    stage = x * (F0 + (1 - x) * (F1 + x * F2))
    slope = F0 + (1 - 2 * x) * F1 + x * (2 - 3 * x) * F2
    return stage[None], ((at - slope) / (2 * x * (1 - x) * (1 - 2 * x)))[None]


def _fehlberg() -> Explicit:
    A = np.zeros((6, 6))
    A[1, :1] = [1 / 4]
    A[2, :2] = [3 / 32, 9 / 32]
    A[3, :3] = [1932 / 2197, -7200 / 2197, 7296 / 2197]
    A[4, :4] = [439 / 216, -8, 3680 / 513, -845 / 4104]
    A[5, :5] = [-8 / 27, 2, -3544 / 2565, 1859 / 4104, -11 / 40]
    fourth = np.array([25 / 216, 0, 1408 / 2565, 2197 / 4104, -1 / 5, 0])
    fifth = np.array([16 / 135, 0, 6656 / 12825, 28561 / 56430, -9 / 50, 2 / 55])
    # x (1 - x) (1 - 2 x) is largest there: the derivative determines F_3 best
    x = 0.5 - np.sqrt(1 / 12)
    A_dense, D = _quartic(fifth, x)
    return Explicit(
        order=5,
        dense_order=5,
        estimate_order=4,
        c=np.array([0, 1 / 4, 3 / 8, 12 / 13, 1, 1 / 2]),
        A=A,
        b=fifth,
        E=(fifth - fourth)[None],
        c_dense=np.array([x]),
        A_dense=A_dense,
        D=D,
    )


RKF45 = _fehlberg()
"""Runge-Kutta-Fehlberg 4(5) [MASS]; the solution of order 5 is carried on, ``b - E`` are weights of order 4."""


@dataclass(frozen=True, eq=False)
class Collocation:
    """A collocation method whose last stage is the end of the step: ``u_1 = U_s``.

    Attributes
    ----------
    order, dense_order, estimate_order : int
        As in `Explicit`.
    c, A : ndarray, shapes (s,), (s, s)
    e : ndarray, shape (s,)
        The error is estimated by ``(gamma / h - J)^-1 (f + sum e_i Z_i / h)`` with ``Z_i = U_i - u`` and gamma the real
        eigenvalue of the inverse of A.
    """

    order: int
    dense_order: int
    estimate_order: int
    c: Array
    A: Array
    e: Array


_r = np.sqrt(6.0)

RADAU = Collocation(
    order=5,
    dense_order=5,
    estimate_order=3,
    c=np.array([(4 - _r) / 10, (4 + _r) / 10, 1.0]),
    A=np.array(
        [
            [(88 - 7 * _r) / 360, (296 - 169 * _r) / 1800, (-2 + 3 * _r) / 225],
            [(296 + 169 * _r) / 1800, (88 + 7 * _r) / 360, (-2 - 3 * _r) / 225],
            [(16 - _r) / 36, (16 + _r) / 36, 1 / 9],
        ]
    ),
    e=np.array([-13 - 7 * _r, -13 + 7 * _r, -1.0]) / 3,
)
"""Radau IIA of order 5 [EXU]."""


class Splitting(NamedTuple):
    """Eigenvalues and eigenvectors of the inverse of A, which split the equations of the three stages."""

    A_inverse: Array  # (3, 3)
    gamma: float  # real eigenvalue
    pair: complex  # one of the complex pair of eigenvalues
    T_real: Array  # (3,) eigenvectors
    T_pair: Array
    row_real: Array  # (3,) rows of the inverse of the eigenvectors
    row_pair: Array

    @classmethod
    def of(cls, method: Collocation) -> Splitting:
        """Return the splitting of a method of three stages."""
        inverse = np.linalg.inv(method.A)
        values, vectors = np.linalg.eig(inverse)
        real, pair = int(np.argmin(np.abs(values.imag))), int(np.argmax(values.imag))
        T = vectors[:, real].real, vectors[:, pair]
        rows = np.linalg.inv(np.column_stack([T[0], T[1], T[1].conj()]))
        return cls(inverse, float(values[real].real), complex(values[pair]), *T, rows[0].real, rows[1])

    def back(self, real: Array, pair: Array) -> Array:
        """Return the stages, shape (3, n), of the solutions of the real and of the complex system."""
        return np.outer(self.T_real, real) + 2.0 * np.outer(self.T_pair, pair).real


NEWTON_STEPS = 7
"""Iterations after which Newton's method counts as divergent (as in RADAU5)."""


def root_mean_square(x: Array) -> float:
    """Return the root mean square of the components."""
    return float(np.linalg.norm(x) / np.sqrt(x.size))


def difference_quotients(derivative: Derivative, t: float, u: Array, f: Array) -> Array:
    """Return the Jacobian of f by forward differences, shape (n_u, n_u), from n_u evaluations."""
    J = np.empty((len(u), len(u)))
    for j in range(len(u)):
        moved = u.copy()
        moved[j] += np.sqrt(np.finfo(float).eps) * max(1.0, abs(u[j]))
        J[:, j] = (derivative(t, moved) - f) / (moved[j] - u[j])
    return J


class ExplicitStep:
    """Steps of an explicit Runge-Kutta method."""

    least_growth = 1.0

    def __init__(self, method: Explicit, problem: InitialValueProblem) -> None:
        problem.counters.update(rejected=0)
        self.method, self._problem = method, problem
        self._k = np.empty(0)

    def restart(self) -> None:
        """Forget earlier steps."""

    def attempt(self, t: float, u: Array, f: Array, h: float) -> tuple[Array, float]:
        """Return the end of a step of length h, shape (n_u,), and its scaled error; not finite where it failed."""
        method = self.method
        s, d = len(method.b), len(method.c_dense)
        k = self._k = np.empty((s + 1 + d, len(u)))
        k[0] = f
        for i in range(1, s):
            k[i] = self._problem.derivative(t + method.c[i] * h, u + h * (method.A[i, :i] @ k[:i]))
        end = u + h * (method.b @ k[:s])
        scale = self._problem.tolerance * (1.0 + np.maximum(np.abs(u), np.abs(end)))
        e = method.E @ k[:s] / scale
        error = h * root_mean_square(e[0])
        if len(e) == 2 and error > 0.0:
            # the fifth-order estimate, corrected by the third-order one [Hairer, Norsett, Wanner, section II.10]
            error *= np.linalg.norm(e[0]) / np.sqrt(np.sum(e[0] ** 2) + 0.01 * np.sum(e[1] ** 2))
        return end, error

    def piece(self, t: float, u: Array, h: float, end: Array, f_end: Array) -> Nested:
        """Return the dense output of the last attempted step.

        Parameters
        ----------
        t, h : float, s
            Start and length of the step.
        u, end, f_end : ndarray, shape (n_u,)
            Start, settled end, and the derivative at the settled end.
        """
        method, k = self.method, self._k
        s = len(method.b)
        k[s] = f_end
        for i, (c, a) in enumerate(zip(method.c_dense, method.A_dense, strict=True), start=s + 1):
            k[i] = self._problem.derivative(t + c * h, u + h * (a[:i] @ k[:i]))
        return Nested(t, h, u, np.vstack([_hermite(u, end, h * k[0], h * f_end), h * (method.D @ k)]))


def _hermite(u: Array, end: Array, hf: Array, hf_end: Array) -> Array:
    """Return F_0 to F_2, shape (3, n_u)."""
    change = end - u
    return np.array([change, hf - change, 2 * change - hf - hf_end])


class CollocationStep:
    """Steps of a collocation method of three stages."""

    least_growth = 1.2
    """Least growth of a step for which new factors are computed."""

    def __init__(self, method: Collocation, problem: InitialValueProblem) -> None:
        self.method, self._problem = method, problem
        problem.counters.update(rejected=0, jacobians=0, factorisations=0)
        self._split = Splitting.of(method)
        # Newton's error is kept well below that of the step, but not below rounding
        self._newton = max(10 * np.finfo(float).eps / problem.tolerance, min(0.03, np.sqrt(problem.tolerance)))
        self.restart()

    def restart(self) -> None:
        """Forget the Jacobian and the last step."""
        self._J = np.empty((0, 0))
        self._fresh = False
        self._factors: tuple[float, Any, Any] | None = None
        self._last: Nested | None = None
        self._slow = False

    def _linearise(self, t: float, u: Array, f: Array) -> None:
        self._J = self._problem.jacobian(t, u, f)
        self._fresh, self._slow, self._factors = True, False, None
        self._problem.counters["jacobians"] += 1

    def _factorise(self, h: float) -> tuple[Any, Any]:
        # keep the factors if the length differs by rounding: only the convergence of Newton's method depends on them
        if self._factors is None or abs(self._factors[0] - h) > 1e-10 * h:
            one, split = np.eye(len(self._J)), self._split
            self._factors = h, lu_factor(split.gamma / h * one - self._J), lu_factor(split.pair / h * one - self._J)
            self._problem.counters["factorisations"] += 2
        return self._factors[1:]

    def attempt(self, t: float, u: Array, f: Array, h: float) -> tuple[Array, float]:
        """Return the end of a step of length h, shape (n_u,), and its scaled error; not finite where it failed."""
        if not self._J.size or self._slow:
            self._linearise(t, u, f)
        Z = self._solve(t, u, h)
        if Z is None and not self._fresh:
            self._linearise(t, u, f)
            Z = self._solve(t, u, h)
        if Z is None:
            return u, np.inf
        end = u + Z[-1]
        scale = self._problem.tolerance * (1.0 + np.maximum(np.abs(u), np.abs(end)))
        real = self._factorise(h)[0]
        self._f, self._Z = f, Z
        return end, root_mean_square(lu_solve(real, f + self.method.e @ Z / h) / scale)

    def _solve(self, t: float, u: Array, h: float) -> Array | None:
        """Solve for Z of a step by simplified Newton iteration, shape (3, n_u); None where it diverges."""
        method, split, scale = self.method, self._split, self._problem.tolerance * (1.0 + np.abs(u))
        real, pair = self._factorise(h)
        Z: Array = np.zeros((3, len(u))) if self._last is None else self._last(t + method.c * h) - u
        before = 0.0
        for n in range(NEWTON_STEPS):
            F = np.array([self._problem.derivative(t + c * h, u + z) for c, z in zip(method.c, Z, strict=True)])
            residual = F - split.A_inverse @ Z / h
            if not np.all(np.isfinite(residual)):
                return None
            change = split.back(lu_solve(real, split.row_real @ residual), lu_solve(pair, split.row_pair @ residual))
            size = root_mean_square(change / scale)
            rate = size / before if before else 0.0
            if n and (rate >= 1.0 or rate ** (NEWTON_STEPS - 1 - n) * size > self._newton * (1.0 - rate)):
                return None
            Z = Z + change
            if size == 0.0 or (n and rate * size < self._newton * (1.0 - rate)):
                self._slow = n > 1 and rate > 1e-3
                return Z
            before = size
        return None

    def piece(self, t: float, u: Array, h: float, end: Array, f_end: Array) -> Nested:
        """Return the dense output of the last attempted step; arguments as of `ExplicitStep.piece`.

        Parameters
        ----------
        t, h, u, end, f_end : see `ExplicitStep.piece`
        """
        x = self.method.c[0]
        F = _hermite(u, end, h * self._f, h * f_end)
        slope = F[0] + (1 - 2 * x) * F[1] + x * (2 - 3 * x) * F[2]
        quartic = (self._split.A_inverse[0] @ self._Z - slope) / (2 * x * (1 - x) * (1 - 2 * x))
        self._fresh, self._last = False, Nested(t, h, u, np.vstack([F, quartic]))
        return self._last


OneStep = ExplicitStep | CollocationStep
