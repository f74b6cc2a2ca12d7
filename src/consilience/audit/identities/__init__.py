"""Oracles without a second engine: identities that the answers of every sound engine satisfy."""

# mypy: implicit-reexport

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
