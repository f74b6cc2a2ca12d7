"""Rows and forces of a mechanism at a state, in body velocities: what every descriptor form is written with.

    M (dv/dt, dw'/dt) = f + Q^T lam,   Q (dv/dt, dw'/dt) = gamma,   Q (v, w') = nu,   g = 0,     M = diag(m 1, I'),

v of the centres of mass in world axes, w' in body axes, f with the gyroscopic torque ``-w' x I' w'`` in it. All calls
of the compiled kernels from the forms written in NumPy are here.

The full turns of the joint coordinates that elements read are told by `angles`, values that may be off by anything
below half a turn. A form that carries them along, by the rates given here, has all of its state in its coordinates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace, flatten, holonomic_rows, workspace
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.bodies.mass_metric import factorise
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.projection import project
from consilience.reference.kernel.compiled import kernel


@kernel
def _evaluate(model: Model, t: float, y: Array, angles: Array, ws: Workspace, rates: Array, errors: Array) -> None:
    """All terms at the rotation matrices in ``ws.A``."""
    forces.evaluate(model, t, y, angles, ws)
    constraints.evaluate(model, t, y, angles, ws)
    forces.control_errors(model, t, y, angles, ws, errors)
    for n in range(angles.shape[0]):
        rates[n] = coordinate(model, y, ws.A, n, angles[n]).rate


class Terms(NamedTuple):
    """Terms at one state, n_b bodies and q rows of which the first q_h are holonomic."""

    f: Array  # (6 n_b,) applied and gyroscopic forces
    Q: Array  # (q, 6 n_b)
    gamma: Array  # (q,)
    rate: Array  # (q,) nu
    value: Array  # (q,) g; zero for the non-holonomic rows
    integral_rates: Array  # (n_controls,) target - q
    angle_rates: Array  # (n_c,)


class BodyTerms:
    """Terms of one mechanism.

    Parameters
    ----------
    mechanism : Mechanism

    Attributes
    ----------
    mass : ndarray, shape (6 n_b, 6 n_b)
        M.
    holonomic : int
        q_h.
    integrals, angles : int
        Numbers of integrals of controllers and of joint coordinates that elements read.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._model = flatten(mechanism)
        self._ws = workspace(self._model)
        n_b = len(mechanism.bodies)
        self.mass = np.zeros((6 * n_b, 6 * n_b))
        for b, body in enumerate(mechanism.bodies):
            self.mass[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = body.mass * np.eye(3)
            self.mass[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = body.inertia
        self.holonomic = holonomic_rows(self._model)
        self.integrals = len(mechanism.controls)
        self.angles = len(self._model.coordinate)

    def evaluate(self, t: float, y: Array, angles: Array, A: Array | None = None) -> Terms:
        """Terms at a packed state y, shape (n_b + n_e, 13), of `consilience.reference.bodies.arrays`.

        Parameters
        ----------
        A : ndarray, shape (n_b, 3, 3), optional
            Rotation matrices; those of the Euler parameters in y by default.

        Returns
        -------
        Terms
            Arrays that the next call overwrites, except for the rates.
        """
        ws = self._ws
        if A is None:
            rotations(y, ws.A)
        else:
            ws.A[:] = A
        rates, errors = np.empty(self.angles), np.empty(y.shape)
        _evaluate(self._model, t, y, angles, ws, rates, errors)
        integral_rates = errors[len(self._model.mass) :].reshape(-1)[: self.integrals]
        return Terms(ws.f, ws.Q, ws.gamma, ws.rate, ws.value, integral_rates, rates)

    def independent_rows(self, limit: int | None = None) -> Array:
        """Numbers of independent rows of the Q evaluated last: pivots of a QR of ``L^-1 Q^T``, ``M = L L^T``.

        Parameters
        ----------
        limit : int, optional
            Most rows to take: the rank where the constraints hold. Off them dependent rows look independent.
        """
        self._ws.limit[0] = len(self._ws.Q) if limit is None else limit
        rank = factorise(self._model, self._ws)
        return self._ws.pivot[:rank].copy()

    def accelerations(self, terms: Terms, limit: int | None = None) -> tuple[Array, Array]:
        """(dv/dt, dw'/dt), shape (6 n_b,), and multipliers of independent rows, the others zero, shape (q,).

        Parameters
        ----------
        terms : Terms
            Those evaluated last.
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

    def count_turns(self, y: Array, angles: Array) -> Array:
        """Joint coordinates that elements read at y, within half a turn of `angles`, shape (n_c,)."""
        counted = angles.copy()
        forces.count_turns(self._model, y, self._ws, counted)
        return counted

    def project(self, t: float, y: Array, angles: Array) -> int:
        """Move y in place to ``g = 0``, ``Q (v, w') = nu`` [MASS: kinematical assembling during integration].

        Returns
        -------
        int
            Rank to work with until the next projection.
        """
        project(self._model, t, y, angles, self._ws)
        return int(self._ws.limit[0])


def least_norm_multipliers(Q: Array, constraint_force: Array) -> Array:
    """The lam of least norm with ``Q^T lam = constraint_force``, shape (q,)."""
    if len(Q) == 0:
        return np.zeros(0)
    return np.linalg.lstsq(Q.T, constraint_force, rcond=RANK_TOLERANCE)[0]
