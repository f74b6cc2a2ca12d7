"""Origins of problems of the IFToMM library: their equations in one to three coordinates."""

from functools import cache

import numpy as np
from scipy.linalg import expm

from oracles.benchmarks import bicycle, bricard, governor, rolling_bicycle, spatial_slider_crank, windows
from oracles.origins import newton_euler
from oracles.origins.relative import lagrange
from oracles.test_published_vehicles import C1, K0, K2, M


def _table(case, published, solve):
    """Values from ``solve(case, times)``: a dictionary from (body or joint, observable) to arrays, time first."""
    times = np.array(sorted({known.time for known in published}))
    found = solve(case, times)
    rows = [np.searchsorted(times, known.time) for known in published]
    return np.array(
        [
            np.atleast_2d(found[known.of, known.observable].T).T[row, known.component]
            for known, row in zip(published, rows, strict=True)
        ]
    )


def _origin(solve):
    return lambda case, published: _table(case, published, solve)


def _windows(case, times):
    """A02: all upright bars turn by theta about -z; the upper bars translate."""
    count = len(case.mechanism.bodies) // 2
    theta, rate = windows.angle(count, times)
    zero, s, c = 0 * theta, np.sin(theta), np.cos(theta)
    found = {}
    for i in range(count + 1):
        place = np.column_stack([s + i, c, zero]), np.column_stack([rate * c, -rate * s, zero])
        for name, turned in ((f"up_{i}", 1), (f"over_{i}", 0)):
            found[name, "p_WB"], found[name, "v_WB_W"] = place
            found[name, "w_WB_W"] = np.column_stack([zero, zero, -rate * turned])
    return found


def _bricard(case, times):
    """A04: one equation in the crank angle; each rod has its origin at its first end."""
    one = bricard.reduced()
    q, rate = one.solve(np.zeros(2), times).T
    middles = one.centre(q)
    ends = [np.zeros((len(q), 3))]
    for k in range(5):
        ends.append(2 * middles[:, k] - ends[-1])
    found = {(f"rod_{k + 1}", "p_WB"): ends[k] for k in range(5)}
    return found | {("hinge_1", "angle"): q, ("hinge_1", "angle_rate"): rate}


def _governor(case, times):
    """A05: equations of the symmetric mechanism; positive hinge angles point down."""
    s, v, beta, beta_rate, omega = governor.solve(times).T
    zero = 0 * s
    found = {
        ("sleeve", "p_WB"): np.column_stack([zero, zero, s]),
        ("sleeve", "v_WB_W"): np.column_stack([zero, zero, v]),
        ("bearing", "angle_rate"): omega,
    }
    for side in ("right", "left"):
        found[f"hinge_{side}", "angle"] = beta - governor.START[2]
        found[f"hinge_{side}", "angle_rate"] = beta_rate
    return found


def _slider_crank(case, times):
    """Crank motion from conservation of energy."""
    theta, rate = spatial_slider_crank.solve(times).T
    slider = np.array([spatial_slider_crank.poses(angle)[0][2] for angle in theta])
    return {
        ("pivot", "angle"): theta,
        ("pivot", "angle_rate"): rate,
        ("slide", "distance"): slider[:, 0] - 0.2,
        ("slider", "p_WB"): slider,
    }


def _manoeuvre(case):
    """Initial speed and lean rate."""
    rates = case.initial.rates
    return -bicycle.REAR * rates["rear_hub"]["angle"], rates["ride"]["orientation"][0]


def _linear_bicycle(case, times):
    """Linear equations of Meijaard et al. with their printed coefficients."""
    speed, lean_rate = _manoeuvre(case)
    stiffness = bicycle.G * K0 + speed**2 * K2
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, np.hstack([stiffness, speed * C1]))]])
    y = np.array([expm(A * t) @ [0, 0, lean_rate, 0] for t in times])
    axis = np.column_stack([np.full(len(times), np.nan), np.full(len(times), np.nan), np.sin(y[:, 0])])
    return {("rear_frame", "y_axis"): axis, ("steer", "angle"): y[:, 1], ("steer", "angle_rate"): y[:, 3]}


_equations = cache(rolling_bicycle.Equations)


def _bicycle(case, times):
    """Lagrange's equations with multipliers of the rolling constraints."""
    y = _equations().solve(*_manoeuvre(case), times)
    poses, rates, B = (
        np.array([x.full() for x in out])
        for out in zip(*(_equations().read(*np.split(row, 2)) for row in y), strict=True)
    )
    found = {
        ("rear_frame", "y_axis"): B[:, :, 1],
        ("steer", "angle"): y[:, 6],
        ("steer", "angle_rate"): y[:, 15],
        ("rear_hub", "angle_rate"): y[:, 16],
    }
    for n, name in enumerate(("rear_frame", "front_frame", "rear_wheel", "front_wheel")):
        found |= {(name, "p_WB"): poses[:, :, n], (name, "v_WB_W"): rates[:, :, n]}
    return found


ORIGINS = {
    f"n_four_bar_{count}-{variant}": (_origin(_windows),) for count in ("one", "two") for variant in ("short", "long")
}
ORIGINS |= {
    "bricard": (_origin(_bricard), newton_euler.values),
    "flyball_governor": (_origin(_governor), lagrange()),
    "spatial_slider_crank": (_origin(_slider_crank), lagrange("cross")),
    "bicycle-linear": (_origin(_linear_bicycle),),
    **{f"bicycle-{name}": (_origin(_bicycle), newton_euler.values) for name in ("weaving", "stable", "capsizing")},
}
