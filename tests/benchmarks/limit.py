"""The reference against heyoka: Taylor's method on minimal equations written by hand, as a limit of the speed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from routes import SPAN, TOLERANCES, Route, over, setup, sweep
from tables import Table
from timing import ROUNDS, less, race, ratio, seconds

from consilience.case import Case, load_case
from consilience.mechanism import Array
from consilience.reference import simulate
from oracles import double_pendulum, four_bar
from oracles.planar import Plane, held

try:
    import heyoka as hy
except ImportError:
    hy = None

TARGET = 1e-12
"""Largest error of the position of any body at any sample in m."""

FINER = tuple(10.0 ** (-k / 2.0) for k in range(20, 33))
"""Tolerances of heyoka: 1e-10 to 1e-16."""

Pair = tuple[Any, Any]
"""A complex number as two expressions."""


@dataclass(frozen=True)
class Minimal:
    """Minimal equations of a case for heyoka.

    Attributes
    ----------
    system : list of (variable, derivative)
    start : ndarray
    positions : callable
        From states at the samples, shape (n_t, n), to p_WB, shape (n_t, n_b, 3).
    """

    system: list[tuple[Any, Any]]
    start: Array
    positions: Callable[[Array], Array]


def _times(a: Pair, b: Pair) -> Pair:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _pair(z: complex) -> Pair:
    return z.real, z.imag


def _dot(a: Pair, b: Pair) -> Any:
    return a[0] * b[0] + a[1] * b[1]


def _turned(z: complex, angle: Any) -> Pair:
    """Return ``z exp(i angle)``."""
    return _times(_pair(z), (hy.cos(angle), hy.sin(angle)))


def _left(z: Pair) -> Pair:
    """Return ``i z``."""
    return -1.0 * z[1], z[0]


def pendulum(case: Case) -> Minimal:
    """Return ``J q'' = Q(q)`` with the moment Q of the weight about the hinge."""
    plane = Plane(case.mechanism, "hinge")
    A, (body,) = plane.pin("hinge"), plane.bodies()
    q, r = hy.make_vars("q", "r")
    J = body.inertia + body.mass * abs(body.com - A) ** 2
    Q = body.mass * _dot(_pair(plane.gravity), _left(_turned(body.com - A, q)))

    def positions(y: Array) -> Array:
        return np.stack([plane.place(0, A, np.full(len(y), A), np.exp(1j * y[:, 0]))[0]], axis=1)

    return Minimal([(q, r), (r, Q / J)], np.array(held(case, "hinge")), positions)


def double(case: Case) -> Minimal:
    """Return Lagrange's equations in two absolute angles, solved for the accelerations."""
    plane = Plane(case.mechanism, "shoulder")
    A, B = plane.pin("shoulder"), plane.pin("elbow")
    k, start = double_pendulum.pendulum(case)
    q1, q2, w1, w2 = hy.make_vars("q1", "q2", "w1", "w2")
    g = _pair(k.gravity)
    z = _turned(k.mass_2 * k.link * np.conj(k.arm_2), q1 - q2)
    a = k.inertia_1 + k.mass_1 * abs(k.arm_1) ** 2 + k.mass_2 * abs(k.link) ** 2
    b = k.inertia_2 + k.mass_2 * abs(k.arm_2) ** 2
    r1 = _dot(g, _left(_turned(k.mass_1 * k.arm_1 + k.mass_2 * k.link, q1))) - z[1] * w2**2.0
    r2 = k.mass_2 * _dot(g, _left(_turned(k.arm_2, q2))) + z[1] * w1**2.0
    determinant = a * b - z[0] ** 2.0
    system = [(q1, w1), (q2, w2), (w1, (b * r1 - z[0] * r2) / determinant), (w2, (a * r2 - z[0] * r1) / determinant)]

    def positions(y: Array) -> Array:
        turns = np.exp(1j * y[:, :2].T)
        anchors = np.full(len(y), A), A + k.link * turns[0]
        drawn = A, B
        return np.stack([plane.place(n, drawn[n], anchors[n], turns[n])[0] for n in range(2)], axis=1)

    return Minimal(system, start, positions)


def _components(r: Pair, s: Pair, v: Pair) -> Pair:
    """Return x and y of ``x r + y s = v``."""
    determinant = r[0] * s[1] - s[0] * r[1]
    return (v[0] * s[1] - s[0] * v[1]) / determinant, (r[0] * v[1] - v[0] * r[1]) / determinant


