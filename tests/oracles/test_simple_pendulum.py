"""The closed form of the pendulum fulfils its equation of motion and its initial conditions."""

import numpy as np
import pytest

from oracles.simple_pendulum import swing


@pytest.mark.parametrize("amplitude", [np.radians(5.0), -np.pi / 2, 3.0])
def test_satisfies_its_equation(amplitude):
    h, times = 1e-3, np.linspace(0, 10, 41)
    sine, cosine, rate = swing(amplitude, 1.3, 9.81, times)
    rates = [swing(amplitude, 1.3, 9.81, times + k * h)[2] for k in (-2, -1, 1, 2)]
    acceleration = np.array([1, -8, 8, -1]) @ rates / (12 * h)
    assert np.max(np.abs(acceleration + 9.81 / 1.3 * sine)) < 1e-8
    assert np.max(np.abs(sine**2 + cosine**2 - 1)) < 1e-14
    assert np.max(np.abs(rate**2 / 2 - 9.81 / 1.3 * (cosine - np.cos(amplitude)))) < 1e-13


def test_starts_at_rest_at_its_amplitude():
    sine, cosine, rate = swing(-1.2, 1.0, 9.81, np.zeros(1))
    assert np.arctan2(sine, cosine) == pytest.approx(-1.2, abs=1e-15)
    assert rate == pytest.approx(0.0, abs=1e-15)


def test_small_swings_are_harmonic():
    times = np.linspace(0, 2, 9)
    sine, _, _ = swing(1e-4, 1.0, 9.81, times)
    assert np.max(np.abs(sine - 1e-4 * np.cos(np.sqrt(9.81) * times))) < 1e-12
