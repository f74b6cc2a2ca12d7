"""Which impulses and losses equilibrium determines along a motion, where joints and drives carry a part of the load."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

import consilience as cs
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    Compliance,
    Drive,
    Frame,
    Joint,
    Mechanism,
    SpherePlane,
    constant,
    determinate_forces,
    drawing_state,
    linear,
)
from consilience.report.contact_values import open_in_words
from consilience.report.trajectory_files import export_trajectory
from contact_problems import BALL, LEVEL, G, Lab

LAB = Lab()
MASS, RADIUS, MU, RATE = 2.0, 0.1, 0.5, 1.5
TIMES = np.linspace(0.0, 0.4, 5)
HERE = Frame(np.zeros(3), np.eye(3))


def on_rail(motion=None, overlap=0.0, guided=False, **law):
    """A ball that a drive moves along x of the lab, on a floor; `guided`: it may move along z on a carriage as well."""
    centre = LAB.origin + (RADIUS - overlap) * LAB.axes[:, 2]
    along = Frame(centre, LAB.axes[:, [1, 2, 0]])  # z of the frames of a prismatic joint is its axis
    across = Frame(centre, LAB.axes)
    inertia = LAB.principal @ np.diag(BALL) @ LAB.principal.T
    ball = Body("ball", MASS, centre, 0.5 * (inertia + inertia.T), HERE)
    rail = Joint("rail", "prismatic", GROUND, "carriage" if guided else "ball", along, along)
    guide = Joint("guide", "prismatic", "carriage", "ball", across, across)
    floor = SpherePlane("floor", "ball", centre, RADIUS, GROUND, LAB.origin, LAB.axes[:, 2], **law)
    drive = Drive("motor", "rail", "distance", linear(RATE) if motion is None else motion)
    bodies = (ball, replace(ball, name="carriage")) if guided else (ball,)
    joints = (rail, guide) if guided else (rail,)
    mechanism = Mechanism("rail", LAB.axes @ LEVEL, bodies, joints, drives=(drive,), contacts=(floor,))
    still = drawing_state(mechanism)
    speed = mechanism.drives[0].motion.at(0.0)[1]
    return mechanism, replace(still, v_WB_W=np.tile(speed * LAB.axes[:, 0], (len(bodies), 1)))


@pytest.mark.parametrize(
    ("law", "loss"),
    [({"friction": MU}, True), ({}, False), ({"friction": MU, "motion": constant(0.0)}, False)],
    ids=["slides", "smooth", "halted"],
)
def test_a_rail_and_a_plane_share_the_load_in_ways_that_no_law_tells(law, loss):
    """Any N that is not negative is in equilibrium; with friction the drive gives mu N v, and the contact loses it."""
    motion = cs.simulate(*on_rail(**law), TIMES)
    found = motion.open_forces()
    assert np.all(found.contacts[1:].any(axis=2))
    assert np.array_equal(found.contacts, found.sums)
    assert not found.contacts[0].any()
    assert list(found.loss) == [False] + 4 * [loss]


def test_what_a_law_or_equilibrium_gives_is_told_though_a_drive_moves_the_body():
    """On a guide across the rail N bears the weight; a compliant contact presses by its overlap: both lose mu N v t."""
    overlap, stiffness = 1e-3, 3e4
    soft = on_rail(overlap=overlap, friction=MU, compliance=Compliance(stiffness))
    for (mechanism, start), N in ((on_rail(guided=True, friction=MU), MASS * G), (soft, stiffness * overlap)):
        motion = cs.simulate(mechanism, start, TIMES)
        found = motion.open_forces()
        assert not any(part.any() for part in (found.contacts, found.sums, found.loss))
        assert motion.contact_loss == pytest.approx(MU * N * RATE * TIMES, abs=1e-9)
        assert motion.contact_impulse[1:, 0] @ LAB.axes[:, 2] == pytest.approx(N * np.diff(TIMES), abs=1e-9)


def test_feet_that_hit_between_samples_leave_their_shares_open_and_their_sum_told():
    """Rough feet that rebound at once: nine impulses, six equations; their sum is that of the centre of mass."""
    feet = LAB.points([(0.3, 0.1, -0.2), (-0.2, 0.2, -0.2), (0.1, -0.3, -0.2)], friction=MU, restitution=0.5)
    mechanism = LAB.free_body(MASS, BALL, LEVEL, feet)
    motion = cs.simulate(mechanism, LAB.state((0.0, 0.0, 0.4), (0.0, 0.0, 0.0)), np.array([0.0, 0.1, 0.3]))
    found = motion.open_forces()
    assert not any(part.any() for part in (motion.contact_mode, found.sums, found.loss))
    assert [bool(at.any()) for at in found.contacts] == [False, False, True]
    (line,) = open_in_words(mechanism, motion)
    assert line.startswith("open at some samples: contact_impulse of foot 0, foot 1, foot 2 (")


CORNERS, SPIN = np.array([(x, y, -0.1) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]), 10.0
SIGNS = np.array([1.0, -1.0, -1.0, 1.0])  # shares of the corners that have no sum and no moment
MOMENTS, FALL = np.array([0.05, 0.05, 0.08]), 1.0


def _after(N, v, rebound):
    """Velocity and spin of the box after normal impulses N, with friction against the slip after the impact."""

    def balance(z):
        slip = (z[:3] + np.cross(z[3:], CORNERS)) * [1.0, 1.0, 0.0]
        P = N[:, None] * ([0.0, 0.0, 1.0] - MU * slip / np.linalg.norm(slip, axis=1)[:, None])
        return np.r_[MASS * (z[:3] - v) - P.sum(axis=0), MOMENTS * (z[3:] - [0, 0, SPIN]) - np.cross(CORNERS, P).sum(0)]

    return fsolve(balance, [v[0], v[1], rebound * FALL, 0.0, 0.0, 0.8 * SPIN], xtol=1e-12)


def _of_share(share, v, rebound):
    """Velocities after an impact in which all corners rebound, where each carries `share` more or less than others."""

    def normals(q):
        return q[0] + q[1] * np.sign(CORNERS[:, 0]) + q[2] * np.sign(CORNERS[:, 1]) + share * SIGNS

    def off(q):
        z = _after(normals(q), v, rebound)
        return [z[2] - rebound * FALL, z[3], z[4]]

    q = fsolve(off, [(1.0 + rebound) * MASS * FALL / 4.0, 0.0, 0.0], xtol=1e-11)
    assert np.max(np.abs(off(q))) < 1e-9
    assert np.min(normals(q)) > 0.0
    return _after(normals(q), v, rebound)


@pytest.mark.parametrize("rebound", [0.0, 0.5])
def test_a_box_that_lands_on_four_corners_while_it_turns_and_slides_is_refused(rebound):
    """Shares that no law tells lead to other velocities: two of them, solved apart, satisfy all laws."""
    feet, thrown = LAB.points(CORNERS, friction=MU, restitution=rebound), np.array([0.5, 0.2, -FALL])
    box = LAB.free_body(MASS, MOMENTS, LEVEL, feet)
    even, uneven = (_of_share(share, thrown, rebound) for share in (0.0, 0.1))
    assert np.max(np.abs(even - uneven)) > 1e-3
    told = "impact of foot 0, foot 1, foot 2, foot 3 at t = 0 s: the laws of .* allow several .* velocities afterwards"
    with pytest.raises(NumericalFailure, match=told):
        cs.simulate(box, LAB.state((0, 0, 0.1), thrown, (0, 0, SPIN)), np.array([0.0, 1e-3]))


@pytest.mark.parametrize("spin", [0.0, SPIN])
def test_a_box_that_lands_while_it_slides_or_turns_alone_is_answered(spin):
    """Slip has one direction, or is across the arms: shares without sum and moment change nothing."""
    rebound, slide, reach = 0.5, 2.0 * (spin == 0.0), 0.2 * np.sqrt(2.0)
    feet = LAB.points(CORNERS, friction=0.3, restitution=rebound)
    box = LAB.free_body(MASS, MOMENTS, LEVEL, feet)
    motion = cs.simulate(box, LAB.state((0, 0, 0.1), (slide, 0.0, -FALL), (0, 0, spin)), np.array([0.0, 1e-3]))
    _, v, w = LAB.centre(motion)
    impulse = 0.3 * (1.0 + rebound) * MASS * FALL
    braked = slide - impulse / MASS if slide else 0.0
    assert v == pytest.approx([braked, 0.0, rebound * FALL - 1e-3 * G], abs=1e-9)
    assert w == pytest.approx([0.0, 0.0, spin - impulse * reach / MOMENTS[2] if spin else 0.0], abs=1e-9)


def test_friction_about_the_normal_shares_a_torque_with_friction_across():
    """Two rough spheres in line: a couple of their friction balances torsional moments, where there are any."""
    spheres = [SpherePlane(n, "b", (x, 0, RADIUS), RADIUS, GROUND, np.zeros(3), (0, 0, 1), friction=MU)
               for n, x in (("left", -0.3), ("right", 0.3))]  # fmt: skip
    body, joint = Body("b", MASS, np.zeros(3), np.diag(BALL), HERE), Joint("free", "free", GROUND, "b", HERE, HERE)
    mechanism = Mechanism("two", np.array(LEVEL), (body,), (joint,), contacts=tuple(spheres))
    turning = replace(mechanism, contacts=tuple(replace(s, torsional=0.01) for s in spheres))
    for one, across in ((mechanism, True), (turning, False)):
        found = determinate_forces(one, drawing_state(one))
        assert found.pairs.all()
        assert found.contacts.tolist() == [[False, across, True]] * 2


def test_files_and_words_tell_what_is_open(tmp_path):
    mechanism, start = on_rail(friction=MU)
    motion = cs.simulate(mechanism, start, TIMES)
    export_trajectory(mechanism, motion, tmp_path / "motion.csv")
    with (tmp_path / "motion.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    columns = [f"floor.contact_{what}_open.{axis}" for what in ("impulse", "sum") for axis in "xyz"]
    assert [[row[name] for name in (*columns, "contact_loss_open")] for row in rows] == [["False"] * 7] + 4 * [
        ["True"] * 7
    ]
    (line,) = open_in_words(mechanism, motion)
    assert "contact_impulse of floor; its sum over two bodies of floor; contact_loss (" in line
