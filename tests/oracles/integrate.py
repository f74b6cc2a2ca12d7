"""Integration of a small ordinary differential equation close to rounding error."""

import numpy as np
from scipy.integrate import solve_ivp


def integrate(rhs, start, times, tolerance=1e-13):
    """Solution of ``y' = rhs(y)`` at `times`, shape (n_t, n_y), from ``y(0) = start``.

    Each interval is integrated on its own, so that every sample ends a step: the interpolant of DOP853 is of lower
    order than its steps.
    """
    y, now, samples = np.asarray(start, dtype=float), 0.0, []
    for time in times:
        if time != now:
            solution = solve_ivp(
                lambda _, y: rhs(y), (now, time), y, method="DOP853", rtol=tolerance, atol=tolerance, t_eval=[time]
            )
            assert solution.success, solution.message
            y, now = solution.y[:, -1], time
        samples.append(y)
    return np.array(samples)
