"""Mass matrix, forces and constraint equations of an assembled Exudyn system, read from its own solver.

Exudyn's equations are ``M q'' + Cq^T lam = f`` and ``Cq q'' = -c`` in seven coordinates per body. They are brought
to ``a = (a_WB_W, alpha_WB_W)`` of each body by ``q' = T v`` and ``q'' = T a + S``; the columns of T span what the unit
norms of the Euler parameters e allow. S is ``-1/4 |w|^2 e`` and no term sees it: Exudyn writes ``w = 2 G e'``, and
``G e = 0``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from consilience.mechanism import Array, State, euler_parameter_matrix, rotation_from_quaternion
from consilience_exudyn.library import POINTWISE, exu, simulation_settings
from consilience_exudyn.maximal import Maximal, coordinates, count_turns, place, velocities
from consilience_exudyn.rows import DiscRow, gammas

_STENCIL = ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))
"""Points and twelvefold weights of the central first derivative; exact for polynomials of degree four."""


@dataclass(frozen=True, eq=False)
class Equations:
    """``M a = f + J^T mu``, ``J a = gamma`` at one state, for ``a = (a_WB_W, alpha_WB_W)`` of each body.

    Attributes
    ----------
    M : ndarray, shape (6 n_b, 6 n_b)
    f : ndarray, shape (6 n_b,)
    J : ndarray, shape (r, 6 n_b)
        Rows of the joints, then the other constraints; Exudyn's multipliers are the negative of `mu`.
    gamma : ndarray, shape (r,)
    """

    M: Array
    f: Array
    J: Array
    gamma: Array


def velocity_map(state: State) -> Array:
    """T of ``q' = T (v_WB_W, w_WB_W)``, shape (7 n_b, 6 n_b)."""
    blocks = [
        block_diag(np.eye(3), 0.5 * euler_parameter_matrix(q).T @ rotation_from_quaternion(q).T) for q in state.quat_WB
    ]
    return np.asarray(block_diag(*blocks))


