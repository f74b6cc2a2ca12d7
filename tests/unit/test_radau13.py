"""Radau IIA of order 13 for stiff motions: coefficients, motions, and detection of stiffness."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import load_case
from consilience.mechanism import JointSpring, State, initial_state
from consilience.reference import simulate
from consilience.reference.steppers.radau13 import ESTIMATE, IN, LAMBDA, NESTED, OUT, STAGES, A, B, C
from flat import PLANAR
from mechanisms import LOOPS, TREES, chain, states_of

KINDS = {name: TREES[name] for name in ("long_chain", "forced_chain")}
KINDS |= {"linkage": LOOPS["four_bar"], "loop": LOOPS["loop_universal"], "flat": PLANAR["branched"]}
"""One mechanism for each specialised set of compiled kernels."""

STIFFNESS, DAMPING = 4e5, 2e4
"""Of springs about or along joint axes, N/m and N s/m: time constants of 0.05 ms and 50 ms for 1 kg."""


def stiff(mechanism):
    """Return the mechanism with stiff springs in its joints, in place of its own joint springs."""
    held = [j for j in mechanism.joints if j.kind in ("revolute", "prismatic")]
    coordinate = {"revolute": "angle", "prismatic": "distance"}
    springs = [JointSpring(f"k_{j.name}", j.name, coordinate[j.kind], STIFFNESS, DAMPING, 0.1) for j in held]
    return replace(mechanism, joint_springs=tuple(springs))


def test_coefficients_integrate_powers():
    """``sum b c^k = 1 / (k + 1)`` up to the order 2 s - 1, and ``sum a c^k = c^(k+1) / (k + 1)`` up to s - 1."""
    for k in range(2 * STAGES - 1):
        assert B @ C**k == pytest.approx(1.0 / (k + 1), abs=2e-15)
    assert abs(B @ C ** (2 * STAGES - 1) - 1.0 / (2 * STAGES)) > 1e-9
    for k in range(STAGES):
        np.testing.assert_allclose(A @ C**k, C ** (k + 1) / (k + 1), atol=2e-15)
    np.testing.assert_allclose(A[-1], B, atol=2e-15)
    assert C[-1] == 1.0


def test_eigenvectors_make_the_inverse_diagonal():
    """The real part of ``OUT diag(f(lambda)) IN`` is f(A^-1): here for the powers 0, 1 and -1."""
    assert LAMBDA[0].imag == 0.0
    for power, matrix in ((0, np.eye(STAGES)), (1, np.linalg.inv(A)), (-1, A)):
        np.testing.assert_allclose((OUT * LAMBDA**power @ IN).real, matrix, atol=1e-11)


def test_the_estimate_measures_the_highest_power_alone():
    """With ``f = c^k`` and ``Z = c^(k+1) / (k+1)``, the estimate is zero for k below the number of stages."""
    for k in range(STAGES):
        assert abs(0.0**k + ESTIMATE @ C ** (k + 1) / (k + 1)) < 1e-11
    assert abs(ESTIMATE @ C ** (STAGES + 1) / (STAGES + 1)) > 1e-6


def test_the_dense_output_is_the_polynomial_through_the_stages():
    x = np.linspace(-0.3, 1.7, 9)
    factors = [x if i % 2 == 0 else 1.0 - x for i in range(STAGES)]
    for power in range(1, STAGES + 1):
        nested = np.cumprod(factors, axis=0).T @ (NESTED @ C**power)
        np.testing.assert_allclose(nested, x**power, atol=1e-11)


@pytest.mark.parametrize("name", KINDS)
def test_motions_agree_with_those_of_the_explicit_method(name):
    """Also at a coarse tolerance, where several samples lie within a step."""
    mechanism = KINDS[name]
    state = states_of(mechanism, 2)[1]
    times = np.linspace(0.0, 0.5, 26)
    explicit = simulate(mechanism, state, times, 1e-13, "relative", "tp86")
    for tolerance, factor in ((1e-6, 10.0), (1e-12, 100.0)):
        found = simulate(mechanism, state, times, tolerance, "relative", "radau13")
        for observable in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
            a, b = getattr(found, observable), getattr(explicit, observable)
            assert np.max(np.abs(a - b)) < factor * tolerance * max(1.0, np.max(np.abs(b))), observable


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11])
def test_a_slider_on_a_stiff_spring_follows_the_closed_form(tolerance):
    """``m x'' + c x' + k (x - x0) = m g`` along the axis: two exponentials, whose rates differ by a factor of 1000."""
    mechanism = stiff(chain("prismatic", seed=4))
    (joint,), (body,) = mechanism.joints, mechanism.bodies
    axis, drawn = joint.F.R[:, 2], initial_state(mechanism)
    # 0.23 m from rest at 5 m/s: the quick exponential starts at 0.04 mm
    state = State(drawn.p_WB + 0.33 * axis, drawn.quat_WB, drawn.v_WB_W - 5.1 * axis, drawn.w_WB_W)
    times = np.linspace(0.0, 0.4, 41)
    found = simulate(mechanism, state, times, tolerance, "relative")
    rates = np.roots([body.mass, DAMPING, STIFFNESS])
    start = (state.p_WB[0] - body.drawing.p) @ axis
    rest = 0.1 + body.mass * mechanism.gravity @ axis / STIFFNESS
    amplitudes = np.linalg.solve([[1.0, 1.0], rates], [start - rest, state.v_WB_W[0] @ axis])
    x = rest + np.exp(np.outer(times, rates)) @ amplitudes
    assert np.max(np.abs((found.p_WB[:, 0] - body.drawing.p) @ axis - x)) < 3.0 * tolerance
    assert found.counters["evaluations"] < 800


@pytest.mark.parametrize("name", KINDS)
def test_radau13_takes_stiff_mechanisms_alone(name):
    mechanism = KINDS[name]
    state, times = states_of(mechanism, 2)[1], np.linspace(0.0, 0.3, 7)
    soft, explicit = (simulate(mechanism, state, times, 1e-7, "relative", by) for by in (None, "tp86"))
    if name in ("long_chain", "forced_chain", "loop"):  # planar mechanisms use Taylor series by default
        assert soft.counters == explicit.counters
    hard = stiff(mechanism)
    found, explicit = (simulate(hard, state, times, 1e-7, "relative", by) for by in (None, "tp86"))
    assert found.counters["evaluations"] < explicit.counters["evaluations"] / 5
    truth = simulate(hard, state, times, 1e-12, "relative", "tp86")
    assert np.max(np.abs(found.p_WB - truth.p_WB)) < 1e-6
    again = simulate(hard, state, times, 1e-7, "relative")
    assert np.array_equal(found.p_WB, again.p_WB)
    assert found.counters == again.counters


def test_the_stiff_governor_over_ten_seconds():
    """Heights of the sleeve, integrated independently in long double (remarks of the case)."""
    case = load_case("flyball_governor")
    motion = simulate(case.mechanism, case.initial_state, np.array([0.0, 0.5, 1.0, 10.0]), 1e-10, "relative")
    sleeve = [b.name for b in case.mechanism.bodies].index("sleeve")
    np.testing.assert_allclose(motion.p_WB[1:, sleeve, 2], [0.743249424786, 0.501420922380, 0.619622917061], atol=5e-11)
    assert motion.counters["evaluations"] < 20000
