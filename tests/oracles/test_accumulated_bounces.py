"""Ends of bounces that accumulate against dry friction of a joint, and between the two walls of a groove."""

from dataclasses import replace

import numpy as np
import pytest

from consilience import Case, Drawing, simulate
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    DryFriction,
    Frame,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    State,
    kinetic_energy,
    potential_energy,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)
from consilience.reference.contact import simulate_with_contacts, stepper
from consilience.reference.contact.bounces import Bounces
from consilience.reference.contact.layout import layout_of
from contact_problems import BALL, LEVEL, G, Lab
from oracles.closed_forms.grooves import end_in_groove

LAB = Lab()
MASS, RADIUS = 2.0, 0.1


def ends(events):
    return [event.time for event in events if event.kind == "bounces end"]


@pytest.mark.parametrize(("e", "bound"), [(0.5, 0.3), (0.5, 1.0), (0.5, 5.0), (0.8, 1.0), (0.8, 5.0), (0.95, 1.0)])
def test_bounces_against_dry_friction_end_with_the_sum_of_their_flights(e, bound):
    """Up it is slowed by ``g + C/m``, down pulled by ``g - C/m``: speeds and flights fall by ``e sqrt(down/up)``."""
    up, down, height = G + bound / MASS, G - bound / MASS, 0.3
    speed, r = np.sqrt(2.0 * down * height), e * np.sqrt(down / up)
    end = speed / down + e * speed * (1.0 / up + 1.0 / np.sqrt(up * down)) / (1.0 - r)
    turn = LAB.axes @ LAB.principal.T
    inertia = LAB.principal @ np.diag(BALL) @ LAB.principal.T
    top = LAB.origin + height * LAB.axes[:, 2]
    home = Frame(top - turn @ LAB.com, turn)
    body = Body("slider", MASS, LAB.com, 0.5 * (inertia + inertia.T), home)
    joint = Joint("rail", "prismatic", GROUND, "slider", Frame(top, LAB.axes), Frame(LAB.com, LAB.principal))
    foot = PointPlane("foot", "slider", LAB.com, GROUND, LAB.origin, LAB.axes[:, 2], restitution=e)
    brake = DryFriction("brake", "rail", "distance", bound=bound)
    mechanism = Mechanism("braked", LAB.axes @ LEVEL, (body,), (joint,), contacts=(foot,), dry_frictions=(brake,))
    still = np.zeros((1, 3))
    start = State(home.p[None], quaternion_from_rotation(turn)[None], still, still)
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, end + 0.1]))
    assert ends(events) == pytest.approx([end], abs=1e-11)
    assert answer.contact_loss[-1] == pytest.approx(MASS * G * height, abs=1e-12)
    assert not [event for event in events if event.kind == "closes"]


def groove(slopes, e, place, velocity, radius):
    """Body of the lab between two smooth walls whose bottom its centre reaches at the origin, and its start."""
    contacts = []
    for name, side, slope in zip("lr", (1.0, -1.0), slopes, strict=True):
        normal = LAB.axes @ [side * np.sin(slope), 0.0, np.cos(slope)]
        at = LAB.origin - radius * normal
        if radius:
            contacts.append(SpherePlane(name, "body", LAB.com, radius, GROUND, at, normal, restitution=e))
        else:
            contacts.append(PointPlane(name, "body", LAB.com, GROUND, at, normal, restitution=e))
    start = LAB.state((place[0], 0.0, place[1]), (velocity, 0.2, 0.0))
    return LAB.free_body(MASS, BALL, LEVEL, contacts), start


@pytest.mark.parametrize("duration", [3.0, 12.0])
@pytest.mark.parametrize("radius", [0.0, RADIUS])
@pytest.mark.parametrize(
    ("slopes", "e", "place", "velocity"),
    [
        ((0.5, 0.5), 0.5, (0.05, 0.3), 0.0),
        ((0.7, 0.7), 0.6, (0.03, 0.2), 0.0),  # each wall is struck before the bounces on the other are over
        ((0.6, 0.8), 0.6, (0.02, 0.3), 0.1),
        ((0.6, 0.8), 0.7, (0.02, 0.3), 0.1),
    ],
)
def test_bounces_in_a_groove_end_together_whatever_the_duration(slopes, e, place, velocity, radius, duration):
    mechanism, start = groove(slopes, e, place, velocity, radius)
    end = end_in_groove(slopes, e, place, (velocity, 0.0), G)
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, duration]))
    assert ends(events)[-1] == pytest.approx(end, abs=1e-9)
    p, v, w = LAB.centre(answer)
    assert p == pytest.approx([0.0, 0.2 * duration, 0.0], abs=1e-10)
    assert v == pytest.approx([0.0, 0.2, 0.0], abs=1e-11)
    assert w == pytest.approx(np.zeros(3), abs=1e-11)
    assert answer.contact_loss[-1] == pytest.approx(MASS * (G * place[1] + 0.5 * velocity**2), abs=1e-9)
    assert answer.contact_mode[-1].tolist() == [1, 1]
    weight = LAB.axes.T @ np.sum(answer.contact_impulse, axis=(0, 1))
    assert weight == pytest.approx(MASS * np.array([-velocity, 0.0, G * duration]), abs=1e-9)


