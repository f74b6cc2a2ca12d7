"""Mutants of contacts that adapters share, whose module ``contacts`` adds the elementary contacts of a mechanism."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from consilience.audit.mutate.mutants import CONTACTS, FINE, FRACTION, Mutant, decades
from consilience.audit.mutate.mutated import Planting
from consilience.audit.mutate.seams import inside, on_result, wrapped
from consilience.engine import Question


def contact_mutants(engine: str) -> tuple[Mutant, ...]:
    """Return the mutants of contacts for an engine, by the name that tells them from those of other engines."""
    instant, motion = Question.INSTANT, Question.TRAJECTORY
    return (
        Mutant(CONTACTS, f"friction of one partner, {engine}", "the coefficient halved", FINE, FRACTION, instant,
               _parts(lambda part, e: {"friction": part.friction * (1.0 - 0.5 * e)})),
        Mutant(CONTACTS, f"restitution squared, {engine}", "the coefficient squared", (1.0, 0.1), FRACTION, motion,
               _parts(lambda part, e: {"restitution": part.restitution ** (1.0 + e)})),
        Mutant(CONTACTS, f"normal of the partner, {engine}", "forces on the partner in place of the body", FINE,
               FRACTION, instant, inside(("", "instant", on_result(_on_partner)))),
        Mutant(CONTACTS, f"contact at another point, {engine}", "the shape of the body aside", decades(-1, -9, 2), "m",
               instant, _parts(_aside)),
    )  # fmt: skip


def _parts(change: Callable[[Any, float], dict[str, Any]]) -> Planting:
    """Change fields of the elementary contacts that the adapter adds."""

    def altered(original: Any, magnitude: float, contact: Any) -> Any:
        return tuple(replace(part, **change(part, magnitude)) for part in original(contact))

    return inside(("contacts", "contact_parts", wrapped(altered)))


def _aside(part: Any, magnitude: float) -> dict[str, Any]:
    """Return the place of a shape on its body, moved by a length."""
    name = "corner" if hasattr(part, "corner") else "center"
    return {name: getattr(part, name) + magnitude * np.array([1.0, -2.0, 2.0]) / 3.0}


def _on_partner(answer: Any, magnitude: float) -> None:
    if answer.contact_force is not None:  # a mechanism with stops alone has none
        answer.contact_force[:] *= 1.0 - 2.0 * magnitude
