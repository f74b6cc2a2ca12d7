"""What must happen within seconds is meant for a machine that does nothing else: others are slow, and stand still."""

import math
import time

_ADDITIONS = 500_000
_TIME = 0.05
"""Of so many additions on such a machine, s."""

_PAUSE = 0.02
_LAP = 0.1
"""Longest that a look and a pause take where the machine does not stand still, s."""


def slowness():
    """How many times slower than such a machine it is, a whole number; 1 where it is as fast or faster."""
    start, total = time.perf_counter(), 0
    for n in range(_ADDITIONS):
        total += n * n
    return max(1, math.ceil((time.perf_counter() - start) / _TIME))


def soon(condition, within=2.0):
    """Whether a condition comes true within some seconds, of which those that the machine stood still do not count."""
    left, last = within * slowness(), time.monotonic()
    while not condition():
        if left <= 0.0:
            return False
        time.sleep(_PAUSE)
        now = time.monotonic()
        left, last = left - min(now - last, _LAP), now
    return True
