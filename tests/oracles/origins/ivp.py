"""Origins of problems of the test set for initial value problems."""

from functools import cache

import numpy as np

from oracles.benchmarks import squeezer_angles
from oracles.benchmarks.andrews import START
from oracles.origins.relative import lagrange

_equations = cache(squeezer_angles.Equations)
_PINS = {name: n for n, name in enumerate(("O", "F", "B", "G", "A_5", "H", "A_7"))}


def _squeezer(case, published):
    """Joint angles are the published angles minus their initial values in the test set."""
    times = np.array(sorted({known.time for known in published}))
    beta = START[0] + case.initial.coordinates.get("O", {}).get("angle", 0.0)
    y = _equations().solve(beta, times)
    y[:, :7] -= START
    columns = [_PINS[known.of] + 7 * (known.observable == "angle_rate") for known in published]
    return np.array([y[np.searchsorted(times, k.time), c] for k, c in zip(published, columns, strict=True)])


_SQUEEZER = (_squeezer, lagrange("E_3", "E_4", "E_6"))

ORIGINS = {"andrews-ivp": _SQUEEZER, "andrews-iftomm": _SQUEEZER}
