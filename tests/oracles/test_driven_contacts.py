"""Contacts with what drives move, against closed forms: drives give and take energy, which is no loss of contacts.

Sliders in a turned world, z out of the plate. The plate is driven by ``z = A sin(w t)``; flights are parabolas, whose
ends are roots of one variable.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from consilience.errors import NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    Compliance,
    Cone,
    Drive,
    Frame,
    Function,
    Initial,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    State,
    initial_state,
    sine,
)
from consilience.reference.contact import contact_instant, simulate_with_contacts
from mechanisms import rotation

TURN = rotation(np.random.default_rng(47))
G, MASS, ZERO, OFF = 9.81, 2.0, np.zeros(3), np.array([0.03, -0.02, 0.05])
X, Z = TURN[:, 0], TURN[:, 2]
UP, ALONG = TURN, TURN[:, [1, 2, 0]]  # frames with z along Z and X


def body(name, mass, at):
    return Body(name, mass, OFF, np.diag([0.02, 0.03, 0.04]), Frame(at, np.eye(3)))


def slider(name, predecessor, successor, at, axes):
    """Prismatic joint at the origin of its successor; `at` is from that of the predecessor."""
    return Joint(name, "prismatic", predecessor, successor, Frame(at, axes), Frame(ZERO, axes))


def ball_over_plate(amplitude, frequency, height, restitution):
    """Ball of 0.1 m above a plate that a drive shakes."""
    bodies = (body("plate", 5.0, ZERO), body("ball", MASS, height * Z))
    joints = (slider("lift", GROUND, "plate", ZERO, UP), slider("fall", GROUND, "ball", height * Z, UP))
    touch = SpherePlane("touch", "ball", ZERO, 0.1, "plate", ZERO, Z, restitution=restitution)
    shaker = Drive("shaker", "lift", "distance", sine(amplitude, frequency))
    return Mechanism("shaken", -G * Z, bodies, joints, drives=(shaker,), contacts=(touch,))


def lands(flight, plate, after, until):
    """Time of the next landing later than `after`, or None."""
    grid = np.linspace(after, until, 20001)
    below = np.flatnonzero(flight(grid) - plate(grid) < 0.0)
    return brentq(lambda t: flight(t) - plate(t), *grid[below[0] - 1 :][:2], xtol=1e-15) if len(below) else None


def test_a_ball_that_bounces_on_a_shaken_plate_loses_what_restitution_takes_and_no_more():
    A, w, e, end = 0.02, 20.0, 0.8, 1.5
    mechanism = ball_over_plate(A, w, 0.6, e)
    answer, events = simulate_with_contacts(mechanism, initial_state(mechanism), np.linspace(0.0, end, 4), 1e-12)
    t, z, v, times, impulse, loss = 0.0, 0.5, 0.0, [], 0.0, 0.0

    def flight(s):
        return z + v * (s - t) - 0.5 * G * (s - t) ** 2

    while (hit := lands(flight, lambda s: A * np.sin(w * s), t + 1e-6, end)) is not None:
        plate, before = A * w * np.cos(w * hit), v - G * (hit - t)
        t, z, v = hit, flight(hit), plate - e * (before - plate)
        times.append(t)
        impulse += MASS * (v - before)
        loss += 0.5 * MASS * (1.0 - e**2) * (before - plate) ** 2
    assert len(times) == 2
    assert [one.time for one in events] == pytest.approx(times, abs=1e-12)
    assert answer.p_WB[-1, 1] == pytest.approx((flight(end) + 0.1) * Z, abs=1e-10)
    assert np.sum(answer.contact_impulse[:, 0], axis=0) == pytest.approx(impulse * Z, abs=1e-10)
    assert answer.contact_loss[-1] == pytest.approx(loss, abs=1e-10)


def test_a_plate_throws_a_plastic_ball_where_it_falls_away_and_takes_its_speed_at_each_landing():
    A, w, end = 0.05, 18.0, 0.9
    mechanism = ball_over_plate(A, w, 0.1, 0.0)
    rest = Initial(coordinates={"fall": {"distance": 0.0}}, rates={"fall": {"distance": A * w}})
    answer, events = simulate_with_contacts(mechanism, initial_state(mechanism, rest), np.linspace(0.0, end, 4), 1e-12)
    away, times, loss = np.arcsin(G / (A * w**2)) / w, [], 0.0
    while away < end:
        t, z, v = away, A * np.sin(w * away), A * w * np.cos(w * away)

        def flight(s, t=t, z=z, v=v):
            return z + v * (s - t) - 0.5 * G * (s - t) ** 2

        hit = lands(flight, lambda s: A * np.sin(w * s), t + 1e-3, t + 1.0)
        times += [t, hit]
        if hit < end:
            loss += 0.5 * MASS * (v - G * (hit - t) - A * w * np.cos(w * hit)) ** 2
        away += 2.0 * np.pi / w * np.ceil((hit - away) * w / (2.0 * np.pi))
    times = [t for t in times if t < end]
    assert len(times) == 5
    found = [one.time for one in events if one.kind in ("opens", "impact")]
    assert found == pytest.approx(times, abs=1e-12)
    assert answer.contact_loss[-1] == pytest.approx(loss, abs=1e-10)


@pytest.mark.parametrize("share", [1.0 - 1e-4, 1.0 - 1e-6])
@pytest.mark.parametrize("end", [0.5, 1.7, 3.1, 6.0])
@pytest.mark.parametrize("phase", [0.0, 0.4])
def test_no_step_passes_over_a_force_that_falls_a_little_below_its_bound(end, phase, share):
    """Friction holds a load on a shaken table up to ``mu_s g``, a little less than ``A w^2``: there it slips."""
    A, w = 0.05, 6.0
    bodies = (body("table", 5.0, ZERO), body("load", MASS, ZERO))
    here = Frame(ZERO, UP)
    joints = (slider("along", GROUND, "table", ZERO, ALONG), Joint("free", "parallel_axes", GROUND, "load", here, here))
    static = A * w**2 * share / G
    feet = PointPlane("feet", "load", OFF, "table", OFF, Z, friction=0.5 * static, static_friction=static)
    shaker = Drive("shaker", "along", "distance", sine(A, w, phase))
    mechanism = Mechanism("shaken", -G * Z, bodies, joints, drives=(shaker,), contacts=(feet,))
    place, speed = A * np.sin(phase) * np.tile(X, (2, 1)), A * w * np.cos(phase) * np.tile(X, (2, 1))
    state = State(place, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), speed, np.zeros((2, 3)))
    _, events = simulate_with_contacts(mechanism, state, np.array([0.0, end]), 1e-12)
    assert events[0].kind == "slips"
    assert events[0].time == pytest.approx((np.arcsin(share) - phase) / w, abs=1e-11)


def test_friction_takes_the_way_that_a_drive_goes_to_and_fro():
    """A follower that gravity presses on the ground, on a carriage: load m g, way of the drive, no freedom along it."""
    A, w, mu, end = 0.1, 5.0, 0.4, 2.0
    bodies = (body("carriage", 1.0, ZERO), body("follower", MASS, 0.1 * Z))
    joints = (slider("along", GROUND, "carriage", ZERO, ALONG), slider("down", "carriage", "follower", 0.1 * Z, UP))
    foot = PointPlane("foot", "follower", -0.1 * Z, GROUND, ZERO, Z, friction=mu)
    shaker = Drive("shaker", "along", "distance", sine(A, w))
    mechanism = Mechanism("pushed", -G * Z, bodies, joints, drives=(shaker,), contacts=(foot,))
    answer, events = simulate_with_contacts(mechanism, initial_state(mechanism), np.linspace(0.0, end, 5), 1e-12)
    turns = np.pi / w * (np.arange(3) + 0.5)
    ends = np.array([0.0, *turns, end])
    ways = np.diff(A * np.sin(w * ends))
    assert [(one.kind, one.time) for one in events] == [("slips", pytest.approx(t, abs=1e-12)) for t in turns]
    assert answer.contact_loss[-1] == pytest.approx(mu * MASS * G * np.sum(np.abs(ways)), abs=1e-10)
    pushed = MASS * G * (end * Z - mu * np.sign(ways) @ np.diff(ends) * X)
    assert np.sum(answer.contact_impulse[:, 0], axis=0) == pytest.approx(pushed, abs=1e-10)


def on_a_rail(normal, friction, **elements):
    """Block on a rail along X, which touches a plane."""
    touch = SpherePlane("touch", "block", ZERO, 0.1, GROUND, -0.1 * normal, normal, friction=friction)
    rail = slider("rail", GROUND, "block", ZERO, ALONG)
    return Mechanism("railed", -G * Z, (body("block", MASS, ZERO),), (rail,), contacts=(touch,), **elements)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_what_a_drive_presses_into_a_wall_is_told_as_such(friction):
    """``q'' = 1 m/s^2`` into the wall from rest: no force is in the way of a drive."""
    pushes = Drive("ram", "rail", "distance", Function(np.array([0.0, 0.0, 0.5])))
    mechanism = on_a_rail(-X, friction, drives=(pushes,))
    state = initial_state(mechanism)
    for ask in (
        lambda: contact_instant(mechanism, [state]),
        lambda: simulate_with_contacts(mechanism, state, np.linspace(0.0, 1.0, 3)),
    ):
        with pytest.raises(NumericalFailure, match="contact 'touch': joints or drives press its bodies together"):
            ask()


def test_friction_under_a_load_that_a_rail_carries_as_well_is_open():
    """``G_nn = 0`` and no acceleration: any load obeys the laws, and each slows the block in another way."""
    mechanism = on_a_rail(Z, 0.3)
    moving = initial_state(mechanism, Initial(rates={"rail": {"distance": 1.0}}))
    with pytest.raises(NumericalFailure, match="'touch' allow several accelerations: joints carry its load as well"):
        contact_instant(mechanism, [moving])


@pytest.mark.parametrize("cone", [Cone(), Cone("pyramid", 7), Cone("box")], ids=lambda cone: cone.kind)
def test_a_spring_that_just_touches_on_a_rail_holds_nothing_whatever_rounding_leaves_of_its_force(cone):
    """The gap is zero, of either sign by rounding, and so is the bound of friction."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        axes, at = rotation(rng), rng.normal(size=3)
        rail = Joint("rail", "prismatic", GROUND, "block", Frame(at, axes), Frame(ZERO, axes))
        soft = {"friction": 0.5, "cone": cone, "compliance": Compliance(2500.0, 9.0)}
        touch = SpherePlane("touch", "block", ZERO, 0.1, GROUND, at - 0.1 * axes[:, 0], axes[:, 0], **soft)
        mechanism = Mechanism("railed", -G * axes[:, 0], (body("block", MASS, at),), (rail,), contacts=(touch,))
        answer, _ = simulate_with_contacts(mechanism, initial_state(mechanism), np.linspace(0.0, 1.0, 3), 1e-10)
        assert answer.p_WB[-1, 0] == pytest.approx(at, abs=1e-12)
        assert np.max(np.abs(answer.contact_impulse)) < 1e-10
