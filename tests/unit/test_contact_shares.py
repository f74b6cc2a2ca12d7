"""Contacts whose shares of a load equilibrium leaves open: a choice that no law forbids, and determinate sums."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.mechanism import determinate_forces, linear
from consilience.reference.contact import contact_instant, simulate_with_contacts
from consilience.report.contact_motion import contacts_at_frames
from contact_problems import LEVEL, G, Lab

LAB = Lab()
MASS, HALF, HEIGHT = 2.0, 0.5, 0.3
LEGS = HALF * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
TIMES = np.linspace(0.0, 1.0, 11)


def table(centre, friction=0.0, push=0.0):
    """A table on four legs, its centre of mass off the middle by `centre`, m; a push in x grows to `push` N in 1 s."""
    feet = np.column_stack([LEGS - centre, np.full(4, -HEIGHT)])
    legs = LAB.points(feet, friction=friction)
    loads = [(1.0, 0.0, 0.0)] if push else []
    found = LAB.free_body(MASS, (0.2, 0.3, 0.4), LEVEL, legs, loads)
    grows = tuple(replace(load, history=linear(push)) for load in found.loads)
    return replace(found, loads=grows), LAB.state((0.0, 0.0, HEIGHT), (0.0, 0.0, 0.0)), feet


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_four_legs_of_a_table_carry_a_quarter_each(friction):
    """By symmetry of least norm, at an instant and along the motion."""
    mechanism, state, _ = table((0.0, 0.0), friction)
    quarter = LAB.axes @ [0.0, 0.0, MASS * G / 4.0]
    answer, _ = simulate_with_contacts(mechanism, state, TIMES)
    assert contact_instant(mechanism, [state]).contact_force[0] == pytest.approx(np.tile(quarter, (4, 1)), abs=1e-11)
    assert answer.contact_impulse[1:] == pytest.approx(np.tile(0.1 * quarter, (10, 4, 1)), abs=1e-11)


@pytest.mark.parametrize("push", [0.0, 0.35])
def test_no_leg_of_a_table_pulls_while_its_load_moves_and_sums_are_those_of_equilibrium(push):
    """At a load 0.7 off the middle both ways the least norm pulls at the far leg by a tenth of the weight."""
    mechanism, state, feet = table((0.7 * HALF, 0.7 * HALF), 0.4, push * MASS * G)
    answer, _ = simulate_with_contacts(mechanism, state, TIMES)
    found = answer.contact_impulse[1:] @ LAB.axes
    normal, along = found[:, :, 2], np.linalg.norm(found[:, :, :2], axis=2)
    assert np.min(normal) > 0.0
    assert np.all(along <= 0.4 * normal)
    pushed = 0.5 * push * MASS * G * np.diff(TIMES**2)
    balance = np.column_stack([-pushed, 0.0 * pushed, np.full(10, 0.1 * MASS * G)])
    assert np.sum(found, axis=1) == pytest.approx(balance, abs=1e-10)
    assert np.sum(np.cross(feet, found), axis=1) == pytest.approx(np.zeros((10, 3)), abs=1e-10)


def test_a_page_tells_shares_that_are_open_and_what_contacts_of_two_bodies_carry_together():
    mechanism, state, _ = table((0.7 * HALF, 0.7 * HALF), 0.4)
    answer, _ = simulate_with_contacts(mechanism, state, TIMES)
    assert not np.any(determinate_forces(mechanism, state).contacts.all(axis=1))
    told = contacts_at_frames(mechanism, answer, np.arange(len(TIMES)))
    weight = LAB.axes @ [0.0, 0.0, MASS * G]
    for contact in told:
        assert contact["open"] == [True] * len(TIMES)
        assert contact["together"] == [pytest.approx(weight, abs=1e-3)] * len(TIMES)
    three = replace(mechanism, contacts=mechanism.contacts[:3])  # three legs without friction would be determined
    smooth = replace(three, contacts=tuple(replace(leg, friction=0.0) for leg in three.contacts))
    theirs = replace(answer, contact_impulse=answer.contact_impulse[:, :3], contact_mode=answer.contact_mode[:, :3])
    told = contacts_at_frames(smooth, theirs, np.arange(3))
    assert [contact["open"] for contact in told] == [[False] * 3] * 3
