"""Which forces equilibrium determines beside contacts, stops and dry friction: textbook statics in skew axes."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.mechanism import (
    GROUND,
    DryFriction,
    Frame,
    Joint,
    Mechanism,
    PointPlane,
    Stop,
    contact_pairs,
    determinate_forces,
    determinate_reactions,
    drawing_state,
)
from mechanisms import GRAVITY, four_bar, lumpy_body, rotation

FORCE, TORQUE, PLANE_FORCE = slice(0, 3), slice(3, 6), slice(0, 2)


def slab(friction, **elements):
    """A lumpy body in a skew plane, a point of it on a line of that plane."""
    rng = np.random.default_rng(5)
    body = lumpy_body("slab", rng)
    R, place = rotation(rng), np.array([0.2, -0.1, 0.4])
    own = body.drawing
    M = Frame(own.R.T @ (place - own.p), own.R.T @ R)
    plane = Joint("plane", "planar", GROUND, "slab", Frame(place, R), M)
    corner = np.array([0.3, -0.2, 0.1])
    normal = R @ [0.6, 0.8, 0.0]
    foot = PointPlane("foot", "slab", corner, GROUND, own.p + own.R @ corner, normal, friction=friction)
    mechanism = Mechanism("slab", GRAVITY, (body,), (plane,), contacts=(foot,), **elements)
    along = R @ [-0.8, 0.6, 0.0]
    return mechanism, drawing_state(mechanism), along


def test_without_friction_and_where_it_slides_all_forces_are_determined():
    mechanism, at_rest, along = slab(0.0)
    sliding = replace(at_rest, v_WB_W=0.7 * along[None])
    for found in (determinate_forces(mechanism, at_rest), determinate_forces(slab(0.4)[0], sliding)):
        assert all(part.all() for part in found)


def test_friction_that_sticks_shares_the_force_across_the_plane_with_the_joint():
    """Three rows of the joint, three of the contact, and one of each is along the normal of the plane."""
    mechanism, at_rest, _ = slab(0.4)
    reactions, pairs, contacts = determinate_forces(mechanism, at_rest)
    assert np.array_equal(contacts, pairs)
    assert reactions[0, PLANE_FORCE].all()
    assert not reactions[0, 2]
    assert not pairs.any()  # the open force is along a skew direction
    assert determinate_reactions(mechanism, at_rest).all()


def test_a_contact_that_is_apart_leaves_nothing_open():
    mechanism, at_rest, _ = slab(0.4)
    (foot,) = mechanism.contacts
    apart = replace(mechanism, contacts=(replace(foot, point=foot.point - 0.01 * foot.normal),))
    assert all(part.all() for part in determinate_forces(apart, at_rest))


@pytest.mark.parametrize("element", ["stop", "dry friction"])
def test_what_holds_one_coordinate_twice_is_open(element):
    """A hinge at its stop, and a frictionless point that holds the hinge as well: the share of each is open."""
    mechanism, _, _ = slab(0.0)
    hinge = replace(mechanism.joints[0], kind="revolute", name="hinge")
    held = replace(mechanism, joints=(hinge,))
    at_rest = drawing_state(held)
    assert all(part.all() for part in determinate_forces(held, at_rest))
    acting = {
        "stop": {"stops": (Stop("stop", "hinge", "angle", lower=0.0),)},
        "dry friction": {"dry_frictions": (DryFriction("pin", "hinge", "angle", bound=1.0),)},
    }[element]
    reactions, pairs, _ = determinate_forces(replace(held, **acting), at_rest)
    assert not pairs.any()
    assert not reactions[0, PLANE_FORCE].any()
    assert reactions[0, 5]  # no torque about the hinge's axis


def test_joints_alone_are_as_before():
    mechanism = four_bar()
    state = drawing_state(mechanism)
    assert np.array_equal(determinate_forces(mechanism, state)[0], determinate_reactions(mechanism, state))


def test_forces_of_a_pair_add_up_with_the_sign_of_the_side():
    mechanism, _, _ = slab(0.0)
    (foot,) = mechanism.contacts
    assert contact_pairs([foot, replace(foot, body=GROUND, partner="slab")]).tolist() in ([[1.0, -1.0]], [[-1.0, 1.0]])


def test_feet_share_the_force_of_a_body_in_ways_that_leave_its_sum_determined():
    """Three rough feet on a skew floor: nine forces, six equations; their sum is the weight's."""
    _, at_rest, _ = slab(0.4)
    mechanism, _, _ = slab(0.4)
    (foot,), (body,) = mechanism.contacts, mechanism.bodies
    n = foot.normal
    arms = np.cross(n, [[0.3, 0.1, 0.0], [-0.2, 0.2, 0.1], [0.1, -0.3, 0.2]])
    feet = [
        replace(foot, name=f"foot {k}", corner=body.drawing.R.T @ (foot.point + arm - body.drawing.p))
        for k, arm in enumerate(arms)
    ]
    free = replace(mechanism.joints[0], kind="free")
    found = determinate_forces(replace(mechanism, joints=(free,), contacts=tuple(feet)), at_rest)
    assert found.pairs.all()
    assert not found.contacts.any()
