"""Motions with contacts against balances: momentum, statics without gravity, what happens at the first instant."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.mechanism import (
    GROUND,
    Body,
    Compliance,
    DiscPlane,
    Frame,
    Joint,
    Mechanism,
    SpherePlane,
    SphereSphere,
    State,
    quaternion_from_rotation,
)
from consilience.mechanism.observables import angular_momentum, kinetic_energy, linear_momentum, potential_energy
from consilience.reference.contact import contact_instant, simulate_with_contacts
from contact_problems import BALL, FEET, LEVEL, G, Lab, turned

SPRING = Compliance(800.0, 3.0)


def pressed_together():
    """Two free bodies without gravity that turn and slide on one another, 4 to 6 cm into one another."""
    here = Frame(np.zeros(3), np.eye(3))
    inertia = np.array([[0.04, 0.006, -0.005], [0.006, 0.05, 0.003], [-0.005, 0.003, 0.06]])
    lumps = {"a": (2.0, [0.05, 0.02, -0.03]), "b": (3.0, [-0.02, 0.04, 0.06])}
    bodies = tuple(Body(name, mass, np.array(com), inertia, here) for name, (mass, com) in lumps.items())
    joints = tuple(Joint(f"free {b.name}", "free", GROUND, b.name, here, here) for b in bodies)
    R = turned(0.4, -0.2, 0.7)
    state = State(
        np.array([[0.0, 0.0, 0.0], [0.1, 0.2, -0.3]]),
        np.array([quaternion_from_rotation(R), quaternion_from_rotation(R.T)]),
        np.array([[0.5, -0.2, 0.1], [-0.3, 0.6, 0.2]]),
        np.array([[2.0, -1.0, 3.0], [-1.0, 2.5, 1.5]]),
    )
    return Mechanism("pressed", np.zeros(3), bodies, joints), state, R


@pytest.mark.parametrize("kind", ["sphere on plane", "sphere on sphere", "disc on plane"])
def test_a_force_and_its_reaction_have_one_line_of_action_where_shapes_overlap(kind):
    """Momentum, and its moment about the origin, are constant whatever the law of the contact."""
    mechanism, state, R = pressed_together()
    law = {"friction": 0.5, "compliance": SPRING}
    normal = R @ np.array([0.1, 0.2, 1.0])  # axes of b, whose rotation is R.T
    at = state.p_WB[0] + R @ np.array([0.1, 0.0, -0.1])
    in_b = R @ (at - state.p_WB[1])
    center, unit = np.array([0.1, 0.0, -0.1]), normal / np.linalg.norm(normal)
    contact = {
        "sphere on plane": SpherePlane("c", "a", center, 0.1, "b", in_b - 0.06 * unit, normal, **law),
        "sphere on sphere": SphereSphere("c", "a", center, 0.1, "b", in_b - 0.21 * unit, 0.15, **law),
        "disc on plane": DiscPlane(
            "c", "a", center, R.T @ np.array([1.0, 0.1, 0.3]), 0.1, "b", in_b - 0.05 * unit, normal, **law
        ),
    }[kind]
    mechanism = replace(mechanism, contacts=(contact,))
    motion, _ = simulate_with_contacts(mechanism, state, np.linspace(0.0, 0.05, 3), 1e-11)
    assert motion.contact_gap[0, 0] < -0.02
    assert np.linalg.norm(motion.contact_impulse[-1]) > 0.05
    states = [State(*parts) for parts in zip(motion.p_WB, motion.quat_WB, motion.v_WB_W, motion.w_WB_W, strict=True)]
    for of in (linear_momentum, angular_momentum):
        np.testing.assert_allclose(of(mechanism, states[-1]), of(mechanism, states[0]), atol=1e-9)


@pytest.mark.parametrize(("push", "acceleration"), [(0.3, 0.0), (0.5, (0.5 - 0.4) * 20.0 / 2.0)])
def test_a_rate_of_rounding_is_no_slip_where_loads_alone_press(push, acceleration):
    """2 kg without gravity, pressed onto a floor with 20 N and pushed along it, at its weight's height: no torque."""
    lab, mu, press = Lab(), 0.4, 20.0
    feet = np.array(FEET) * [1.0, 1.0, 0.0]
    mechanism = lab.free_body(
        2.0, (0.02, 0.03, 0.04), np.zeros(3), lab.points(feet, friction=mu), [(push * press, 0.0, -press)]
    )
    state = lab.state(np.zeros(3), (0.0, 1e-15, 0.0))
    answer = contact_instant(mechanism, [state])
    np.testing.assert_allclose(lab.axes.T @ answer.a_WB_W[0, 0], [acceleration, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(answer.alpha_WB_W, 0.0, atol=1e-12)


def test_an_impact_of_the_first_instant_is_an_event():
    """A ball thrown onto the floor it touches leaves it at once with e of its speed, and comes back after 2 e v/g."""
    lab, v, e = Lab(), 1.3, 0.6
    mechanism = lab.free_body(2.0, (0.02, 0.02, 0.02), (0.0, 0.0, -G), [lab.sphere(0.1, restitution=e)])
    back = 2.0 * e * v / G
    motion, events = simulate_with_contacts(
        mechanism, lab.state([0.0, 0.0, 0.1], [0.0, 0.0, -v]), np.array([0.0, 1.5 * back])
    )
    assert [(event.kind, event.name) for event in events] == [("impact", "contact 'ball'")] * 2
    np.testing.assert_allclose(motion.event_time, [0.0, back], atol=1e-12)


@pytest.mark.parametrize(("rebound", "friction", "end"), [(0.5, 0.0, 1.7), (0.3, 0.2, 1.5)])
def test_bounces_in_a_groove_lose_what_contacts_lose_and_nothing_by_snapping_shut(rebound, friction, end):
    """Energy and losses add up to that of the start: of 6 J, the last low flights must not lose 1e-9 J unseen."""
    lab, angles = Lab(), np.radians([35.0, -50.0])
    walls = [
        SpherePlane(
            f"wall {k}", "body", lab.com, 0.1, GROUND, lab.origin, lab.axes @ [np.sin(a), 0.0, np.cos(a)],
            restitution=rebound, friction=friction,
        )
        for k, a in enumerate(angles)
    ]  # fmt: skip
    mechanism = lab.free_body(2.0, BALL, LEVEL, walls)
    start = lab.state((0.0, 0.0, 0.3), (0.3, 0.2, 0.0))
    answer, _ = simulate_with_contacts(mechanism, start, np.linspace(0.0, end, 31), 1e-12)
    states = [answer.state(k) for k in range(31)]
    total = [kinetic_energy(mechanism, s) + potential_energy(mechanism, s) for s in states] + answer.contact_loss
    assert np.max(np.abs(total - total[0])) < 1e-10
    assert answer.contact_loss[-1] > 3.0
