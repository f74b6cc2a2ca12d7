"""Units in which engines compute with matched settings.

Mechanics does not depend on units, but engines have absolute constants: least divisors, regularisations, thresholds of
solvers. With matched settings a mechanism of unusual sizes is given in units in which they are usual; the factors are
powers of two, so that nothing is rounded. At its own defaults an engine gets SI units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from consilience.engine.answers import Method, Profile, Route
from consilience.engine.questions import Question
from consilience.mechanism import (
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

ORDINARY = 128.0
"""Factor on usual sizes within which a mechanism has ordinary ones."""

_PHYSICAL = (Question.MODEL, Question.INSTANT, Question.TRAJECTORY)


def with_units(
    mechanism: Mechanism, states: Sequence[State], question: Question, methods: tuple[Method, ...]
) -> tuple[Method, ...]:
    """Return methods of an engine with the units of a mechanism among their settings, if it is far from SI units.

    The law of contact that a method solves has the numbers of the engine in these units; it is returned in SI units.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
        States of which the fastest velocity counts, and the forces at the first; without any, those in the drawing.
    question : Question
    methods : tuple of Method
    """
    if question not in _PHYSICAL:
        return methods
    units = _units(mechanism, states)
    if units == Units():
        return methods
    own = {SETTING: list(units.inverse)}
    return tuple(
        replace(m, settings={**m.settings, **own}, law=_law_in(units.inverse, m.law))
        if m.profile is Profile.MATCHED and m.route is not Route.REFERENCE
        else m
        for m in methods
    )


def _law_in(units: Units, law: ContactLaw | None) -> ContactLaw | None:
    """Return a law of contact in other units."""
    if law is None:
        return None
    return replace(units.convert(law), compliance=law.compliance and units.convert(law.compliance))


def _units(mechanism: Mechanism, states: Sequence[State]) -> Units:
    """Return units in which the sizes of a mechanism are usual, SI where they are; the time is that of its motion."""
    mass, length = sum(body.mass for body in mechanism.bodies), characteristic_length(mechanism)
    with np.errstate(all="ignore"):  # forces in a drawing may overflow
        pull = applied_wrenches(mechanism, states[0] if states else drawing_state(mechanism)).total / (mass * length)
        pull[:, 3:] /= length
        rates = [np.sqrt(np.abs(pull)), *(s.v_WB_W / length for s in states), *(s.w_WB_W for s in states)]
        fastest = max(float(np.max(np.abs(rate))) for rate in rates)
    to_one = own_units(mechanism, 1.0 / fastest if 0.0 < fastest < np.inf else USUAL[2])
    own = (size * factor for size, factor in zip(USUAL, to_one, strict=True))
    return Units(*(1.0 if 1.0 / ORDINARY <= factor <= ORDINARY else factor for factor in own))


def units_of(method: Method | None) -> Units:
    """Return the units among the settings of a method; those of SI where there are none."""
    found = method.settings.get(SETTING) if method else None
    return Units(*found).inverse if found else Units()


def without_units(method: Method) -> Method:
    """Return a method as its adapter knows it."""
    return replace(method, settings={name: value for name, value in method.settings.items() if name != SETTING})
