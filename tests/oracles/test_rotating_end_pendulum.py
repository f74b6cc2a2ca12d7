"""The closed form of the gyrostat: its elliptic integrals, momenta, energy and cusps."""

import numpy as np
import pytest
from scipy.integrate import quad

from consilience.case import load_case
from oracles.rotating_end_pendulum import Gyrostat, gyrostat, incomplete_third

TIMES = np.linspace(0.03, 5.0, 60)


@pytest.mark.parametrize("n", [-5.0, -0.3, 0.4])
@pytest.mark.parametrize("amplitude", [-0.7, 0.9, 2.0, 7.5])
def test_integral_of_the_third_kind(n, amplitude):
    m = 0.42
    expected, _ = quad(lambda a: 1 / ((1 - n * np.sin(a) ** 2) * np.sqrt(1 - m * np.sin(a) ** 2)), 0, amplitude)
    assert incomplete_third(n, np.array(amplitude), m) == pytest.approx(expected, rel=1e-9)


@pytest.fixture(params=["shipped", "slow rotor", "fast rotor"])
def top(request):
    shipped = gyrostat(load_case("rotating_end_pendulum"))
    spin = {"shipped": 1.0, "slow rotor": 0.2, "fast rotor": 8.0}[request.param]
    return Gyrostat(shipped.transverse, spin * shipped.axial_momentum, shipped.weight_moment)


def rates(top, h=5e-4):
    coefficients = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    offsets = (-4, -3, -2, -1, 1, 2, 3, 4)
    return np.tensordot(coefficients, np.array([top.solve(TIMES + k * h) for k in offsets]), 1)


def test_momenta_and_energy(top):
    u, _, _ = top.solve(TIMES)
    u_dot, phi_dot, psi_dot = rates(top)
    vertical = top.transverse * (1 - u * u) * phi_dot + top.axial_momentum * u
    assert np.max(np.abs(vertical)) < 1e-10 * top.axial_momentum
    energy = top.transverse / 2 * (u_dot**2 / (1 - u * u) + (1 - u * u) * phi_dot**2) + top.weight_moment * u
    assert np.max(np.abs(energy)) < 1e-10 * top.weight_moment
    assert np.max(np.abs(psi_dot + u * phi_dot)) < 1e-10 * np.max(np.abs(phi_dot))


def test_rises_no_higher_than_it_was_released_and_rests_there(top):
    u, phi, psi = top.solve(np.linspace(0, 5, 2001))
    assert np.max(u) <= 0.0
    assert u[0] == pytest.approx(0.0, abs=1e-30)
    assert (phi[0], psi[0]) == pytest.approx((0.0, 0.0), abs=1e-14)
    assert np.all(np.diff(phi) > -1e-15)


def test_the_azimuth_of_the_shipped_case_turns_forward():
    _, phi, psi = gyrostat(load_case("rotating_end_pendulum")).solve(np.array([5.0]))
    assert phi[0] > 2 * np.pi
    assert psi[0] > 0
