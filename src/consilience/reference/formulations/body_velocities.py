"""Formulations in the velocities (v, w') of all bodies, with compiled accelerations.

    M (dv/dt, dw'/dt) = f + Q^T lam,    Q (dv/dt, dw'/dt) = gamma                     [MASS (36)-(39), C4 (4.84)-(4.97)]

======================  ==================================================================================
name                    accelerations by
======================  ==================================================================================
descriptor              full descriptor form, index 1, QR in the metric of the masses (`descriptor`)
null_space              minimal form, null space by singular value decomposition (`null_space`)
null_space_qr           minimal form, null space by pivoted QR (`null_space_qr`)
coordinate_partitioning minimal form in independent velocities, full pivoting (`partitioning`)
articulated_body        minimal form along a spanning tree, articulated bodies, cut joints (`recursive`)
composite_body          the same with the joint-space mass matrix of composite bodies (`recursive`)
======================  ==================================================================================

All share the coordinates ``u = (y, turns)`` and a chart:

- y: the packed state of `bodies.arrays`, row by row;
- turns: the joint coordinates that elements read. A pose determines an angle up to full turns; these angles are
  integrated by their rates and determine the full turns, nothing else;
- chart: independent rows, found where the constraints hold and kept off the manifold, where dependent rows look
  independent. It is constant between calls of `settle` (and of `coordinates`).

`settle` projects y onto the constraints in the mass metric, reads the angles from the poses, and selects rows.

**Reactions.** The descriptor form computes its multipliers with the accelerations. For the other formulations they are
the solution of least norm of ``Q^T lam = M a - f`` [C4 (4.84)-(4.97)].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from consilience.engine import Unsupported
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State, float_array
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import Model, P, Workspace, flatten, pack, unpack, workspace
from consilience.reference.bodies.canonical import at_origins, joint_wrenches
from consilience.reference.bodies.forces import control_errors, count_turns
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.bodies.mass_metric import factorise, mass_matrix
from consilience.reference.bodies.motion import rotations, state_rates
from consilience.reference.bodies.projection import project
from consilience.reference.bodies.spanning_tree import TreeModel, flatten_tree
from consilience.reference.formulations import descriptor, null_space, null_space_qr, partitioning, recursive
from consilience.reference.formulations.row_selection import RowSelection, selection
from consilience.reference.kernel.compiled import kernel

AppliedForces = Callable[[float, State], Array]

KERNELS: dict[str, Callable[..., int]] = {
    "descriptor": descriptor.accelerations,
    "null_space": null_space.accelerations,
    "null_space_qr": null_space_qr.accelerations,
    "coordinate_partitioning": partitioning.accelerations,
}
"""Kernels of accelerations from all constraint rows; parameters as in `descriptor.accelerations`."""

TREE_KERNELS: dict[str, Callable[..., int]] = {
    "articulated_body": recursive.accelerations,
    "composite_body": recursive.composite_accelerations,
}
"""Kernels of accelerations along a spanning tree, their first parameter."""


def kernel_names() -> tuple[str, ...]:
    """Return the names of the formulations of this module."""
    return (*KERNELS, *TREE_KERNELS)


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Return nothing: the kernels represent every joint and element."""
    return ()


@kernel
def _rates(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array, dy: Array, rates: Array) -> None:
    """Write the derivative dy of y with the accelerations a, and the rates of the turns; ``ws.A`` belongs to y.

    Parameters
    ----------
    model, t, y, turns, ws
        As in `constraints.evaluate`.
    a : ndarray, shape (6 n_b,)
        Accelerations (dv/dt, dw'/dt).
    dy : ndarray, shape (n_b + n_e, 13)
        Overwritten.
    rates : ndarray, shape (n_c,)
        Overwritten by the rates of the joint coordinates that elements read.
    """
    control_errors(model, t, y, turns, ws, dy)
    state_rates(y, a, dy)
    for n in range(turns.shape[0]):
        rates[n] = coordinate(model, y, ws.A, n, turns[n]).rate