CHAOS = (0.85, 0.49), 0.77, (0.0, 0.3), 0.15, 0.0
"""Each impact amplifies what is left of the rounding before it, until the order of the walls depends on it."""


def test_bounces_between_smooth_walls_end_on_both_whatever_their_order():
    mechanism, start = groove(*CHAOS)
    answer, _ = simulate_with_contacts(mechanism, start, np.array([0.0, 4.0]))
    p, v, _ = LAB.centre(answer)
    assert p == pytest.approx([0.0, 0.8, 0.0], abs=1e-9)
    assert v == pytest.approx([0.0, 0.2, 0.0], abs=1e-9)
    assert answer.contact_loss[-1] == pytest.approx(MASS * (G * 0.3 + 0.5 * 0.15**2), abs=1e-9)
    assert answer.contact_mode[-1].tolist() == [1, 1]


def test_bounces_between_rough_walls_end_at_rest_with_all_energy_lost():
    mechanism, start = groove(*CHAOS)
    rough = tuple(replace(wall, friction=0.1) for wall in mechanism.contacts)
    ends = []
    for tolerance in (1e-10, 1e-12):
        answer, _ = simulate_with_contacts(replace(mechanism, contacts=rough), start, np.array([0.0, 4.0]), tolerance)
        p, v, _ = LAB.centre(answer)
        assert p[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-9)
        assert v == pytest.approx(np.zeros(3), abs=1e-12)
        assert answer.contact_loss[-1] == pytest.approx(MASS * (G * 0.3 + 0.5 * (0.15**2 + 0.2**2)), abs=1e-9)
        ends.append(p[1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)  # though the order of the last impacts is another one


def test_low_impacts_without_end_are_refused():
    bounces = Bounces(layout_of(LAB.free_body(MASS, BALL, LEVEL, [LAB.sphere(RADIUS, restitution=0.5)])), 1.0)

    def strike(n):
        rate = -1e-6 * np.array([1.0 + n % 2])
        return bounces.add(1e-6 * n, np.array([True]), np.zeros(1), rate, np.array([False]), np.eye(3, 6))

    assert [strike(n) for n in range(9)] == 8 * [{}] + [{0: None}]  # the first has no flight before it
    for n in range(9, 1001):
        strike(n)
    with pytest.raises(NumericalFailure, match=r"contact 'ball', t = .* they do not end"):
        strike(1001)


def thrown_box(friction, restitution, turn, spin):
    """A lumpy box that falls onto a floor from a height of 0.6 m, turned and turning."""
    inertia = np.array([[0.022, 0.002, 0.002], [0.002, 0.032, 0.002], [0.002, 0.002, 0.042]])
    here = Frame(np.zeros(3), np.eye(3))
    body = Body("box", 1.0, np.array([0.012, -0.015, 0.008]), inertia, here)
    floor = BoxPlane(
        "floor",
        "box",
        np.zeros(3),
        np.array([0.3, 0.2, 0.1]),
        GROUND,
        np.zeros(3),
        np.array([0.0, 0.0, 1.0]),
        friction=friction,
        restitution=restitution,
    )
    flight = Joint("flight", "free", GROUND, "box", here, here)
    mechanism = Mechanism("thrown", np.array([0.0, 0.0, -9.81]), (body,), (flight,), contacts=(floor,))
    quat = quaternion_from_rotation_vector(np.array(turn))[None]
    return mechanism, State(np.array([[0.0, 0.0, 0.6]]), quat, np.zeros((1, 3)), np.array([spin]))


@pytest.mark.parametrize("turn", [(0.2, -0.3, 0.4), (-0.5, 0.1, 0.2), (0.35, 0.3, -0.1)])
def test_a_box_without_friction_settles_on_its_corners_with_its_momentum(turn):
    """Forces are vertical: the centre of mass keeps its velocity along the floor, and the box its momentum about it.

    Its bounces on four corners accumulate together, mostly without a ratio.
    """
    mechanism, start = thrown_box(0.0, 0.5, turn, (0.6, -0.9, 1.1))
    times = np.linspace(0.0, 2.5, 6)
    answer, _ = simulate_with_contacts(mechanism, start, times, 1e-11)
    body = mechanism.bodies[0]
    R = rotation_from_quaternion(np.concatenate([start.quat_WB, answer.quat_WB[-1]]))
    assert np.max(np.abs(answer.contact_gap[-1])) < 1e-9
    np.testing.assert_allclose(np.abs(R[1] @ np.array([0.0, 0.0, 1.0])), [0.0, 0.0, 1.0], atol=1e-9)  # on a large face
    momentum = (R[0] @ body.inertia @ R[0].T @ start.w_WB_W[0])[2]
    right = [0.0, 0.0, momentum / (R[1] @ body.inertia @ R[1].T)[2, 2]]
    np.testing.assert_allclose(answer.w_WB_W[-1, 0], right, atol=1e-9)
    drift = np.cross(start.w_WB_W[0], R[0] @ body.com) * times[-1]
    moved = answer.p_WB[-1, 0] + R[1] @ body.com - start.p_WB[0] - R[0] @ body.com
    np.testing.assert_allclose(moved[:2], drift[:2], atol=1e-9)


def thrown_past_rest():
    """A box that slides on an edge: a corner comes close to rest, and its slip turns by more than a right angle."""
    return thrown_box(0.6, 0.3, (0.641, -0.27, -0.117), (1.953, -1.411, 0.192))


@pytest.mark.parametrize("parts", [2, stepper._MOST_PIECES])
def test_friction_never_points_along_a_slip_that_turns_while_a_step_is_repeated(parts, monkeypatch):
    """The motion goes on, and loses what its friction takes; friction that pointed on would hold the slip there."""
    monkeypatch.setattr(stepper, "_MOST_PIECES", parts)
    mechanism, start = thrown_past_rest()
    answer, _ = simulate_with_contacts(mechanism, start, np.linspace(0.0, 0.6, 16), 1e-11)
    states = [answer.state(k) for k in range(16)]
    total = [kinetic_energy(mechanism, s) + potential_energy(mechanism, s) for s in states] + answer.contact_loss
    np.testing.assert_allclose(total, total[0], rtol=0.0, atol=1e-10)


def test_corners_that_share_an_impact_and_slide_in_different_directions_end_the_motion_by_name():
    """Four corners hit as the box falls flat: how they share the impulse is open, and with it where friction drives."""
    mechanism, start = thrown_box(
        0.4, 0.3, (0.22135139, -0.02523439, -0.2357725), (0.40963783, 0.82985531, -1.64302337)
    )
    body = replace(mechanism.bodies[0], com=np.array([-0.01258576, -0.00976012, -0.01426627]))
    with pytest.raises(
        NumericalFailure, match=r"impact of floor\[0, 2, 4, 6\] at t = 0.44210732.* slide in different directions"
    ):
        simulate_with_contacts(replace(mechanism, bodies=(body,)), start, np.linspace(0.0, 0.45, 16), 1e-10)


def _rocking_box(law: str, friction: float, spin: tuple[float, float, float]) -> Case:
    """Return a box whose left edge bounces to rest before the right one strikes, in a rotated frame."""
    n, t = np.array([0.36, 0.48, 0.8]), np.array([0.8, -0.6, 0.0])
    R = np.stack([t, np.cross(n, t), n], axis=1)
    drawing = Drawing("rocking box", gravity=tuple(-9.81 * n))
    at, inertia = tuple(0.1 * n), R @ np.diag([0.02, 0.03, 0.025]) @ R.T
    drawing.body("box", mass=1.0, at=at, com=tuple(R @ [0.01, 0.0, 0.03]), inertia=inertia)
    drawing.joint("flight", "free", "ground", "box", at=at)
    plane = {"point": (0.0, 0.0, 0.0), "normal": tuple(n), "friction": friction, "restitution": 0.4}
    box = {"at": at, "half_sizes": (0.2, 0.15, 0.1), "orientation": R, "impact_law": law}
    drawing.add("contact", "floor", body="box", **box, **plane)
    return drawing.case(rates={"flight": {"angular_velocity": tuple(R @ spin)}}, duration=0.3, sample=0.05)


def test_corners_whose_bounces_have_ended_have_their_share_of_expansion_by_poissons_law() -> None:
    """Without friction, and where all corners are compressed, the laws of Poisson and Newton are one."""
    one, other = (simulate(_rocking_box(law, 0.0, (0.3, -1.5, 0.1))) for law in ("newton", "poisson"))
    np.testing.assert_allclose(other.p_WB, one.p_WB, rtol=0, atol=1e-13)
    np.testing.assert_allclose(other.contact_loss, one.contact_loss, rtol=0, atol=1e-9)


def test_a_box_that_rocks_by_poissons_law_goes_on_from_its_samples_as_if_it_started_there() -> None:
    case = _rocking_box("poisson", 0.4, (0.0, -1.5, 0.0))
    whole = simulate(case)
    for k in (1, 2):
        again = simulate_with_contacts(case.mechanism, whole.state(k), whole.time[k:], 1e-10)[0]
        np.testing.assert_allclose(again.p_WB, whole.p_WB[k:], rtol=0, atol=1e-12)
