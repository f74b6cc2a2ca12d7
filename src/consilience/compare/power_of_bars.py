"""Power of comparisons by bars: the answer of the reference about a mechanism with an error, judged as the engine's."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace

import numpy as np

from consilience.compare.instant import SOFTENED
from consilience.compare.instants import Instants
from consilience.compare.power import LARGEST, Power, powerless
from consilience.compare.result import Comparison, Quantity, Verdict
from consilience.compare.rules import NO_POWER, POWERLESS
from consilience.compare.softness import EXPLAINED
from consilience.compare.uncertainty import ROUNDING
from consilience.engine import InstantAnswer, Run

WIDEST = 1e-6
"""Largest difference that may agree, however wide the condition of the equations makes the bar."""

OPEN = "of the equations leaves no digit to judge"
"""Why a difference above a bar that is wider than `LARGEST` blames no model: such bars no longer bound rounding."""

PASSED = (Verdict.AGREES, Verdict.REGULARISATION)
"""Verdicts by bars that a run passes over."""


def with_power(
    compared: Comparison, perturbed: Iterable[Run], judged: Callable[[Run], Sequence[Quantity]]
) -> Comparison:
    """Return a comparison by bars with its power; unresolved if it has none.

    Parameters
    ----------
    compared : Comparison
    perturbed : iterable of Run
        Answers of the reference about mechanisms with an error.
    judged : callable
        Function that compares such an answer in the place of the engine's.
    """
    found = tuple(power for run in perturbed if (power := _power(compared, run, judged(run))) is not None)
    compared = replace(compared, power=found)
    missed = [q for q in compared.quantities if not q.met]
    if compared.verdict is Verdict.MODEL and all(q.bar > LARGEST for q in missed):
        why = f"{missed[0].name}: difference {missed[0].difference:.2g}, bar {missed[0].bar:.2g}: the condition {OPEN}"
        return replace(compared, verdict=Verdict.UNRESOLVED, rule=NO_POWER, why=why)
    if compared.verdict not in PASSED:
        return compared
    if powerless(found):
        return replace(compared, verdict=Verdict.UNRESOLVED, rule=NO_POWER, why=POWERLESS)
    wide = next((q for q in compared.quantities if compared.verdict is Verdict.AGREES and q.difference > WIDEST), None)
    if wide is None:
        return compared
    why = f"{wide.name}: difference {wide.difference:.2g}; the bar, {wide.bar:.2g} by the condition, is too wide"
    return replace(compared, verdict=Verdict.UNRESOLVED, rule=NO_POWER, why=why)


def _power(compared: Comparison, run: Run, quantities: Sequence[Quantity]) -> Power | None:
    """Return the power for one error by the quantity that shows it first; None if the error changes nothing."""
    error = run.perturbation
    assert error is not None
    shown = [q for q in quantities if q.count and q.bar > 0.0 and q.difference > ROUNDING]
    if not shown:
        return None
    soft = compared.verdict is Verdict.REGULARISATION
    own = {q.name: EXPLAINED * q.difference for q in compared.quantities if soft and q.name in SOFTENED}
    ratio = max(q.difference / max(q.bar, own.get(q.name, 0.0)) for q in shown)
    return Power(error.kind, error.of, error.size / ratio)


def at_first_states(answer: InstantAnswer, count: int) -> InstantAnswer:
    """Return the answer at the first states alone."""
    arrays = {f.name: getattr(answer, f.name) for f in fields(answer)}
    return InstantAnswer(**{name: a[:count] if isinstance(a, np.ndarray) else a for name, a in arrays.items()})


def instants_at_first_states(instants: Instants, count: int) -> Instants:
    """Return the properties of the first states alone."""
    of_states = ("condition", "determined", "determined_pairs")
    return replace(instants, **{name: getattr(instants, name)[:count] for name in of_states})
