"""Errors in the elements of a mechanism: a part of their coefficients and laws is lost.

The magnitude is the part that is lost; 1 leaves nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from consilience.audit.mutate.mutants import Precondition
from consilience.mechanism import Mechanism, coefficient_acts, scaled_coefficient


def lost(kind: str, *fields: str) -> Callable[[Mechanism, float], Mechanism]:
    """Return the change that loses a part of fields of all elements of a kind, such as ``frictions``."""

    def change(mechanism: Mechanism, magnitude: float) -> Mechanism:
        elements: dict[str, Any] = {
            kind: tuple(
                replace(one, **{field: scaled_coefficient(getattr(one, field), 1.0 - magnitude) for field in fields})
                for one in getattr(mechanism, kind)
            )
        }
        return replace(mechanism, **elements)

    return change


def given(kind: str, *fields: str) -> Precondition:
    """Require an element of a kind of which one of these fields is neither zero nor left out."""
    return lambda subject: any(
        coefficient_acts(getattr(one, field)) for one in getattr(subject.mechanism, kind) for field in fields
    )
