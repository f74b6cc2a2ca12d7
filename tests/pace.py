"""What must happen within seconds is meant for a machine that does nothing else: others are slow, and stand still."""

import math
import time

_ADDITIONS = 500_000
_TIME = 0.05
"""Of so many additions on such a machine, s."""

_PAUSE = 0.02
_ATTEMPTS = 4


def slowness():
    """How many times slower than such a machine it is, a whole number; 1 where it is as fast or faster."""
    start, total = time.perf_counter(), 0
    for n in range(_ADDITIONS):
        total += n * n
    return max(1, math.ceil((time.perf_counter() - start) / _TIME))


def soon(condition, within=2.0):
    """Whether a condition comes true within some seconds, of which those that the machine stood still do not count."""
    for _ in range(round(within * slowness() / _PAUSE)):
        if condition():
            return True
        time.sleep(_PAUSE)
    return bool(condition())


def prompt(attempt, within=2.0):
    """Whether what answers with the time it took, in s, takes less at one of a few attempts: a stall spoils one."""
    return any(attempt() < within * slowness() for _ in range(_ATTEMPTS))
