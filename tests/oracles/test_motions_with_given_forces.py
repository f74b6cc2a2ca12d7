"""Contacts on springs and dampers, friction that reactions of joints bound, friction moments: closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.errors import NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    Compliance,
    Drive,
    DryFriction,
    Frame,
    Function,
    Initial,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    initial_state,
)
from consilience.reference.contact import contact_instant, simulate_with_contacts
from contact_problems import BALL, LEVEL, Lab, turned

G, LAB = 9.81, Lab()
STATE, TIME = 1e-10, 1e-11


def soft_ball(compliance, gravity=LEVEL, friction=0.0):
    """Ball of 2 kg and 0.1 m, its normal motion that of a point on the spring."""
    return LAB.free_body(2.0, BALL, gravity, [LAB.sphere(0.1, friction=friction, compliance=compliance)])


def test_a_ball_leaves_a_spring_and_a_damper_where_they_would_pull():
    """Without gravity ``x = v/wd exp(-s t) sin(wd t)``, and ``k x + c x' = 0`` ends the contact, still overlapping."""
    m, k, c, v = 2.0, 5000.0, 60.0, 1.5
    s = c / (2 * m)
    wd = np.sqrt(k / m - s**2)
    lasts = (np.pi - np.arctan2(c * wd, k - c * s)) / wd
    x = v / wd * np.exp(-s * lasts) * np.sin(wd * lasts)
    leaves = v * np.exp(-s * lasts) * (np.cos(wd * lasts) - s / wd * np.sin(wd * lasts))
    touches = 0.2 / v
    times = np.array([0.0, touches + lasts + 0.1])
    answer, events = simulate_with_contacts(
        soft_ball(Compliance(k, c), np.zeros(3)), LAB.state([0, 0, 0.3], [0, 0, -v]), times, 1e-13
    )
    assert [e.kind for e in events] == ["closes", "opens"]
    assert [e.time for e in events] == pytest.approx([touches, touches + lasts], abs=TIME)
    assert LAB.centre(answer)[0] == pytest.approx([0, 0, 0.1 - x - 0.1 * leaves], abs=STATE)
    assert answer.contact_loss[-1] == pytest.approx(0.5 * m * (v**2 - leaves**2), abs=STATE)
    assert LAB.axes.T @ answer.contact_impulse[-1, 0] == pytest.approx([0, 0, m * (v - leaves)], abs=STATE)


@pytest.mark.parametrize("damping", [0.0, 20.0, 200.0])
@pytest.mark.parametrize(("duration", "d"), [(0.02, 0.999e-3), (0.1, 0.999e-3), (0.3, 0.99999e-3)])
def test_no_step_passes_over_a_plate_that_dips_a_little_into_a_spring_and_a_damper(duration, d, damping):
    """Plate and ball move as told, ``g = d + a sin(w t)``, a little below zero: until ``k g + c g' = 0``, then parting.

    With ``tan b = c w/k`` that is ``k d + hypot(k, c w) a sin(w t + b) = 0``.
    """
    a, w, k = 1e-3, 100.0 * np.pi, 1e3
    here = Frame(np.zeros(3), LAB.axes)
    ball = Body("ball", 1.0, np.zeros(3), 1e-2 * np.eye(3), Frame(LAB.origin, np.eye(3)))
    slide = {
        name: Joint(name, "prismatic", GROUND, name, Frame(LAB.origin, here.R), here) for name in ("plate", "ball")
    }
    contact = SpherePlane(
        *("c", "ball", np.zeros(3), 0.1, "plate", np.zeros(3), LAB.axes[:, 2]), compliance=Compliance(k, damping)
    )
    moves = {"plate": Function(harmonics=[(a, w, np.pi)]), "ball": Function([0.1 + d])}
    drives = tuple(Drive(f"moves {name}", name, "distance", move) for name, move in moves.items())
    bodies = (replace(ball, name="plate"), ball)
    mechanism = Mechanism("dips", np.zeros(3), bodies, tuple(slide.values()), drives=drives, contacts=(contact,))
    answer, events = simulate_with_contacts(mechanism, initial_state(mechanism), np.array([0.0, duration]), 1e-12)
    b, most = np.arctan2(damping * w, k), np.hypot(k, damping * w)
    touches = (np.pi + np.arcsin(d / a)) / w
    leaves = (2.0 * np.pi - np.arcsin(k * d / (most * a)) - b) / w
    dips = round(duration * w / (2.0 * np.pi))
    told = (np.array([touches, leaves]) + 2.0 * np.pi / w * np.arange(dips)[:, None]).ravel()
    assert [e.kind for e in events] == ["closes", "opens"] * dips
    assert [e.time for e in events] == pytest.approx(told, abs=TIME)
    impulse = k * a / w * (np.cos(w * leaves) - np.cos(w * touches)) - k * d * (leaves - touches)
    impulse -= damping * a * (np.sin(w * leaves) - np.sin(w * touches))
    assert LAB.axes.T @ answer.contact_impulse[-1, 0] == pytest.approx([0, 0, dips * impulse], rel=1e-7, abs=1e-14)


