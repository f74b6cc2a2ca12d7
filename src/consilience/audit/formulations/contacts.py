"""Motions with contacts from event to event, within the band of time stepping, on random mechanisms.

Time stepping (`consilience.reference.contact.time_stepping`) has errors of order one in its step, in part at random:
an impact, or a stick, comes anywhere within a step. Its band at a sample is `SAFETY` times the largest difference of
successive levels up to that sample, each brought to the finest step, plus `FLOOR`. Both formulations solve impacts by
Moreau's law.

A mechanism without a comparison has a reason with a name, `REASONS`. Of these, `OPEN` are what the laws leave open; any
other is a fault of one of the formulations.
"""

from __future__ import annotations

import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import TimeoutError
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from pebble import ProcessPool

from consilience.audit.random_contacts import random_contacts
from consilience.engine import TrajectoryAnswer
from consilience.errors import NumericalFailure
from consilience.mechanism import Array, Mechanism, State, assemble_velocities, contact_parts
from consilience.reference.contact import simulate_with_contacts
from consilience.reference.contact.time_stepping import SteppedMotion, step_with_contacts

TIMES = np.linspace(0.0, 0.4, 9)
LEVELS, FINER = (8, 16, 32, 64), (128, 256, 512)
"""Steps between two samples; where their band is wide, or too narrow by chance, finer ones in place of the coarsest."""

SAFETY, FLOOR = 4.0, 1e-8
WIDE = 0.05
"""Width of a band, m, from which it decides nothing."""

TOLERANCE = 1e-10
DISPLACED, SENSITIVE = 1e-7, 1e3
"""Change of the velocities of the start, m/s or rad/s, and magnification of it that makes a motion sensitive."""

OPEN = {
    "indeterminate": "the laws allow several accelerations",
    "painleve": "no forces satisfy the laws: contacts jam",
    "grazing": "nearby starts part, or have no motion",
}
FAULTS = {
    "unsettled": "events at one instant follow one another without end",
    "timed out": "the limit of time was reached",
    "wide band": "the levels of time stepping are too far apart",
    "failed": "a formulation failed in another way",
}
REASONS = OPEN | FAULTS
"""Why there is no comparison."""

_TOLD = {
    "several accelerations": "indeterminate",
    "(Painleve)": "painleve",
    "do not settle": "unsettled",
    "no answer within": "timed out",
}
"""Words of failures, and the reasons that they tell."""


Solve = Callable[[State, int], TrajectoryAnswer | SteppedMotion]
"""Function of a state and a number of steps that solves a motion, see `compare_motions`."""


