"""Drawn extremes of every curve against the motion: ``python tests/peaks.py [CASE ...]``, all cases by default.

A motion sampled several times more finely than the one that is drawn is evaluated about the extremes of each drawn
curve and at random times. What it has beyond them is at most one per cent of the curve's largest magnitude, or the
panel is marked. Exit code 1 if not.
"""

import sys
from dataclasses import replace

import numpy as np

from consilience.case import load_cases, shipped_cases
from consilience.engine.worker.client import InProcessEngine
from consilience.report.curves import KINDS, MOST, CurveSet, curve_sets
from consilience.suite import densely_sampled
from consilience.suite.dense import finest_motion

FINER = 8
"""Samples of the finer motion in an interval of the drawn one; half of them are evaluated about an extreme."""

RANDOM = 100
"""Number of random times."""

LARGEST = 0.01
"""Largest part of a curve's magnitude by which a drawn extreme may be off."""


def beyond(curves, mechanism, finer):
    """Return how far the finer motion goes beyond the drawn extremes, relative to the largest magnitude, by curve."""
    kind, count = KINDS[curves.what], len(finer.time)
    extremes = np.concatenate([curves.values.argmax(axis=0), curves.values.argmin(axis=0)])
    peaks = np.searchsorted(finer.time, curves.time[np.unique(extremes)])
    about = (peaks[:, None] + np.arange(-FINER, FINER + 1, 2)).ravel()
    some = np.random.default_rng(len(finer.time)).integers(0, count, RANDOM)
    at = np.unique(np.clip([*about, *some], 0, count - 1))
    names = [tuple(name) for name in kind.names(mechanism)]
    columns = [names.index(tuple(name)) for name in curves.names]
    found = kind.values(mechanism, finer, at)[:, columns]
    if curves.what == "coordinates":
        found = turned(curves, finer.time[at], found)
    off = np.maximum(found.max(axis=0) - curves.values.max(axis=0), curves.values.min(axis=0) - found.min(axis=0))
    size = np.max(np.abs(curves.values), axis=0)
    return np.divide(off, size, out=np.zeros_like(off), where=size > 0.0)


def turned(curves, time, found):
    """Add the full turns that the drawn angles have there."""
    for k, name in enumerate(curves.names):
        if name.label.startswith("angle"):
            drawn = np.interp(time, curves.time, curves.values[:, k])
            found[:, k] += 2.0 * np.pi * np.round((drawn - found[:, k]) / (2.0 * np.pi))
    return found


def errors(case):
    """List the unmarked curves of a case whose drawn extremes are off, and count all curves and marked ones."""
    m, engine = case.mechanism, InProcessEngine("reference")
    dense = densely_sampled(case)
    drawn = finest_motion(engine, dense).answer
    if drawn is None:
        return [], 0, 0
    finer = finest_motion(engine, replace(dense, sample=dense.sample / FINER)).answer
    count, marked, wrong = 0, 0, []
    for curves in (CurveSet.of(one.data()) for one in curve_sets(m, drawn)):
        for name, off, still in zip(curves.names, beyond(curves, m, finer), curves.open, strict=True):
            count, marked = count + 1, marked + bool(still)
            if off > LARGEST and name.panel not in curves.marks:
                wrong.append(f"{case.name}, {curves.what}, {name.panel}, {name.label}: off by {100 * off:.2g} %")
    return wrong, count, marked


def main(names):
    """Check the cases that are named, or all."""
    found = [case for name in names for case in load_cases(name)] if names else shipped_cases()
    wrong, count, marked = [], 0, 0
    for case in found:
        own, curves, still = errors(case)
        wrong, count, marked = wrong + own, count + curves, marked + still
        for line in own:
            print(line, flush=True)
    print(f"{len(found)} cases, {count} curves (at most {MOST} panels of a kind): {marked} marked, {len(wrong)} off")
    return wrong


if __name__ == "__main__":
    sys.exit(bool(main(sys.argv[1:])))
