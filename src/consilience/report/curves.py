"""Curves of a motion over time: coordinates, rates, positions, velocities, energies and reactions.

A drawing must not miss a peak: samples are halved until the extremes of every curve settle. A curve whose extremes do
not settle before the samples of the motion are used up says by how much its peak may be off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from consilience.compare.energies import turned_springs
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import (
    JOINT_KINDS,
    Array,
    Joint,
    Mechanism,
    RelativeMotion,
    characteristic_length,
    joint_coordinates,
    joint_rates,
    kinetic_energy,
    potential_energies,
    relative_motion,
    with_full_turns,
)
from consilience.report.motion import largest_turn
from consilience.report.reactions import can_be_told, reactions_over_time

START = 120
"""Number of intervals before the first halving; more where a body turns by more than one radian in an interval."""

SETTLED = 0.01
"""Change of an extreme on two halvings, relative to the largest magnitude of its curve, that a settled curve has."""

FLOOR = 1e-9
"""Curves smaller than this part of the largest one of their kind are the rounding of the others."""

TIMES_LENGTH = ("N", "rad", "rad/s")
"""Units of curves that are compared with the others of their kind times the characteristic length."""

STRAIGHT = 0.002
"""Deviation from straight lines between the samples that are kept, relative to the range of a curve."""

KEPT = 300
"""Largest number of samples of a drawing, but for the extremes."""

MOST = 12
"""Largest number of panels of a figure."""

UNITS = {"angle": "rad", "angle1": "rad", "angle2": "rad", "distance": "m", "x": "m", "y": "m", "position": "m"}
"""Units of coordinates that are numbers or, `position`, three of them."""

_XYZ = ("x", "y", "z")


class CurveName(NamedTuple):
    """Name of a curve: panel that shows it, label within the panel, and unit."""

    panel: str
    label: str
    unit: str


@dataclass(frozen=True, eq=False)
class CurveSet:
    """Curves of one kind over common times.

    Attributes
    ----------
    what : str
        A key of `KINDS`.
    names : tuple of CurveName
    time : ndarray, shape (n,), s
    values : ndarray, shape (n, number of curves)
    open : ndarray, shape (number of curves,)
        By how much the extremes changed at the last two halvings, relative to the largest magnitude of the curve; 0 for
        settled curves.
    panels : int
        Number of panels that the mechanism has; those above `MOST` are left out.
    """

    what: str
    names: tuple[CurveName, ...]
    time: Array
    values: Array
    open: Array
    panels: int

    @property
    def marks(self) -> dict[str, str]:
        """Words about panels with an open peak, by panel."""
        worst = dict[str, float]()
        for name, change in zip(self.names, self.open, strict=True):
            worst[name.panel] = max(worst.get(name.panel, 0.0), float(change))
        return {panel: f"peak may be off by {100 * change:.2g} %" for panel, change in worst.items() if change}

    def data(self) -> dict[str, Any]:
        """Return the curves as data of a file, as `replayschema.ReplayCurveSet`: five digits, a row for each curve."""
        return {
            "what": self.what,
            "names": [list(name) for name in self.names],
            "time": [float(f"{t:.6g}") for t in self.time],
            "values": [[float(f"{v:.5g}") for v in row] for row in self.values.T],
            "open": [float(f"{v:.2g}") for v in self.open],
            "panels": self.panels,
        }

    @classmethod
    def of(cls, data: dict[str, Any]) -> CurveSet:
        """Return the curves of data of a file."""
        names, arrays = tuple(CurveName(*n) for n in data["names"]), (data["time"], data["values"], data["open"])
        time, values, change = map(np.array, arrays)
        return cls(data["what"], names, time, values.T, change, data["panels"])

    def by_panel(self) -> dict[str, list[int]]:
        """Return the indices of the curves of each panel."""
        found = dict[str, list[int]]()
        for k, name in enumerate(self.names):
            found.setdefault(name.panel, []).append(k)
        return found


class CurveKind(NamedTuple):
    """A kind of curves: their names, and their values at samples of a motion, shape (n, number of curves)."""

    names: Callable[[Mechanism], list[CurveName]]
    values: Callable[[Mechanism, TrajectoryAnswer, Array], Array]


def _of_joints(rate: str) -> CurveKind:
    """Return the kind of joint coordinates, or with the unit suffix of a rate, of their rates."""

    def names(mechanism: Mechanism) -> list[CurveName]:
        return [CurveName(f"{j.name}: {c}", label, UNITS[c] + rate) for j, c, label in _scalars(mechanism)]

    return CurveKind(names, partial(_told, joint_rates) if rate else _coordinates)


def _scalars(mechanism: Mechanism) -> list[tuple[Joint, str, str]]:
    """Return the joints, names of coordinates and labels of all scalar joint coordinates."""
    own = [(j, c) for j in mechanism.joints for c in JOINT_KINDS[j.kind].coordinates if c in UNITS]
    return [(j, c, label) for j, c in own for label in (_XYZ if c == "position" else (c,))]


def _told(
    told: Callable[[Joint, RelativeMotion], dict[str, Array]],
    mechanism: Mechanism,
    answer: TrajectoryAnswer,
    samples: Array,
) -> Array:
    """Return what a function of joint and relative motion tells of all scalar coordinates, a row for each sample."""
    found = []
    for state in (answer.state(int(k)) for k in samples):
        row: list[Any] = []
        for joint in mechanism.joints:
            known = told(joint, relative_motion(mechanism, state, joint))
            row += [np.ravel(known[c]) for c in JOINT_KINDS[joint.kind].coordinates if c in UNITS]
        found.append(np.concatenate(row))
    return np.array(found)


def _coordinates(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> Array:
    """Return the joint coordinates, full turns counted, a row for each sample."""
    found, rates = (_told(told, mechanism, answer, samples) for told in (joint_coordinates, joint_rates))
    turning = np.array([c.startswith("angle") and not j.pitch for j, c, _ in _scalars(mechanism)], dtype=bool)
    found[:, turning] = with_full_turns(found[:, turning].T, rates[:, turning].T, answer.time[samples]).T
    return found


def _of_bodies(field: str, unit: str) -> CurveKind:
    """Return the kind of a vector of every body origin, world axes."""

    def values(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> Array:
        return np.asarray(getattr(answer, field)[samples].reshape(len(samples), -1))

    return CurveKind(lambda m: [CurveName(b.name, label, unit) for b in m.bodies for label in _XYZ], values)


def _energies(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> Array:
    states = [answer.state(int(k)) for k in samples]
    springs = turned_springs(mechanism, answer)[:, samples].T
    kinetic = np.array([kinetic_energy(mechanism, state) for state in states])
    potential = np.array([potential_energies(mechanism, *at) for at in zip(states, springs, strict=True)])
    return np.column_stack([kinetic, potential, kinetic + potential])


def _reaction_names(mechanism: Mechanism) -> list[CurveName]:
    parts = (("force", "N"), ("torque", "N m"))
    return [CurveName(f"{j.name}: {part}", part, unit) for j in mechanism.joints for part, unit in parts]


def _reactions(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> Array:
    # the first sample decides which components are determined
    found = reactions_over_time(mechanism, answer, np.concatenate([[0], samples]))[1:]
    return np.asarray(found.reshape(len(samples), -1))


KINDS: dict[str, CurveKind] = {
    "coordinates": _of_joints(""),
    "rates": _of_joints("/s"),
    "positions": _of_bodies("p_WB", "m"),
    "velocities": _of_bodies("v_WB_W", "m/s"),
    "energies": CurveKind(
        lambda _: [CurveName("energy", e, "J") for e in ("kinetic", "potential", "total")], _energies
    ),
    "reactions": CurveKind(_reaction_names, _reactions),
}
"""Kinds of curves, in the order of a page."""


def curve_sets(
    mechanism: Mechanism, answer: TrajectoryAnswer, kinds: Sequence[str] = tuple(KINDS), panels: Sequence[str] = ()
) -> Iterator[CurveSet]:
    """Compute the curves of a motion; a kind without curves is left out.

    Parameters
    ----------
    mechanism : Mechanism
    answer : TrajectoryAnswer
        Motion; the more samples it has, the narrower the peaks that are found.
    kinds : sequence of str
        Keys of `KINDS`.
    panels : sequence of str
        Names of joints or bodies, or of panels; default: all.
    """
    first, length = _first_stride(answer), characteristic_length(mechanism)
    for what in kinds:
        kind = KINDS[what]
        if what == "reactions" and not can_be_told(mechanism):
            continue
        names = kind.names(mechanism)
        found = dict.fromkeys(n.panel for n in names if not panels or {n.panel, n.panel.partition(":")[0]} & {*panels})
        own = [k for k, name in enumerate(names) if name.panel in list(found)[:MOST]]
        if own:
            drawn = tuple(names[k] for k in own)
            evaluate, rounding = partial(_columns, kind, own, mechanism, answer), partial(_rounding, drawn, length)
            shown = _settled(evaluate, rounding, answer, first)
            yield from _drawable(CurveSet(what, drawn, *shown, panels=len(found)), length)


def _columns(kind: CurveKind, own: list[int], mechanism: Mechanism, answer: TrajectoryAnswer, at: Array) -> Array:
    return kind.values(mechanism, answer, at)[:, own]


def _first_stride(answer: TrajectoryAnswer) -> int:
    """Return the stride of the first samples, a power of two."""
    stride = 1
    while (len(answer.time) - 1) // (2 * stride) >= START and largest_turn(answer.quat_WB[:: 2 * stride]) <= 1.0:
        stride *= 2
    return stride


def _rounding(names: Sequence[CurveName], length: float, values: Array) -> Array:
    """Return which curves are rounding beside the largest of them, shape (number of curves,), bool."""
    largest = np.max(np.abs(values), axis=0) * [length if n.unit in TIMES_LENGTH else 1.0 for n in names]
    return np.asarray(largest < FLOOR * np.max(largest, initial=0.0, where=np.isfinite(largest)))


def _settled(
    evaluate: Callable[[Array], Array], rounding: Callable[[Array], Array], answer: TrajectoryAnswer, stride: int
) -> tuple[Array, Array, Array]:
    """Halve the samples until the extremes settle, rounding apart; return times, values, open changes: `CurveSet`."""
    last = len(answer.time) - 1
    samples = np.unique([*np.arange(0, last, stride), *_jerks(answer), last])
    values = evaluate(samples)

    def change_of(samples: Array, values: Array) -> Array:
        return np.where(rounding(values), 0.0, _open(answer, samples, values, 4 * stride))

    while np.any((change := change_of(samples, values)) > SETTLED) and stride > 1:
        stride //= 2
        between = np.setdiff1d(np.arange(0, last, stride), samples)
        order = np.argsort(np.concatenate([samples, between]))
        values = np.concatenate([values, evaluate(between)])[order]
        samples = np.concatenate([samples, between])[order]
    return answer.time[samples], values, np.where(change > SETTLED, change, 0.0)


def _open(answer: TrajectoryAnswer, samples: Array, values: Array, every: int) -> Array:
    """Return how far extremes may be off, relative to the largest magnitude: by two halvings, or between samples."""
    time, largest = answer.time[samples], np.max(np.abs(values), axis=0)
    beyond = _between(time, values, np.zeros(0) if answer.event_time is None else answer.event_time)
    part = np.divide(beyond, largest, out=np.zeros_like(beyond), where=largest > 0.0)
    return np.maximum(part, _change(values, samples % every == 0))


def _between(time: Array, values: Array, events: Array) -> Array:
    """Return by how much curves are estimated to go beyond their extremes between samples, shape (number of curves,).

    Beside an event, where a curve may jump, by straight lines through the two samples before it and behind it;
    elsewhere by parabolas through each extreme and its neighbours.
    """
    high, low = values.max(axis=0), values.min(axis=0)
    behind = np.searchsorted(time, events)
    beyond = np.zeros(values.shape[1])
    for k, t in zip(behind, events, strict=True):
        for a, b in ((k - 2, k - 1), (k + 1, k)):
            if min(a, b) >= 0 and max(a, b) < len(time):
                met = values[b] + (t - time[b]) / (time[b] - time[a]) * (values[b] - values[a])
                beyond = np.maximum(beyond, np.maximum(met - high, low - met))
    for sign in (1.0, -1.0):
        for n, k in enumerate((sign * values).argmax(axis=0)):
            if 0 < k < len(time) - 1 and not np.any((behind == k) | (behind == k + 1)):
                a, b, c = np.polyfit(time[k - 1 : k + 2] - time[k], sign * (values[k - 1 : k + 2, n] - values[k, n]), 2)
                beyond[n] = max(beyond[n], c - b * b / (4.0 * a) if a < 0.0 else 0.0)
    return beyond


def _jerks(answer: TrajectoryAnswer) -> Array:
    """Return the samples at which a body's velocity or angular velocity changes most: forces peak there."""
    rates = [np.linalg.norm(np.diff(v, axis=0), axis=-1) for v in (answer.v_WB_W, answer.w_WB_W)]
    peaks = np.concatenate([np.argmax(rate, axis=0) for rate in rates if len(rate)] or [np.zeros(1, dtype=int)])
    return np.unique(np.minimum([peaks, peaks + 1], len(answer.time) - 1))


