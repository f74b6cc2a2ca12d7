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

from functools import lru_cache
from typing import Any, cast

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.contact.compiled_equations import CompiledEquations
from consilience.reference.contact.derivative import EVALUATE, FORCES, OBSERVE, SAMPLE
from consilience.reference.contact.joint_friction import (
    LOCKED,
    JointReaction,
    agreeing_offsets,
    reacting_joints,
    reaction_across,
)
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.problem import ContactProblem
from consilience.reference.contact.response import HELD, ObservedRows, Response, SampledRows
from consilience.reference.contact.row_modes import RowModes, open_modes
from consilience.reference.steppers.motion import DERIVATIVE

_DETERMINED = 1e-9
"""Part of a reaction, over the reaction, that dependent constraints may leave open."""


class ContactEquations(CompiledEquations):
    """Equations of motion with contacts at packed states; work arrays are overwritten at each evaluation.

    Attributes
    ----------
    acting : list of int
        Friction sets of the modes taken over.
    held : ndarray, shape (n_f,), m/s
        Slip of each friction set below which the direction of its force is the heading.
    pressed : ndarray of bool, shape (n_s,)
        Which compliant contacts carry a force.
    reacting : bool
        Whether reactions bound the friction of the modes taken over: `kernel` cannot tell them.
    """

    def __init__(self, layout: RowLayout) -> None:
        super().__init__(layout)
        self.held, self.acting = np.zeros(len(layout.friction)), list[int]()
        self.pressed = np.zeros(len(layout.springs), dtype=bool)
        self._springs = np.array(layout.springs, dtype=np.int64)
        laws = [layout.parts[k].compliance for k in layout.springs]
        self._law = np.array([(law.stiffness, law.damping) for law in laws]).reshape(-1, 2)
        self._bounded = {3 * k: s for s, k in enumerate(layout.springs)}
        self._reacting = reacting_joints(layout)
        self.reacting = False
        self._structure = lru_cache(maxsize=32)(self._structure_of)
        self.activate(open_modes(layout))
        self.inverse = np.zeros((6 * len(self.model.mass),) * 2)  # L^-1
        for b, (mass, F) in enumerate(zip(self.model.mass, self.model.inertia_factor, strict=True)):
            v, w = slice(6 * b, 6 * b + 3), slice(6 * b + 3, 6 * b + 6)
            self.inverse[v, v], self.inverse[w, w] = np.eye(3) / np.sqrt(mass), np.linalg.inv(F)

    def respond(self, t: float, y: Array, turns: Array) -> Response:
        """Evaluate rows, free accelerations and the response to forces on the rows."""
        rows, ws = self.rows, self._ws
        self._ask(EVALUATE, t, y, turns)
        z, load = self.inverse @ ws.f, self.inverse @ rows.J.T
        pull = float(np.linalg.norm(z))
        K = load
        if len(ws.Q):
            U, singular, Vt = np.linalg.svd(self.inverse @ ws.Q.T, full_matrices=False)
            rank = min(int(self.rank[0]), int(np.sum(singular > RANK_TOLERANCE * singular[0])))
            self.U, self.pseudo = U[:, :rank], Vt[:rank].T / singular[:rank]
            z = z - self.U @ (self.U.T @ z) + self.U @ (self.pseudo.T @ ws.gamma)
            K = self.held_by_joints(load)
        given = self._given()
        reactions = {j: self._reaction(j, z, load) for j in self._reacting}
        return Response(z, K.T, load.T @ z + rows.bias + K.T @ (K @ given), load, given, reactions, pull)

    def held_by_joints(self, load: Array) -> Array:
        """Return what joints leave of rows ``L^-1 J^T``, shape (6 n_b, m), at the state of the last response."""
        if len(self._ws.Q):
            for _ in range(2):  # the second pass removes rounding errors along the joints
                load = load - self.U @ (self.U.T @ load)
        return load

    def free_velocities(self, response: Response, velocity: Array, h: float) -> tuple[Array, Array]:
        """Return what a step h of the applied forces makes of velocities (v, w'), shape (6 n_b,), without p.

        At the state of the response: rates of the rows, shape (m,), with the effect of forces that the state gives,
        and (v, w').
        """
        z = np.linalg.solve(self.inverse.T, velocity) + h * (self.inverse @ self._ws.f + response.K.T @ response.given)
        if len(self._ws.Q):
            z = z - self.U @ (self.U.T @ z) + self.U @ (self.pseudo.T @ self._ws.rate)
        return response.load.T @ z, self.inverse.T @ z

    def press(self, touching: float) -> None:
        """Press the compliant contacts that the last state presses: with gaps below `touching`, m, and no pull."""
        gap, rate = self.rows.gap[self._springs], self.rows.u[3 * self._springs]
        least = np.where(rate > 0.0, 1.0, -1.0) * self._law[:, 0] * touching
        self.pressed[:] = (gap <= touching) & (self._spring_forces() >= least)

    def _spring_forces(self) -> Array:
        """Return the forces of the compliant contacts, were they pressed, at the last state, shape (n_s,), N."""
        motion = np.stack([self.rows.gap[self._springs], self.rows.u[3 * self._springs]])
        return -np.sum(self._law.T * motion, axis=0)

    def _given(self) -> Array:
        """Return the forces of compliant contacts at the last state, shape (m,); they bound friction."""
        given = np.zeros(len(self.layout.names))
        if not len(self._springs):
            return given
        given[3 * self._springs] = np.where(self.pressed, self._spring_forces(), 0.0)
        for j, one in enumerate(self.layout.friction):
            if one.load in self._bounded:
                self.offsets[j] = max(given[one.load], 0.0)  # of rounding it may be less
        return given

    def _reaction(self, j: int, z: Array, load: Array) -> JointReaction:
        """Return the reaction that bounds a friction set, at the state of U and `pseudo`, as of the forces of rows.

        Dependent constraints that leave it undetermined raise `NumericalFailure`.
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

    def energy(self, y: Array) -> float:
        """Return the kinetic energy of a packed state, J."""
        bodies = y[: len(self.model.mass)]
        v, w = bodies[:, 7:10], bodies[:, 10:13]
        spin = np.einsum("bi,bij,bj->", w, self.model.inertia, w)
        return 0.5 * float(np.sum(v * v, axis=1) @ self.model.mass + spin)

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
        key = touching.tobytes(), self.pressed.tobytes(), *self.offsets.tolist()  # bytes can be looked up
        names, normals, friction, rows, sets = self._structure(*key)
        K, free, scale = response.K[rows], response.free[rows], np.linalg.norm(response.load[:, rows], axis=0)
        held = np.linalg.norm(K, axis=1) <= HELD * scale
        K[held] = 0.0
        free[held & (np.abs(free) <= HELD * scale * response.pull)] = 0.0
        found = ContactProblem(K @ K.T, free, names, normals, friction, sliding[rows], scale, response.pull)
        return found, rows, sets

    def _structure_of(self, touching: bytes, pressed: bytes, *offsets: float) -> tuple[Any, ...]:
        """Return names, normals and friction of the problem of the normals that touch, and its rows and sets."""
        layout = self.layout
        normals = [n for n, touches in zip(layout.normals, touching, strict=True) if touches]
        loads = {None, *normals, *(row for row, s in self._bounded.items() if pressed[s])}
        sets = [j for j, one in enumerate(layout.friction) if one.load in loads]
        rows = sorted({*normals, *(r for j in sets for r in layout.friction[j].rows)})
        place = {row: k for k, row in enumerate(rows)}
        return (
            tuple(layout.names[row] for row in rows),
            tuple(place[n] for n in normals),
            tuple(layout.friction[j].among(place, normals, offsets[j]) for j in sets),
            *(np.array(part, dtype=np.int64) for part in (rows, sets)),
        )

    def activate(self, modes: RowModes) -> None:
        """Take over modes for `rates` and `row_forces`."""
        layout, active = self.layout, self._modes
        closed = np.flatnonzero(modes.closed)
        normal = [layout.normals[n] for n in closed]
        self.acting = [j for j, mode in enumerate(modes.friction) if mode is not None]
        self.reacting = any(j in self._reacting for j in self.acting)
        springs = np.flatnonzero(modes.pressed)
        active.acting[:] = len(normal), len(self.acting) + len(springs)
        active.normal[: len(normal)], active.gap[: len(normal)] = normal, layout.gaps[closed]
        for part in (active.disc, active.holds, active.drag, active.held, active.chosen):
            part[...] = 0
        for part in (active.row, active.load, active.spring):
            part[...] = -1
        for k, j in enumerate(self.acting):
            one, mode, heading = layout.friction[j], modes.friction[j], modes.heading[j]
            assert mode is not None
            d = len(one.rows)
            active.row[k, :d], active.drag[k, :d], active.holds[k] = one.rows, mode.drag, len(mode.held)
            active.held[k, : len(mode.held), :d] = mode.held
            active.offset[k], active.load[k] = self.offsets[j], normal.index(one.load) if one.load in normal else -1
            if one.load in self._bounded:
                self._take_spring(k, self._bounded[one.load])
            if heading is not None and one.is_disc:
                active.pair[k] = cast(int, one.load) // 3
                active.disc[k], active.slow[k] = one.kinetic, self.held[j]
                active.heading[k] = heading @ self.rows.frame[active.pair[k], 1:]
        for k, s in enumerate(springs, len(self.acting)):  # the force that a state gives, as one that slides
            active.row[k, 0], active.drag[k, 0] = 3 * layout.springs[s], 1.0
            self._take_spring(k, int(s))

    def _take_spring(self, k: int, s: int) -> None:
        """Let the force of a spring be the offset of a set of the active modes."""
        self._modes.spring[k], self._modes.law[k] = self._springs[s], self._law[s]

    def choose(self, t: float, force: Array, rate: Array | float = 0.0) -> None:
        """Let forces that the modes leave undetermined be the nearest to others, shape (m,), which change at a rate."""
        self._modes.since[0], self._modes.chosen[0], self._modes.chosen[1] = t, force, rate

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
        """Return the derivative of a state with impulses and loss, in the modes taken over (`derivative.serve`)."""
        dY = np.zeros_like(Y)
        if self.reacting:
            self._give(t, Y, turns)
        self._ask(DERIVATIVE, t, Y, turns, dY)
        return dY

    def _give(self, t: float, y: Array, turns: Array) -> None:
        """Give the bounds that are reactions, in the modes taken over."""
        reacting = [j for j in self._reacting if j in self.acting]
        at = [self.acting.index(j) for j in reacting]
        self._modes.offset[at] = start = self.offsets[reacting]
        response, slopes = self.respond(t, y, turns), []
        base = self._forces(t, y, turns)
        for k in at:
            self._modes.offset[k] += 1.0
            slopes.append(self._forces(t, y, turns) - base)
            self._modes.offset[k] -= 1.0
        found = agreeing_offsets([response.reactions[j] for j in reacting], base, np.array(slopes).T, start)
        if found is None:
            names = ", ".join(self.layout.friction[j].name for j in reacting)
            raise NumericalFailure(f"{names}, t = {t:.12g} s: {LOCKED}")
        self.offsets[reacting] = self._modes.offset[at] = found

    def _forces(self, t: float, y: Array, turns: Array) -> Array:
        p = np.zeros(len(self.layout.names))
        self._ask(FORCES, t, y, turns, p)
        return p

    def determinant(self, t: float, y: Array, turns: Array) -> float:
        """Return ``det E G S``, scaled by rows without joints, of the modes taken over; zero where nearly singular."""
        return self._ask(FORCES, t, y, turns, np.zeros(len(self.layout.names)))

    def observe(self, times: Array, states: Array, turns: Array) -> ObservedRows:
        """Return the rows and the forces on them at times (n,) and packed states (n, ...), in the modes taken over."""
        count, gaps, m = len(times), len(self.rows.gap), len(self.layout.names)
        found, offset = np.zeros((count, gaps + 2 * m)), self.offsets[None].repeat(count, axis=0)
        for k in range(count if self.reacting else 0):
            force = self.row_forces(float(times[k]), states[k], turns)
            found[k], offset[k] = np.concatenate([self.rows.gap, self.rows.u, force]), self.offsets
        if not self.reacting:
            self.turns[:] = turns
            z = np.empty((count, 1 + states[0].size))
            z[:, 0], z[:, 1:] = times, states.reshape(count, -1)
            self._serve(OBSERVE, 0.0, z.reshape(-1), found.reshape(-1))
        return ObservedRows(found[:, :gaps], found[:, gaps : gaps + m], found[:, gaps + m :], offset)

    def sample(self, times: Array, states: Array, turns: Array) -> SampledRows:
        """Return states (n, ...) at times (n,), projected onto what lasts in the modes taken over, with all rows."""
        count = len(times)
        z = np.column_stack([times, states.reshape(count, -1), turns[None].repeat(count, axis=0)])
        found, offset = np.zeros((count, self.width)), self.offsets[None].repeat(count, axis=0)
        self._modes.halted[:] = 0
        self._serve(SAMPLE, 0.0, z.reshape(-1), found.reshape(-1))
        for k in range(count if self.reacting else 0):
            self._give(float(times[k]), z[k, 1 : z.shape[1] - len(turns)], turns)
            self._serve(SAMPLE, 0.0, z[k], found[k])
            offset[k] = self.offsets
        return self.sampled_rows(z, found)._replace(offset=offset)

    def row_forces(self, t: float, y: Array, turns: Array) -> Array:
        """Return the forces on all rows at a packed state, in the modes taken over, shape (m,)."""
        if self.reacting:
            self._give(t, y, turns)
        return self._forces(t, y, turns)
