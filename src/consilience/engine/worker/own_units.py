"""Units in which engines compute with matched settings.

Mechanics does not depend on units, but engines and adapters have absolute constants: least divisors, regularisations,
thresholds of solvers, steps, overlaps. With matched settings a mechanism of unusual sizes is given in units in which
they are usual; the factors are powers of two, so that nothing is rounded. Answers that depend on absolute constants
beyond rounding, extrapolated ones and those about contacts, stops and dry friction, have such units at any size. At its
own defaults an engine gets SI units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from consilience.engine.answers import Method, Profile, Route
from consilience.engine.questions import Question
from consilience.mechanism import (
    Array,
    ContactLaw,
    Mechanism,
    State,
    Units,
    applied_wrenches,
    characteristic_length,
    drawing_state,
    own_units,
)

SETTING = "units (m, kg, s)"
"""Setting of a method that lists the sizes of its units."""

USUAL = 0.25, 2.0, 0.125
"""Usual length, m, mass, kg, and time, s, of a mechanism: absolute constants of engines are made for them."""

ORDINARY, FAST = 128.0, 4.0
"""Factor on usual sizes within which a mechanism has ordinary ones, and on the usual rate: what depends on units there
is rounding. A solver with absolute constants stops at 1e-6 of the forces of a ring of fifty bodies eight times as fast.
"""

ROUNDED = 1e-12
"""Strain of springs, in characteristic lengths or rad, below which what they pull is the rounding of a pose."""

_PHYSICAL = (Question.MODEL, Question.INSTANT, Question.TRAJECTORY)


def with_units(
    mechanism: Mechanism, states: Sequence[State], question: Question, methods: tuple[Method, ...]
) -> tuple[Method, ...]:
    """Return methods of an engine with the units of a mechanism among their settings, where they need any.

    The law of contact that a method solves has the numbers of the engine in these units; it is returned in SI units.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
        States of which the forces at the first count, and the fastest velocity; without any, forces in the drawing.
    question : Question
    methods : tuple of Method
    """
    if question not in _PHYSICAL:
        return methods
    own = _units(mechanism, states)
    far = Units(
        *(1.0 if 1.0 / ORDINARY <= x <= most else x for x, most in zip(own, (ORDINARY, ORDINARY, FAST), strict=True))
    )
    touching = bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)
    return tuple(
        _in(own if touching or m.route is Route.EXTRAPOLATED else far, m)
        if m.profile is Profile.MATCHED and m.route is not Route.REFERENCE
        else m
        for m in methods
    )


def _in(units: Units, method: Method) -> Method:
    """Return a method with units among its settings, if they are not those of SI."""
    if units == Units():
        return method
    settings = {**method.settings, SETTING: list(units.inverse)}
    law, soft_law = (_law_in(units.inverse, one) for one in (method.law, method.soft_law))
    return replace(method, settings=settings, law=law, soft_law=soft_law)


def _law_in(units: Units, law: ContactLaw | None) -> ContactLaw | None:
    """Return a law of contact in other units."""
    if law is None:
        return None
    rows = law.regularisation and tuple(units.convert(row) for row in law.regularisation)
    return replace(units.convert(law), compliance=law.compliance and units.convert(law.compliance), regularisation=rows)


def _units(mechanism: Mechanism, states: Sequence[State]) -> Units:
    """Return units in which the sizes of a mechanism are usual.

    The time is that in which forces move it; where they hardly do, that in which its velocities move it. What springs
    at rest pull by rounding is no force.
    """
    mass, length = sum(body.mass for body in mechanism.bodies), characteristic_length(mechanism)
    with np.errstate(all="ignore"):  # forces in a drawing may overflow
        pull = applied_wrenches(mechanism, states[0] if states else drawing_state(mechanism)).total / (mass * length)
        pull[:, 3:] /= length
        strongest = float(np.max(np.abs(pull)))
        moved = max((_largest(s.v_WB_W / length, s.w_WB_W) for s in states), default=0.0)
    forced = float(np.sqrt(strongest)) if strongest > ROUNDED * _stiffness(mechanism, length) / mass else 0.0
    fastest = forced if forced * ORDINARY > moved else moved
    to_one = own_units(mechanism, 1.0 / fastest if 0.0 < fastest < np.inf else USUAL[2])
    return Units(*(size * factor for size, factor in zip(USUAL, to_one, strict=True)))


def _stiffness(mechanism: Mechanism, length: float) -> float:
    """Return the stiffness of the stiffest spring, that of a turn at the characteristic length, N/m."""
    straight = [spring.stiffness for spring in mechanism.springs]
    in_joints = [
        spring.stiffness / (1.0 if spring.coordinate == "distance" else length**2) for spring in mechanism.joint_springs
    ]
    return float(np.max(np.abs([0.0, *straight, *in_joints])))


def _largest(*values: Array) -> float:
    return max(float(np.max(np.abs(value))) for value in values)


def units_of(method: Method | None) -> Units:
    """Return the units among the settings of a method; those of SI where there are none."""
    found = method.settings.get(SETTING) if method else None
    return Units(*found).inverse if found else Units()


def without_units(method: Method) -> Method:
    """Return a method as its adapter knows it."""
    return replace(method, settings={name: value for name, value in method.settings.items() if name != SETTING})