def test_a_bowling_ball_on_a_spring_slips_and_rolls_as_on_rigid_ground():
    """On its static deflection ``m g/k`` the load of the friction stays ``m g``."""
    mu, slip = 0.2, np.array([2.0, 1.0])
    sinks, rolls = 2.0 * G / 3e4, 2 * np.hypot(*slip) / (7 * mu * G)
    mechanism = soft_ball(Compliance(3e4), friction=mu)
    start = LAB.state([0, 0, 0.1 - sinks], [*slip, 0])
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, rolls + 0.2]), 1e-13)
    assert [e.kind for e in events] == ["sticks"]
    assert events[0].time == pytest.approx(rolls, abs=TIME)
    gone = slip * rolls - mu * G * slip / np.hypot(*slip) * rolls**2 / 2 + 5 / 7 * slip * 0.2
    assert LAB.centre(answer)[0] == pytest.approx([*gone, 0.1 - sinks], abs=STATE)
    force = LAB.axes.T @ contact_instant(mechanism, [start]).contact_force[0, 0]
    assert force == pytest.approx([*(-mu * 2.0 * G * slip / np.hypot(*slip)), 2.0 * G], abs=1e-9)


def bead_on_rod(gravity, twice=False):
    """Bead of 0.3 kg on a rod along x of the lab that turns at 2 rad/s about z, friction 0.3 of the reaction."""
    lumpy = np.array([[3.0, 0.2, -0.1], [0.2, 4.0, 0.3], [-0.1, 0.3, 5.0]])
    R = turned(0.3, -0.4, 0.7)
    bodies = (
        Body("rod", 2.0, np.array([0.05, 0.02, -0.01]), 1e-2 * lumpy, Frame(LAB.origin, LAB.axes @ R)),
        Body("bead", 0.3, np.zeros(3), 1e-4 * lumpy, Frame(LAB.origin, LAB.axes)),
    )
    along = np.eye(3)[:, [1, 2, 0]]  # z of the joint is x
    joints = [
        Joint("hub", "revolute", GROUND, "rod", Frame(LAB.origin, LAB.axes), Frame(np.zeros(3), R.T)),
        Joint("slide", "prismatic", "rod", "bead", Frame(np.zeros(3), R.T @ along), Frame(np.zeros(3), along)),
    ]
    if twice:
        joints.append(Joint("again", "prismatic", "rod", "bead", joints[1].F, joints[1].M))
    drive = Drive("motor", "hub", "angle", Function([0.0, 2.0]))
    dry = DryFriction("fit", "slide", "distance", coefficient=0.3)
    return Mechanism("bead", LAB.axes @ gravity, bodies, tuple(joints), drives=(drive,), dry_frictions=(dry,))


def sliding(mechanism, r, rate):
    return initial_state(
        mechanism, Initial(coordinates={"slide": {"distance": r}}, rates={"slide": {"distance": rate}})
    )


def test_a_bead_under_gravity_stops_on_its_turning_rod_and_stays():
    """``r'' = 4 r - 0.3 hypot(g, 4 r')``, integrated to 11 digits; it stays, for ``4 r <= 0.3 g``."""
    mechanism = bead_on_rod(LEVEL)
    start = sliding(mechanism, 0.2, 1.0)
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, 0.5, 1.5]), 1e-13)
    assert [e.kind for e in events] == ["sticks"]
    assert events[0].time == pytest.approx(0.73842063542, abs=2e-11)
    r = np.linalg.norm(answer.p_WB[:, 1] - LAB.origin, axis=1)
    assert r[-1] == pytest.approx(0.50644017664, abs=2e-11)
    found = contact_instant(mechanism, [start])
    arm = start.p_WB[1] - LAB.origin
    x = arm / np.linalg.norm(arm)
    assert x @ found.a_WB_W[0, 1] == pytest.approx(-0.3 * np.hypot(G, 4.0), abs=1e-11)


