"""Equations of motion of a mechanism with lasting contacts, stops and dry friction.

    M a = f + Q^T lam + J^T p,     Q a = gamma,     u' = J a + bias,

with the rows J of `layout` and the forces p on them. With ``M = L L^T`` and P the projector onto the null space of
``Q L^-T``, the rows answer forces by the Delassus matrix ``G = K K^T``, ``K = J L^-T P``:

    u' = free + G p,     free = J a_0 + bias,

a_0 the accelerations without p. In known modes ``p = constant + S x`` and ``E u' = 0`` (see `problem`) give p, and
``a = a_0 + L^-T K^T p``. Joint rows that depend on one another are harmless: P comes from singular values.
`derivative` has the same compiled, for known modes.

A compliant contact that is pressed has the force ``N = k (-g) + c (-g')``, given by the state. Bounds of friction that
are reactions of joints follow from the forces of all rows (`joint_friction`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies.arrays import workspace
from consilience.reference.contact.derivative import (
    ActiveModes,
    ContactSystem,
    apply_forces,
    columns,
    follow_turns,
    forces_in_modes,
    move,
    rates,
    restrain,
)
from consilience.reference.contact.joint_friction import (
    LOCKED,
    JointReaction,
    agreeing_offsets,
    reacting_joints,
    reaction_across,
)
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.pairs import RowMotion, row_motion
from consilience.reference.contact.problem import ContactProblem, FrictionSet
from consilience.reference.contact.response import HELD, Response
from consilience.reference.contact.row_modes import RowModes, open_modes
from consilience.reference.kernel.mechanism_record import record_array, record_of

_DETERMINED = 1e-9
"""Part of a reaction, over the reaction, that dependent constraints may leave open."""


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
    pressed : ndarray of bool, shape (n_s,)
        Which compliant contacts carry a force.
    offsets : ndarray, shape (n_f,)
        Constant part of the bound of each friction set at the last state.
    """

    def __init__(self, layout: RowLayout) -> None:
        self.layout, self.model = layout, layout.model
        bodies = len(self.model.mass)
        self._count = 13 * (bodies + (len(self.model.control) + 12) // 13)
        self._ws = workspace(self.model)
        self.rows: RowMotion = record_of(row_motion(len(layout.parts), len(layout.limits), len(layout.names), bodies))
        self.rank, self.held = np.array([len(self._ws.Q)]), np.zeros(len(layout.friction))
        self.acting: list[int] = []
        self.pressed = np.zeros(len(layout.springs), dtype=bool)
        self.offsets = np.array([one.offset for one in layout.friction])
        self._laws = [layout.parts[k].compliance for k in layout.springs]
        self._bounded = {3 * k: s for s, k in enumerate(layout.springs)}
        self._reacting = reacting_joints(layout)
        self.activate(open_modes(layout))
        self.inverse = np.zeros((6 * bodies, 6 * bodies))  # L^-1
        for b in range(bodies):
            o = 6 * b
            self.inverse[o : o + 3, o : o + 3] = np.eye(3) / np.sqrt(self.model.mass[b])
            self.inverse[o + 3 : o + 6, o + 3 : o + 6] = np.linalg.inv(self.model.inertia_factor[b])

    def move(self, t: float, y: Array, turns: Array) -> RowMotion:
        """Evaluate the rows at a packed state."""
        move(self._system, y, turns)
        return self.rows

    def joint_rows(self, t: float, y: Array, turns: Array) -> tuple[Array, Array, Array]:
        """Return Q, the violations and the rates nu of the joints' rows at a packed state."""
        restrain(self._system, t, y, turns)
        return self._ws.Q, self._ws.value, self._ws.rate

    def follow(self, y: Array, turns: Array) -> None:
        """Replace the joint coordinates that are read, shape (n_q,), by their values at a packed state."""
        follow_turns(self._system, y, turns)

    def respond(self, t: float, y: Array, turns: Array) -> Response:
        """Evaluate rows, free accelerations and the response to forces on the rows."""
        rows, ws = self.move(t, y, turns), self._ws
        apply_forces(self._system, t, y, turns)
        z, load = self.inverse @ ws.f, self.inverse @ rows.J.T
        pull = float(np.linalg.norm(z))
        K = load
        if len(ws.Q):
            restrain(self._system, t, y, turns)
            U, singular, Vt = np.linalg.svd(self.inverse @ ws.Q.T, full_matrices=False)
            rank = min(int(self.rank[0]), int(np.sum(singular > RANK_TOLERANCE * singular[0])))
            self.U, self.pseudo = U[:, :rank], Vt[:rank].T / singular[:rank]
            z = z - self.U @ (self.U.T @ z) + self.U @ (self.pseudo.T @ ws.gamma)
            for _ in range(2):  # the second pass removes rounding errors along the joints
                K = K - self.U @ (self.U.T @ K)
        given = self._given()
        reactions = {j: self._reaction(j, z, load) for j in self._reacting}
        return Response(z, K.T, load.T @ z + rows.bias + K.T @ (K @ given), load, given, reactions, pull)

    def free_velocities(self, response: Response, velocity: Array, h: float) -> tuple[Array, Array]:
        """Return what a step h of the applied forces makes of velocities at the state of the response, without p.

        Parameters
        ----------
        velocity : ndarray, shape (6 n_b,)
            (v, w') before.
        h : float, s

        Returns
        -------
        ndarray, shape (m,)
            Rates of the rows, with the effect of forces that the state gives.
        ndarray, shape (6 n_b,)
            (v, w').
        """
        z = np.linalg.solve(self.inverse.T, velocity) + h * (self.inverse @ self._ws.f + response.K.T @ response.given)
        if len(self._ws.Q):
            z = z - self.U @ (self.U.T @ z) + self.U @ (self.pseudo.T @ self._ws.rate)
        return response.load.T @ z, self.inverse.T @ z

    def press(self, touching: float) -> None:
        """Press the compliant contacts that the last state presses: with gaps below `touching`, m, and no pull."""
        for s, (k, law) in enumerate(zip(self.layout.springs, self._laws, strict=True)):
            gap, rate, least = self.rows.gap[k], self.rows.u[3 * k], law.stiffness * touching
            force = -law.stiffness * gap - law.damping * rate
            self.pressed[s] = gap <= touching and force >= (least if rate > 0.0 else -least)

    def spring_force(self, s: int) -> float:
        """Return the force of a compliant contact that is pressed, at the last state, N."""
        k, law = self.layout.springs[s], self._laws[s]
        return float(-law.stiffness * self.rows.gap[k] - law.damping * self.rows.u[3 * k])

    def stored(self, pressed: Array) -> float:
        """Return the energy in the springs of the compliant contacts that are pressed, at the last state, J."""
        gaps = self.rows.gap[list(self.layout.springs)]
        return float(
            sum(0.5 * law.stiffness * g**2 for law, g, on in zip(self._laws, gaps, pressed, strict=True) if on)
        )

    def _given(self) -> Array:
        """Return the forces of compliant contacts at the last state, shape (m,); they bound friction."""
        given = np.zeros(len(self.layout.names))
        for s in np.flatnonzero(self.pressed):
            given[3 * self.layout.springs[s]] = self.spring_force(int(s))
        for j, one in enumerate(self.layout.friction if self._bounded else ()):
            if one.load in self._bounded:
                self.offsets[j] = given[one.load]
        return given

    def _reaction(self, j: int, z: Array, load: Array) -> JointReaction:
        """Return the reaction that bounds a friction set, at the state of U and `pseudo`, as of the forces of rows.

        Raises
        ------
        NumericalFailure
            Constraints that depend on one another leave it undetermined.
        """
        joint = self._reacting[j]
        across = reaction_across(self.layout, joint, self._ws)
        rows = slice(self.model.first_row[joint], self.model.first_row[joint + 1])
        wide = np.zeros((3, len(self._ws.Q)))
        wide[:, rows] = across
        lost = wide - (wide @ self.pseudo) @ np.linalg.pinv(self.pseudo)
        if np.max(np.abs(lost)) > _DETERMINED * np.max(np.abs(across)):
            raise NumericalFailure(
                f"{self.layout.friction[j].name}: constraints that depend on one another leave its reaction open"
            )
        of_left = wide @ self.pseudo @ self.U.T
        return JointReaction(of_left @ (z - self.inverse @ self._ws.f), -of_left @ load)

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
        loads = {None, *normals, *(row for row, s in self._bounded.items() if self.pressed[s])}
        sets = [j for j, one in enumerate(layout.friction) if one.load in loads]
        rows = np.array(sorted({*normals, *(r for j in sets for r in layout.friction[j].rows)}), dtype=np.int64)
        place = {int(row): k for k, row in enumerate(rows)}
        K, free, scale = response.K[rows], response.free[rows], np.linalg.norm(response.load[:, rows], axis=0)
        held = np.linalg.norm(K, axis=1) <= HELD * scale
        K[held] = 0.0
        free[held & (np.abs(free) <= HELD * scale * response.pull)] = 0.0
        problem = ContactProblem(
            *(K @ K.T, free),
            tuple(layout.names[row] for row in rows),
            tuple(place[n] for n in normals),
            tuple(_at(layout.friction[j], place, float(self.offsets[j]), normals) for j in sets),
            *(sliding[rows], scale),
        )
        return problem, rows, np.array(sets, dtype=np.int64)

    def activate(self, modes: RowModes) -> None:
        """Take over modes for `rates` and `row_forces`."""
        layout = self.layout
        normal = [n for n, closed in zip(layout.normals, modes.closed, strict=True) if closed]
        self.acting = [j for j, mode in enumerate(modes.friction) if mode is not None]
        springs = np.flatnonzero(modes.pressed)
        sets = len(self.acting) + len(springs)
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
            chosen=np.zeros(len(layout.names)),
            rank=self.rank,
            owner=layout.site[3 * np.arange(len(layout.parts))],
        )
        for k, j in enumerate(self.acting):
            one, mode, heading = layout.friction[j], modes.friction[j], modes.heading[j]
            assert mode is not None
            d = len(one.rows)
            active.row[k, :d], active.drag[k, :d], active.holds[k] = one.rows, mode.drag, len(mode.held)
            active.held[k, : len(mode.held), :d] = mode.held
            active.offset[k], active.load[k] = self.offsets[j], normal.index(one.load) if one.load in normal else -1
            if heading is not None and one.is_disc:
                active.pair[k] = self._pair_of(one)
                active.disc[k], active.slow[k] = one.kinetic, self.held[j]
                active.heading[k] = heading @ self.rows.frame[active.pair[k], 1:]
        for k, s in enumerate(springs, len(self.acting)):  # the force that a state gives, as one that slides
            active.row[k, 0], active.drag[k, 0] = 3 * layout.springs[s], 1.0
        self._modes, self._springs = active, springs
        self._system = record_array(
            ContactSystem(self.model, layout.pairs, layout.limits, self.rows, self._ws, record_of(active))
        )

    def choose(self, force: Array) -> None:
        """Let forces that the modes taken over leave undetermined be the nearest to others, shape (m,), N (N m)."""
        self._modes.chosen[:] = force

    def columns(self) -> tuple[Array, Array]:
        """Return S and E of the modes taken over, at the last state, shape (m, r) and (r, m); see `problem`."""
        count = len(self._modes.normal) + int(np.sum(self._modes.holds))
        S, E = np.zeros((count, len(self.layout.names))), np.zeros((count, len(self.layout.names)))
        columns(self._system, S, E, np.zeros(len(self.layout.names)))
        return S.T, E

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
        self._give(t, Y[: self._count].reshape(-1, 13), turns)
        rates(self._system, t, Y, turns, dY)
        return dY

    def _give(self, t: float, y: Array, turns: Array) -> None:
        """Give the forces of compliant contacts and the bounds that are reactions, in the modes taken over."""
        reacting = [j for j in self._reacting if j in self.acting]
        if not len(self._springs) and not reacting:
            return
        self.move(t, y, turns)
        self._given()
        self._take_offsets()
        if not reacting:
            return
        at = [self.acting.index(j) for j in reacting]
        start, response = self.offsets[reacting], self.respond(t, y, turns)
        base, slopes = self._forces(t, y, turns), []
        for k in at:
            self._modes.offset[k] += 1.0
            slopes.append(self._forces(t, y, turns) - base)
            self._modes.offset[k] -= 1.0
        found = agreeing_offsets([response.reactions[j] for j in reacting], base, np.array(slopes).T, start)
        if found is None:
            names = ", ".join(self.layout.friction[j].name for j in reacting)
            raise NumericalFailure(f"{names}, t = {t:.12g} s: {LOCKED}")
        self.offsets[reacting] = found
        self._take_offsets()

    def _take_offsets(self) -> None:
        """Take over the bounds of friction and the forces of compliant contacts at the last state."""
        for k, j in enumerate(self.acting):
            self._modes.offset[k] = self.offsets[j]
        for k, s in enumerate(self._springs, len(self.acting)):
            self._modes.offset[k] = self.spring_force(int(s))

    def _forces(self, t: float, y: Array, turns: Array) -> Array:
        a, p = np.zeros(len(self.inverse)), np.zeros(len(self.layout.names))
        forces_in_modes(self._system, t, y, turns, a, p)
        return p

    def row_forces(self, t: float, y: Array, turns: Array) -> Array:
        """Return the forces on all rows at a packed state, in the modes taken over, shape (m,)."""
        self._give(t, y, turns)
        return self._forces(t, y, turns)


def direction(slip: Array, heading: Array, held: float) -> Array:
    """Return the direction of sliding, shape (2,), continued through zero speed: the side of `heading` is kept.

    Below the speed `held`, m/s, it is the heading: of zero speed rounding would decide.
    """
    speed = float(np.hypot(slip[0], slip[1]))
    if speed <= held:
        return heading
    return np.asarray(slip / (speed if slip @ heading >= 0.0 else -speed))


def _at(one: FrictionSet, place: dict[int, int], offset: float, normals: list[int]) -> FrictionSet:
    """Return a friction set with rows renumbered, and the offset that it has; a load that the state gives is in it."""
    load = place[one.load] if one.load in normals else None
    rows = tuple(place[r] for r in one.rows)
    return replace(one, rows=rows, load=load, offset=offset)
