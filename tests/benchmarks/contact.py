"""CPU time for a motion with contact of given accuracy: the reference against the engines' adapters, side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from functools import partial

import numpy as np
from tables import Table
from timing import race, ratio, seconds

from consilience.case import Case, shipped_cases
from consilience.engine import Engine, Method, Profile, Question, Route, TrajectoryAnswer, installed, load_engine
from consilience.errors import ConsilienceError
from consilience.mechanism import Array, characteristic_length, rotation_from_quaternion
from consilience.reference.contact import simulate_with_contacts

BARS = {1e-9: (10.0, "any route of any engine"), 1e-4: (1.0, "engines' own steps")}
"""Largest error of the pose of any body at any sample in m, with the least ratio of times, and what counts."""

TRUTH = 1e-13
TOLERANCES = tuple(10.0 ** (-0.5 * n) for n in range(8, 25))
LEVELS = 7
"""Steps that are tried: a quarter of the sampling interval, and a quarter of that, and so on."""

PATIENCE, AT_LEAST = 16.0, 0.1
"""A method is given up where a run takes so many times as long as the reference, and so long in s."""

SHORT = ("block_incline-down", "bowling-skid")

Run = Callable[[], TrajectoryAnswer]


def _chosen(names: Collection[str], target: float) -> Iterator[Case]:
    """Yield the cases of a table, all without names; to 1e-9 no impacts, whose places in a step no engine finds."""
    for case in shipped_cases():
        hits = target < 1e-4 and bool({"impact", "stop"} & set(case.tags))
        if "contact" in case.tags and not hits and (not names or case.name in names):
            yield case


def _error(run: Run, truth: Array, length: float) -> tuple[float, float]:
    """Return the error of a run over poses with a length, infinite where it fails, and its CPU time."""
    start = time.process_time()
    try:
        found = run()
    except (ConsilienceError, ArithmeticError, ValueError, RuntimeError):
        return np.inf, time.process_time() - start
    cpu = time.process_time() - start
    return float(np.max(np.abs(_poses(found, length) - truth))), cpu


def _motion(engine: Engine, case: Case, method: Method, step: float) -> TrajectoryAnswer:
    return engine.trajectory(case.mechanism, case.initial_state, case.times, method, step)


def _reference(case: Case, tolerance: float) -> TrajectoryAnswer:
    return simulate_with_contacts(case.mechanism, case.initial_state, case.times, tolerance)[0]


def _poses(answer: TrajectoryAnswer, length: float) -> Array:
    """Return the positions of the origins, and of points at a length from them along each axis, less the origins."""
    axes = length * rotation_from_quaternion(answer.quat_WB)
    return np.concatenate([answer.p_WB[..., None], axes], axis=-1)


def _hopeless(errors: list[float], cpu: float, target: float, patience: float) -> bool:
    """Whether a run of the target's accuracy would take too long, as the errors shrink with a quarter of the step."""
    if len(errors) < 2 or not np.isfinite(errors[-2]):
        return False
    gain = errors[-2] / errors[-1]
    return gain < 1.5 or cpu * 4.0 ** (np.log(errors[-1] / target) / np.log(gain)) > patience


def _fastest(case: Case, truth: Array, target: float, patience: float) -> tuple[str, Run] | None:
    """Return the fastest run of any engine that reaches an accuracy, and how; of 1e-4 by its own steps alone."""
    best: tuple[float, str, Run] | None = None
    length = characteristic_length(case.mechanism)
    for name in installed():
        if name == "reference":
            continue
        engine = load_engine(name)
        if engine.unsupported(case.mechanism, Question.TRAJECTORY):
            continue
        for method in engine.methods(case.mechanism, Question.TRAJECTORY):
            if (method.route is not Route.NATIVE) if target == 1e-4 else (method.profile is Profile.DEFAULT):
                continue
            errors = list[float]()
            for step in method.tolerances or [case.sample / 4**n for n in range(1, LEVELS + 1)]:
                run = partial(_motion, engine, case, method, step)
                error, cpu = _error(run, truth, length)
                errors.append(error)
                if error <= target and (best is None or cpu < best[0]):
                    best = cpu, f"{name}, {method.name}, {step:.3g}", run
                left = patience if best is None else min(patience, best[0])
                if error <= target or cpu > left or _hopeless(errors, cpu, target, left):
                    break
    return None if best is None else best[1:]


def run(short: bool, names: Collection[str] = ()) -> Iterator[Table]:
    """Yield one table for each accuracy, of all cases or of those named."""
    columns = ("case", "over", "reference", "engine", "how", "engine / reference")
    for target, (bar, what) in BARS.items():
        about = (
            f"Bar: {bar:g}. The fastest of {what}, as its adapter is called; the reference builds its model within the "
            "time, an adapter may keep that of the run before. "
            "The error is that of each body's origin and of the body's axes, as long as the mechanism's longest arm. "
            f"A method is given up where a run takes {PATIENCE:g} times as long as the reference, or would."
        )
        table = Table(f"A motion with contact to {target:.0e} m", about, columns)
        for case in _chosen(SHORT if short else names, target):
            length, own = characteristic_length(case.mechanism), None
            truth = _poses(_reference(case, TRUTH), length)
            for tolerance in TOLERANCES:
                mine = partial(_reference, case, tolerance)
                error, cpu = _error(mine, truth, length)
                if error <= target:
                    own = mine, max(PATIENCE * cpu, AT_LEAST)
                    break
            start = [case.name, f"{case.times[-1]:g} s"]
            if own is None:
                table.rows.append([*start, "not reached", "", "", ""])
                continue
            found = _fastest(case, truth, target, own[1])
            if found is None:
                alone = race({"reference": own[0]}, 3)["reference"].median
                cells = [seconds(alone), f"none within {seconds(own[1])}", "", f"> {own[1] / alone:.2g}"]
                table.rows.append([*start, *cells])
            else:
                samples = race({"reference": own[0], "engine": found[1]}, 3)
                cells = [seconds(samples[name].median) for name in ("reference", "engine")]
                times = ratio(samples["engine"], samples["reference"])
                table.rows.append([*start, *cells, found[0], str(times)])
            print("   ", " | ".join(table.rows[-1]), flush=True)
        yield table
