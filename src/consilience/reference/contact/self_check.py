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

As friction jams (Painleve) the determinant of the modes falls to zero; it is watched from step to step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import hypot

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array
from consilience.reference.bodies.arrays import all_rows, holonomic_rows
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.lasting import sliding_rates, widest_margin
from consilience.reference.contact.mode_system import sliding_indicator
from consilience.reference.contact.problem import FrictionSet
from consilience.reference.contact.response import HELD, Response
from consilience.reference.contact.row_modes import RowModes

BAR = 1e-7
"""Largest violation, relative to lengths, speeds, forces or accelerations of the mechanism."""

_SLIDES = 1e-4
"""Slip, over the speeds of the mechanism, from which its direction is checked."""

_JAMS = 1e-6
"""Determinant of modes in which sliding friction counts as jammed."""


def check_laws(equations: ContactEquations, modes: RowModes, at: tuple[float, Array, Array], speed: float) -> None:
    """Check a state with what lasts there against all laws.

    Parameters
    ----------
    equations : ContactEquations
        In these modes.
    modes : RowModes
    at : tuple
        Time, packed state and turns.
    speed : float, m/s
        Of the mechanism.

    Raises
    ------
    NumericalFailure
        With the row, the time, and the violation over `BAR`.
    """
    joints = _joint_rows(equations, at, speed)
    response = equations.respond(*at)
    force = equations.row_forces(*at)
    for names, what, violations in (*joints, *_violations(equations, response, modes, force, speed)):
        worst = int(np.argmax(violations))
        if not violations[worst] <= BAR:
            raise NumericalFailure(
                f"{names[worst]}, t = {at[0]:.12g} s: {what}, by {violations[worst]:.3g} of the largest"
            )


def refuse_overlap(equations: ContactEquations, at: tuple[float, Array, Array], least: float) -> None:
    """Refuse a start at which shapes overlap, or a joint is beyond a stop, by more than `least`, m (rad).

    Raises
    ------
    InvalidInput
    """
    layout = equations.layout
    gaps = equations.move(*at).gap[layout.gaps]
    if not len(gaps) or np.min(gaps) >= -least:
        return
    worst = int(np.argmin(gaps))
    name, k = layout.names[layout.normals[worst]], layout.part_of(worst)
    if k is None:
        raise InvalidInput(name, f"the joint is {-gaps[worst]:.6g} beyond it at the start", "Start within it.")
    part = layout.parts[k]
    raise InvalidInput(
        name,
        f"'{part.body}' and '{part.partner}' overlap by {-gaps[worst]:.6g} m at the start",
        "Start with the shapes apart, or just touching.",
    )


Violations = tuple[Sequence[str], str, Array]
"""Rows, what is wrong there, and by how much."""


def _joint_rows(equations: ContactEquations, at: tuple[float, Array, Array], speed: float) -> list[Violations]:
    """Return the violations of the joints' rows."""
    model = equations.model
    if not all_rows(model):
        return []
    Q, value, rate = equations.joint_rows(*at)
    v, q = at[1][: len(model.mass), 7:13].ravel(), holonomic_rows(model)
    gap, drift = np.abs(value[:q]) / max(1.0, model.length), np.abs(Q @ v - rate) / max(1.0, speed)
    names = ["constraints"] * len(value)
    found: list[Violations] = [(names, "a joint is violated", gap)] if q else []
    return [*found, (names, "the rate of a joint is not zero", drift)]


