"""Integrator of the harness: what it refuses."""

import numpy as np
import pytest

from consilience.engine import runge_kutta_4

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
