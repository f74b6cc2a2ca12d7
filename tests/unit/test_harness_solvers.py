"""Integrator and constraint solver of the harness."""

import numpy as np
import pytest

from consilience.engine import runge_kutta_4, solve_constrained

STABLE = 2.785293563405282
"""Real root of ``1 - x + x^2 / 2 - x^3 / 6 + x^4 / 24 = 1`` [Hairer, Wanner, Solving ODEs II, IV.2]: the method decays
for x below."""


@pytest.mark.parametrize(("rate", "stable"), [(0.999 * STABLE, True), (1e3 * STABLE, False)])
def test_a_step_beyond_the_stability_region_is_named(rate, stable):
    """``y' = -rate y`` by steps of 1 s; far beyond the region y overflows."""
    seen = []

    def run():
        return runge_kutta_4(lambda y: -rate * y, np.ones(1), 1.0, 40, seen.append, 1)

    if stable:
        assert abs(run()[0]) < 1.0
    else:
        with np.errstate(over="ignore", invalid="ignore"), pytest.raises(FloatingPointError, match=r"below 2\.7\d 1/s"):
            run()


def test_a_row_of_rounding_holds_nothing_whatever_the_units_of_the_others():
    """A mass on a line: the row of the line, one in units of 1e-6, and one that only rounding keeps from zero."""
    M, f = np.diag([2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0])
    for unit in (1e-6, 1.0, 1e6):
        J = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, unit], [0.0, 3e-17, 0.0]])
        a, lam = solve_constrained(M, f, J, np.array([0.5, unit * 0.7, 1e-16]))
        multiplier = (0.5 - (1.0 / 2.0 + 2.0 / 3.0)) / (1.0 / 2.0 + 1.0 / 3.0)  # J M^-1 J^T of the first row
        np.testing.assert_allclose(a, [(1.0 + multiplier) / 2.0, (2.0 + multiplier) / 3.0, 0.7], rtol=1e-14)
        np.testing.assert_allclose(lam, [multiplier, (4.0 * 0.7 - 3.0) / unit, 0.0], rtol=1e-13, atol=1e-30)
