"""How fast the machine is just now: what must happen within seconds is meant for one that does nothing else."""

import math
import time

_ADDITIONS = 500_000
_TIME = 0.05
"""Of so many additions on such a machine, s."""


def slowness():
    """How many times slower than such a machine it is, a whole number; 1 where it is as fast or faster."""
    start, total = time.perf_counter(), 0
    for n in range(_ADDITIONS):
        total += n * n
    return max(1, math.ceil((time.perf_counter() - start) / _TIME))
