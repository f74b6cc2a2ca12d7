"""Integration of small ordinary differential equations to nearly rounding error."""

import numpy as np
from scipy.integrate import solve_ivp


def integrate(rhs, start, times, longest=0.0125, tolerance=1e-13):
    """Solution of ``y' = rhs(y)`` at `times`, shape (n_t, n_y), from ``y(0) = start``.

    Every sample ends an interval of its own, because the interpolant of DOP853 is of lower order than its steps. With a
    tolerance of 1e-13 alone, the steps through the fast parts of a loop leave errors of 1e-11; steps no longer than
    `longest` reduce these to rounding.
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