class Terms:
    """Exudyn's solver, initialised on one system, as a source of the terms of its equations.

    Attributes
    ----------
    rows : ndarray of int, shape (r,)
        Algebraic equations of joints, then of all rows without an object of Exudyn's; the others are the unit norms
        of Euler parameters.
    """

    def __init__(self, model: Maximal) -> None:
        self.model = model
        self._data = model.system.systemData
        self._solver = exu.MainSolverImplicitSecondOrder()
        self._solver.InitializeSolver(model.system, simulation_settings(POINTWISE))
        self._size = 7 * len(model.bodies)
        self._above = self._size + model.integrals
        added = [row.index for row in model.rows]
        native = [index for objects in model.joints for index in objects if index not in added]
        self._native = sum(len(self._data.GetObjectLTGAE(index)) for index in native)
        self.rows = np.array([row for index in native + added for row in self._data.GetObjectLTGAE(index)], dtype=int)
        self._lengths = self._rod_lengths()

    def _rod_lengths(self) -> Array:
        """Length per algebraic row: of a rod its distance, zero for rows that are polynomials as they are."""
        lengths = np.zeros(self._solver.GetAEsize())
        for joint, objects in zip(self.model.mechanism.joints, self.model.joints, strict=True):
            if joint.kind == "rod" and objects:
                lengths[self._data.GetObjectLTGAE(objects[0])] = joint.length
        return lengths

    def place(self, q: Array, v: Array) -> None:
        """Put the current configuration at coordinates `q` and rates `v`."""
        place(self.model, q, v, exu.ConfigurationType.Current)

    def mass_matrix(self, state: State) -> Array:
        """Mass matrix in ``(v_WB_W, w_WB_W)`` of each body, shape (6 n_b, 6 n_b)."""
        self.place(coordinates(state), velocities(state))
        T = velocity_map(state)
        return np.asarray(T.T @ self._coordinate_mass() @ T)

    def constraint_jacobian(self, state: State) -> Array:
        """Jacobian of the joint rows for ``(v_WB_W, w_WB_W)`` of each body, shape (r, 6 n_b)."""
        self.place(coordinates(state), velocities(state))
        return np.asarray(self._coordinate_jacobian() @ velocity_map(state))

    def equations(self, state: State) -> Equations:
        """All terms at a consistent state; leaves the current configuration there."""
        q, v = coordinates(state), velocities(state)
        count_turns(self.model, state, exu.ConfigurationType.Current)
        c = self._convective(q, v)[: self._native]
        self.place(q, v)
        T = velocity_map(state)
        M, J = self._coordinate_mass(), self._coordinate_jacobian() @ T
        self._solver.ComputeODE2RHS(self.model.system)
        f = self._residual()[: self._size]
        gamma = np.append(-c, self._added_gamma(state, J[self._native :]))
        return Equations(M=T.T @ M @ T, f=T.T @ f, J=J, gamma=gamma)

    def _added_gamma(self, state: State, J: Array) -> Array:
        """Gamma of the rows behind the native ones, whose Jacobian is J.

        Those of a disc are directions in which the point of contact does not move; the columns of the body's
        velocity hold them.
        """
        known, found, start = gammas(self.model.mechanism, state), [np.zeros(0)], 0
        for added in self.model.rows:
            values = known[added.number]
            if isinstance(added.row, DiscRow):
                body = self.model.mechanism.body_index[added.row.rolling.body]
                values = J[start : start + 3, 6 * body : 6 * body + 3] @ values
            else:
                values = values[list(added.kept)]
            found.append(values)
            start += len(values)
        return np.concatenate(found)

    def set_multipliers(self, mu: Array) -> None:
        """Give the current configuration the multipliers that belong to `Equations`."""
        lam = np.zeros(self._solver.GetAEsize())
        lam[self.rows] = -mu
        self._data.SetAECoordinates(lam, exu.ConfigurationType.Current)

    def _residual(self) -> Array:
        return np.array(self._solver.GetSystemResidual())

    def _coordinate_mass(self) -> Array:
        self._solver.ComputeMassMatrix(self.model.system)
        return np.array(self._solver.GetSystemMassMatrix())[: self._size, : self._size]

    def _coordinate_jacobian(self) -> Array:
        system, solver = self.model.system, self._solver
        # the first call sets the whole matrix to zero, the second adds to it
        solver.ComputeJacobianODE2RHS(system, scalarFactor_ODE2=0.0, scalarFactor_ODE2_t=0.0, scalarFactor_ODE1=0.0)
        solver.ComputeJacobianAE(
            system, scalarFactor_ODE2=1.0, scalarFactor_ODE2_t=1.0, scalarFactor_ODE1=1.0, velocityLevel=False
        )
        jacobian: Any = np.array(solver.GetSystemJacobian())
        return np.asarray(jacobian[self._above :, : self._size][self.rows])

    def _algebraic(self, velocity_level: bool) -> Array:
        self._solver.ComputeAlgebraicEquations(self.model.system, velocityLevel=velocity_level)
        return self._residual()[self._above :]

    def _convective(self, q: Array, v: Array) -> Array:
        """``c = d/ds C'(q + s v, v)`` of the joint rows by one central stencil with a big step, without truncation.

        C is a polynomial in the Euler parameters, C' along a straight line one of degree at most four. The rod's
        ``|d| - L`` is not, but ``|d| C'`` is, and where ``C' = 0`` its derivative is ``|d| c``.
        """
        step = 0.25 / max(1.0, float(np.max(np.abs(v), initial=0.0)))
        rod = self._lengths > 0.0
        total = np.zeros(len(self._lengths))
        for point, weight in _STENCIL:
            self.place(q + point * step * v, v)
            distance = np.where(rod, self._lengths + self._algebraic(False), 1.0)
            total += weight * distance * self._algebraic(True)
        return np.asarray((total / (12.0 * step) / np.where(rod, self._lengths, 1.0))[self.rows])
