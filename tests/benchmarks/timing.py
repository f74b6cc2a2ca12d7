"""CPU times of several ways to do the same work, measured side by side in one run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

LEAST = 0.02
"""CPU time in s of one measurement at least: a short work is repeated, so that the clock does not matter."""

ROUNDS = 7


@dataclass(frozen=True)
class Sample:
    """CPU time of one call in s, for each round."""

    times: tuple[float, ...]

    @property
    def median(self) -> float:
        return float(np.median(self.times))


@dataclass(frozen=True)
class Ratio:
    """Median and quartiles of the ratios of two samples, round by round."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.median:.2g} ({self.low:.2g} to {self.high:.2g})"


def ratio(numerator: Sample, denominator: Sample) -> Ratio:
    """Return the ratio of two samples round by round, so that slow periods of the machine affect both."""
    low, median, high = np.percentile(np.array(numerator.times) / np.array(denominator.times), (25, 50, 75))
    return Ratio(float(median), float(low), float(high))


def less(whole: Sample, part: Sample) -> Sample:
    """Return the difference of two samples, round by round."""
    return Sample(tuple(w - p for w, p in zip(whole.times, part.times, strict=True)))


def race(contenders: Mapping[str, Callable[[], object]], rounds: int = ROUNDS) -> dict[str, Sample]:
    """Return the CPU time of each contender, warm, in turns; each round starts with another contender."""
    repeats = {}
    for name, work in contenders.items():
        work()
        repeats[name] = max(1, math.ceil(LEAST / max(_once(work, 1), 1e-9)))
    names = list(contenders)
    times: dict[str, list[float]] = {name: [] for name in names}
    for n in range(rounds):
        for name in names[n % len(names) :] + names[: n % len(names)]:
            times[name].append(_once(contenders[name], repeats[name]))
    return {name: Sample(tuple(values)) for name, values in times.items()}


def _once(work: Callable[[], object], repeats: int) -> float:
    start = time.process_time()
    for _ in range(repeats):
        work()
    return (time.process_time() - start) / repeats


def seconds(value: float) -> str:
    """Return a time as text in a suitable unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"
