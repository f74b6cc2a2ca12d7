"""Integration of a small ordinary differential equation close to rounding error."""

import numpy as np
from scipy.integrate import solve_ivp


def integrate(rhs, start, times, longest=0.0125, tolerance=1e-13):
    """Solution of ``y' = rhs(y)`` at `times`, shape (n_t, n_y), from ``y(0) = start``.

    Each interval is integrated on its own, so that every sample ends a step: the interpolant of DOP853 is of lower
    order than its steps. At a tolerance of 1e-13 alone the steps through the fast parts of a loop still leave 1e-11;
    steps no longer than `longest` bring that to rounding.
    """
    y, now, samples = np.asarray(start, dtype=float), 0.0, []
    for time in times:
        if time != now:
            solution = solve_ivp(
                lambda _, y: rhs(y),
                (now, time),
                y,
                method="DOP853",
                rtol=tolerance,
                atol=tolerance,
                t_eval=[time],
                first_step=min(longest, abs(time - now)),
                max_step=longest,
            )
            assert solution.success, solution.message
            y, now = solution.y[:, -1], time
        samples.append(y)
    return np.array(samples)