def test_friction_of_a_reaction_that_is_shared_is_refused():
    mechanism = bead_on_rod(LEVEL, twice=True)
    with pytest.raises(NumericalFailure, match="dry friction 'fit': constraints that depend on one another leave"):
        contact_instant(mechanism, [sliding(mechanism, 0.2, 1.0)])


@pytest.mark.parametrize("slope", [0.0, 0.6], ids=["along", "oblique"])
def test_an_impact_that_loads_a_joint_with_friction_of_its_reaction_is_refused(slope):
    """On a rail that turns no more a bead strikes a wall: across the rail the joint carries nothing, or an impulse."""
    normal = LAB.axes @ np.array([-1.0, 0.0, slope])
    wall = PointPlane("wall", "bead", np.zeros(3), GROUND, LAB.origin + 0.3 * LAB.axes[:, 0], normal, restitution=0.5)
    still = bead_on_rod(np.zeros(3))
    drive = replace(still.drives[0], motion=Function([0.0]))
    mechanism = replace(still, drives=(drive,), contacts=(wall,))
    start, times = sliding(mechanism, 0.2, 1.0), np.array([0.0, 0.3])
    if slope:
        with pytest.raises(NumericalFailure, match=r"dry friction 'fit': the impact at .* loads its joint"):
            simulate_with_contacts(mechanism, start, times)
    else:
        answer, _ = simulate_with_contacts(mechanism, start, times)
        assert np.linalg.norm(answer.v_WB_W[-1, 1]) == pytest.approx(0.5, abs=1e-12)


def test_drilling_friction_stops_a_spinning_ball_and_nothing_else():
    """``I w' = -tau m g``: the spin falls linearly, over the angle ``I w^2 / (2 tau m g)``; the ball stays."""
    tau, spin, inertia = 0.004, 9.0, BALL[2]
    mechanism = LAB.free_body(2.0, BALL, LEVEL, [LAB.sphere(0.1, friction=0.3, torsional=tau)])
    stops = inertia * spin / (tau * 2.0 * G)
    times = np.array([0.0, 0.5 * stops, stops + 0.3])
    answer, events = simulate_with_contacts(mechanism, LAB.state([0, 0, 0.1], [0, 0, 0], [0, 0, spin]), times, 1e-13)
    assert LAB.centre(answer, 1)[2] == pytest.approx([0, 0, 0.5 * spin], abs=STATE)
    position, velocity, rate = LAB.centre(answer)
    assert [*position, *velocity, *rate] == pytest.approx([0, 0, 0.1, *np.zeros(6)], abs=STATE)
    assert answer.contact_loss[-1] == pytest.approx(0.5 * inertia * spin**2, abs=STATE)
    turned_by = 0.5 * spin * stops
    start = LAB.state([0, 0, 0.1], [0, 0, 0])
    R = LAB.axes.T @ answer.state(2).R_WB[0] @ start.R_WB[0].T @ LAB.axes
    expected = [[np.cos(turned_by), -np.sin(turned_by), 0], [np.sin(turned_by), np.cos(turned_by), 0], [0, 0, 1]]
    assert pytest.approx(np.array(expected), abs=STATE) == R
    assert all(event.time <= stops + TIME for event in events)


@pytest.mark.parametrize("friction", [0.4, 0.02], ids=["rolls", "slips"])
def test_rolling_friction_slows_a_ball_while_it_rolls_or_slips(friction):
    """Rolling: ``(I + m r^2) w' = -rho m g``; slipping: ``I w' = mu m g r - rho m g`` and ``v' = -mu g``."""
    rho, r, v, m, inertia, t = 0.003, 0.1, 1.4, 2.0, BALL[0], 0.4
    mechanism = LAB.free_body(m, BALL, LEVEL, [LAB.sphere(r, friction=friction, rolling=rho)])
    heading, across = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])
    if friction == 0.4:
        spin, stops = v / r, v * (inertia + m * r**2) / (rho * m * G * r)
        path, rate, times = v**2 / (2 * v / stops), 0.0, [0.0, stops + 0.2]
    else:
        spin, times = 0.5 * v / r, [0.0, t]
        path, rate = v * t - friction * G * t**2 / 2, spin + (friction * m * G * r - rho * m * G) / inertia * t
    start = LAB.state([0, 0, r], v * heading, spin * across)
    answer, _ = simulate_with_contacts(mechanism, start, np.array(times), 1e-13)
    position, _, turning = LAB.centre(answer)
    assert position == pytest.approx(path * heading + [0, 0, r], abs=STATE)
    assert turning == pytest.approx(rate * across, abs=STATE)
