"""Oracles that are integrated numerically: conserved quantities and derivatives, to the accuracy of each oracle."""

import numpy as np
import pytest

from consilience.case import load_case
from oracles import double_pendulum, four_bar, slider_crank, spatial_pendulum
from oracles.planar import components, held

TIMES = np.linspace(0, 5, 21)


@pytest.mark.parametrize("module", [four_bar, slider_crank])
def test_loop_keeps_its_energy(module):
    case = load_case(module.__name__.rpartition(".")[2])
    linkage = module.linkage(case)
    kinetic, potential = linkage.energy(linkage.solve(held(case, "crank_pivot"), TIMES))
    assert np.ptp(kinetic + potential) < 1e-11 * np.ptp(potential)


@pytest.mark.parametrize("module", [four_bar, slider_crank])
def test_derivatives_of_the_closure(module):
    linkage = module.linkage(load_case(module.__name__.rpartition(".")[2]))
    q, h = np.linspace(-3, 3, 13), 1e-5
    for before, here, after in zip(*(linkage.motions(q + k * h) for k in (-1, 0, 1)), strict=True):
        for name, expected in (
            ("anchor", here.anchor_q),
            ("anchor_q", here.anchor_qq),
            ("turn", 1j * here.a_q * here.turn),
            ("a_q", here.a_qq),
        ):
            slope = (np.asarray(getattr(after, name)) - getattr(before, name)) / (2 * h)
            assert np.allclose(slope, expected, rtol=1e-7, atol=1e-8)


def test_double_pendulum_keeps_its_energy():
    pendulum, start = double_pendulum.pendulum(load_case("double_pendulum"))
    energy = pendulum.energy(pendulum.solve(start, TIMES))
    assert np.ptp(energy) < 1e-11


def test_components_in_a_skew_basis():
    x, y = components(1 + 2j, -0.5 + 1j, 2 * (1 + 2j) - 3 * (-0.5 + 1j))
    assert (x, y) == pytest.approx((2.0, -3.0), abs=1e-15)


def test_complex_step_gives_the_slope_of_the_potential():
    case = load_case("spatial_pendulum")
    chain, q, h = spatial_pendulum.Chain(case.mechanism), spatial_pendulum.start(case)[:3], 1e-6
    _, stepped = chain.mass_matrix_and_potential(q + 1j * spatial_pendulum.STEP * np.eye(3))
    _, ahead = chain.mass_matrix_and_potential(q + h * np.eye(3).astype(complex))
    _, behind = chain.mass_matrix_and_potential(q - h * np.eye(3).astype(complex))
    assert np.allclose(stepped.imag / spatial_pendulum.STEP, (ahead - behind).real / (2 * h), atol=1e-7)
