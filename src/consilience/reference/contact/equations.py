"""Equations of motion of a mechanism with lasting contacts, stops and dry friction.

    M a = f + Q^T lam + J^T p,     Q a = gamma,     u' = J a + bias,

with the rows J of `layout` and the forces p on them. With ``M = L L^T`` and P the projector onto the null space of
``Q L^-T``, the rows answer forces by the Delassus matrix ``G = K K^T``, ``K = J L^-T P``:

    u' = free + G p,     free = J a_0 + bias,

a_0 the accelerations without p. In known modes ``p = constant + S x`` and ``E u' = 0`` (see `problem`) give p, and
``a = a_0 + L^-T K^T p``. Joint rows that depend on one another are harmless: P comes from singular values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.pairs import RowMotion, move_rows, row_motion
from consilience.reference.contact.problem import ContactProblem, FrictionMode, FrictionSet

RANK = 1e-9
"""Singular values of the scaled system of given modes below this count as zero: dependent contacts."""


@dataclass(frozen=True, eq=False)
class RowModes:
    """Modes of all rows of a layout.

    Attributes
    ----------
    closed : ndarray of bool, shape (n_n,)
        Which normals are closed.
    friction : tuple of FrictionMode or None, length n_f
        None where the load of the friction is open.
    heading : tuple of ndarray or None, length n_f
        Direction of sliding, shape (d,): that of the force while the speed is zero. Of a disc the direction follows
        the velocity.
    """

    closed: Array
    friction: tuple[FrictionMode | None, ...]
    heading: tuple[Array | None, ...]


def open_modes(layout: RowLayout) -> RowModes:
    """Return the modes in which nothing touches and no joint has friction."""
    none = (None,) * len(layout.friction)
    return RowModes(np.zeros(len(layout.normals), dtype=bool), none, none)


@dataclass(frozen=True, eq=False)
class Response:
    """Free accelerations and the response to forces on rows at one state.

    Attributes
    ----------
    z : ndarray, shape (6 n_b,)
        ``L^T a_0``.
    K : ndarray, shape (m, 6 n_b)
    free : ndarray, shape (m,)
    load : ndarray, shape (6 n_b, m)
        ``L^-1 J^T``.
    """

    z: Array
    K: Array
    free: Array
    load: Array


class ContactEquations:
    """Equations of motion with contacts at packed states; work arrays are overwritten at each evaluation.

    Attributes
    ----------
    layout : RowLayout
    rows : RowMotion
        Of the last state.
    rank : int
        Upper limit of the rank of the joint rows.
    held : float, m/s
        Slip below which the direction of friction is the heading.
    """

    def __init__(self, layout: RowLayout) -> None:
        self.layout, self.model = layout, layout.model
        bodies = len(self.model.mass)
        self._ws = workspace(self.model)
        self.rows: RowMotion = row_motion(len(layout.parts), len(layout.limits), len(layout.names), bodies)
        self.rank, self.held = len(self._ws.Q), 0.0
        self.inverse = np.zeros((6 * bodies, 6 * bodies))  # L^-1
        for b in range(bodies):
            o = 6 * b
            self.inverse[o : o + 3, o : o + 3] = np.eye(3) / np.sqrt(self.model.mass[b])
            self.inverse[o + 3 : o + 6, o + 3 : o + 6] = np.linalg.inv(self.model.inertia_factor[b])

    def move(self, t: float, y: Array, turns: Array) -> RowMotion:
        """Evaluate the rows at a packed state."""
        rotations(y, self._ws.A)
        move_rows(self.model, self.layout.pairs, self.layout.limits, y, turns, self._ws.A, self.rows)
        return self.rows

    def joint_rows(self, t: float, y: Array, turns: Array) -> tuple[Array, Array, Array]:
        """Return Q, the violations and the rates nu of the joints' rows at a packed state."""
        rotations(y, self._ws.A)
        constraints.evaluate(self.model, t, y, turns, self._ws)
        return self._ws.Q, self._ws.value, self._ws.rate

    def respond(self, t: float, y: Array, turns: Array) -> Response:
        """Evaluate rows, free accelerations and the response to forces on the rows."""
        rows, ws = self.move(t, y, turns), self._ws
        forces.evaluate(self.model, t, y, turns, ws)
        z, load = self.inverse @ ws.f, self.inverse @ rows.J.T
        K = load
        if len(ws.Q):
            constraints.evaluate(self.model, t, y, turns, ws)
            U, singular, Vt = np.linalg.svd(self.inverse @ ws.Q.T, full_matrices=False)
            rank = min(self.rank, int(np.sum(singular > RANK_TOLERANCE * singular[0])))
            self.U, self.pseudo = U[:, :rank], Vt[:rank].T / singular[:rank]
            z = z - self.U @ (self.U.T @ z) + self.U @ (self.pseudo.T @ ws.gamma)
            for _ in range(2):  # the second pass removes rounding errors along the joints
                K = K - self.U @ (self.U.T @ K)
        return Response(z, K.T, load.T @ z + rows.bias, load)

    def accelerations(self, response: Response, p: Array) -> Array:
        """Return (dv/dt, dw'/dt) of all bodies, shape (6 n_b,), under forces p on the rows."""
        return self.inverse.T @ (response.z + response.K.T @ p)

    def multipliers(self, response: Response, p: Array) -> Array:
        """Return the multipliers of the joints' rows, of least norm, shape (q,), at the state of the response.

        With forces on rows, ``Q^T lam = M a - f - J^T p``.
        """
        if not len(self._ws.Q):
            return np.zeros(0)
        left = response.z + response.K.T @ p - self.inverse @ self._ws.f - response.load @ p
        return np.asarray(self.pseudo @ (self.U.T @ left))

    def multipliers_of_impulse(self, response: Response, p: Array) -> Array:
        """Return the impulses of the joints' rows, of least norm, shape (q,), under impulses p on the rows."""
        if not len(self._ws.Q):
            return np.zeros(0)
        return np.asarray(-self.pseudo @ (self.U.T @ (response.load @ p)))

    def problem(self, response: Response, touching: Array, sliding: Array) -> tuple[ContactProblem, Array, Array]:
        """Return the contact problem of the normals that touch and of all friction that acts there.

        Parameters
        ----------
        response : Response
        touching : ndarray of bool, shape (n_n,)
        sliding : ndarray, shape (m,)
            Rates of the rows, exactly zero where nothing slides.

        Returns
        -------
        ContactProblem
        rows : ndarray of int
            Its rows among all.
        sets : ndarray of int
            Its friction sets among all.
        """
        layout = self.layout
        normals = [n for n, touches in zip(layout.normals, touching, strict=True) if touches]
        sets = [j for j, one in enumerate(layout.friction) if one.load is None or one.load in normals]
        rows = np.array(sorted({*normals, *(r for j in sets for r in layout.friction[j].rows)}), dtype=np.int64)
        place = {int(row): k for k, row in enumerate(rows)}
        K = response.K[rows]
        problem = ContactProblem(
            K @ K.T,
            response.free[rows],
            tuple(layout.names[row] for row in rows),
            tuple(place[n] for n in normals),
            tuple(_at(layout.friction[j], place) for j in sets),
            sliding[rows],
            np.linalg.norm(response.load[:, rows], axis=0),
        )
        return problem, rows, np.array(sets, dtype=np.int64)

    def forces(self, response: Response, modes: RowModes) -> Array:
        """Return the forces on all rows in given modes, of least norm, shape (m,)."""
        constant, S, E = self._active(modes)
        if not len(E):
            return constant
        G = response.K @ response.K.T
        size = np.abs(E) @ np.linalg.norm(response.load, axis=0)
        system = (E @ G @ (S / size)) / size[:, None]
        wanted = -(E @ (response.free + G @ constant)) / size
        U, singular, Vt = np.linalg.svd(system)
        rank = int(np.sum(singular > RANK * max(1.0, singular[0])))
        inverse = Vt[:rank].T / singular[:rank] @ U[:, :rank].T
        x = inverse @ wanted
        x += inverse @ (wanted - system @ x)
        return np.asarray(constant + (S / size) @ x)

    def _active(self, modes: RowModes) -> tuple[Array, Array, Array]:
        """Return constant, S and E of given modes at the last state, as `mode_system.columns_and_rows`."""
        layout, m = self.layout, len(self.layout.names)
        constant, columns, rows = np.zeros(m), [], []
        of_normal = {}
        for n, closed in zip(layout.normals, modes.closed, strict=True):
            if closed:
                column, row = np.zeros(m), np.zeros(m)
                column[n] = row[n] = 1.0
                of_normal[n] = column
                columns.append(column)
                rows.append(row)
        for one, mode, heading in zip(layout.friction, modes.friction, modes.heading, strict=True):
            if mode is None:
                continue
            at = list(one.rows)
            drag = mode.drag
            if heading is not None and len(at) == 2 and one.facets == 0:
                drag = -one.kinetic * direction(self.rows.u[at], heading, self.held)
            if one.load is not None:
                of_normal[one.load][at] += drag
            constant[at] += one.offset * drag
            for held in mode.held:
                row = np.zeros(m)
                row[at] = held
                columns.append(row)
                rows.append(row)
        return constant, np.array(columns).reshape(-1, m).T, np.array(rows).reshape(-1, m)


def direction(slip: Array, heading: Array, held: float) -> Array:
    """Return the direction of sliding, shape (2,), continued through zero speed: the side of `heading` is kept.

    Below the speed `held`, m/s, it is the heading: of zero speed rounding would decide.
    """
    speed = float(np.hypot(slip[0], slip[1]))
    if speed <= held:
        return heading
    return np.asarray(slip / (speed if slip @ heading >= 0.0 else -speed))


def _at(one: FrictionSet, place: dict[int, int]) -> FrictionSet:
    """Return a friction set with rows renumbered."""
    load = None if one.load is None else place[one.load]
    rows = tuple(place[r] for r in one.rows)
    return FrictionSet(one.name, rows, one.kinetic, one.static, load, one.offset, one.facets, one.angle)
