"""The file ``replay.json`` of a report: scenes of the cases, motions on every engine, reactions over time.

The file holds what the page needs to draw mechanisms in motion. Without the file, a page only lacks its drawings; a
report without the question `trajectory` has drawings and no motions.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

from consilience.case import Case
from consilience.compare.judge import REFERENCE
from consilience.engine import Profile, Run, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism, State
from consilience.report.contact_motion import contacts_at_frames, phases
from consilience.report.curves import curve_sets
from consilience.report.motion import chosen_samples, encoded_difference, encoded_poses
from consilience.report.reactions import can_be_told, drift_over_time, reactions_over_time
from consilience.report.replayschema import FORMAT
from consilience.report.scene import scene
from consilience.report.selection import grouped

PLOTTED, DRIFTING = 31, 301
"""Largest number of samples in a plot of reactions, and of the violation of the joints."""

Replay = dict[str, Any]
"""Data of a case as `replayschema.ReplayCase`; `motion` and `along`, values over time on all engines, may be None."""


def replay_of(case: Case, runs: Sequence[Run], dense: TrajectoryAnswer | None = None) -> Replay:
    """Make the replay of a case.

    Parameters
    ----------
    case : Case
    runs : sequence of Run
        All runs of the case; the replay shows the first matched method of each engine at its finest level.
    dense : TrajectoryAnswer, optional
        Motion of the reference for curves; default: that of the runs.
    """
    shown = dict(_headlines(runs))
    m = case.mechanism
    motion, along = (_motion(m, shown), _along(m, shown)) if REFERENCE in shown else (None, None)
    drawn = scene(m, case.initial_state)
    answer = dense if dense is not None else shown[REFERENCE][0] if REFERENCE in shown else None
    curves = [] if answer is None else [one.data() for one in curve_sets(m, answer)]
    found = {"case": case.name, "seed": case.seed, "motion": motion, "along": along, "scene": drawn}
    return found | {"curves": curves, "phases": _phases(m, shown)}


def motion_alone(case: Case, answer: TrajectoryAnswer, how: str) -> Replay:
    """Make the replay of a single motion of a case in place of the reference."""
    found = replay_of_motion(case.mechanism, case.initial_state, answer, how)
    return found | {"case": case.name, "seed": case.seed}


def replay_of_motion(mechanism: Mechanism, start: State, answer: TrajectoryAnswer, how: str = "") -> Replay:
    """Make the replay of a motion of a mechanism that starts in a state; `how` names method and step."""
    shown = {REFERENCE: (answer, how)}
    drawn, motion = scene(mechanism, start), _motion(mechanism, shown)
    found = {"case": mechanism.name, "seed": 0, "scene": drawn, "along": None, "motion": motion, "curves": []}
    return found | {"phases": _phases(mechanism, shown)}


def _headlines(runs: Sequence[Run]) -> Iterator[tuple[str, tuple[TrajectoryAnswer, str]]]:
    """Return the finest motion of the first matched method of every engine, with method and step in words."""
    for engine in dict.fromkeys(run.engine for run in runs):
        moved = [
            (run, run.answer, run.method)
            for run in runs
            if run.engine == engine and run.question.over_time and run.answer is not None and run.method is not None
        ]
        name = next((method.name for _, _, method in moved if method.profile is Profile.MATCHED), None)
        own = [(r, a, m) for r, a, m in moved if m.name == name and m.softness in (None, 1.0)]
        if own:
            run, answer, method = min(own, key=lambda one: one[0].step or 0.0)
            kind = "step" if method.substeps else "tolerance"
            yield engine, (answer, f"{method.name}, {kind} {run.step:.3g}{' s' if method.substeps else ''}")


def _phases(mechanism: Mechanism, shown: dict[str, tuple[TrajectoryAnswer, str]]) -> Replay:
    """List the phases of contacts by every engine that tells any."""
    told = {engine: phases(mechanism, answer) for engine, (answer, _) in shown.items()}
    return {engine: found for engine, found in told.items() if found}


def _motion(mechanism: Mechanism, shown: dict[str, tuple[TrajectoryAnswer, str]]) -> Replay:
    """Encode the motion of the reference, and the differences of motions on the same time grid."""
    reference, how = shown[REFERENCE]
    samples = chosen_samples(reference)
    time = reference.time[samples]
    return {
        "start": float(time[0]),
        "step": float(time[1] - time[0]) if len(time) > 1 else 0.0,
        "count": len(samples),
        "end": float(reference.time[-1]),
        "reference": encoded_poses(reference, samples) | {"how": how},
        "engines": {
            engine: encoded_difference(answer, reference, samples) | {"how": own}
            for engine, (answer, own) in shown.items()
            if engine != REFERENCE and np.array_equal(answer.time, reference.time)
        },
        "contacts": contacts_at_frames(mechanism, reference, samples),
    }


def _along(mechanism: Mechanism, shown: dict[str, tuple[TrajectoryAnswer, str]]) -> Replay | None:
    """Compute the violation of the joints over time on all engines, and reactions where states determine them."""
    reference, _ = shown[REFERENCE]
    samples, drifting = (_spread(len(reference.time), most) for most in (PLOTTED, DRIFTING))
    alike = {e: answer for e, (answer, _) in shown.items() if np.array_equal(answer.time, reference.time)}
    if not any(joint.rows for joint in mechanism.joints):
        return None
    found = {e: reactions_over_time(mechanism, a, samples) for e, a in alike.items()} if can_be_told(mechanism) else {}
    known = [j for j in range(len(mechanism.joints)) if found and np.isfinite(found[REFERENCE][:, j, 0]).any()]
    return {
        "times": [float(f"{t:.6g}") for t in reference.time[samples]],
        "drift_times": [float(f"{t:.6g}") for t in reference.time[drifting]],
        "joints": [mechanism.joints[j].name for j in known],
        "engines": {
            e: {
                "force": [_plain(found[e][:, j, 0]) for j in known],
                "torque": [_plain(found[e][:, j, 1]) for j in known],
                "drift": _plain(drift_over_time(mechanism, answer, drifting)),
            }
            for e, answer in alike.items()
        },
    }


def _spread(count: int, most: int) -> Array:
    """Choose evenly spread samples, the first included."""
    return np.arange(0, count, max(1, -(-(count - 1) // (most - 1))))


def _plain(values: Array) -> list[float | None]:
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]


def replays(
    cases: Sequence[Case], runs: Sequence[Run], dense: Mapping[str, TrajectoryAnswer] | None = None, jobs: int = 1
) -> str:
    """Write the text of ``replay.json``: the replays of all cases that can be assembled, made by `jobs` processes.

    `dense` as in `replay_of`.
    """
    of_case, dense = grouped((run.case, run) for run in runs), dense or {}
    drawn = [case for case in cases if not case.unassembled]
    asked = drawn, [of_case.get(case.name, []) for case in drawn], [dense.get(case.name) for case in drawn]
    processes = min(jobs, len(drawn))
    if processes > 1:
        with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
            found = list(pool.map(replay_of, *asked))
    else:
        found = list(map(replay_of, *asked))
    return json.dumps({"format": FORMAT, "cases": found}, allow_nan=False, separators=(",", ":"))
