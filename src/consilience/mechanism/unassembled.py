"""The error of an assembly without solution: which rows stay violated, and by how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.errors import CannotAssemble
from consilience.mechanism.model import Mechanism
from consilience.mechanism.spatial import Array

_AS_WELL = 0.1
"""Share of the largest residual from which drives, couplings and held coordinates are named beside its row."""


def stays_violated(
    mechanism: Mechanism, names: Sequence[str], residual: Array, sizes: Array, iterations: int, other: str
) -> CannotAssemble:
    """Return the error that names the row with the largest residual, and the drives and held coordinates against it.

    Where rows contradict one another, the least sum of squares leaves a part of the contradiction in each.

    Parameters
    ----------
    names : sequence of str, length q
        Of the rows (`assembly.row_names`).
    residual : ndarray, shape (q,)
        In units of the sizes of the rows.
    sizes : ndarray, shape (q,)
        m and rad in a unit of each row.
    iterations : int
    other : str
        What else to do than to draw the mechanism closer to an assembled pose.
    """
    worst, left = int(np.argmax(np.abs(residual))), np.abs(residual * sizes)
    as_well = {
        name: f"{name} ({left[n]:.3g})"
        for n, name in enumerate(names)
        if abs(residual[n]) >= _AS_WELL * abs(residual[worst]) and ", constraint " not in name and name != names[worst]
    }
    against = f", beside {' and '.join(as_well.values())}" if as_well else ""
    return CannotAssemble(
        f"mechanism '{mechanism.name}': {names[worst]}",
        f"it stays violated by {left[worst]:.3g} after {iterations} iterations{against}",
        f"Draw the mechanism closer to an assembled pose, or {other} fewer or other joint coordinates.",
    )
