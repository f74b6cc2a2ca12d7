"""Types of records: NumPy structured arrays, whose fields Numba and Python read as attributes."""

from __future__ import annotations

from typing import Any

import numpy as np

INT = np.int64


def record_type(*fields: tuple[Any, ...]) -> np.dtype[Any]:
    """Return the type of records with some fields: name, type and, for an array, its shape."""
    return np.dtype((np.record, list(fields)), align=True)
