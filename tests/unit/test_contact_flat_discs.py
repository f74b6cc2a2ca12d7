"""A disc that comes parallel to its plane is refused by name and time; one that only comes near goes on.

Released at rest with its axis tilted by th, a disc falls in a plane. Where its rim slides freely the centre falls
straight down, ``m g a (sin th0 - sin th) = (I + m a^2 cos^2 th) th'^2/2``; where it sticks the disc turns about it,
with ``I + m a^2``. Both times until it is flat are quadratures.
"""

import re

import numpy as np
import pytest
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import GROUND, Compliance, DiscPlane
from consilience.reference.contact import simulate_with_contacts
from consilience.reference.contact.march import QuietSteps
from consilience.reference.contact.rims import Rims
from contact_problems import LEVEL, Lab, turned

MASS, RADIUS, INERTIA, TILT = 0.5, 0.1, 0.00125, 0.6
FREE, STUCK = 0.0, 10.0
"""Friction with which the rim slides without resistance, and does not slide."""


def tilted(friction=FREE, spin=(0.0, 0.0, 0.0), height=0.0, fall=0.0, gravity=LEVEL, **law):
    """A disc tilted by `TILT` about y at a height, m, that falls at a speed, with a spin, axes of `Lab`."""
    lab, turn = Lab(), turned(0.0, TILT, 0.0)
    disc = DiscPlane(
        "rim",
        "body",
        lab.com,
        lab.principal[:, 2],
        RADIUS,
        GROUND,
        lab.origin,
        lab.axes[:, 2],
        friction=friction,
        **law,
    )
    mechanism = lab.free_body(MASS, (INERTIA, INERTIA, 2.0 * INERTIA), gravity, [disc])
    centre = np.array([0.0, 0.0, height + RADIUS * np.sin(TILT)])
    return mechanism, lab.state(centre, [0.0, 0.0, -fall], spin, turn)


def flat_at(friction):
    """Time at which a disc at rest comes flat, s."""
    g, weight = -LEVEL[2], MASS * RADIUS**2

    def slowness(x):  # th = TILT - x^2: regular at rest
        th = TILT - x * x
        moment = INERTIA + weight * (np.cos(th) ** 2 if friction == FREE else 1.0)
        risen = 2.0 * np.cos(TILT - 0.5 * x * x) * np.sin(0.5 * x * x)  # sin(TILT) - sin(th)
        return 2.0 * x * np.sqrt(moment / (2.0 * MASS * g * RADIUS * risen)) if x else 0.0

    return scipy.integrate.quad(slowness, 1e-12, np.sqrt(TILT), epsabs=1e-14, epsrel=1e-13)[0]


def refused(mechanism, start, span=0.3, tolerance=1e-12, samples=4):
    """Return the time at which a motion is refused as a disc comes flat, s."""
    with pytest.raises(NumericalFailure, match="the disc comes parallel to its plane") as failure:
        simulate_with_contacts(mechanism, start, np.linspace(0.0, span, samples), tolerance)
    told = re.match(r"contact 'rim', t = (\S+) s: ", str(failure.value))
    return float(told[1])


@pytest.mark.parametrize("friction", [FREE, STUCK])
@pytest.mark.parametrize(("tolerance", "bar"), [(1e-12, 1e-9), (1e-9, 1e-8), (1e-6, 1e-5), (1e-4, 1e-3)])
def test_a_disc_that_comes_flat_is_refused_at_the_time_of_quadrature(friction, tolerance, bar):
    assert refused(*tilted(friction), tolerance=tolerance) == pytest.approx(flat_at(friction), abs=bar)


@pytest.mark.parametrize("samples", [2, 5, 50, 401])
def test_steps_do_not_march_through_a_flat_disc_whatever_the_samples(samples):
    assert refused(*tilted(), 0.14, samples=samples) == pytest.approx(flat_at(FREE), abs=1e-9)


def test_steps_of_python_refuse_it_as_compiled_ones_do(monkeypatch):
    monkeypatch.setattr(QuietSteps, "watch", lambda *_: None)
    assert refused(*tilted()) == pytest.approx(flat_at(FREE), abs=1e-9)


@pytest.mark.parametrize("friction", [0.05, 0.1, 0.2])
def test_a_disc_that_slides_with_friction_comes_flat_between_the_two(friction):
    """It took minutes, or ended with steps that were too short."""
    assert flat_at(FREE) < refused(*tilted(friction), 0.5) < flat_at(STUCK)


def test_a_disc_on_a_compliant_plane_comes_flat():
    """A stiff plane yields little: the disc comes flat a little later."""
    late = refused(*tilted(compliance=Compliance(1e6, 0.0)), tolerance=1e-9) - flat_at(FREE)
    assert 0.0 < late < 1e-4


@pytest.mark.parametrize(("fall", "above"), [(0.3, 0.2), (0.7, 0.0)])
def test_a_disc_in_flight_is_refused_where_it_is_parallel_to_its_plane(fall, above):
    """It turns by `TILT` in 0.1 s, above the plane or as it comes down on it with its whole rim."""
    height = above + 0.1 * fall - RADIUS * np.sin(TILT)
    flying = tilted(spin=(0.0, -TILT / 0.1, 0.0), height=height, fall=fall, gravity=np.zeros(3))
    assert refused(*flying) == pytest.approx(0.1, abs=1e-9)


def test_a_disc_that_flies_past_flat_is_not_refused():
    """It turns about an axis that is not in the plane, and comes no nearer to flat than by a tenth of a radian."""
    flying = tilted(spin=(0.8, -TILT / 0.1, 0.0), height=1.0, gravity=np.zeros(3))
    answer, _ = simulate_with_contacts(*flying, np.linspace(0.0, 0.3, 4), 1e-9)
    assert np.min(answer.contact_gap) > 0.5


@pytest.mark.parametrize("spin", [0.3, 1e-3])
def test_a_disc_that_spins_a_little_rises_again(spin):
    """Its angular momentum about the vertical keeps it from coming flat; without friction it keeps its energy."""
    answer, events = simulate_with_contacts(*tilted(spin=(0.0, 0.0, spin)), np.linspace(0.0, 0.3, 4), 1e-12)
    assert not events
    assert answer.contact_loss == pytest.approx(np.zeros(4), abs=1e-8)


def test_without_the_refusal_the_energy_that_is_lost_is_told(monkeypatch):
    """The lowest point jumps across the disc, and the projection onto it takes the speed: no law of contact sees it."""
    monkeypatch.setattr(Rims, "keep_clear", lambda *_: None)
    monkeypatch.setattr(Rims, "refuse_flat", lambda *_: None)
    monkeypatch.setattr(QuietSteps, "watch", lambda *_: None)
    energy = MASS * -LEVEL[2] * RADIUS * np.sin(TILT)
    with pytest.raises(NumericalFailure, match=r"energy, t = 0\.13 s: it has changed by -0\.\d+ J") as failure:
        simulate_with_contacts(*tilted(), np.linspace(0.0, 0.14, 15), 1e-12)
    lost = float(re.search(r"changed by -(\S+) J", str(failure.value))[1])
    assert 0.9 * energy < lost < 1.0001 * energy
