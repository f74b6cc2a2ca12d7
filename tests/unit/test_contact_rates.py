"""Rows of contacts in motion: their biases are the rates of the relative velocities where no body accelerates."""

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
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    kinetic_energy,
    quaternion_from_rotation_vector,
    quaternion_product,
)
from consilience.reference.bodies.arrays import pack
from consilience.reference.contact import simulate_with_contacts
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.layout import layout_of
from consilience.reference.contact.simulation import ContactSimulation

HERE = Frame(np.zeros(3), np.eye(3))
INERTIA = np.array([[0.4, 0.02, -0.01], [0.02, 0.5, 0.03], [-0.01, 0.03, 0.6]])
COMS = np.array([[0.1, -0.2, 0.3], [-0.2, 0.1, 0.05]])
POINT, NORMAL = np.array([0.1, 0.2, -0.7]), np.array([1.0, -2.0, 2.0])
AT, CENTER = np.array([0.2, 0.1, -0.3]), np.array([-0.1, 0.3, 0.2])
SHAPES = {
    "sphere on plane": SpherePlane("c", "a", AT, 0.1, "b", POINT, NORMAL, friction=0.3),
    "point on plane": PointPlane("c", "a", AT, "b", POINT, NORMAL, friction=0.3),
    "sphere on sphere": SphereSphere("c", "a", AT, 0.1, "b", CENTER, 0.2, friction=0.3),
    "disc on plane": DiscPlane("c", "a", AT, np.array([0.3, 1.0, 0.2]), 0.15, "b", POINT, NORMAL, friction=0.3),
}


def mechanism(contact):
    """Two free lumpy bodies that touch."""
    bodies = tuple(Body(name, 1.0 + n, COMS[n], INERTIA, HERE) for n, name in enumerate("ab"))
    joints = tuple(Joint(f"free {name}", "free", GROUND, name, HERE, HERE) for name in "ab")
    return Mechanism("pair", np.zeros(3), bodies, joints, contacts=(contact,))


@pytest.mark.parametrize("contact", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_biases_are_rates_of_the_rates_of_bodies_that_do_not_accelerate(contact, seed):
    """Tangents turn with their normal and with their body: ``(t . u)' = t . u' + t' . u``."""
    rng = np.random.default_rng(seed)
    phi, v, w = rng.normal(size=(3, 2, 3))
    quats = np.array([quaternion_from_rotation_vector(one) for one in phi])
    places = np.array([[0.0, 0.0, 1.5], [0.3, -0.2, 0.0]])
    one = mechanism(contact)
    equations = ContactEquations(layout_of(one))
    y = pack(equations.layout.smooth, State(places, quats, v, w))
    turns = np.zeros(len(equations.model.coordinate))

    def rates(time):
        moved = y.copy()
        for body in moved:
            body[:3] += time * body[7:10]
            body[3:7] = quaternion_product(body[3:7], quaternion_from_rotation_vector(time * body[10:13]))
        return equations.move(0.0, moved, turns).u.copy()

    bias, h = equations.move(0.0, y, turns).bias.copy(), 1e-4
    near, far = ((rates(k * h) - rates(-k * h)) / (2.0 * k * h) for k in (1.0, 2.0))
    np.testing.assert_allclose(bias, (4.0 * near - far) / 3.0, atol=1e-9 * max(1.0, np.max(np.abs(bias))))


STIFF = Compliance(stiffness=400.0)


def soft_landing(friction):
    """The pair with a soft contact that has just closed, on a plane that turns."""
    one = mechanism(replace(SHAPES["sphere on plane"], friction=friction, compliance=STIFF))
    n = NORMAL / np.linalg.norm(NORMAL)
    place = POINT + 0.1 * n - AT  # the sphere touches the plane
    places, spin, still = np.array([place, np.zeros(3)]), np.array([[0.4, 0.3, -0.2]] * 2), [[1.0, 0.0, 0.0, 0.0]] * 2
    closing = np.array([-0.3 * n, np.zeros(3)])
    return one, State(places, np.array(still), closing + np.cross(spin, places), spin)


@pytest.mark.parametrize("friction", [0.01, 50.0], ids=["slides", "sticks"])
def test_accelerations_of_rows_are_rates_of_their_rates_where_the_state_gives_forces(friction):
    """The spring's force acts once: it is among the forces, and in the free accelerations."""
    one, start = soft_landing(friction)

    def at(time):
        run = ContactSimulation(one, start, np.array([0.0, time]), 1e-13)
        run.integrate()
        response = run.stepper.respond(run.stepper.t, run.stepper.y)
        return run.equations.rows.u.copy(), response.accelerations(run.stepper.forces())

    time, h = 0.03, 1e-4
    near, far = ((at(time + k * h)[0] - at(time - k * h)[0]) / (2.0 * k * h) for k in (1.0, 2.0))
    found = at(time)[1]
    np.testing.assert_allclose(found, (4.0 * near - far) / 3.0, atol=1e-7 * np.max(np.abs(found)))


def test_a_soft_contact_that_sticks_on_a_turning_plane_keeps_its_energy():
    """The spring stores energy, friction that sticks takes none: kinetic energy and that of the spring are constant."""
    one, start = soft_landing(50.0)
    times = np.linspace(0.0, 0.05, 11)
    answer, _ = simulate_with_contacts(one, start, times, 1e-11)
    assert np.all(answer.contact_mode[1:, 0] == 2)  # it sticks
    energies = []
    for k in range(len(times)):
        at = State(answer.p_WB[k], answer.quat_WB[k], answer.v_WB_W[k], answer.w_WB_W[k])
        energies.append(kinetic_energy(one, at) + 0.5 * STIFF.stiffness * min(0.0, answer.contact_gap[k, 0]) ** 2)
    np.testing.assert_allclose(energies, energies[0], rtol=1e-9)
