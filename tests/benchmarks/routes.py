"""Routes to a motion of given accuracy: a run at a level, its positions, and levels from coarse to fine."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from implicit import radau13
from scipy.integrate import ode

from consilience.case import Case
from consilience.errors import ConsilienceError
from consilience.mechanism import Array
from consilience.reference import simulate
from consilience.reference.integrators.tsitouras import TSITOURAS

SPAN, INTERVALS = 5.0, 5
"""Length of a motion in s, and between how many samples: few, so that taking them costs no one anything."""

TOLERANCES = tuple(10.0 ** (-k / 2.0) for k in range(6, 27))
"""1e-3 to 1e-13 in half decades."""

STEPS = tuple(125 * 2.0 ** (k / 2.0) for k in range(-4, 21))
"""Steps in a second, 31 to 128000, in factors of the square root of two."""

FAILURES = (ConsilienceError, RuntimeError, ValueError, ArithmeticError, np.linalg.LinAlgError)
"""What an engine raises where a level is too coarse for it."""


@dataclass(frozen=True, eq=False)
class Route:
    """A route to a motion.

    Attributes
    ----------
    engine, name : str
    native : bool
        Whether the engine's own integrator does all of the integration.
    levels : sequence of float
        Tolerances, or steps between samples, from coarse to fine.
    run : callable
        ``run(level)``: the timed call.
    positions : callable
        From the result of `run` to p_WB at the samples, shape (n_t, n_b, 3). Not timed.
    """

    engine: str
    name: str
    native: bool
    levels: Sequence[float]
    run: Callable[[float], Any]
    positions: Callable[[Any], Array]


@dataclass(frozen=True, eq=False)
class Found:
    """Coarsest level of a route that reaches an accuracy, and the CPU time of one run in s."""

    route: Route
    level: float
    cpu: float

    def __call__(self) -> Any:
        return self.route.run(self.level)

    @property
    def label(self) -> str:
        return f"{self.route.engine}, {self.route.name}, {self.level:.3g}"


def over(case: Case, span: float) -> Case:
    """Return the case over a span in s, with few samples."""
    return replace(case, duration=span, sample=span / INTERVALS, published=())


def steps(case: Case) -> list[int]:
    """Return numbers of steps between samples, from coarse to fine: `STEPS` scaled to the interval, at least one."""
    return sorted({max(1, round(per_second * case.sample)) for per_second in STEPS})


def setup(case: Case, formulation: str) -> Callable[[], object]:
    """Return a call of the reference for the first sample alone: the time of all work but the integration."""
    return lambda: simulate(case.mechanism, case.initial_state, case.times[:1], 1e-6, formulation)


def weights(counts: Sequence[int], orders: Sequence[int]) -> Array:
    """Return weights that remove the terms ``h^p`` of the given orders from results with several numbers of steps."""
    system = np.vstack([np.ones(len(counts)), *(np.array(counts, dtype=float) ** -p for p in orders)])
    return np.linalg.solve(system, np.eye(len(counts))[0])


def extrapolated(route: Route, counts: Sequence[int], orders: Sequence[int]) -> Route:
    """Return the Richardson extrapolation of a route over `counts` times the level; each count removes one order."""
    factors = weights(counts, orders)

    def run(level: float) -> list[Any]:
        return [route.run(level * count) for count in counts]

    def positions(raw: list[Any]) -> Array:
        return np.tensordot(factors, np.array([route.positions(one) for one in raw]), 1)

    coarse = sorted({max(1, round(level / 4.0)) for level in route.levels[:5:2]} - set(route.levels))
    name = f"{route.name}, extrapolated over {counts}"
    return Route(route.engine, name, route.native, [*coarse, *route.levels], run, positions)


def dop853(derivative: Callable[[float, Array], Array], y: Array, times: Array, tolerance: float) -> Array:
    """Integrate by the compiled DOP853 of SciPy; return y at the times.

    Raises
    ------
    RuntimeError
        The integrator failed.
    """
    solver = ode(derivative).set_integrator("dop853", rtol=tolerance, atol=tolerance, nsteps=1_000_000)
    solver.set_initial_value(y, times[0])
    motion = [y]
    for t in times[1:]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a warning accompanies the return code, which is checked
            motion.append(solver.integrate(t))
        if not solver.successful():
            raise RuntimeError(f"dop853 gave up at {solver.t} s")
    return np.array(motion)


Integrator = Callable[[Callable[[float, Array], Array], Array, Array, float], Array]
"""Of a derivative, an initial y, times and a tolerance: y at these."""

_A, _B, _E, _C = TSITOURAS.A, TSITOURAS.b, TSITOURAS.E[0], TSITOURAS.c.tolist()


def tp86(derivative: Callable[[float, Array], Array], y: Array, times: Array, tolerance: float) -> Array:
    """Integrate by the pair and step control of the reference; return y at the times.

    Raises
    ------
    RuntimeError
        The step size became too small.
    """
    K = np.empty((len(_B), len(y)))
    motion, t = [y], float(times[0])
    K[0] = derivative(t, y)
    slope = np.sqrt(np.mean((K[0] / (1.0 + np.abs(y))) ** 2))
    h, known = tolerance ** (1.0 / 8.0) / max(float(slope), 1.0 / (times[-1] - t)), True
    for target in times[1:].tolist():
        while t < target:
            remaining = target - t
            step = remaining if h >= remaining else min(h, 0.5 * remaining)
            if not step > 1e-14 * max(1.0, t):
                raise RuntimeError(f"tp86 gave up at {t} s")
            weights = step * _A
            if not known:
                K[0] = derivative(t, y)
            for i in range(1, len(K)):
                K[i] = derivative(t + _C[i] * step, y + weights[i, :i] @ K[:i])
            end = y + step * (_B @ K)
            scaled = step * (_E @ K) / (1.0 + np.maximum(np.abs(y), np.abs(end)))
            error = float(np.sqrt(scaled @ scaled / len(y))) ** (8.0 / 7.0) / tolerance
            factor = 6.0 if error == 0.0 else min(6.0, max(0.2, 0.8 * error ** (-1.0 / 8.0)))
            known = not error <= 1.0
            if known:
                h = step * min(1.0, factor)
                continue
            y, t = end, target if step == remaining else t + step
            h = max(h, step * factor) if step < h else step * factor
        motion.append(y)
    return np.array(motion)


HIGH_ORDER = {"DOP853": dop853, "TP86": tp86, "RADAU13": radau13}
"""Integrators that an engine's accelerations are given to: SciPy's, compiled, and those of the reference."""


def sweep(
    route: Route, truth: Array, targets: Sequence[float], worth: Callable[[float], float]
) -> Iterator[tuple[float, Found]]:
    """Return, for each accuracy from coarse to fine, the coarsest level of a route that reaches the accuracy.

    Parameters
    ----------
    worth : callable
        From an accuracy to the CPU time in s beyond which a run is of no interest.
    """
    left = sorted(targets, reverse=True)
    for level in route.levels:
        start = time.process_time()
        try:
            raw = route.run(level)
            cpu = time.process_time() - start
            error = float(np.max(np.abs(route.positions(raw) - truth)))
        except FAILURES:
            cpu, error = time.process_time() - start, np.inf
        while left and error <= left[0]:
            yield left.pop(0), Found(route, level, cpu)
        while left and cpu > worth(left[0]):
            left.pop(0)
        if not left:
            return
