"""Gauss collocation in the relative form: coefficients by powers of c, motions against another integrator."""

import numpy as np
import pytest

from consilience.mechanism import rough_dampers
from consilience.reference import simulate
from consilience.reference.steppers.gauss import DIFFERENCE, STAGES, A, B, C
from mechanisms import LOOPS, TREES, states_of

SMOOTH = {name: mechanism for name, mechanism in (TREES | LOOPS).items() if not rough_dampers(mechanism)}


def test_coefficients_integrate_powers():
    """``sum b c^k = 1 / (k + 1)`` up to the order 2 s - 1, and ``sum a c^k = c^(k+1) / (k + 1)`` up to s - 1."""
    for k in range(2 * STAGES):
        assert B @ C**k == pytest.approx(1.0 / (k + 1), abs=2e-15)
    assert abs(B @ C ** (2 * STAGES) - 1.0 / (2 * STAGES + 1)) > 1e-10
    for k in range(STAGES):
        np.testing.assert_allclose(A @ C**k, C ** (k + 1) / (k + 1), atol=2e-15)


def test_the_last_difference_measures_the_highest_power_alone():
    for k in range(STAGES - 1):
        assert abs(DIFFERENCE @ C**k) < 1e-15
    assert abs(DIFFERENCE @ C ** (STAGES - 1)) > 1e-6


@pytest.mark.parametrize("name", SMOOTH)
def test_motions_agree_with_those_of_the_runge_kutta_method(name):
    mechanism = SMOOTH[name]
    state = states_of(mechanism, 2)[1]
    times = np.linspace(0.0, 0.5, 6)
    explicit = simulate(mechanism, state, times, 1e-13, "relative")
    found = simulate(mechanism, state, times, 1e-12, "relative", "gauss")
    for observable in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
        a, b = getattr(found, observable), getattr(explicit, observable)
        assert np.max(np.abs(a - b)) < 1e-10 * max(1.0, np.max(np.abs(b))), observable
