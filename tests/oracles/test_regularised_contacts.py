"""Regularised contacts, ``u' + R f = a_ref``, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    Regularisation,
    SpherePlane,
    State,
    rotation_from_quaternion,
)
from consilience.reference.contact import simulate_regularised

MASS, G, RADIUS, D = 1.7, 9.81, 0.1, 0.5
LAW = Regularisation(
    pull=1000.0, decay=20.0, least=D, most=D, width=1e-3, midpoint=0.5, power=2.0, inverse_mass=1.0 / MASS
)
TIMES = np.linspace(0.0, 1.0, 11)
NORMAL = np.array([2.0, -1.0, 2.0]) / 3.0
INERTIA = np.array([[0.011, 0.001, -0.002], [0.001, 0.013, 0.0005], [-0.002, 0.0005, 0.009]])
COM = np.array([0.03, -0.02, 0.05])
TURN = np.array([0.8, -0.2, 0.4, 0.4])


def ball_on_a_plane(gravity, **law):
    """A lumpy body whose sphere, about its centre of mass, touches a plane through the origin, and its rest."""
    center = RADIUS * NORMAL - rotation_from_quaternion(TURN) @ COM
    frame = Frame(center, rotation_from_quaternion(TURN))
    mechanism = Mechanism(
        "ball",
        gravity=gravity,
        bodies=(Body("ball", MASS, COM, INERTIA, frame),),
        joints=(Joint("flight", "free", GROUND, "ball", frame, Frame(np.zeros(3), np.eye(3))),),
        contacts=(SpherePlane("floor", "ball", COM, RADIUS, GROUND, np.zeros(3), NORMAL, **law),),
    )
    return mechanism, State(center[None], TURN[None], np.zeros((1, 3)), np.zeros((1, 3)))


def height(mechanism, motion):
    """Height of the centre of mass above where the ball touches."""
    A = rotation_from_quaternion(motion.quat_WB[:, 0])
    return (motion.p_WB[:, 0] + A @ COM) @ NORMAL - RADIUS


def test_ball_sinks_in_as_the_damped_oscillator():
    """With one d and ``R = (1 - d)/d/m`` the force is ``d m (a_ref + g)``: ``x'' + d b x' + d^2 k x = (1 - d) g``.

    From rest at no overlap: ``x = x_s (1 - e^(-c t)(cos w t + c/w sin w t))``, ``x_s = (1 - d) g/(d^2 k)``,
    ``c = d b/2``, ``w^2 = d^2 k - c^2``.
    """
    mechanism, state = ball_on_a_plane(-G * NORMAL)
    found = height(mechanism, simulate_regularised(mechanism, [LAW], state, TIMES))
    c = 0.5 * D * LAW.decay
    w = np.sqrt(D**2 * LAW.pull - c**2)
    rest = (1.0 - D) * G / (D**2 * LAW.pull)
    wanted = rest * (1.0 - np.exp(-c * TIMES) * (np.cos(w * TIMES) + c / w * np.sin(w * TIMES)))
    assert np.max(np.abs(found + wanted)) < 1e-9 * rest


def test_ball_without_damping_keeps_its_energy():
    """Conservation: with d the same everywhere the law is a spring of ``d^2 k m`` beside a force ``d m g``."""
    mechanism, state = ball_on_a_plane(-G * NORMAL)
    law = replace(LAW, decay=1e-12)
    motion = simulate_regularised(mechanism, [law], state, TIMES)
    x, v = -height(mechanism, motion), motion.v_WB_W[:, 0] @ NORMAL
    energy = 0.5 * v**2 + 0.5 * D**2 * law.pull * x**2 - (1.0 - D) * G * x
    assert np.max(np.abs(energy)) < 1e-9 * G * np.max(x)


@pytest.mark.parametrize("overlap", [1e-4, 3e-4, 5e-4, 8e-4, 2e-3])
def test_ball_rests_where_its_law_carries_it(overlap):
    """Equilibrium: ``R f = a_ref`` with ``f = m g`` gives ``(1 - d) g = d^2 k r`` at any impedance d(r)."""
    law = replace(LAW, least=0.9, most=0.95)
    d, gravity = law.impedance(overlap), G
    law = replace(law, pull=(1.0 - d) * gravity / (d**2 * overlap), decay=100.0)
    mechanism, state = ball_on_a_plane(-gravity * NORMAL)
    state = replace(state, p_WB=state.p_WB - overlap * NORMAL)
    motion = simulate_regularised(mechanism, [law], state, TIMES)
    assert np.max(np.abs(height(mechanism, motion) + overlap)) < 1e-9 * overlap


def test_impedance_rises_smoothly_and_alike_about_its_midpoint():
    """Identity: the impedance is odd about a midpoint of a half, has the ends, and stays beyond the width."""
    law = replace(LAW, least=0.9, most=0.95)
    share = np.linspace(0.0, 0.5, 6)
    low, high = (np.array([law.impedance(x * law.width) for x in s]) for s in (share, 1.0 - share))
    assert np.allclose(low + high, 0.9 + 0.95, atol=1e-15)
    assert law.impedance(0.0) == 0.9
    assert law.impedance(5.0 * law.width) == 0.95


def test_laws_that_are_not_covered_are_refused():
    mechanism, state = ball_on_a_plane(-G * NORMAL, friction=0.3)
    with pytest.raises(InvalidInput, match="no pyramid of four facets"):
        simulate_regularised(mechanism, [LAW], state, TIMES)
    mechanism, state = ball_on_a_plane(-G * NORMAL)
    with pytest.raises(InvalidInput, match="2 laws of 1 contacts"):
        simulate_regularised(mechanism, [LAW, LAW], state, TIMES)
    with pytest.raises(InvalidInput, match="below one"):
        replace(LAW, most=1.0)
