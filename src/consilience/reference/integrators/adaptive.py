"""Integrators for all formulations, by name, through `derivative(t, u)` and `settle(t, u)`.

=========  ================================================  =====  ============  ============================
name       method                                            order  dense output  samples
=========  ================================================  =====  ============  ============================
rkf45      Runge-Kutta-Fehlberg 4(5), fifth order kept       5      h^5           steps end on them
dop853     Dormand-Prince 8(5,3)                             8      h^8           steps end on them
tp86       Tsitouras-Papakostas 8(6)                         8      h^8           steps end on them
radau      Radau IIA with simplified Newton iteration        5      h^5           steps end on them
bdf        Gear's BDF of variable order and step, by SciPy   1-5    as the step   dense output, settled
=========  ================================================  =====  ============  ============================

Sources: [MASS] for Runge-Kutta-Fehlberg, [ATTIA, EXU] for BDF and [EXU] for Radau. Dense output of the one-step methods
converges as fast as their steps, but with larger errors, and is not settled: their steps therefore end on the samples.
A BDF step on a sample would disturb the history; the dense output of BDF is the method itself.

**Error.** The estimate of a step, in the root mean square of components scaled by ``tolerance (1 + |u_i|)``, is kept
below one. In SI units absolute accuracy counts below 1 m, 1 m/s, 1 rad/s, and relative accuracy above. The estimate of
radau is of third order only, as in RADAU5: its results are more accurate and more expensive than asked for where the
tolerance is tight.

**Settling.** After each accepted step the formulation settles u: it projects u onto the constraints and counts turns. A
one-step method continues from the settled value with the derivative there, and its dense output ends there. BDF shifts
its whole history by the change of u in settling: the value changes, the differences stay. This change is no larger than
the error of a step, so the order is kept [Eich, SIAM J. Numer. Anal. 30, 1993, 1467-1482] and nothing drifts.

**Charts.** A formulation whose coordinates change meaning along the motion has an attribute `chart`, any value that can
be compared and assigned. It defines the meaning of u in `derivative`, `settle` and `state`; only `settle` changes it,
and then returns u in the new chart. There one-step methods discard all data of earlier steps but the step size, and BDF
starts anew with order one. Samples are converted to canonical states at once; `state_at` reads the dense output of a
step in the chart of that step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

import numpy as np
import scipy

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array, State
from consilience.reference.integrators.coefficients import DORMAND_PRINCE, Explicit
from consilience.reference.integrators.dense import Dense, StepPolynomial
from consilience.reference.integrators.step_control import LARGEST, SAFETY, SMALLEST, STATUS
from consilience.reference.integrators.tableaus import (
    RADAU,
    RKF45,
    Collocation,
    CollocationStep,
    ExplicitStep,
    OneStep,
    difference_quotients,
    root_mean_square,
)
from consilience.reference.integrators.tsitouras import TSITOURAS

RESOLVED = 1e-14
"""Smallest step, as a part of the time (or of one second)."""


class Integrable(Protocol):
    """Interface of a formulation for the integrators; `chart` (see the module) is optional."""

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt``, shape (n_u,)."""

    def settle(self, t: float, u: Array) -> Array:
        """Return the coordinates to continue with after an accepted step, shape (n_u,); a new array if any changes."""

    def state(self, u: Array) -> State:
        """Return the canonical state."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion at its sample times and between them.

    Attributes
    ----------
    times : ndarray, shape (n_t,), s
    samples : ndarray, shape (n_t, n_u)
        Settled coordinates, each in the chart of its time.
    states : tuple of State
        The samples as canonical states.
    counters : dict
        ``steps`` accepted, ``evaluations`` of the derivative (those for Jacobians included); ``rejected`` steps of the
        one-step methods; ``jacobians`` and ``factorisations`` (of one n_u x n_u matrix each) of the implicit methods.
    dense : Dense
        Coordinates as a function of time over the whole interval.
    """

    times: Array
    samples: Array
    states: tuple[State, ...]
    counters: dict[str, int]
    dense: Dense


def _chart(formulation: Integrable) -> object:
    """Return the chart of the coordinates; None for a formulation with a single chart."""
    return getattr(formulation, "chart", None)


def _choose(formulation: Integrable, chart: object) -> None:
    """Set the chart of the coordinates."""
    if chart is not None:
        cast(Any, formulation).chart = chart


def state_at(formulation: Integrable, motion: Motion, t: float) -> State:
    """Return the canonical state between samples, from the dense output, not settled.

    Raises
    ------
    InvalidInput
        The time is outside the motion.
    """
    chart = _chart(formulation)
    _choose(formulation, motion.dense.charts[int(motion.dense.step(t))])
    state = formulation.state(motion.dense(t))
    _choose(formulation, chart)
    return state