def _violations(
    equations: ContactEquations, response: Response, modes: RowModes, force: Array, speed: float
) -> Iterator[Violations]:
    """Yield the rows of contacts, the law of each, and its violations."""
    layout, rows = equations.layout, equations.rows
    moved = response.free + response.K @ (response.K.T @ (force - response.given))
    weight = np.maximum(np.linalg.norm(response.load, axis=0), np.finfo(float).tiny)
    pushed = np.maximum(np.abs(response.free) / weight, weight * np.abs(force))
    fastest = float(np.max(pushed, initial=HELD / BAR * response.pull)) or 1.0
    largest = max(float(np.max(np.abs(force), initial=0.0)), fastest / float(np.max(weight, initial=1.0)))
    length, normals = max(1.0, equations.model.length), np.array(layout.normals, dtype=np.int64)
    gap, n, inadmissible = rows.gap[layout.gaps], normals[modes.closed], list[Violations]()
    if len(normals):
        yield [layout.names[k] for k in normals], "shapes overlap", -gap / length
    if len(n):
        names = [layout.names[k] for k in n]
        yield names, "the gap of a contact that carries a force opens", np.abs(gap[modes.closed]) / length
        yield names, "a contact that lasts moves along its normal", np.abs(rows.u[n]) / speed
        yield names, "a contact that lasts accelerates along its normal", np.abs(moved[n]) / weight[n] / fastest
        inadmissible.append((names, "a contact pulls", -force[n] / largest))
    for j, one in enumerate(layout.friction):
        mode, at, name = modes.friction[j], list(one.rows), [one.name]
        if mode is None:
            continue
        bound, slip = equations.offsets[j] if one.load is None else force[one.load], rows.u[at]
        if len(mode.held):
            pace = fastest * float(np.mean(weight[at]))
            yield name, "what is held accelerates", np.array([hypot(*(mode.held @ moved[at])) / pace])
            yield name, "what is held slides", np.array([hypot(*(mode.held @ slip)) / speed])
        beyond = (_support(one, force[at]) - one.static * bound) / largest
        inadmissible.append((name, "friction is beyond its bound", np.array([beyond])))
        size = hypot(*slip)
        if not len(mode.held) and size > _SLIDES * speed:
            lost = one.kinetic * bound * _most(one, slip / size) + force[at] @ slip / size
            yield name, "friction does not oppose the slip", np.array([abs(lost) / largest])
    told = next((one for one in inadmissible if np.max(one[2]) > BAR), None)
    if told is not None:
        margin, *_ = widest_margin(equations, response, modes, sliding_rates(equations, modes, 0.0))
        worst = int(np.argmax(told[2]))
        found = told[2][worst] if not np.isfinite(margin) else -margin / largest
        yield [told[0][worst]], told[1], np.array([found])


def _most(one: FrictionSet, heading: Array) -> float:
    """Return the largest ``-T . heading`` over the unit set."""
    vertices = one.vertices
    return 1.0 if vertices is None else float(np.max(-(vertices @ heading)))


def _support(one: FrictionSet, force: Array) -> float:
    """Return the size of the unit set's multiple on whose boundary a force is."""
    vertices = one.vertices
    if vertices is None or len(one.rows) == 1:
        return hypot(*force)
    middles = 0.5 * (vertices + np.roll(vertices, -1, axis=0))
    return float(np.max((middles / np.sum(middles**2, axis=1)[:, None]) @ force))


def refuse_jam(equations: ContactEquations, response: Response, modes: RowModes, time: float) -> None:
    """Refuse modes in which sliding friction has jammed.

    Raises
    ------
    NumericalFailure
    """
    loaded = [
        one.name
        for one, mode in zip(equations.layout.friction, modes.friction, strict=True)
        if mode is not None and np.any(mode.drag) and one.load in equations.layout.normals
    ]
    if not loaded:
        return
    scale = np.linalg.norm(response.load, axis=0)
    scale[scale == 0.0] = 1.0
    value = sliding_indicator(response.K @ response.K.T, scale, *equations.columns())
    if value <= _JAMS:
        raise NumericalFailure(
            f"{', '.join(dict.fromkeys(loaded))}, t = {time:.12g} s: sliding friction jams (Painleve): the determinant "
            f"of its equations, relative to that without friction, has fallen to {value:.3g}"
        )
