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

from collections.abc import Iterator

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array
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
    for name, what, violation in (*joints, *_violations(equations, response, modes, force, speed)):
        if not violation <= BAR:
            raise NumericalFailure(f"{name}, t = {at[0]:.12g} s: {what}, by {violation:.3g} of the largest")


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


Violation = tuple[str, str, float]
"""Row, what is wrong there, and by how much."""


def _joint_rows(equations: ContactEquations, at: tuple[float, Array, Array], speed: float) -> list[Violation]:
    """Return the violations of the joints' rows."""
    Q, value, rate = equations.joint_rows(*at)
    model, v = equations.model, at[1][: len(equations.model.mass), 7:13].ravel()
    holonomic = len(value) - 2 * len(model.rolling) - len(model.skate)
    gap, drift = np.abs(value[:holonomic]) / max(1.0, model.length), np.abs(Q @ v - rate) / max(1.0, speed)
    found = [("constraints", "a joint is violated", float(np.max(gap, initial=0.0)))]
    return [*found, ("constraints", "the rate of a joint is not zero", float(np.max(drift, initial=0.0)))]


def _violations(
    equations: ContactEquations, response: Response, modes: RowModes, force: Array, speed: float
) -> Iterator[Violation]:
    """Yield the rows of contacts, the law of each, and its violation."""
    layout, rows = equations.layout, equations.rows
    moved = response.free + response.K @ (response.K.T @ (force - response.given))
    weight = np.maximum(np.linalg.norm(response.load, axis=0), np.finfo(float).tiny)
    pushed = np.maximum(np.abs(response.free) / weight, weight * np.abs(force))
    fastest = float(np.max(pushed, initial=HELD / BAR * response.pull)) or 1.0
    largest = max(float(np.max(np.abs(force), initial=0.0)), fastest / float(np.max(weight, initial=1.0)))
    length = max(1.0, equations.model.length)
    inadmissible = None
    for k, n in enumerate(layout.normals):
        gap, rate, name = rows.gap[layout.gaps[k]], rows.u[n], layout.names[n]
        yield name, "shapes overlap", -gap / length
        if modes.closed[k]:
            yield name, "the gap of a contact that carries a force opens", abs(gap) / length
            yield name, "a contact that lasts moves along its normal", abs(rate) / speed
            yield name, "a contact that lasts accelerates along its normal", abs(moved[n]) / weight[n] / fastest
            if force[n] < -BAR * largest:
                inadmissible = inadmissible or (name, "a contact pulls", -force[n] / largest)
    for j, one in enumerate(layout.friction):
        mode = modes.friction[j]
        if mode is None:
            continue
        at = list(one.rows)
        bound = equations.offsets[j] if one.load is None else force[one.load]
        pace = fastest * float(np.mean(weight[at]))
        yield one.name, "what is held accelerates", float(np.linalg.norm(mode.held @ moved[at]) / pace)
        yield one.name, "what is held slides", float(np.linalg.norm(mode.held @ rows.u[at]) / speed)
        beyond = (_support(one, force[at]) - one.static * bound) / largest
        if beyond > BAR:
            inadmissible = inadmissible or (one.name, "friction is beyond its bound", float(beyond))
        if not len(mode.held) and np.linalg.norm(rows.u[at]) > _SLIDES * speed:
            heading = rows.u[at] / np.linalg.norm(rows.u[at])
            lost = one.kinetic * bound * _most(one, heading) + force[at] @ heading
            yield one.name, "friction does not oppose the slip", float(abs(lost) / largest)
    if inadmissible is not None:
        margin, *_ = widest_margin(equations, response, modes, sliding_rates(equations, modes, 0.0))
        yield inadmissible if not np.isfinite(margin) else (*inadmissible[:2], -margin / largest)


def _most(one: FrictionSet, heading: Array) -> float:
    """Return the largest ``-T . heading`` over the unit set."""
    vertices = one.vertices
    return 1.0 if vertices is None else float(np.max(-(vertices @ heading)))


def _support(one: FrictionSet, force: Array) -> float:
    """Return the size of the unit set's multiple on whose boundary a force is."""
    vertices = one.vertices
    if vertices is None or len(one.rows) == 1:
        return float(np.linalg.norm(force))
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
