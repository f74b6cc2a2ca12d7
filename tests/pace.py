"""Deadlines of tests, in proportion to the speed of the machine.

A deadline is stated for a fast, idle machine. A slow machine gets proportionally more time, and pauses in which the
whole machine stood still do not count.
"""

import math
import time

_ADDITIONS = 500_000
_TIME = 0.05
"""Time of these additions on a fast machine, s."""

_PAUSE = 0.02
_LAP = 0.1
"""Longest time between two evaluations of a condition on a machine that does not stand still, s."""


def slowness():
    """Return how many times slower this machine is than a fast one, as an integer of at least 1."""
    start, total = time.perf_counter(), 0
    for n in range(_ADDITIONS):
        total += n * n
    return max(1, math.ceil((time.perf_counter() - start) / _TIME))


def soon(condition, within=2.0):
    """Return whether a condition becomes true within a deadline in s, scaled as the module describes."""
    left, last = within * slowness(), time.monotonic()
    while not condition():
        if left <= 0.0:
            return False
        time.sleep(_PAUSE)
        now = time.monotonic()
        left, last = left - min(now - last, _LAP), now
    return True