@dataclass
class _Integration:
    """One integration: its arguments, counters, and recorded steps and samples."""

    formulation: Integrable
    times: Array
    tolerance: float
    step: float | None
    label: str
    counters: dict[str, int]
    samples: list[Array] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    pieces: list[StepPolynomial] = field(default_factory=list)
    charts: list[object] = field(default_factory=list)

    def derivative(self, t: float, u: Array) -> Array:
        """Evaluate the derivative, and count."""
        self.counters["evaluations"] += 1
        return self.formulation.derivative(t, u)

    def jacobian(self, t: float, u: Array, f: Array) -> Array:
        """Return the Jacobian of the derivative, shape (n_u, n_u)."""
        J = difference_quotients(self.derivative, t, u, f)
        if not np.all(np.isfinite(J)):
            raise self.failure(t, NOT_FINITE)
        return J

    def sample(self, u: Array) -> None:
        """Record settled coordinates in the present chart."""
        self.samples.append(u)
        self.states.append(self.formulation.state(u))

    def accept(self, t: float, piece: StepPolynomial, chart: object) -> None:
        """Record the dense output of a step that ends at t."""
        self.counters["steps"] += 1
        self.ends.append(t)
        self.pieces.append(piece)
        self.charts.append(chart)

    def failure(self, t: float, why: str) -> NumericalFailure:
        """Return the error to raise at time t."""
        return NumericalFailure(f"{self.label}: at t = {t:.6g} s {why}")

    def motion(self) -> Motion:
        """Return the recorded motion."""
        dense = Dense(np.array(self.ends), tuple(self.pieces), tuple(self.charts))
        return Motion(self.times, np.array(self.samples), tuple(self.states), self.counters, dense)


TOO_SMALL = STATUS[1]
NOT_FINITE = "the derivative is not finite"


def _length(run: _Integration, h: float, remaining: float) -> float:
    """Return the length of the next step towards a sample."""
    if run.step is not None:
        return remaining / max(1, int(np.ceil(remaining / run.step - 1e-9)))
    if h >= remaining:
        return remaining
    # a remainder a little longer than the step is halved, so that no sliver of a step is left
    return min(h, 0.5 * remaining)


def _one_step(run: _Integration, u: Array, method: OneStep) -> None:
    """Integrate with a one-step method; steps end on the samples."""
    t, span = float(run.times[0]), float(run.times[-1] - run.times[0])
    f = run.derivative(t, u)
    if not np.all(np.isfinite(f)):
        raise run.failure(t, NOT_FINITE)
    exponent = 1.0 / (method.method.estimate_order + 1)
    # over which u changes by about tolerance ** (1 / order) of its size
    h = run.tolerance ** (1.0 / method.method.order) / max(root_mean_square(f / (1.0 + np.abs(u))), 1.0 / span)
    growth = LARGEST
    for target in run.times[1:]:
        while t < target:
            length = _length(run, h, target - t)
            if length < RESOLVED * max(1.0, abs(t)):
                raise run.failure(t, TOO_SMALL)
            with np.errstate(over="ignore", invalid="ignore"):  # a step that is not finite is rejected
                end, error = method.attempt(t, u, f, length)
            if run.step is not None and np.isfinite(error):
                error = 0.0
            if not error <= 1.0:
                if run.step is not None:
                    raise run.failure(t, "the step failed: shorten it")
                run.counters["rejected"] += 1
                h = length * (max(SMALLEST, SAFETY * error**-exponent) if np.isfinite(error) else 0.5)
                growth = 1.0
                continue
            factor = min(growth, max(SMALLEST, SAFETY * error**-exponent)) if error else growth
            growth = LARGEST
            after = float(target) if length == target - t else t + length
            u, f = _settled(run, method, (t, u, length), after, end)
            longer = length if 1.0 <= factor < method.least_growth else length * factor
            h = max(h, longer) if length < h else longer  # a sample that shortens a step does not shorten the next
            t = after
        run.sample(u)


def _settled(
    run: _Integration, method: OneStep, start: tuple[float, Array, float], t: float, end: Array
) -> tuple[Array, Array]:
    """Settle the end of a step and record its dense output; return settled coordinates and their derivative.

    Parameters
    ----------
    run : _Integration
    method : OneStep
    start : (float, ndarray, float)
        Time, coordinates and length of the step.
    t : float, s
    end : ndarray, shape (n_u,)
        Time and coordinates of the end of the step.
    """
    formulation = run.formulation
    before = _chart(formulation)
    u = formulation.settle(t, end)
    f = run.derivative(t, u)
    after = _chart(formulation)
    if after == before:
        run.accept(t, method.piece(*start, u, f), before)
        return u, f
    _choose(formulation, before)
    run.accept(t, method.piece(*start, end, run.derivative(t, end)), before)
    _choose(formulation, after)
    method.restart()
    return u, f


