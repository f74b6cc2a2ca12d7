"""CPU time for a motion of given accuracy: the reference against the fastest route of any engine to that accuracy."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import route_dart
import route_exudyn
import route_mujoco
import route_pinocchio
from observable_origins import with_observable_origins
from routes import SPAN, TOLERANCES, Found, Route, over, setup, sweep
from tables import Table
from timing import ROUNDS, Sample, less, race, ratio, seconds

from consilience.case import Case, load_case, shipped_cases
from consilience.errors import ConsilienceError
from consilience.mechanism import Array, spanning_tree
from consilience.reference import simulate

TARGETS = (1e-6, 1e-9)
"""Largest error of the position of any body at any sample in m; of a point that moves (`observable_origins`)."""

LARGEST = 10
"""Bodies of a case at most."""

TRUTHS = (("relative", 1e-13), ("null_space", 1e-13))
CLOSE = 0.1
"""The two truths agree to this fraction of the finest target, or the case is left out: it is too sensitive."""

FORMULATIONS = ("relative",)
"""Formulations of the reference that run; the faster one counts."""

ENGINES = {
    "MuJoCo": route_mujoco.routes,
    "Exudyn": route_exudyn.routes,
    "Pinocchio": route_pinocchio.routes,
    "DART": route_dart.routes,
}

PATIENCE, AT_LEAST, AT_MOST = 4.0, 0.1, 5.0
"""A route is given up where one run takes so many times the best so far, but within these bounds in s."""

HOPELESS = 20.0
"""A route is given up, too, where one run takes so many times as long as the reference: finer ones take longer."""

SHORTEST = 0.1
"""A problem of less than this part of 5 s is not gone beyond: its authors end it there for a reason."""

SHORT = ("double_pendulum", "four_bar")
BARS = {"loop": 10.0, "tree": 3.0}


@dataclass
class Outcome:
    """Result of a case."""

    case: Case
    kind: str
    best: dict[float, dict[str, Found]] = field(default_factory=dict)
    samples: dict[float, dict[str, Sample]] = field(default_factory=dict)

    def worth(self, target: float) -> float:
        """CPU time in s beyond which a run cannot matter; it decreases as results come in."""
        best = self.best[target]
        known = [PATIENCE * f.cpu for name, f in best.items() if name != "reference"]
        known += [HOPELESS * best["reference"].cpu] if "reference" in best else []
        return min(max(AT_LEAST, min(known, default=np.inf)), AT_MOST)


def _chosen(short: bool) -> Iterator[Case]:
    for case in [load_case(name) for name in SHORT] if short else shipped_cases():
        if len(case.mechanism.bodies) <= LARGEST and not case.mechanism.contacts and not case.mechanism.controls:
            yield case


def _truth(case: Case) -> Array | None:
    """Return positions at the samples, or None if two formulations differ too much."""
    try:
        one, two = (simulate(case.mechanism, case.initial_state, case.times, tol, form).p_WB for form, tol in TRUTHS)
    except ConsilienceError:
        return None
    return one if np.max(np.abs(one - two)) < CLOSE * min(TARGETS) else None


def _reference(case: Case) -> Iterator[Route]:
    for formulation in FORMULATIONS:

        def run(tolerance: float, formulation: str = formulation) -> Array:
            return simulate(case.mechanism, case.initial_state, case.times, tolerance, formulation).p_WB

        yield Route("reference", formulation, False, TOLERANCES, run, lambda motion: motion)


def _faster(found: Found, best: dict[str, Found], group: str) -> None:
    if group not in best or found.cpu < best[group].cpu:
        best[group] = found


def _known(case: Case) -> tuple[Case, Array] | None:
    """Return the case and its true positions over 5 s, or over its own duration if 5 s is too long or too sensitive."""
    for span in (SPAN, case.duration):
        if span == case.duration or SHORTEST * span <= case.duration:
            of_span = with_observable_origins(over(case, span))
            truth = _truth(of_span)
            if truth is not None:
                return of_span, truth
    return None


def _study(case: Case, truth: Array) -> Outcome:
    outcome = Outcome(case, "loop" if spanning_tree(case.mechanism)[1] else "tree", {target: {} for target in TARGETS})
    for route in _reference(case):
        for target, found in sweep(route, truth, TARGETS, lambda _: np.inf):
            _faster(found, outcome.best[target], "reference")
    for make in ENGINES.values():
        for route in make(case):
            for target, found in sweep(route, truth, TARGETS, outcome.worth):
                _faster(found, outcome.best[target], "any")
                if route.native:
                    _faster(found, outcome.best[target], "native")
    return outcome


def _row(outcome: Outcome, target: float, group: str) -> list[str]:
    best, case = outcome.best[target], outcome.case
    start = [case.name, outcome.kind, str(len(case.mechanism.bodies)), f"{case.duration:g} s"]
    if "reference" not in best:
        return [*start, "not reached", "", "", "", "", "", ""]
    samples = outcome.samples[target]
    own, before = (seconds(samples[name].median) for name in ("reference", "translation"))
    start += [own, before, best["reference"].label.partition(", ")[2]]
    if group not in best:
        most = outcome.worth(target)
        return [*start, f"none within {seconds(most)}", "", f"> {most / samples['reference'].median:.2g}", ""]
    motion = less(samples["reference"], samples["translation"])
    times = (str(ratio(samples[group], sample)) for sample in (samples["reference"], motion))
    return [*start, seconds(samples[group].median), best[group].label, *times]


def run(short: bool) -> Iterator[Table]:
    """Yield one table for each accuracy; after an interrupt, with the cases measured so far."""
    columns = ("case", "kind", "bodies", "over", "reference", "of it translation", "how", "engine", "how")
    columns += ("engine / reference", "without translation")
    abouts = {
        (
            1e-9,
            "any",
        ): "Bars: 10 on every loop, 3 on every tree. The fastest route of any engine: its own integrator, raw or "
        "extrapolated over steps, or its accelerations under DOP853 of SciPy or the methods of the reference "
        "(TP86 and RADAU13, in NumPy). The engine's model is built before the clock starts. The "
        "time of the reference is that of the whole call of `simulate`, translation of the state and the answer "
        "included; in the last column the reference starts from its model, too. A route is abandoned where "
        f"one run takes {PATIENCE:g} times as long as the fastest route so far, or {HOPELESS:g} times as long as the "
        "reference. Where origins do not show rotation, as of a top on its tip or a free body, other points of the "
        "bodies are compared. A problem of less than 0.5 s, and a motion too sensitive for 5 s, runs over its own "
        "duration.",
        (1e-6, "native"): "Bar: 1. The fastest integrator of any engine, raw or extrapolated over steps.",
    }
    tables = {
        key: Table(f"A motion to {key[0]:.0e} m, {what}", about, columns)
        for (key, about), what in zip(
            abouts.items(), ("any way of any engine", "engines' own integrators"), strict=True
        )
    }
    left_out, left = [], list(_chosen(short))
    try:
        while left:
            if not _measure(left[0], tables, 5 if short else ROUNDS):
                left_out.append(left[0].name)
            del left[0]
    except KeyboardInterrupt:
        print("    interrupted", flush=True)
    for table in tables.values():
        if left_out:
            table.about += f" Left out, too sensitive for this accuracy: {', '.join(left_out)}."
        if left:
            table.about += f" Interrupted, not measured: {', '.join(case.name for case in left)}."
        yield table


def _measure(case: Case, tables: Mapping[tuple[float, str], Table], rounds: int) -> bool:
    """Add the rows of a case; return False if its motion is too sensitive."""
    start, known = time.perf_counter(), _known(case)
    if known is None:
        return False
    case, truth = known
    outcome, rows = _study(case, truth), []
    for target, group in tables:
        wanted = {name: found for name, found in outcome.best[target].items() if name in ("reference", group)}
        if "reference" in wanted:
            translation = setup(case, wanted["reference"].route.name)
            outcome.samples[target] = race({**wanted, "translation": translation}, rounds)
        rows.append(_row(outcome, target, group))
        print("   ", " | ".join(rows[-1]), flush=True)
    for table, row in zip(tables.values(), rows, strict=True):
        table.rows.append(row)
    print(f"    {case.name}: {time.perf_counter() - start:.1f} s", flush=True)
    return True
