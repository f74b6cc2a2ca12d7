"""Errors in the elements of a mechanism: a part of their coefficients and laws is lost.

The magnitude is the part that is lost; 1 leaves nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from consilience.audit.mutate.mutants import Precondition
from consilience.audit.mutate.subjects import MutationSubject
from consilience.mechanism import Function, Mechanism


def lost(kind: str, *fields: str) -> Callable[[Mechanism, float], Mechanism]:
    """Return the change that loses a part of fields of all elements of a kind, such as ``frictions``."""

    def change(mechanism: Mechanism, magnitude: float) -> Mechanism:
        elements: dict[str, Any] = {
            kind: tuple(
                replace(one, **{field: _left(getattr(one, field), 1.0 - magnitude) for field in fields})
                for one in getattr(mechanism, kind)
            )
        }
        return replace(mechanism, **elements)

    return change


def _left(value: Any, share: float) -> Any:
    """Return a share of a number, of numbers or of a function; None stays None."""
    if value is None:
        return None
    if isinstance(value, Function):
        table = None if value.table is None else replace(value.table, y=share * value.table.y)
        return Function(share * value.polynomial, value.harmonics * [share, 1.0, 1.0], table)
    return tuple(share * one for one in value) if isinstance(value, tuple) else share * value


def given(kind: str, *fields: str) -> Precondition:
    """Require an element of a kind of which one of these fields is neither zero nor left out."""

    def holds(subject: MutationSubject) -> bool:
        values = [getattr(one, field) for one in getattr(subject.mechanism, kind) for field in fields]
        return any(value is not None and (isinstance(value, Function) or bool(np.any(value))) for value in values)

    return holds
