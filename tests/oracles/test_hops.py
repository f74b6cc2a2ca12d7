"""Sliding under an associated cone, against closed forms: it hops, and the hops add up to Coulomb's way and time.

An impulse of the cone leaves the nearest velocity, in the mass metric, of those with ``u_n >= mu abs(u_t)``. From
``(u, 0)`` along and across the plane that is ``u (1, mu)/(1 + mu^2)``; from ``u (1, -mu)`` it is the share
``(1 - mu^2)/(1 + mu^2)`` of ``u (1, mu)``. The series of all flights is geometric: ``u/(mu g)`` long and
``u^2/(2 mu g)`` far.
"""

import numpy as np
import pytest

from consilience.errors import NumericalFailure
from consilience.mechanism import rotation_from_quaternion
from consilience.reference.contact import contact_instant, simulate_with_contacts
from contact_problems import FEET, LEVEL, G, Lab

LAB, MU = Lab(), 0.4


def block(gravity=LEVEL):
    contacts = LAB.points(FEET, friction=MU, associated=True)
    return LAB.free_body(2.0, (0.02, 0.03, 0.04), gravity, contacts)


def centre(motion, k):
    return LAB.axes.T @ (motion.p_WB[k, 0] + rotation_from_quaternion(motion.quat_WB[k, 0]) @ LAB.com - LAB.origin)


def test_a_block_hops_to_where_coulomb_s_law_stops_it():
    v = np.array([1.2, 0.9, 0.0])
    speed = np.linalg.norm(v)
    rise, stop = MU * speed / (1 + MU**2), speed / (MU * G)
    times = np.array([0.0, rise / G, 1.1 * stop])
    motion, events = simulate_with_contacts(block(), LAB.state([0, 0, 0.1], v), times, 1e-11)
    apex = v * rise / G / (1 + MU**2) + [0, 0, 0.1 + 0.5 * rise**2 / G]
    np.testing.assert_allclose(centre(motion, 1), apex, atol=1e-11)
    np.testing.assert_allclose(centre(motion, 2), 0.5 * v * stop + [0, 0, 0.1], atol=1e-8)
    assert events[-1].time == pytest.approx(stop, abs=1e-8)
    assert np.all(motion.contact_mode[2] == 2)
    # since the first sample, which has the velocities after the impact at the start
    assert motion.contact_loss[2] == pytest.approx(0.5 * 2.0 * speed**2 / (1 + MU**2), rel=1e-9)


def test_nothing_slides_and_stays():
    """Pushed by half of its weight it would slide from rest; by a third it sticks."""
    start, times = LAB.state([0, 0, 0.1], [0.0, 0.0, 0.0]), np.array([0.0, 0.1])
    with pytest.raises(NumericalFailure, match="t = 0 s: contact 'foot 0': what slides under an associated cone parts"):
        simulate_with_contacts(block((0.5 * G, 0.0, -G)), start, times)
    motion, _ = simulate_with_contacts(block((G / 3, 0.0, -G)), start, times)
    np.testing.assert_allclose(centre(motion, 1), [0, 0, 0.1], atol=1e-12)
    with pytest.raises(NumericalFailure, match="parts at once"):
        contact_instant(block(), [LAB.state([0, 0, 0.1], [1.2, 0.9, 0.0])])
