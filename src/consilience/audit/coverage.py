"""Coverage of the uncertainty of motions: bands of ladders against the errors to far finer runs.

Every engine runs its ladder on every case as in a suite, and once more with far smaller steps. The difference of the
ladder's finest level to the finer run is the true discretisation error, whatever the reference says; the band of that
level, from the ladder alone, should be larger, and not by much. One observable of one ladder is one trial.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from consilience.case import Case
from consilience.compare import grouped, markdown_table
from consilience.compare.motion import OBSERVABLES, Scales
from consilience.compare.uncertainty import declared_order, estimates
from consilience.engine import Method, Question, Run, TrajectoryAnswer
from consilience.engine.worker.client import Worker
from consilience.engine.worker.requests import Plan
from consilience.suite import ask_ladder, open_plan

ASKED_COVERAGE, WIDEST = 0.95, 20.0
"""Fraction of the bands that must hold, and largest allowed median of band over error."""

FINER = (32, 16, 8, 4)
"""Ratios of steps for the finer run, the first that `BUDGET` affords."""

BUDGET = 10.0
"""CPU time in s for a finer run."""


@dataclass(frozen=True)
class Trial:
    """One observable of one ladder.

    Attributes
    ----------
    error, band : float
        True error of the finest level, and its uncertainty from the ladder alone.
    order : float or None
        Observed among the levels.
    """

    case: str
    engine: str
    method: str
    observable: str
    error: float
    band: float
    order: float | None

    @property
    def covered(self) -> bool:
        """Whether the true error lies within the band."""
        return self.error <= self.band

    @property
    def ratio(self) -> float:
        """Band over error."""
        return self.band / self.error if self.error > 0.0 else np.inf


@dataclass(frozen=True)
class Skipped:
    """A ladder without a trial, and why."""

    case: str
    engine: str
    method: str
    reason: str


def trials(cases: Sequence[Case], engine: str, limit: float = 300.0) -> Iterator[Trial | Skipped]:
    """Yield the trials of one engine on the cases.

    The time limit of a request to the worker is in s.
    """
    with Worker(engine, limit) as worker:
        for case in cases:
            plan = open_plan(worker, case)
            if isinstance(plan, str):
                yield Skipped(case.name, engine, "", plan)
                continue
            for method in plan.methods.get(Question.TRAJECTORY, ()):
                runs = [run for run in ask_ladder(worker, case, plan, method) if run.method == method]
                yield from _trials(worker, case, plan, method, runs)


def _trials(worker: Worker, case: Case, plan: Plan, method: Method, runs: list[Run]) -> Iterator[Trial | Skipped]:
    """Yield the trials of one ladder, or the reason why there are none.

    Parameters
    ----------
    worker : Worker
    case : Case
    plan : Plan
        Plan of the engine for the case.
    method : Method
    runs : list of Run
        The ladder, coarse to fine.
    """
    answers = [run.answer for run in runs if run.answer is not None]
    if declared_order(method) is None or len(answers) < max(2, len(runs)):
        finer: TrajectoryAnswer | str = next((run.reason for run in runs if run.reason), "no ladder of steps")
    else:
        finer = _finer(worker, case, plan, method, runs[-1])
    if isinstance(finer, str):
        yield Skipped(case.name, worker.engine, method.name, finer)
        return
    scales = Scales.of(case.mechanism, finer)
    for estimate in estimates(answers, method, [run.step for run in runs], scales):
        error = float(np.max(OBSERVABLES[estimate.name](answers[-1], finer, scales)))
        yield Trial(case.name, worker.engine, method.name, estimate.name, error, estimate.band, estimate.order)


def _finer(worker: Worker, case: Case, plan: Plan, method: Method, finest: Run) -> TrajectoryAnswer | str:
    """Return the motion at far smaller steps, or the reason why there is none.

    Parameters
    ----------
    worker : Worker
    case : Case
    plan : Plan
        Plan of the engine for the case.
    method : Method
    finest : Run
        Run at the finest level of the ladder.
    """
    assert finest.step is not None
    factor = next((f for f in FINER if f * finest.cpu <= BUDGET), FINER[-1])
    if method.tolerances:
        factor = 100
    (run,) = ask_ladder(worker, case, plan, method, (finest.step / factor,))
    return run.answer or f"the finer run: {run.reason}"


def coverage(found: Sequence[Trial]) -> tuple[float, float]:
    """Return the fraction of trials whose band holds, and the median of band over error."""
    return float(np.mean([t.covered for t in found])), float(np.median([t.ratio for t in found]))


def exit_code(found: Sequence[Trial | Skipped]) -> int:
    """Return 0 if the bands hold and are not too wide, 1 if not, 3 without any trial."""
    done = [t for t in found if isinstance(t, Trial)]
    if not done:
        return 3
    part, width = coverage(done)
    return 0 if part >= ASKED_COVERAGE and width <= WIDEST else 1


def table(found: Sequence[Trial | Skipped]) -> str:
    """Return Markdown: coverage and width by engine and method, bands that do not hold, skipped ladders."""
    done = [t for t in found if isinstance(t, Trial)]
    groups = grouped(done, lambda t: (t.engine, t.method))
    heads = ("engine", "method", "trials", "covered", "band / error, median")
    rows = []
    for (engine, method), group in [*groups.items(), (("all", ""), done)]:
        part, width = coverage(group)
        rows.append((engine, method, len(group), f"{100 * part:.1f} %", f"{width:.2g}"))
    missed = [
        (
            *(t.case, t.engine, t.method, t.observable),
            *("hidden" if t.order is None else f"{t.order:.2f}", f"{t.error:.2e}", f"{t.band:.2e}"),
        )
        for t in done
        if not t.covered
    ]
    skipped = [s for s in found if isinstance(s, Skipped)]
    lines = [
        *markdown_table(heads, rows, "llrrr"),
        "",
        *markdown_table(("case", "engine", "method", "observable", "order", "error", "band"), missed, "llllrrr"),
        "",
        *(f"- {s.case}, {s.engine}, {s.method or 'all methods'}: {s.reason}" for s in skipped),
    ]
    return "\n".join(lines) + "\n"
