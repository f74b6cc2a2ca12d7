"""Formulations in body velocities: the compiled kernels as `consilience.reference.formulations.protocol.Formulation`.

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

All share the coordinates ``u = (y, angles, rank)``, so that the derivative depends on t and u alone:

- the packed state y of `bodies.arrays` row by row: poses by Euler parameters, velocities v and w' of all
  bodies, integrals of controllers;
- the joint coordinates that elements read, angles with their full turns. The poses say an angle only up to turns: the
  angles are integrated with their own rates, decide about the turns and nothing else;
- the rank of the constraints where they hold, the upper limit of that found off the manifold, where rows that depend on
  others seem independent. It is constant between calls of `settle`.

`settle` projects positions and velocities onto the constraints in the metric of the masses, reads the angles from the
poses, and finds the rank.

**Reactions.** The descriptor form has its multipliers with the accelerations. For the others, which eliminate them,
they come from the equations of motion once the accelerations are known, ``Q^T lam = M a - f`` [C4 (4.84)-(4.97)], as
the solution of least norm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from consilience.engine import Unsupported
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import Model, P, Workspace, all_rows, flatten, pack, unpack, workspace
from consilience.reference.bodies.canonical import at_origins, joint_wrenches
from consilience.reference.bodies.forces import control_errors, count_turns
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.bodies.projection import project
from consilience.reference.bodies.spanning_tree import TreeModel, flatten_tree
from consilience.reference.formulations import descriptor, null_space, null_space_qr, partitioning, recursive
from consilience.reference.kernel.compiled import kernel

AppliedForces = Callable[[float, State], Array]

KERNELS: dict[str, Callable[..., int]] = {
    "descriptor": descriptor.accelerations,
    "null_space": null_space.accelerations,
    "null_space_qr": null_space_qr.accelerations,
    "coordinate_partitioning": partitioning.accelerations,
}
"""Accelerations from all constraint rows, arguments as in `descriptor.accelerations`."""

TREE_KERNELS: dict[str, Callable[..., int]] = {
    "articulated_body": recursive.accelerations,
    "composite_body": recursive.composite_accelerations,
}
"""The same along a spanning tree, which is their first argument."""


def kernel_names() -> tuple[str, ...]:
    """Formulations of this module."""
    return (*KERNELS, *TREE_KERNELS)


def unsupported(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Nothing: the kernels know every joint and element."""
    return ()


@kernel
def _rates(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array, dy: Array, turning: Array) -> None:
    """Derivatives of y and of the angles with the accelerations a: ``r' = v``, ``p' = 1/2 G^T w'`` [MASS (38)].

    The rotation matrices of y are in ``ws.A``.
    """
    control_errors(model, t, y, turns, ws, dy)
    for b in range(model.mass.shape[0]):
        e0, e1, e2, e3 = y[b, 3], y[b, 4], y[b, 5], y[b, 6]
        w1, w2, w3 = y[b, 10], y[b, 11], y[b, 12]
        for k in range(3):
            dy[b, k] = y[b, 7 + k]
        dy[b, 3] = -0.5 * (e1 * w1 + e2 * w2 + e3 * w3)
        dy[b, 4] = 0.5 * (e0 * w1 + e2 * w3 - e3 * w2)
        dy[b, 5] = 0.5 * (e0 * w2 + e3 * w1 - e1 * w3)
        dy[b, 6] = 0.5 * (e0 * w3 + e1 * w2 - e2 * w1)
        for k in range(6):
            dy[b, 7 + k] = a[6 * b + k]
    for n in range(turns.shape[0]):
        turning[n] = coordinate(model, y, ws.A, n, turns[n]).rate