@dataclass(frozen=True)
class ContactComparison:
    """Two motions of one random mechanism.

    Attributes
    ----------
    seed, bodies, contacts, events : int
        Contacts are elementary ones.
    loops : int
    difference, band : float, m
        At the sample where the difference exceeds the band most, or is nearest to it.
    reason : str
        One of `REASONS` where there is no comparison; else empty.
    message : str
        Of the failure.
    """

    seed: int
    bodies: int
    contacts: int
    loops: int
    events: int = 0
    difference: float = 0.0
    band: float = 0.0
    reason: str = ""
    message: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the band, or the laws leave the motion open."""
        return self.reason in OPEN or (not self.reason and self.difference <= self.band)


def compare(seed: int) -> ContactComparison:
    """Compare both formulations on the random mechanism of a seed."""
    mechanism, start = random_contacts(seed)

    def solve(state: State, steps: int) -> TrajectoryAnswer | SteppedMotion:
        """Solve the motion from a state, by time stepping where there are steps."""
        if steps:
            return step_with_contacts(mechanism, state, TIMES, steps)
        return simulate_with_contacts(mechanism, state, TIMES, TOLERANCE, "moreau")[0]

    return compare_motions(seed, mechanism, start, solve)


def compare_motions(seed: int, mechanism: Mechanism, start: State, solve: Solve) -> ContactComparison:
    """Compare both formulations on the motion of a mechanism from a state.

    Parameters
    ----------
    seed : int
        Of the mechanism, to be told.
    mechanism : Mechanism
    start : State
    solve : callable
        Solves the motion from a state: from event to event, with Moreau's impacts, or by a number of steps between two
        samples where the number is not zero. Raises a NumericalFailure where there is no motion.
    """
    found = _of_size(seed, mechanism)
    try:
        motion = solve(start, 0)
        levels = [solve(start, steps).p_WB for steps in LEVELS]
        for steps in FINER:
            off, band = _sizes(motion.p_WB - levels[-1]), SAFETY * band_of(levels) + FLOOR
            if band[-1] >= WIDE or np.any(off > band):
                levels = [*levels[1:], solve(start, steps).p_WB]
    except NumericalFailure as failure:
        return replace(found, reason=reason_of(str(failure)), message=str(failure))
    off, band = _sizes(motion.p_WB - levels[-1]), SAFETY * band_of(levels) + FLOOR
    worst = int(np.argmax(off / band))
    events = len(motion.event_time) if isinstance(motion, TrajectoryAnswer) and motion.event_time is not None else 0
    found = replace(found, events=events, difference=float(off[worst]), band=float(band[worst]))
    if found.agrees and band[-1] < WIDE:
        return found
    if _is_sensitive(mechanism, start, motion.p_WB, solve):
        return replace(found, reason="grazing")
    return replace(found, reason="wide band") if band[-1] >= WIDE else found


def reason_of(message: str) -> str:
    """Return which of `REASONS` the message of a failure tells."""
    return next((name for words, name in _TOLD.items() if words in message), "failed")


def _of_size(seed: int, mechanism: Mechanism) -> ContactComparison:
    parts = sum(len(contact_parts(contact)) for contact in mechanism.contacts)
    return ContactComparison(seed, len(mechanism.bodies), parts, len(mechanism.joints) - len(mechanism.bodies))


def _sizes(difference: Array) -> Array:
    """Return the largest entry at each sample."""
    return np.asarray(np.max(np.abs(difference), axis=(1, 2)))


def band_of(levels: list[Array]) -> Array:
    """Return the error of the finest level at each sample, shape (n_t,), from differences of successive levels."""
    last = len(levels) - 2
    finer = [_sizes(a - b) * 2.0 ** (n - last) for n, (a, b) in enumerate(pairwise(levels))]
    return np.maximum.accumulate(np.max(finer, axis=0))


def _is_sensitive(mechanism: Mechanism, start: State, positions: Array, solve: Solve) -> bool:
    """Return whether a nearby start has no motion, or one that parts."""
    rng = np.random.default_rng(0)
    shape = start.v_WB_W.shape
    near = replace(
        start,
        v_WB_W=start.v_WB_W + DISPLACED * rng.normal(size=shape),
        w_WB_W=start.w_WB_W + DISPLACED * rng.normal(size=shape),
    )
    try:
        other = solve(assemble_velocities(mechanism, near), 0)
    except NumericalFailure:
        return True
    return bool(np.max(np.abs(other.p_WB - positions)) > SENSITIVE * DISPLACED)


def campaign(seeds: Sequence[int], limit: float = 120.0) -> Iterator[ContactComparison]:
    """Compare one mechanism after another, in a process that none keeps longer than the limit, s."""
    with ProcessPool(max_workers=1, context=multiprocessing.get_context("spawn")) as pool:
        found = [(seed, pool.schedule(compare, args=(seed,), timeout=limit)) for seed in seeds]
        for seed, future in found:
            try:
                yield future.result()
            except TimeoutError:
                mechanism, _ = random_contacts(seed)
                yield replace(_of_size(seed, mechanism), reason="timed out", message=f"after {limit:g} s")


def summary(found: list[ContactComparison]) -> str:
    """Return what the campaign showed, in lines."""
    counts = Counter(one.reason for one in found)
    compared = [one for one in found if not one.reason]
    within, events = sum(one.agrees for one in compared), sum(one.events for one in compared)
    lines = [f"{len(found)} mechanisms: {within} of the {len(compared)} compared lie within the band; {events} events"]
    lines += [f"{counts[reason]} {reason}: {words}" for reason, words in REASONS.items() if counts[reason]]
    if compared:
        bands = np.median([one.band for one in compared])
        lines.append(f"median of the bands {bands:.2g} m")
    lines += [
        f"seed {one.seed}: off by {one.difference:.3g} m, band {one.band:.3g} m" for one in compared if not one.agrees
    ]
    return "\n".join(lines)
