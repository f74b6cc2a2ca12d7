"""Coverage of the uncertainty of motions: bands of ladders against the errors to finer runs.

Every engine runs its ladder on every case as in a suite, and once more with smaller steps. The difference of the
ladder's finest level to the finer run is the true discretisation error, whatever the reference says; the band of that
level, from the ladder alone, should be larger, and not by much. One observable of one ladder is one trial.

Errors of rounding are no trials, nor are motions that get worse with smaller steps: a band that seems not to hold is
counted if a run at half the finer step is nearer to the finer run than the finest level is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from consilience.case import Case
from consilience.compare import grouped, markdown_table
from consilience.compare.motion import OBSERVABLES, Scales
from consilience.compare.uncertainty import ROUNDING, declared_order, estimates
from consilience.engine import Method, Question, Run, TrajectoryAnswer
from consilience.engine.worker.client import EngineHandle, Worker
from consilience.engine.worker.requests import Plan
from consilience.suite import FULL, Thoroughness, ask_ladder, open_plan
from consilience.suite.engine_runs import EngineCase, levels_of

ASKED_COVERAGE, WIDEST = 0.95, 20.0
"""Fraction of the bands that must hold, and largest allowed median of band over error."""

FINER = 16.0
"""Ratio of the errors of the finest level and of the finer run."""

LEAST_FACTOR, BUDGET = 4, 10.0
"""Least ratio of steps where the declared order asks for more, and CPU time in s above which that ratio is taken."""

NEARER = 0.5
"""Largest difference of two finer runs, over the error: a sixth for order one at the least ratio, less for others."""

WORSE = "smaller steps lead nowhere, so that no run tells the error"


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


def trials(
    cases: Sequence[Case], engine: str, thoroughness: Thoroughness = FULL, limit: float = 300.0
) -> Iterator[Trial | Skipped]:
    """Yield the trials of one engine on the cases, by all of its methods.

    Parameters
    ----------
    cases : sequence of Case
    engine : str
    thoroughness : Thoroughness
        Samples of a motion, and whether levels are added.
    limit : float, s
        Time limit of a request to the worker.
    """
    with Worker(engine, limit) as worker:
        for case in map(thoroughness.case, cases):
            plan = open_plan(worker, case)
            if isinstance(plan, str):
                yield Skipped(case.name, engine, "", plan)
                continue
            for method in plan.methods.get(Question.TRAJECTORY, ()):
                levels = levels_of(case, Question.TRAJECTORY, method)
                ladder = EngineCase(worker, case, plan, thoroughness).ladder(Question.TRAJECTORY, method, levels)
                runs = [run for run in ladder if run.method == method]
                yield from ladder_trials(worker, case, plan, method, runs)


def ladder_trials(
    worker: EngineHandle, case: Case, plan: Plan, method: Method, runs: Sequence[Run]
) -> Iterator[Trial | Skipped]:
    """Yield the trials of one ladder, or the reason why there are none.

    Parameters
    ----------
    worker : EngineHandle
    case : Case
    plan : Plan
        Plan of the engine for the case.
    method : Method
    runs : sequence of Run
        The ladder, coarse to fine.
    """
    answers = [run.answer for run in runs if run.answer is not None]
    order, finer = declared_order(method), None
    if order is None or len(answers) < max(2, len(runs)):
        reason = next((run.reason for run in runs if run.reason), "no ladder of steps")
    else:
        factor = factor_of(order, runs[-1].cpu)
        finer, reason = _finer(worker, case, plan, method, runs[-1], factor)
    if finer is None:
        yield Skipped(case.name, worker.engine, method.name, reason)
        return
    scales, beyond = Scales.of(case.mechanism, finer), None
    for estimate in estimates(answers, method, [run.step for run in runs], scales):
        difference = OBSERVABLES[estimate.name]
        error = float(np.max(difference(answers[-1], finer, scales)))
        trial = Trial(case.name, worker.engine, method.name, estimate.name, error, estimate.band, estimate.order)
        if error <= ROUNDING:
            yield Skipped(case.name, worker.engine, method.name, f"{estimate.name}: {error:.0e} is rounding")
            continue
        if not trial.covered:
            beyond = beyond or _finer(worker, case, plan, method, runs[-1], 2 * factor)[0]
            if beyond is not None and float(np.max(difference(beyond, finer, scales))) > NEARER * error:
                yield Skipped(case.name, worker.engine, method.name, f"{estimate.name}: {WORSE}")
                continue
        yield trial


def factor_of(order: int, cpu: float) -> int:
    """Return the ratio of the steps of the finest level, of which the CPU time is in s, and of the finer run."""
    factor = 2 ** max(1, int(np.ceil(np.log2(FINER) / order)))
    while factor > LEAST_FACTOR and factor * cpu > BUDGET:
        factor //= 2
    return factor


def _finer(
    worker: EngineHandle, case: Case, plan: Plan, method: Method, finest: Run, factor: int
) -> tuple[TrajectoryAnswer | None, str]:
    """Return the motion at smaller steps or None, and the reason why there is none.

    Parameters
    ----------
    worker : EngineHandle
    case : Case
    plan : Plan
        Plan of the engine for the case.
    method : Method
    finest : Run
        Run at the finest level of the ladder.
    factor : int
        Ratio of the steps, or of the tolerances.
    """
    assert finest.step is not None
    (run,) = ask_ladder(worker, case, plan, method, (finest.step / factor,))
    return run.answer, f"the finer run: {run.reason}"


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
    for (engine, method), group in [*groups.items(), *([(("all", ""), done)] if done else [])]:
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
