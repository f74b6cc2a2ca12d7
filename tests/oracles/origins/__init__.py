"""Origins of the expected values of the case library: equations that share no code with the reference solver."""

import importlib
import pkgutil
from collections.abc import Callable, Sequence

import numpy as np

from consilience.case import Case, Published

Origin = Callable[[Case, Sequence[Published]], np.ndarray]
"""Values of a case in the order asked."""


def all_origins() -> dict[str, tuple[Origin, ...]]:
    """Origins by case name: one for a closed form, two for values that are computed and not published."""
    found: dict[str, tuple[Origin, ...]] = {}
    for module in pkgutil.iter_modules(__path__):
        own = getattr(importlib.import_module(f"{__name__}.{module.name}"), "ORIGINS", {})
        assert not set(own) & set(found), "two files have origins of one case"
        found |= own
    return found