def _multistep(run: _Integration, u: Array) -> None:
    """Integrate with BDF; samples come from the dense output, which has the order of the step."""
    formulation = run.formulation

    def slope(t: float, u: Array) -> Array:
        return run.jacobian(t, u, run.derivative(t, u))

    end = float(run.times[-1])

    def fresh(t: float, u: Array) -> scipy.integrate.BDF:
        return scipy.integrate.BDF(run.derivative, t, u, end, rtol=run.tolerance, atol=run.tolerance, jac=slope)

    solvers = [fresh(float(run.times[0]), u)]
    while solvers[-1].t < end:
        solver = solvers[-1]
        with np.errstate(over="ignore", invalid="ignore"):
            message = solver.step()
        if message is not None:
            raise run.failure(solver.t, TOO_SMALL)
        t, before, dense = float(solver.t), _chart(formulation), solver.dense_output()
        while run.times[len(run.samples)] < t:
            at = run.times[len(run.samples)]
            run.sample(formulation.settle(at, dense(at)))
            _choose(formulation, before)
        u = formulation.settle(t, solver.y)
        run.accept(t, _transposed(dense), before)
        if run.times[len(run.samples)] == t:
            run.sample(u)
        if _chart(formulation) != before:
            solvers.append(fresh(t, u))
        else:
            # D holds the value and its backward differences: a shift of the whole history changes the value only
            solver.D[0] = solver.y = u
    run.counters["jacobians"] = sum(solver.njev for solver in solvers)
    run.counters["factorisations"] = sum(solver.nlu for solver in solvers)


def _transposed(dense: Callable[[Array], Array]) -> StepPolynomial:
    """Return the dense output of SciPy with one row for each time."""
    return lambda t: dense(t).T


METHODS: dict[str, Explicit | Collocation | None] = {
    "rkf45": RKF45,
    "dop853": DORMAND_PRINCE,
    "tp86": TSITOURAS,
    "radau": RADAU,
    "bdf": None,
}
"""Selectable methods: one-step methods by their coefficients; BDF (None) is SciPy's."""


def integrate(
    formulation: Integrable, u: Array, times: Array, tolerance: float, method: str, step: float | None = None
) -> Motion:
    """Integrate a formulation from ``times[0]`` and return its motion.

    Parameters
    ----------
    formulation : Integrable
        See `consilience.reference.formulations.protocol`.
    u : ndarray, shape (n_u,)
        Consistent coordinates at ``times[0]``, in the present chart.
    times : ndarray, shape (n_t,), s
        Increasing.
    tolerance : float
        Bound on the scaled local error of a step, 1e-13 to 1e-3.
    method : str
        Key of `METHODS`.
    step : float, s, optional
        Constant step (a little shorter where it does not divide the time between samples) in place of step control, for
        the measurement of orders. Newton's method of radau keeps to `tolerance`. Not for BDF, which has no constant
        step of high order without a start of high order.

    Returns
    -------
    Motion

    Raises
    ------
    InvalidInput
        Unknown method, tolerance or step out of range, times that do not increase.
    NumericalFailure
        When and why the integration cannot continue.
    """
    times = np.array(times, dtype=float)
    if method not in METHODS:
        raise InvalidInput(f"method '{method}'", "there is none of that name", f"Methods: {', '.join(METHODS)}.")
    tableau = METHODS[method]
    if not 1e-13 <= tolerance <= 1e-3:
        raise InvalidInput("tolerance", f"{tolerance} is out of range", "Choose 1e-13 to 1e-3.")
    if times.ndim != 1 or len(times) < 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
        raise InvalidInput("times", "they do not increase", "Give finite, increasing sample times.")
    if step is not None and (tableau is None or not 0.0 < step < np.inf):
        what = "bdf chooses its own steps" if tableau is None else f"{step} s is no length of a step"
        raise InvalidInput("step", what, "Give a positive length, to rkf45, dop853, tp86 or radau.")
    label = f"{method}, " + (f"tolerance {tolerance:g}" if step is None else f"steps of {step:g} s")
    run = _Integration(formulation, times, float(tolerance), step, label, {"steps": 0, "evaluations": 0})
    run.ends.append(float(times[0]))
    u = np.array(u, dtype=float)
    run.sample(u)
    if len(times) == 1:
        return run.motion()
    if tableau is None:
        _multistep(run, u)
    elif isinstance(tableau, Explicit):
        _one_step(run, u, ExplicitStep(tableau, run))
    else:
        _one_step(run, u, CollocationStep(tableau, run))
    return run.motion()