def _change(values: Array, coarse: Array) -> Array:
    """Return how far the extremes of every fourth sample are from those of all, relative to the largest magnitude.

    Two halvings: one may pass by a narrow peak twice. `coarse` tells which samples are every fourth.
    """
    few = np.concatenate([values[coarse], values[-1:]])
    off = np.maximum(values.max(axis=0) - few.max(axis=0), few.min(axis=0) - values.min(axis=0))
    largest = np.max(np.abs(values), axis=0)
    return np.asarray(np.divide(off, largest, out=np.zeros_like(off), where=largest > 0.0))


def _drawable(found: CurveSet, length: float) -> Iterator[CurveSet]:
    """Leave out curves that are not numbers, put rounding to zero, and drop samples on lines."""
    own = np.asarray(np.isfinite(found.values).all(axis=0))
    if not own.any():
        return
    names = tuple(name for name, kept in zip(found.names, own.tolist(), strict=True) if kept)
    values, change = found.values[:, own], found.open[own]
    values = np.where(_rounding(names, length, values), 0.0, values)
    kept = thinned(found.time, values)
    yield CurveSet(found.what, names, found.time[kept], values[kept], change, found.panels)


def thinned(time: Array, values: Array) -> Array:
    """Choose samples between which every curve is straight within `STRAIGHT` of its range, at most about `KEPT`.

    Source: Douglas and Peucker 1973, on all curves at once.
    """
    scale = np.maximum(np.ptp(values, axis=0), FLOOR / STRAIGHT * np.max(np.abs(values), axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)

    def worst(a: int, b: int) -> tuple[float, int, int, int]:
        part = (time[a : b + 1] - time[a]) / max(time[b] - time[a], 1e-300)
        line = values[a] + part[:, None] * (values[b] - values[a])
        off = np.max(np.abs(values[a : b + 1] - line) / scale, axis=1)
        k = int(np.argmax(off))
        return -float(off[k]), a, a + k, b

    # extremes are always kept
    kept = {0, len(time) - 1, *map(int, values.argmax(axis=0)), *map(int, values.argmin(axis=0))}
    spans = [worst(a, b) for a, b in pairwise(sorted(kept))]
    heapify(spans)
    while spans and -spans[0][0] > STRAIGHT and len(kept) < KEPT:
        _, a, k, b = heappop(spans)
        kept.add(k)
        heappush(spans, worst(a, k))
        heappush(spans, worst(k, b))
    return np.array(sorted(kept))
