"""Equations of motion of a mechanism with lasting contacts, stops and dry friction.

    M a = f + Q^T lam + J^T p,     Q a = gamma,     u' = J a + bias,

with the rows J of `layout` and the forces p on them. With ``M = L L^T`` and P the projector onto the null space of
``Q L^-T``, the rows answer forces by the Delassus matrix ``G = K K^T``, ``K = J L^-T P``:

    u' = free + G p,     free = J a_0 + bias,

a_0 the accelerations without p. In known modes ``p = constant + S x`` and ``E u' = 0`` (see `problem`) give p, and
``a = a_0 + L^-T K^T p``. Joint rows that depend on one another are harmless: P comes from singular values.
`derivative` has the same compiled, for known modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.contact.derivative import ActiveModes, ContactSystem, accelerations, rates
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.pairs import RowMotion, move_rows, row_motion
from consilience.reference.contact.problem import ContactProblem, FrictionMode, FrictionSet
from consilience.reference.kernel.mechanism_record import record_of


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
    rank : ndarray of int, shape (1,)
        Upper limit of the rank of the joint rows.
    acting : list of int
        Friction sets of the modes taken over.
    held : ndarray, shape (n_f,), m/s
        Slip of each friction set below which the direction of its force is the heading.
    """

    def __init__(self, layout: RowLayout) -> None:
        self.layout, self.model = layout, layout.model
        bodies = len(self.model.mass)
        self._ws = workspace(self.model)
        self.rows: RowMotion = record_of(row_motion(len(layout.parts), len(layout.limits), len(layout.names), bodies))
        self.rank, self.held = np.array([len(self._ws.Q)]), np.zeros(len(layout.friction))
        self.acting: list[int] = []
        self.activate(open_modes(layout))
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
            rank = min(int(self.rank[0]), int(np.sum(singular > RANK_TOLERANCE * singular[0])))
            self.U, self.pseudo = U[:, :rank], Vt[:rank].T / singular[:rank]
            z = z - self.U @ (self.U.T @ z) + self.U @ (self.pseudo.T @ ws.gamma)
            for _ in range(2):  # the second pass removes rounding errors along the joints
                K = K - self.U @ (self.U.T @ K)
        return Response(z, K.T, load.T @ z + rows.bias, load)

    def accelerations_under(self, response: Response, p: Array) -> Array:
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

    def activate(self, modes: RowModes) -> None:
        """Take over modes for `rates` and `row_forces`."""
        layout = self.layout
        normal = [n for n, closed in zip(layout.normals, modes.closed, strict=True) if closed]
        self.acting = [j for j, mode in enumerate(modes.friction) if mode is not None]
        sets = len(self.acting)
        active = ActiveModes(
            normal=np.array(normal, dtype=np.int64),
            row=np.full((sets, 2), -1),
            load=np.full(sets, -1),
            offset=np.zeros(sets),
            disc=np.zeros(sets),
            heading=np.zeros((sets, 3)),
            pair=np.zeros(sets, dtype=np.int64),
            slow=np.zeros(sets),
            drag=np.zeros((sets, 2)),
            held=np.zeros((sets, 2, 2)),
            holds=np.zeros(sets, dtype=np.int64),
            rank=self.rank,
            owner=layout.site[3 * np.arange(len(layout.parts))],
        )
        for k, j in enumerate(self.acting):
            one, mode, heading = layout.friction[j], modes.friction[j], modes.heading[j]
            assert mode is not None
            d = len(one.rows)
            active.row[k, :d], active.drag[k, :d], active.holds[k] = one.rows, mode.drag, len(mode.held)
            active.held[k, : len(mode.held), :d] = mode.held
            active.offset[k], active.load[k] = one.offset, -1 if one.load is None else normal.index(one.load)
            if heading is not None and one.is_disc:
                active.pair[k] = self._pair_of(one)
                active.disc[k], active.slow[k] = one.kinetic, self.held[j]
                active.heading[k] = heading @ self.rows.frame[active.pair[k], 1:]
        self._modes = active
        self._system = record_of(
            ContactSystem(self.model, layout.pairs, layout.limits, self.rows, self._ws, record_of(active))
        )

    def _pair_of(self, one: FrictionSet) -> int:
        """Return the pair of shapes of the friction of a contact."""
        assert one.load is not None
        return one.load // 3

    def heading(self, j: int) -> Array:
        """Return the heading of a disc that slides, shape (2,), along the tangents of the last state."""
        k = self.acting.index(j)
        along: Array = self.rows.frame[self._modes.pair[k], 1:] @ self._modes.heading[k]
        return along / np.linalg.norm(along)

    def turn(self, heading: tuple[Array | None, ...]) -> None:
        """Take over headings of what slides at the last state, faster than they are held."""
        for k, j in enumerate(self.acting):
            one, along = self.layout.friction[j], heading[j]
            if along is None or not one.is_disc:
                continue
            self._modes.slow[k] = self.held[j]
            if float(np.linalg.norm(self.rows.u[list(one.rows)])) > self.held[j]:
                self._modes.heading[k] = along @ self.rows.frame[self._modes.pair[k], 1:]

    def rates(self, t: float, Y: Array, turns: Array) -> Array:
        """Return the derivative of a state with impulses and loss, in the modes taken over (`derivative.rates`)."""
        dY = np.zeros_like(Y)
        rates(self._system, t, Y, turns, dY)
        return dY

    def row_forces(self, t: float, y: Array, turns: Array) -> Array:
        """Return the forces on all rows at a packed state, in the modes taken over, of least norm, shape (m,)."""
        a, p = np.zeros(len(self.inverse)), np.zeros(len(self.layout.names))
        accelerations(self._system, t, y, turns, a, p)
        return p


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
