"""Mass matrix, forces and constraint equations of an assembled Exudyn system, read from Exudyn's solver.

Exudyn's equations are ``M q'' + Cq^T lam = f`` and ``Cq q'' = -c`` in seven coordinates per body. They are transformed
to ``a = (a_WB_W, alpha_WB_W)`` of each body by ``q' = T v`` and ``q'' = T a + S``; the columns of T span the tangent
space of unit Euler parameters e. ``S = -1/4 |w|^2 e`` has no effect on any term: Exudyn writes ``w = 2 G e'``, and
``G e = 0``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from consilience.engine import limit_of_halved
from consilience.mechanism import (
    Array,
    SphereSphere,
    State,
    characteristic_length,
    euler_parameter_matrix,
    rotation_from_quaternion,
)
from consilience_exudyn.contacts import AT_INSTANT, OVERLAPS, parts_of, set_overlap
from consilience_exudyn.library import POINTWISE, exu, simulation_settings
from consilience_exudyn.maximal import Maximal, coordinates, count_turns, place, velocities
from consilience_exudyn.rows import DiscRow, gammas


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
    """Return T of ``q' = T (v_WB_W, w_WB_W)``, shape (7 n_b, 6 n_b)."""
    blocks = [
        block_diag(np.eye(3), 0.5 * euler_parameter_matrix(q).T @ rotation_from_quaternion(q).T) for q in state.quat_WB
    ]
    return np.asarray(block_diag(*blocks))


def convective_terms(
    q: Array,
    v: Array,
    lengths: Array,
    size: float,
    place: Callable[[Array, Array], None],
    algebraic: Callable[[bool], Array],
) -> Array:
    """Return ``c = d/ds C'(q + s v, v)`` of all algebraic rows by a central stencil with a large step.

    The stencil is exact for polynomials of degree four; the step moves coordinates by a quarter of a length or of an
    Euler parameter, in any units. C is a polynomial in the Euler parameters, C' along a straight line a polynomial of
    degree four at most. The equation ``|d| - L`` of a rod is no polynomial, but ``|d| C'`` is, and
    where ``C' = 0`` its derivative is ``|d| c``. Exported scripts contain the text of this function.

    Parameters
    ----------
    q, v : ndarray, shape (n,)
        Coordinates and rates.
    lengths : ndarray, shape (n_rows,), m
        Distance of the rod of each row; zero for rows that are polynomials.
    size : float, m
        Characteristic length of the mechanism.
    place : callable
        Sets coordinates and rates of the current configuration.
    algebraic : callable
        Returns the algebraic rows there: C' if its argument is true, else C.
    """
    rate = float(np.max(np.abs(v) / np.resize([size] * 3 + [1.0] * 4, len(v)), initial=0.0))
    step = 0.25 / rate if rate > 0.0 else 1.0
    rod = lengths > 0.0
    total = np.zeros(len(lengths))
    for point, weight in ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0)):
        place(q + point * step * v, v)
        distance = np.where(rod, lengths + algebraic(False), 1.0)
        total += weight * distance * algebraic(True)
    return total / (12.0 * step) / np.where(rod, lengths, 1.0)


class Terms:
    """Terms of the equations of one system, evaluated by Exudyn's solver.

    Attributes
    ----------
    model : Maximal
    rows : ndarray of int, shape (r,)
        Algebraic equations of joints, then of the rows of `rows_of`; the other algebraic equations are the unit norms
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
        self._lengths, self._length = self._rod_lengths(), characteristic_length(model.mechanism)

    def _rod_lengths(self) -> Array:
        """Distance of the rod of each algebraic row; zero for rows that are polynomials."""
        lengths = np.zeros(self._solver.GetAEsize())
        for joint, objects in zip(self.model.mechanism.joints, self.model.joints, strict=True):
            if joint.kind == "rod" and objects:
                lengths[self._data.GetObjectLTGAE(objects[0])] = joint.length
        return lengths

    def place(self, q: Array, v: Array) -> None:
        """Set coordinates and rates of the current configuration."""
        place(self.model, q, v, exu.ConfigurationType.Current)

    def mass_matrix(self, state: State) -> Array:
        """Return the mass matrix in ``(v_WB_W, w_WB_W)`` of each body, shape (6 n_b, 6 n_b)."""
        self.place(coordinates(state), velocities(state))
        T = velocity_map(state)
        return np.asarray(T.T @ self._coordinate_mass() @ T)

    def constraint_jacobian(self, state: State) -> Array:
        """Return the Jacobian of the constraint rows in ``(v_WB_W, w_WB_W)`` of each body, shape (r, 6 n_b)."""
        self.place(coordinates(state), velocities(state))
        return np.asarray(self._coordinate_jacobian() @ velocity_map(state))

    def equations(self, state: State) -> Equations:
        """Return all terms at a consistent state, at which the current configuration is left."""
        q, v = coordinates(state), velocities(state)
        count_turns(self.model, state, exu.ConfigurationType.Current)
        c = convective_terms(q, v, self._lengths, self._length, self.place, self._algebraic)
        c = c[self.rows][: self._native]
        self.place(q, v)
        T = velocity_map(state)
        M, J = self._coordinate_mass(), self._coordinate_jacobian() @ T
        self._solver.ComputeODE2RHS(self.model.system)
        f = self._residual()[: self._size]
        gamma = np.append(-c, self._added_gamma(state, J[self._native :]))
        return Equations(M=T.T @ M @ T, f=T.T @ f, J=J, gamma=gamma)

    def _added_gamma(self, state: State, J: Array) -> Array:
        """Gamma of the rows behind those of Exudyn's joints, whose Jacobian is J.

        The rows of a disc are along directions in which the point of contact does not move; these directions are the
        columns of J for the velocity of the body.
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

    def contact_force(self, state: State, number: int | None) -> Array:
        """Return the forces of `Equations` with a unit normal force of one elementary contact, or of none.

        Levers in Exudyn's contacts are too long by half of the overlap: forces are extrapolated to none.
        """
        if number is None:
            return self._contact_force(state, None, AT_INSTANT.overlap)
        _, part = parts_of(self.model.mechanism)[number]
        overlap, count = OVERLAPS[isinstance(part, SphereSphere)]
        return limit_of_halved([self._contact_force(state, number, overlap / 2.0**n) for n in range(count)])

    def _contact_force(self, state: State, number: int | None, overlap: float) -> Array:
        system = self.model.system
        for n, (contact, (_, part)) in enumerate(zip(self.model.contacts, parts_of(self.model.mechanism), strict=True)):
            system.SetObjectParameter(contact, "contactStiffness", 1.0 / overlap if n == number else 0.0)
            set_overlap(system, contact, part, AT_INSTANT, overlap)
        count_turns(self.model, state, exu.ConfigurationType.Current)
        self.place(coordinates(state), velocities(state))
        self._solver.ComputeODE2RHS(system)
        return np.asarray(velocity_map(state).T @ self._residual()[: self._size])

    def set_multipliers(self, mu: Array) -> None:
        """Set the multipliers of the current configuration to those of `Equations`."""
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
