"""Oracles without a second engine: identities that the answers of every sound engine satisfy."""

from __future__ import annotations

from consilience.audit.identities.check import IDENTITIES, Checks, Identity, check_case, check_engines
from consilience.audit.identities.descriptions import (
    Description,
    moved,
    recut,
    reordered,
    rotated,
    scaled_units,
    split,
    swapped,
)
from consilience.audit.identities.equations import Equations
from consilience.audit.identities.result import Finding, IdentityOutcome, exit_code

__all__ = [
    "IDENTITIES",
    "Checks",
    "Description",
    "Equations",
    "Finding",
    "Identity",
    "IdentityOutcome",
    "check_case",
    "check_engines",
    "exit_code",
    "moved",
    "recut",
    "reordered",
    "rotated",
    "scaled_units",
    "split",
    "swapped",
]
