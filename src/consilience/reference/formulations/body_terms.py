"""Terms of the descriptor forms written in NumPy: constraint rows and forces in body velocities, by the kernels.

    M (dv/dt, dw'/dt) = f + Q^T lam,   Q (dv/dt, dw'/dt) = gamma,   Q (v, w') = nu,   g = 0,     M = diag(m 1, I'),

v of the centres of mass in world axes, w' in body axes, f including the gyroscopic torque ``-w' x I' w'``
[MASS (36)-(39), C4 (4.84)-(4.97)].

`turns` are approximate values of the joint coordinates that elements read, wrong by less than half a turn; they
determine the full turns of angles. A formulation integrates them by the rates given here, as part of its coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State, continuous_in_time
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace, flatten, holonomic_rows, pack, unpack, workspace
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.bodies.mass_metric import factorise, mass_matrix
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.projection import project
from consilience.reference.formulations.row_selection import RowSelection, selection
from consilience.reference.kernel.compiled import kernel


@kernel
def _evaluate(model: Model, t: float, y: Array, turns: Array, ws: Workspace, rates: Array, errors: Array) -> None:
    """Evaluate all terms at the rotation matrices in ``ws.A``.

    Parameters
    ----------
    model, t, y, turns, ws
        As in `constraints.evaluate`.
    rates : ndarray, shape (n_c,)
        Overwritten by the rates of the joint coordinates that elements read.
    errors : ndarray, shape (n_b + n_e, 13)
        Its rows after those of the bodies are overwritten by the control errors.
    """
    forces.evaluate(model, t, y, turns, ws)
    constraints.evaluate(model, t, y, turns, ws)
    forces.control_errors(model, t, y, turns, ws, errors)
    for n in range(turns.shape[0]):
        rates[n] = coordinate(model, y, ws.A, n, turns[n]).rate


class Terms(NamedTuple):
    """Terms at one state, n_b bodies and q rows of which the first q_h are holonomic."""

    f: Array  # (6 n_b,) applied and gyroscopic forces
    Q: Array  # (q, 6 n_b)
    gamma: Array  # (q,)
    rate: Array  # (q,) nu
    value: Array  # (q,) g; zero for the non-holonomic rows
    integral_rates: Array  # (n_controls,) target - q
    turn_rates: Array  # (n_c,) of the joint coordinates that elements read


class BodyTerms:
    """Evaluation of the terms of one mechanism.

    Parameters
    ----------
    mechanism : Mechanism

    Attributes
    ----------
    inertia : ndarray, shape (n_b, 3, 3)
        I' about the centres of mass, body axes.
    mass : ndarray, shape (6 n_b, 6 n_b)
        M.
    holonomic : int
        q_h.
    integrals, turns : int
        Numbers of integrals of controllers and of joint coordinates that elements read.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._model = flatten(mechanism)
        self._ws = workspace(self._model)
        self.inertia, self.mass = self._model.inertia, mass_matrix(self._model)
        self.holonomic = holonomic_rows(self._model)
        self.integrals = len(mechanism.controls)
        self.turns = len(self._model.coordinate)

    def integrals_of(self, y: Array) -> Array:
        """Return the integrals of controllers in a packed state, a view, shape (n_controls,)."""
        integrals: Array = y[len(self._model.mass) :].reshape(-1)[: self.integrals]
        return integrals

    def evaluate(self, t: float, y: Array, turns: Array, A: Array | None = None) -> Terms:
        """Evaluate the terms at a packed state.

        Parameters
        ----------
        t : float, s
        y : ndarray, shape (n_b + n_e, 13)
        turns : ndarray, shape (n_c,)
        A : ndarray, shape (n_b, 3, 3), optional
            Rotation matrices in place of those of the Euler parameters in y.

        Returns
        -------
        Terms
            Views of the work arrays, which the next call overwrites, except for the rates.
        """
        ws = self._ws
        if A is None:
            rotations(y, ws.A)
        else:
            ws.A[:] = A
        rates, errors = np.empty(self.turns), np.empty(y.shape)
        _evaluate(self._model, t, y, turns, ws, rates, errors)
        return Terms(ws.f, ws.Q, ws.gamma, ws.rate, ws.value, self.integrals_of(errors), rates)

    def kept_rows(self, found: Array, known: RowSelection) -> RowSelection:
        """Return the selection of rows of the last Q to go on with; arguments as in `row_selection.selection`."""
        return selection(self._ws.Q, found, known)

    def independent_rows(self, limit: int | None = None) -> Array:
        """Return the indices of independent rows of the last Q: pivots of a QR of ``L^-1 Q^T``, ``M = L L^T``.

        Parameters
        ----------
        limit : int, optional
            Upper limit: the rank where the constraints hold. Off the manifold dependent rows look independent.
        """
        self._ws.limit[0] = len(self._ws.Q) if limit is None else limit
        rank = factorise(self._model, self._ws)
        return self._ws.pivot[:rank].copy()

    def accelerations(self, terms: Terms, limit: int | None = None) -> tuple[Array, Array]:
        """Solve for (dv/dt, dw'/dt), shape (6 n_b,), and the multipliers, shape (q,), zero for dependent rows.

        Parameters
        ----------
        terms : Terms
            Result of the last evaluation.
        limit : int, optional
            As in `independent_rows`.
        """
        rows, n = self.independent_rows(limit), len(terms.f)
        K = np.zeros((n + len(rows), n + len(rows)))
        K[:n, :n], K[:n, n:], K[n:, :n] = self.mass, -terms.Q[rows].T, terms.Q[rows]
        solution = np.linalg.solve(K, np.concatenate([terms.f, terms.gamma[rows]]))
        lam = np.zeros(len(terms.Q))
        lam[rows] = solution[n:]
        return solution[:n], lam

    def read(self, y: Array, A: Array, near: Array) -> Array:
        """Return the joint coordinates that elements read, angles within half a turn of `near`, shape (n_c,).

        Parameters
        ----------
        y : ndarray, shape (n_b + n_e, 13)
        A : ndarray, shape (n_b, 3, 3)
            Rotation matrices in place of those of the Euler parameters in y.
        near : ndarray, shape (n_c,), m or rad
        """
        value, rate = np.empty(self.turns), np.empty(self.turns)
        forces.read(self._model, y, A, near, value, rate)
        return value

    def count_turns(self, y: Array, turns: Array) -> Array:
        """Return the joint coordinates that elements read at y, angles within half a turn of `turns`, shape (n_c,)."""
        counted = turns.copy()
        forces.count_turns(self._model, y, self._ws, counted)
        return counted

    def project(self, t: float, y: Array, turns: Array) -> Array:
        """Project y in place onto ``g = 0``, ``Q (v, w') = nu`` [MASS]; return rows that are independent there."""
        project(self._model, t, y, turns, self._ws)
        rows: Array = self._ws.pivot[: self._ws.limit[0]].copy()
        return rows