class KernelFormulation:
    """A formulation in body velocities over compiled accelerations.

    Parameters
    ----------
    mechanism : Mechanism
    name : str
        Key of `KERNELS` or `TREE_KERNELS`.
    forces : callable, optional
        ``forces(t, state)``: force (N) and torque (N m) on each body at its origin, world axes, shape (n_b, 6), to act
        beside those of the mechanism. The slow path: Python is called at every evaluation.

    Raises
    ------
    InvalidInput
        If there is no kernel of that name.
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
        self._rows = all_rows(self.model)

    def coordinates(self, state: State) -> Array:
        """Coordinates u of a consistent state: angles within half a turn of zero, integrals of controllers zero."""
        y, turns = self._packed(state)
        _, rank = self._solve(0.0, y, turns, self._rows)
        return np.concatenate([y.ravel(), turns, [rank]])

    def state(self, u: Array) -> State:
        """Canonical state of u; Euler parameters are divided by their norm."""
        return self._state(self._split(u)[0])

    def derivative(self, t: float, u: Array) -> Array:
        """``du/dt`` at the time t, shape (n_u,)."""
        y, turns = self._split(u)
        du = np.zeros(len(u))
        dy, turning = self._split(du)
        a, _ = self._solve(t, y, turns, round(u[-1]))
        _rates(self.model, t, y, turns, self._ws, a, dy, turning)
        return du

    def settle(self, t: float, u: Array) -> Array:
        """New array: u projected onto the constraints, with the angles and the rank found there."""
        settled = np.array(u, dtype=float)
        y, turns = self._split(settled)
        self._ws.limit[0] = round(u[-1])
        project(self.model, t, y, turns, self._ws)
        count_turns(self.model, y, self._ws, turns)
        settled[-1] = self._ws.limit[0]
        return settled

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3).

        Raises
        ------
        NumericalFailure
            If they are not finite, for example at a spring of no length.
        """
        y, turns = self._packed(state)
        return at_origins(self.mechanism, y, self._finite(t, y, turns))

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Joint reactions, on the successor, at the origin of M, axes of F, each shape (n_j, 3).

        Of least norm where dependent rows leave them open.

        Raises
        ------
        NumericalFailure
            If the accelerations are not finite.
        """
        wrench = joint_wrenches(self.mechanism, state, self.multipliers(state, t))
        return wrench[:, :3], wrench[:, 3:]

    def multipliers(self, state: State, t: float = 0.0) -> Array:
        """Multipliers of all rows, of least norm, shape (q,)."""
        y, turns = self._packed(state)
        ws, a = self._ws, self._finite(t, y, turns)
        if self.name == "descriptor":
            return descriptor.multipliers(self.model, t, y, turns, ws, a)
        constraints.evaluate(self.model, t, y, turns, ws)  # a kernel along a tree has left only its own rows there
        constraint_force = mass_matrix(self.model) @ a - ws.f
        lam: Array = np.linalg.lstsq(ws.Q.T, constraint_force, rcond=RANK_TOLERANCE)[0]
        return lam

    def _solve(self, t: float, y: Array, turns: Array, limit: int) -> tuple[Array, int]:
        """Accelerations (dv/dt, dw'/dt) of all bodies, shape (6 n_b,), and the rank, which is `limit` at most."""
        a = np.empty(6 * len(self.mechanism.bodies))
        self._ws.limit[0] = limit
        if self.forces is not None:
            self._ws.external[:] = self._external(self.forces, t, y)
        # the order of rows that a projection left is no part of u: the choice is made anew
        found, self._ws.best[0] = self._ws.best[0], 0.0
        rank = self._kernel(*self._tree, self.model, t, y, turns, self._ws, a)
        self._ws.best[0] = found
        return a, rank

    def _external(self, forces: AppliedForces, t: float, y: Array) -> Array:
        """AppliedForces of the callback at the centres of mass, torques in body axes, shape (6 n_b,)."""
        state = self._state(y)
        wrench = np.asarray(forces(t, state), dtype=float)
        if wrench.shape != (len(self.mechanism.bodies), 6):
            raise InvalidInput("forces", f"shape {wrench.shape}", "Return force and torque of every body, (n_b, 6).")
        A = state.R_WB
        c = np.einsum("bij,bj->bi", A, np.array([b.com for b in self.mechanism.bodies]))
        torque = wrench[:, 3:] - np.cross(c, wrench[:, :3])
        return np.hstack([wrench[:, :3], np.einsum("bji,bj->bi", A, torque)]).ravel()

    def _finite(self, t: float, y: Array, turns: Array) -> Array:
        a, _ = self._solve(t, y, turns, self._rows)
        if not np.all(np.isfinite(a)):
            raise NumericalFailure(f"reference, {self.name}: the accelerations are not finite")
        return a

    def _packed(self, state: State) -> tuple[Array, Array]:
        """Packed state y, and the angles that go with it."""
        y, turns = pack(self.mechanism, state), np.zeros(len(self.model.coordinate))
        count_turns(self.model, y, self._ws, turns)
        return y, turns

    def _state(self, y: Array) -> State:
        """Canonical state of y."""
        unit = y.copy()
        quat = unit[: len(self.mechanism.bodies), P]
        quat /= np.linalg.norm(quat, axis=1, keepdims=True)
        return State(*unpack(self.mechanism, unit))

    def _split(self, u: Array) -> tuple[Array, Array]:
        """Views of u: y, shape (n_b + n_e, 13), and the angles, shape (n_c,)."""
        count = len(u) - len(self.model.coordinate) - 1
        y: Array = u[:count].reshape(-1, 13)
        return y, u[count:-1]