class KernelFormulation:
    """Formulation in body velocities with compiled accelerations.

    Parameters
    ----------
    mechanism : Mechanism
    name : str
        Key of `KERNELS` or `TREE_KERNELS`.
    forces : callable, optional
        ``forces(t, state)``: force (N) and torque (N m) on each body at its origin, world axes, shape (n_b, 6), in
        addition to those of the mechanism; called at every evaluation.

    Raises
    ------
    InvalidInput
        If there is no kernel of that name.

    Attributes
    ----------
    chart : tuple of int
        Selected independent rows.
    """

    def __init__(self, mechanism: Mechanism, name: str, forces: AppliedForces | None = None) -> None:
        if name not in KERNELS and name not in TREE_KERNELS:
            known = ", ".join([*KERNELS, *TREE_KERNELS])
            raise InvalidInput(f"formulation '{name}'", "there is no kernel of that name", f"Kernels: {known}.")
        self.name = name
        self.forces = forces
        self.mechanism = mechanism
        self.model = flatten(mechanism)
        self._kernel = KERNELS[name] if name in KERNELS else TREE_KERNELS[name]
        self._tree: tuple[TreeModel, ...] = () if name in KERNELS else (flatten_tree(mechanism),)
        self._ws = workspace(self.model)
        self.chart: RowSelection = ()

    def coordinates(self, state: State) -> Array:
        """Return coordinates u of a consistent state; angles within half a turn of zero, integrals zero."""
        y, turns = self._packed(state)
        ws = self._ws
        rotations(y, ws.A)
        constraints.evaluate(self.model, 0.0, y, turns, ws)
        ws.limit[0] = len(ws.Q)
        self.chart = selection(ws.Q, ws.pivot[: factorise(self.model, ws)])
        return np.concatenate([y.ravel(), turns])

    def state(self, u: Array) -> State:
        """Return the canonical state of u, Euler parameters normalised."""
        return self._state(self._split(u)[0])

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt`` at the time t, shape (n_u,)."""
        y, turns = self._split(u)
        du = np.zeros(len(u))
        dy, rates = self._split(du)
        a = self._solve(t, y, turns, self.chart)
        _rates(self.model, t, y, turns, self._ws, a, dy, rates)
        return du

    def settle(self, t: float, u: Array) -> Array:
        """Project u onto the constraints and select rows there; return a new array with the turns found."""
        settled, ws = np.array(u, dtype=float), self._ws
        y, turns = self._split(settled)
        ws.limit[0] = len(self.chart) or len(ws.Q)
        project(self.model, t, y, turns, ws)
        self.chart = selection(ws.Q, ws.pivot[: ws.limit[0]], self.chart)
        count_turns(self.model, y, ws, turns)
        return settled

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3).

        Raises
        ------
        NumericalFailure
            If accelerations are not finite, for example at a spring of no length.
        """
        y, turns = self._packed(state)
        return at_origins(self.mechanism, y, self._finite(t, y, turns))

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return joint reactions on the successor, at the origin of M, axes of F, each shape (n_j, 3).

        Where dependent rows leave reactions undetermined, those of least norm.

        Raises
        ------
        NumericalFailure
            If the accelerations are not finite.
        """
        wrench = joint_wrenches(self.mechanism, state, self.multipliers(state, t))
        return wrench[:, :3], wrench[:, 3:]

    def multipliers(self, state: State, t: float = 0.0) -> Array:
        """Return the multipliers of all rows, of least norm, shape (q,)."""
        y, turns = self._packed(state)
        ws, a = self._ws, self._finite(t, y, turns)
        if self.name == "descriptor":
            return descriptor.multipliers(self.model, t, y, turns, ws, a)
        constraints.evaluate(self.model, t, y, turns, ws)  # tree kernels evaluate the rows of cut joints only
        constraint_force = mass_matrix(self.model) @ a - ws.f
        lam: Array = np.linalg.lstsq(ws.Q.T, constraint_force, rcond=RANK_TOLERANCE)[0]
        return lam

    def _solve(self, t: float, y: Array, turns: Array, rows: RowSelection = ()) -> Array:
        """Compute accelerations (dv/dt, dw'/dt), shape (6 n_b,), with the rows given; none: with rows selected here."""
        a, ws = np.empty(6 * len(self.mechanism.bodies)), self._ws
        if self.forces is not None:
            self._ws.external[:] = self._external(self.forces, t, y)
        found = ws.best[0].rank  # rows are selected anew where it is zero
        ws.limit[0], ws.best[0].rank = len(ws.Q), 0
        if rows:
            ws.limit[0], ws.best[0].rank, ws.pivot[: len(rows)] = len(rows), len(rows), rows
        self._kernel(*self._tree, self.model, t, y, turns, ws, a)
        ws.best[0].rank = found
        return a

    def _external(self, forces: AppliedForces, t: float, y: Array) -> Array:
        """Evaluate the callback; return forces at the centres of mass and torques in body axes, shape (6 n_b,)."""
        state = self._state(y)
        remedy = "Return force and torque of every body, (n_b, 6)."
        wrench = float_array(forces(t, state), "forces", remedy)
        if wrench.shape != (len(self.mechanism.bodies), 6):
            raise InvalidInput("forces", f"shape {wrench.shape}", remedy)
        A = state.R_WB
        c = np.einsum("bij,bj->bi", A, np.array([b.com for b in self.mechanism.bodies]))
        torque = wrench[:, 3:] - np.cross(c, wrench[:, :3])
        return np.hstack([wrench[:, :3], np.einsum("bji,bj->bi", A, torque)]).ravel()

    def _finite(self, t: float, y: Array, turns: Array) -> Array:
        a = self._solve(t, y, turns)
        if not np.all(np.isfinite(a)):
            raise NumericalFailure(f"reference, {self.name}: the accelerations are not finite")
        return a

    def _packed(self, state: State) -> tuple[Array, Array]:
        """Return the packed state y and its turns."""
        y, turns = pack(self.mechanism, state), np.zeros(len(self.model.coordinate))
        count_turns(self.model, y, self._ws, turns)
        return y, turns

    def _state(self, y: Array) -> State:
        """Return the canonical state of y."""
        unit = y.copy()
        quat = unit[: len(self.mechanism.bodies), P]
        quat /= np.linalg.norm(quat, axis=1, keepdims=True)
        return State(*unpack(self.mechanism, unit))

    def _split(self, u: Array) -> tuple[Array, Array]:
        """Return views of u: y, shape (n_b + n_e, 13), and the turns, shape (n_c,)."""
        count = len(u) - len(self.model.coordinate)
        y: Array = u[:count].reshape(-1, 13)
        return y, u[count:]
