"""Steps towards an instant at which sliding friction jams (Painleve): there the determinant of the modes is zero."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.mode_system import sliding_indicator
from consilience.reference.contact.problem import in_words
from consilience.reference.contact.quiet_steps import JAMS
from consilience.reference.contact.row_modes import RowModes
from consilience.reference.contact.stepper import SlipTurns, Stepper

_NEAR_JAM = 1e-4
"""Determinant below which a motion that no step is short enough for is about to jam: forces grow as its reciprocal."""


def step(equations: ContactEquations, stepper: Stepper, bound: float) -> None:
    """Take a step; where none is short enough because sliding friction is about to jam, say so.

    Raises
    ------
    NumericalFailure
    """
    try:
        stepper.advance(bound)
    except NumericalFailure as failure:
        if not isinstance(failure, SlipTurns):
            _refuse_jam(equations, stepper.modes, (stepper.t, stepper.y, stepper.turns), _NEAR_JAM)
        raise


def ends_before_jam(equations: ContactEquations, stepper: Stepper, until: float, ends: Callable[[], bool]) -> bool:
    """End the last step before sliding friction jams, if it does by a time; return whether it did.

    Forces grow without bound towards a jam, and may first reach what ends the modes.

    Parameters
    ----------
    equations : ContactEquations
    stepper : Stepper
    until : float, s
    ends : callable
        Whether a repeated step has to end at the present state (`Stepper.shorten`).

    Raises
    ------
    NumericalFailure
        At a jam at the start of the step.
    """
    first = until
    while any(heading is not None for heading in stepper.modes.heading):
        try:
            _refuse_jam(equations, stepper.modes, (until, stepper.between(np.array([until]))[0], stepper.turns))
            break
        except NumericalFailure:
            if until - stepper.started <= 8.0 * float(np.spacing(until)):
                raise
        stepper.shorten(0.5 * (stepper.started + until), ends)
        until = stepper.t
    return until < first


def _refuse_jam(
    equations: ContactEquations, modes: RowModes, at: tuple[float, Array, Array], jams: float = JAMS
) -> None:
    """Refuse modes in which sliding friction has jammed at a time, packed state and turns.

    The scaled determinant without friction is at most one (Hadamard), so the indicator is at least that with friction.

    Raises
    ------
    NumericalFailure
    """
    loaded = [
        one.name
        for one, mode in zip(equations.layout.friction, modes.friction, strict=True)
        if mode is not None and np.any(mode.drag) and one.load in equations.layout.normals
    ]
    if not loaded or equations.determinant(*at) > jams:
        return
    response = equations.respond(*at)
    scale = np.linalg.norm(response.load, axis=0)
    scale[scale == 0.0] = 1.0
    value = sliding_indicator(response.K @ response.K.T, scale, *equations.columns())
    if value <= jams:
        raise NumericalFailure(
            f"{in_words(loaded)}, t = {at[0]:.12g} s: sliding friction jams (Painleve): the "
            f"determinant of its equations, relative to that without friction, has fallen to {value:.3g}"
        )