class DaeMotion:
    """State of an integration of the descriptor form with multipliers as unknowns, step by step.

    Attributes
    ----------
    t : float, s
    y : ndarray, shape (n_b + n_e, 13)
        Packed state.
    counters : dict
    """

    def __init__(self, mechanism: Mechanism, state: State, t: float, counters: tuple[str, ...]) -> None:
        self.t, self.y = t, pack(mechanism, state)
        self.counters: dict[str, int | float] = dict.fromkeys(counters, 0)
        self._mechanism, self._terms, self._n_b = mechanism, BodyTerms(mechanism), len(mechanism.bodies)
        self._inverse_mass = np.linalg.inv(self._terms.mass)
        self._angles = self._terms.count_turns(self.y, np.zeros(self._terms.turns))

    def _end_step(self, terms: Terms, rows: Array, lam: Array) -> None:
        """Record the multipliers of independent rows at the end of a step, and count turns."""
        self._lam = np.zeros(len(terms.Q))
        self._lam[rows] = lam
        self._force, self._Q = terms.Q.T @ self._lam, terms.Q.copy()
        self._angles = self._terms.count_turns(self.y, self._angles)
        self.counters["steps"] += 1

    def multipliers(self) -> Array:
        """Return the multipliers lam of all rows, of least norm for dependent rows, shape (q,)."""
        return least_norm_multipliers(self._Q, self._force)

    def answer(self, times: Array, samples: list[Array]) -> TrajectoryAnswer:
        """Return the canonical motion of packed samples, with the counters."""
        p, quat, v, w = unpack(self._mechanism, np.array(samples))
        return TrajectoryAnswer(times, p, continuous_in_time(quat), v, w, self.counters)


def least_norm_multipliers(Q: Array, constraint_force: Array) -> Array:
    """Return the lam of least norm with ``Q^T lam = constraint_force``, shape (q,)."""
    if len(Q) == 0:
        return np.zeros(0)
    return np.linalg.lstsq(Q.T, constraint_force, rcond=RANK_TOLERANCE)[0]
