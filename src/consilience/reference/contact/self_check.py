"""Laws of contact at single states of a motion, whatever modes it was computed in: a motion checks itself.

========================  ==========================================================================
what                      must hold
========================  ==========================================================================
joints                    violations and rates of all rows are zero
no overlap                no gap of a rigid contact or a stop is negative
no pull                   no normal force is negative
complementarity           what carries a force has no gap, and neither parts nor sinks; what touches
                          without a force does not sink
cone                      no friction is beyond its bound
dissipation               what slides loses the most power that its cone allows; what is held stays
========================  ==========================================================================

Forces that are undetermined must have some choice within all cones. Accelerations are those of the Delassus matrix, not
those of the compiled derivative.

What these laws cannot see, energy that vanishes between samples, `energy_balance` tells at the end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies.arrays import ANGLE, holonomic_rows
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.lasting import sliding_rates, widest_margin
from consilience.reference.contact.problem import FrictionSet
from consilience.reference.contact.response import HELD, SampledRows
from consilience.reference.contact.row_modes import RowModes

Violations = tuple[Sequence[str], str, Array]
"""Names of k rows, what is wrong there, and by how much at n states, shape (n, k)."""

BAR = 1e-7
"""Largest violation, relative to lengths, speeds, forces or accelerations of the mechanism."""

_TOGETHER = 64
"""Largest number of additions that are checked together: it bounds the memory."""

_AT_ONCE = 100
"""Largest number of events at one instant."""

_SLIDES = 1e-4
"""Slip, over the speeds of the mechanism, from which its direction is checked."""


class EventsAtOnce:
    """Number of events at the present instant."""

    def __init__(self) -> None:
        self._time, self._count = -np.inf, 0

    def repeated(self, time: float) -> bool:
        """Return whether several events have come at an instant."""
        return self._count > 1 and time == self._time

    def add(self, time: float) -> None:
        """Count an event; refuse those that follow one another without end while no time passes.

        Raises
        ------
        NumericalFailure
        """
        self._time, self._count = time, self._count + 1 if time == self._time else 0
        if self._count > _AT_ONCE:
            raise NumericalFailure(f"{_AT_ONCE} events of contact at the instant t = {time:.12g} s: they do not settle")


class UncheckedSamples:
    """Samples of the present modes that are still to be checked against the laws: many at once take less time."""

    def __init__(self, equations: ContactEquations) -> None:
        self._equations = equations
        self._found: list[SampledRows] = []
        self._speeds: list[Array] = []

    def add(self, modes: RowModes, rows: SampledRows, speed: float) -> None:
        """Add samples in the present modes, with the speed of the mechanism, m/s."""
        self._modes = modes
        self._found.append(rows)
        self._speeds.append(np.full(len(rows.times), speed))
        if len(self._found) >= _TOGETHER:
            self.check()

    def check(self) -> None:
        """Check what has been added (`check_laws`)."""
        if self._found:
            rows = SampledRows(*map(np.concatenate, zip(*self._found, strict=True)))
            speeds = np.concatenate(self._speeds)
            self._found.clear()
            self._speeds.clear()
            check_laws(self._equations, self._modes, rows, speeds)


def check_laws(equations: ContactEquations, modes: RowModes, rows: SampledRows, speeds: Array) -> None:
    """Check states with what lasts there against all laws.

    Parameters
    ----------
    equations : ContactEquations
        In these modes.
    modes : RowModes
    rows : SampledRows
        At n states, in the order of time.
    speeds : ndarray, shape (n,), m/s
        Of the mechanism.

    Raises
    ------
    NumericalFailure
        With the row, the time, and the violation over `BAR`.
    """
    laws, inadmissible, largest = _violations(equations, modes, rows, speeds)
    worst = [np.max(violations, axis=1) for _, _, violations in (*laws, *inadmissible)]
    for k in np.flatnonzero(~(np.max(worst, axis=0, initial=0.0) <= BAR)).tolist():
        for law in laws:
            _require(law, k, rows.times[k])
        told = next((one for one in inadmissible if not np.max(one[2][k]) <= BAR), None)
        if told is not None:  # unless forces are undetermined, and others admissible
            at = float(rows.times[k]), rows.states[k], rows.turns[k]
            response, given = equations.respond(*at), sliding_rates(equations, modes, 0.0)
            margin, *_ = widest_margin(equations, response, modes, given)
            if np.isfinite(margin):
                told = told[0], told[1], np.where(told[2] < np.max(told[2][k]), -np.inf, -margin / largest[k])
            _require(told, k, rows.times[k])


def _require(law: Violations, k: int, time: float) -> None:
    """Refuse a violation of a law at sample k.

    Raises
    ------
    NumericalFailure
    """
    names, what, violations = law
    worst = int(np.argmax(violations[k]))
    if not violations[k, worst] <= BAR:
        raise NumericalFailure(
            f"{names[worst]}, t = {time:.12g} s: {what}, by {violations[k, worst]:.3g} of the largest"
        )


def refuse_overlap(equations: ContactEquations, at: tuple[float, Array, Array], least: float, metre: float) -> None:
    """Refuse a state at which shapes overlap, or a joint is beyond a stop, by more than `least`, in units of length.

    `metre` is how many of these make a metre, in which the message counts.

    Raises
    ------
    InvalidInput
    """
    layout = equations.layout
    gaps = equations.move(*at).gap[layout.gaps]
    if not len(gaps) or np.min(gaps) >= -least:
        return
    worst = int(np.argmin(gaps))
    name, k, overlap = layout.names[layout.normals[worst]], layout.part_of(worst), -float(gaps[worst])
    if k is None:
        turns = layout.model.coordinate["kind"][layout.limits["coordinate"][layout.gaps[worst] - len(layout.parts)]]
        beyond = f"{overlap:.6g} rad" if turns == ANGLE else f"{overlap / metre:.6g} m"
        raise InvalidInput(name, f"the joint is {beyond} beyond it", "Give a state within it.")
    part = layout.parts[k]
    raise InvalidInput(
        name,
        f"'{part.body}' and '{part.partner}' overlap by {overlap / metre:.6g} m",
        "Give a state with the shapes apart, or just touching.",
    )


def _free_response(equations: ContactEquations, rows: SampledRows, given: Array) -> tuple[Array, Array, Array, Array]:
    """Return K, load, free accelerations and pulls of `Response` at n states, load transposed."""
    inverse, bar = equations.inverse, equations.inverse.T
    z, load = rows.applied @ bar, rows.J @ bar
    K, pull = load, np.linalg.norm(z, axis=1)
    if rows.Q.shape[1]:
        U, singular, Vt = np.linalg.svd(inverse @ np.swapaxes(rows.Q, 1, 2), full_matrices=False)
        kept = singular > RANK_TOLERANCE * singular[:, :1]
        kept &= np.arange(singular.shape[1]) < rows.rank
        U *= kept[:, None]
        along = np.where(kept, np.einsum("nkq,nq->nk", Vt, rows.gamma), 0.0) / np.where(kept, singular, 1.0)
        z = z + np.einsum("nik,nk->ni", U, along - np.einsum("nik,ni->nk", U, z))
        for _ in range(2):  # the second pass removes rounding errors along the joints
            K = K - (K @ U) @ np.swapaxes(U, 1, 2)
    free = np.einsum("nmi,ni->nm", load, z) + rows.bias + _answer(K, given)
    return K, load, free, pull


def _of_springs(equations: ContactEquations, modes: RowModes, rows: SampledRows) -> Array:
    """Return the forces of the compliant contacts that are pressed at n states, shape (n, m)."""
    given = np.zeros(rows.u.shape)
    for k, pressed in zip(equations.layout.springs, modes.pressed, strict=True):
        law = equations.layout.parts[k].compliance
        if pressed:
            given[:, 3 * k] = -law.stiffness * rows.gap[:, k] - law.damping * rows.u[:, 3 * k]
    return given


def _answer(K: Array, force: Array) -> Array:
    """Return the accelerations of rows under forces on them at n states."""
    return np.einsum("nmi,ni->nm", K, np.einsum("nmi,nm->ni", K, force))


def _violations(
    equations: ContactEquations, modes: RowModes, rows: SampledRows, speeds: Array
) -> tuple[list[Violations], list[Violations], Array]:
    """Return the violations of all laws, of those that undetermined forces may seem to violate, and the forces."""
    layout, force, speed = equations.layout, rows.force, speeds[:, None]
    given, offset = _of_springs(equations, modes, rows), rows.offset
    K, load, free, pull = _free_response(equations, rows, given)
    moved = free + _answer(K, force - given)
    weight = np.maximum(np.linalg.norm(load, axis=2), np.finfo(float).tiny)
    pushed = np.maximum(np.abs(free) / weight, weight * np.abs(force))
    fastest = np.maximum(np.max(pushed, axis=1, initial=0.0), HELD / BAR * pull)[:, None]
    fastest[fastest < np.sqrt(np.finfo(float).tiny)] = 1.0  # nothing acts
    heaviest = np.max(weight, axis=1, initial=1.0)[:, None]
    largest = np.maximum(np.max(np.abs(force), axis=1, initial=0.0)[:, None], fastest / heaviest)
    length, normals = max(1.0, equations.model.length), np.array(layout.normals, dtype=np.int64)
    gap, n = rows.gap[:, layout.gaps], normals[modes.closed]
    laws, inadmissible = _joint_rows(equations, rows, speed), list[Violations]()
    if len(normals):
        laws.append(([layout.names[k] for k in normals], "shapes overlap", -gap / length))
    if len(n):
        names = [layout.names[k] for k in n]
        opens = np.abs(gap[:, modes.closed]) / length
        laws.append((names, "the gap of a contact that carries a force opens", opens))
        laws.append((names, "a contact that lasts moves along its normal", np.abs(rows.u[:, n]) / speed))
        sinks = np.abs(moved[:, n]) / weight[:, n] / fastest
        laws.append((names, "a contact that lasts accelerates along its normal", sinks))
        inadmissible.append((names, "a contact pulls", -force[:, n] / largest))
    for j, one in enumerate(layout.friction):
        mode, at, name = modes.friction[j], list(one.rows), [one.name]
        if mode is None:
            continue
        bound, T, slip = offset[:, j] if one.load is None else force[:, one.load], force[:, at], rows.u[:, at]
        if len(mode.held):
            pace = fastest[:, 0] * np.mean(weight[:, at], axis=1)
            laws.append((name, "what is held accelerates", _size(moved[:, at] @ mode.held.T, pace)))
            laws.append((name, "what is held slides", _size(slip @ mode.held.T, speeds)))
        beyond = (_support(one, T) - one.static * bound)[:, None] / largest
        inadmissible.append((name, "friction is beyond its bound", beyond))
        if not len(mode.held):
            size = np.linalg.norm(slip, axis=1)
            heading = slip / np.where(size > 0.0, size, 1.0)[:, None]
            lost = one.kinetic * bound * _most(one, heading) + np.sum(T * heading, axis=1)
            lost[size <= _SLIDES * speeds] = 0.0
            laws.append((name, "friction does not oppose the slip", np.abs(lost)[:, None] / largest))
    return laws, inadmissible, largest


def _joint_rows(equations: ContactEquations, rows: SampledRows, speed: Array) -> list[Violations]:
    """Return the violations of the joints' rows."""
    model, joints = equations.model, rows.Q.shape[1]
    if not joints:
        return []
    q, v = holonomic_rows(model), rows.states[:, : len(model.mass), 7:13].reshape(len(rows.times), -1)
    gap = np.abs(rows.value[:, :q]) / max(1.0, model.length)
    drift = np.abs(np.einsum("nqi,ni->nq", rows.Q, v) - rows.rate) / np.maximum(1.0, speed)
    names = ["constraints"] * joints
    found: list[Violations] = [(names, "a joint is violated", gap)] if q else []
    return [*found, (names, "the rate of a joint is not zero", drift)]


def _size(vectors: Array, scale: Array) -> Array:
    """Return the lengths of vectors, shape (n, d), over scales, shape (n,), as a column."""
    return (np.linalg.norm(vectors, axis=1) / scale)[:, None]


def _most(one: FrictionSet, heading: Array) -> Array:
    """Return the largest ``-T . heading`` over the unit set, headings of shape (n, d)."""
    vertices = one.vertices
    return np.ones(len(heading)) if vertices is None else np.max(-(heading @ vertices.T), axis=1)


def _support(one: FrictionSet, force: Array) -> Array:
    """Return the size of the unit set's multiple on whose boundary a force is, forces of shape (n, d)."""
    vertices = one.vertices
    if vertices is None or len(one.rows) == 1:
        return np.linalg.norm(force, axis=1)
    middles = 0.5 * (vertices + np.roll(vertices, -1, axis=0))
    return np.max(force @ (middles / np.sum(middles**2, axis=1)[:, None]).T, axis=1)