def linkage(case: Case) -> Minimal:
    """Return ``J q'' + h q'^2 = Q`` in the crank angle; loop closure by two circles as in `oracles.four_bar`."""
    plane = Plane(case.mechanism, "crank_pivot")
    A, B0, C0, D = (plane.pin(name) for name in ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot"))
    coupler, rocker = C0 - B0, C0 - D
    branch = float(np.sign((coupler * np.conj(D - B0)).imag))
    q, w = hy.make_vars("q", "w")
    crank = _turned(B0 - A, q)
    BD = (D - A).real - crank[0], (D - A).imag - crank[1]
    f2 = _dot(BD, BD)
    along = 0.5 + (abs(coupler) ** 2 - abs(rocker) ** 2) / (2.0 * f2)
    across = branch * hy.sqrt(abs(coupler) ** 2 / f2 - along**2.0)
    r, s = _times((along, across), BD), _times((along - 1.0, across), BD)
    down = -1.0 * crank[0], -1.0 * crank[1]
    i_r, i_s = _left(r), _left(s)
    against = -1.0 * i_s[0], -1.0 * i_s[1]
    b_q, c_q = _components(i_r, against, (crank[1], down[0]))  # right side: -i crank
    bend = tuple(crank[n] + r[n] * b_q**2.0 - s[n] * c_q**2.0 for n in range(2))
    b_qq, c_qq = _components(i_r, against, bend)
    turns = [(crank, B0 - A, (0.0, 0.0), (0.0, 0.0), 1.0, 0.0, A)]
    turns.append((r, coupler, _left(crank), down, b_q, b_qq, B0))
    turns.append((s, rocker, (0.0, 0.0), (0.0, 0.0), c_q, c_qq, D))
    J = h = Q = 0.0
    for body, (arm, drawn, p_q, p_qq, a_q, a_qq, pin) in zip(plane.bodies(), turns, strict=True):
        c = _times(_pair((body.com - pin) / drawn), arm)
        side = _left(c)
        c_q1 = tuple(p_q[n] + a_q * side[n] for n in range(2))
        c_qq1 = tuple(p_qq[n] + a_qq * side[n] - a_q**2.0 * c[n] for n in range(2))
        J = J + body.mass * _dot(c_q1, c_q1) + body.inertia * a_q**2.0
        h = h + body.mass * _dot(c_q1, c_qq1) + body.inertia * a_q * a_qq
        Q = Q + body.mass * _dot(_pair(plane.gravity), c_q1)

    def positions(y: Array) -> Array:
        motions = four_bar.linkage(case).motions(y[:, 0])
        anchors = [np.broadcast_to(motion.anchor, len(y)) for motion in motions]
        placed = zip(motions, anchors, strict=True)
        return np.stack([plane.place(n, m.drawn, at, m.turn)[0] for n, (m, at) in enumerate(placed)], axis=1)

    return Minimal([(q, w), (w, (Q - h * w**2.0) / J)], np.array(held(case, "crank_pivot")), positions)


CASES = {"physical_pendulum-rotating": pendulum, "double_pendulum": double, "four_bar": linkage}


def _taylor(minimal: Minimal, times: Array, tolerances: tuple[float, ...]) -> Route:
    """Return a route by heyoka; its first run compiles the equations, and only the propagation is timed."""

    @cache
    def compiled(tolerance: float) -> Any:
        return hy.taylor_adaptive(minimal.system, minimal.start, tol=tolerance)

    def run(tolerance: float) -> Array:
        integrator = compiled(tolerance)
        integrator.time = 0.0
        integrator.state[:] = minimal.start
        return np.array(integrator.propagate_grid(times)[-1])

    return Route("heyoka", "Taylor", True, tolerances, run, minimal.positions)


def _first(route: Route, truth: Array) -> Any:
    return next((found for _, found in sweep(route, truth, (TARGET,), lambda _: np.inf)), None)


def run(short: bool) -> Iterator[Table]:
    """Yield one table; without heyoka an empty table that says so."""
    about = "Bar: 5. heyoka propagates hand-written minimal equations, compiled before the clock starts. The reference "
    about += "takes the case as it is, a spatial mechanism, and translates it within the call."
    table = Table(f"The limit: 5 s of motion to {TARGET:.0e} m against heyoka", about, ())
    table.columns = ("case", "reference", "of it translation", "tolerance", "heyoka", "tolerance")
    table.columns += ("reference / heyoka", "without translation")
    if hy is None:
        table.about += " **heyoka is not installed: nothing was measured.**"
        yield table
        return
    for name, equations in CASES.items():
        case = over(load_case(name), SPAN)
        minimal = equations(case)
        finest = _taylor(minimal, case.times, FINER[-1:])
        truth = finest.positions(finest.run(FINER[-1]))
        ours = Route(
            "reference",
            "relative",
            False,
            (*TOLERANCES, 10**-13.5, 1e-14),
            lambda tol, case=case: simulate(case.mechanism, case.initial_state, case.times, tol, "relative").p_WB,
            lambda motion: motion,
        )
        found, other = _first(ours, truth), _first(_taylor(minimal, case.times, FINER), truth)
        if found is None or other is None:
            table.rows.append([name, *("not reached" if f is None else f"{f.level:.2g}" for f in (found, other))])
            continue
        contenders = {"reference": found, "heyoka": other, "translation": setup(case, "relative")}
        samples = race(contenders, 5 if short else ROUNDS)
        propagation = less(samples["reference"], samples["translation"])
        times = (samples["reference"], samples["translation"], samples["heyoka"])
        whole, translation, theirs = (seconds(sample.median) for sample in times)
        ratios = (str(ratio(sample, samples["heyoka"])) for sample in (samples["reference"], propagation))
        table.rows.append([name, whole, translation, f"{found.level:.2g}", theirs, f"{other.level:.2g}", *ratios])
    yield table
