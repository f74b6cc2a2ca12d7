"""Contacts, stops and dry friction as data: what is refused, gaps of all shapes, tangents, units, files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from consilience.case import Case, load_case
from consilience.case.file.reader import cases_from_tables
from consilience.case.file.writer import case_table
from consilience.engine import Question
from consilience.engine.worker.codec import encode, value_of
from consilience.engine.worker.wire import MessageHeader
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    CapsulePlane,
    Compliance,
    Cone,
    DiscPlane,
    Drive,
    DryFriction,
    Frame,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    Stop,
    contact_gap,
    contact_parts,
    contact_tangents,
    elementary_contacts,
    in_units,
    joint_spring_motion,
    linear,
    nearest_points,
    quaternion_from_rotation_vector,
    quaternion_product,
    random_states,
    refuse_overlap,
    sharing_rows,
)
from consilience.reference.contact import simulate_with_contacts
from consilience.reference.engine import ReferenceEngine
from contact_problems import LEVEL, G, Lab, turned

ZERO, X, Z = np.zeros(3), np.eye(3)[0], np.eye(3)[2]
AT_HOME = Frame(ZERO, np.eye(3))
FLOOR = (GROUND, np.array([0.3, -0.2, -0.4]), np.array([0.2, -0.3, 1.0]))
SKEW = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0
LAWS = {
    "restitution": 0.4,
    "friction": 0.3,
    "static_friction": 0.5,
    "cone": Cone("pyramid", 6, 0.2, (1.0, 0.5, 0.0)),
    "associated": True,
    "impact_law": "poisson",
    "torsional": 0.01,
    "rolling": 0.02,
}


def contacts(**law):
    """One contact of each class, off every axis."""
    at = np.array([0.1, 0.2, -0.1])
    return (
        SpherePlane("sphere", "a", at, 0.1, *FLOOR, **law),
        PointPlane("point", "a", at, *FLOOR, **law),
        SphereSphere("pair", "a", at, 0.1, "b", at + X, 0.2, **law),
        BoxPlane("box", "a", at, np.array([0.1, 0.2, 0.3]), "b", *FLOOR[1:], orientation=SKEW, **law),
        CapsulePlane("capsule", "a", at, at + X, 0.1, *FLOOR, **law),
        DiscPlane("disc", "a", at, np.array([1.0, 2.0, 2.0]), 0.3, *FLOOR, **law),
    )


def mechanism(**groups):
    """Two bodies that float, and a slide from one to the other."""
    joints = (
        Joint("free_a", "free", GROUND, "a", AT_HOME, AT_HOME),
        Joint("free_b", "free", GROUND, "b", AT_HOME, AT_HOME),
        Joint("slide", "cylindrical", "a", "b", AT_HOME, AT_HOME),
    )
    bodies = tuple(Body(name, 1.0, ZERO, np.eye(3), AT_HOME) for name in "ab")
    return Mechanism("m", ZERO, bodies, joints, **groups)


def state(seed=0):
    """A random state, not of the slide."""
    rng = np.random.default_rng(seed)
    turns = np.array([quaternion_from_rotation_vector(rng.normal(size=3)) for _ in range(2)])
    return State(rng.normal(size=(2, 3)), turns, rng.normal(size=(2, 3)), rng.normal(size=(2, 3)))


def everything():
    """A mechanism with each contact, stop and dry friction, its frames coincident in the drawing."""
    return mechanism(
        contacts=(*contacts(**LAWS), SpherePlane("soft", "a", X, 0.1, *FLOOR, compliance=Compliance(1e4, 2.0))),
        stops=(Stop("end", "slide", "distance", -0.5, None, 0.3), Stop("turn", "slide", "angle", -1.0, 2.0)),
        dry_frictions=(
            DryFriction("rub", "slide", "distance", 3.0),
            DryFriction("pin", "slide", "angle", coefficient=0.2, radius=0.01),
        ),
    )


def numbers(value):
    """All values of the fields of a dataclass, arrays as lists."""
    if hasattr(value, "__dataclass_fields__"):
        return {name: numbers(one) for name, one in vars(value).items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def test_a_message_and_a_case_file_hold_every_field():
    m = everything()
    tree, arrays = encode(m)
    sent = value_of(MessageHeader({"value": tree}), arrays)
    table = case_table(Case.of(m))
    (read,) = cases_from_tables("m", "m.toml", table)
    for group in ("contacts", "stops", "dry_frictions"):
        for old, new, written in zip(
            getattr(m, group), getattr(sent, group), getattr(read.mechanism, group), strict=True
        ):
            assert numbers(new) == numbers(old)
            assert type(written) is type(old)
            assert flat(written) == pytest.approx(flat(old), abs=1e-14)


def flat(value):
    """Names and numbers of a dataclass in one dict."""
    found = {}
    for name, one in numbers(value).items():
        parts = one.items() if isinstance(one, dict) else [("", one)]
        for key, part in parts:
            for n, number in enumerate(np.ravel(np.array(part, dtype=object))):
                found[name, key, n] = number
    return found


@pytest.mark.parametrize("contact", contacts(), ids=lambda c: c.name)
def test_the_gap_is_the_least_distance_of_points_of_the_shapes(contact):
    m, s = mechanism(), state(3)
    R, p = s.R_WB, s.p_WB
    plane = (p[1], R[1]) if contact.partner == "b" else (ZERO, np.eye(3))
    if isinstance(contact, SphereSphere):
        apart = p[0] + R[0] @ contact.center - p[1] - R[1] @ contact.partner_center
        expected = np.linalg.norm(apart) - 0.3
    else:
        n = plane[1] @ contact.normal
        off = plane[0] + plane[1] @ contact.point

        def height(point):
            return n @ (p[0] + R[0] @ point - off)

        if isinstance(contact, DiscPlane):
            e1 = np.cross(contact.axis, X)
            e1 /= np.linalg.norm(e1)
            e2 = np.cross(contact.axis, e1)

            def rim(t):
                return height(contact.center + 0.3 * (np.cos(t) * e1 + np.sin(t) * e2))

            coarse = min(np.linspace(0, 2 * np.pi, 33), key=rim)
            expected = minimize_scalar(rim, bracket=(coarse - 0.2, coarse, coarse + 0.2), tol=1e-12).fun
        elif isinstance(contact, BoxPlane):
            grid = np.array(np.meshgrid(*[(-1.0, 0.3, 1.0)] * 3)).reshape(3, -1).T
            expected = min(height(contact.center + SKEW @ (g * contact.half_sizes)) for g in grid)
        elif isinstance(contact, CapsulePlane):
            expected = min(height(x) for x in np.linspace(contact.start, contact.end, 5)) - 0.1
        else:
            expected = height(contact.center) - contact.radius
    assert contact_gap(m, s, contact) == pytest.approx(expected, abs=1e-9)
    for part in contact_parts(contact):
        found = nearest_points(m, s, part)
        assert found.on_body - found.on_partner == pytest.approx(found.gap * found.normal, abs=1e-12)


def test_a_flat_disc_touches_with_a_point_of_its_rim():
    disc = DiscPlane("d", "a", ZERO, Z, 0.3, GROUND, ZERO, Z)
    flat = State([[0, 0, 0.1], ZERO], [[1, 0, 0, 0]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    found = nearest_points(mechanism(), flat, disc)
    assert found.gap == pytest.approx(0.1)
    assert np.linalg.norm(found.on_body - [0, 0, 0.1]) == pytest.approx(0.3)


def test_parts_keep_names_and_laws_in_order():
    parts = elementary_contacts(mechanism(contacts=contacts(**LAWS)))
    assert [p.name for p in parts][3:11] == [f"box[{n}]" for n in range(8)]
    assert [p.name for p in parts][11:] == ["capsule[0]", "capsule[1]", "disc"]
    assert all(getattr(p, name) == value for p in parts for name, value in LAWS.items())


@pytest.mark.parametrize(
    ("tangent", "normal", "first"),
    [
        (None, Z, X),  # x of the partner
        (None, X, [0, 1, 0]),  # y where the normal is along x
        ((0.0, 1.0, 1.0), Z, [0, 1, 0]),  # projected
        (None, np.array([1.0, 2.0, 2.0]) / 3.0, np.array([8.0, -2.0, -2.0]) / np.sqrt(72.0)),
    ],
)
def test_tangents_follow_the_stated_rule(tangent, normal, first):
    t1, t2 = Cone(tangent=tangent).tangents(normal)
    assert t1 == pytest.approx(np.array(first, dtype=float), abs=1e-15)
    assert t2 == pytest.approx(np.cross(normal, t1), abs=1e-15)


def test_tangents_turn_with_the_partner():
    s, contact = state(5), contacts(cone=Cone("box"), friction=0.2)[3]
    R, (part, *_) = s.R_WB[1], contact_parts(contact)
    t1, t2 = contact_tangents(mechanism(), s, part)
    n = R @ contact.normal
    assert t1 == pytest.approx((R @ X - (n @ R @ X) * n) / np.linalg.norm(np.cross(n, R @ X)), abs=1e-14)
    assert t2 == pytest.approx(np.cross(n, t1), abs=1e-14)


def test_features_tell_shapes_and_laws_apart():
    plain = mechanism(contacts=contacts()).features
    assert {f for f in plain if "contact" in f} == {
        *(f"{shape} on plane contact" for shape in ("sphere", "point", "box", "capsule", "disc")),
        *("sphere on sphere contact", "moving plane contact"),
    }
    laws = everything().features.keys() - plain.keys()
    assert laws == {
        *("contact restitution", "contact friction", "static friction", "pyramid cone", "associated cone"),
        *("Poisson impact", "torsional friction", "rolling friction", "compliant contact"),
        *("stop", "stop restitution", "dry friction", "dry friction of a reaction"),
    }


def test_gaps_and_limits_are_the_same_in_other_units():
    m, s = everything(), state(7)
    other = in_units(m, 100.0, 1e3, 10.0, {"slide": -1.0})
    moved = State(100.0 * s.p_WB, s.quat_WB, 10.0 * s.v_WB_W, 0.1 * s.w_WB_W)
    for old, new in zip(m.contacts, other.contacts, strict=True):
        assert contact_gap(other, moved, new) == pytest.approx(100.0 * contact_gap(m, s, old), rel=1e-13)
    assert (other.stops[0].lower, other.stops[0].upper) == (None, 50.0)
    assert (other.stops[1].lower, other.stops[1].upper) == (-2.0, 1.0)
    force = 1e3 * 100.0 / 10.0**2
    assert other.contacts[-1].compliance == Compliance(1e4 * force / 100.0, 2.0 * force * 10.0 / 100.0)
    assert other.dry_frictions[0].bound == pytest.approx(3.0 * force)
    assert (other.dry_frictions[1].coefficient, other.dry_frictions[1].radius) == (0.2, 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Cone("star"), "cone: kind: 'star' is none; Use one of circle, pyramid, box"),
        (lambda: Cone("pyramid", 2), "cone: facets: 2 make no pyramid"),
        (lambda: Cone("box", 6), "cone: box: it has no facets"),
        (lambda: Cone(tangent=(0.0, 0.0, 0.0)), "cone: tangent: it is the zero vector"),
        (lambda: Compliance(0.0), "stiffness: 0 is out of range"),
        (lambda: contacts(cone=Cone("box")), "friction: it is missing beside a box cone"),
        (lambda: contacts(associated=True), "friction: it is missing beside associated"),
        (lambda: contacts(friction=0.4, static_friction=0.3), "static_friction: 0.3 is out of range"),
        (lambda: contacts(restitution=0.1, compliance=Compliance(1.0)), "restitution: a spring and a damper decide"),
        (lambda: contacts(rebound_threshold=0.1, compliance=Compliance(1.0)), "rebound_threshold: a spring and"),
        (lambda: contacts(impact_law="moreau", compliance=Compliance(1.0)), "impact_law: a spring and a damper decide"),
        (lambda: contacts(friction="much"), "friction: 'much' is no number"),
        (lambda: contacts(impact_law="stronge"), "impact_law: 'stronge' is none"),
        (lambda: contacts(friction=0.1, cone=Cone(tangent=(0.2, -0.3, 1.0))), "cone: tangent: it is along the normal"),
        (lambda: PointPlane("p", "a", ZERO, "a", ZERO, Z), "both sides are 'a'"),
        (lambda: SpherePlane("p", "a", ZERO, 0.0, "b", ZERO, Z), "radius: 0 is out of range"),
        (lambda: SpherePlane("p", "a", ZERO, 1e-300, "b", ZERO, Z), "radius: 1e-300 is out of range"),
        (lambda: BoxPlane("p", "a", ZERO, [0.1, 1e160, 0.1], "b", ZERO, Z), "half_sizes: 1e+160 is out of range"),
        (lambda: PointPlane("p", "a", ZERO, "b", ZERO, ZERO), "normal: it is the zero vector"),
        (lambda: BoxPlane("p", "a", ZERO, [0.1, 0.0, 0.1], "b", ZERO, Z), "half_sizes: 0 is out of range"),
        (lambda: CapsulePlane("p", "a", X, X, 0.1, "b", ZERO, Z), "the ends of the capsule coincide"),
        (lambda: Stop("s", "slide", "angle"), "it has no limit"),
        (lambda: Stop("s", "slide", "angle", 1.0, 1.0), "lower 1 is not below upper 1"),
        (lambda: Stop("s", "slide", "angle", 0.0, restitution=2.0), "restitution: 2.0 is out of range"),
        (lambda: DryFriction("d", "slide", "angle"), "none of bound and coefficient given"),
        (lambda: DryFriction("d", "slide", "distance", 1.0, 0.2), "both of bound and coefficient given"),
        (lambda: DryFriction("d", "slide", "angle", coefficient=0.2), "the radius of the pin is missing"),
        (lambda: DryFriction("d", "slide", "distance", coefficient=0.2, radius=0.1), "it has no pin"),
        (lambda: DryFriction("d", "slide", "angle", -1.0), "bound: -1 is negative"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(InvalidInput) as error:
        make()
    assert message.partition(";")[0] in str(error.value)


@pytest.mark.parametrize("name", ["pulled_boxes", "ball_in_corner-leaves", "bouncing_table", "hinge_between_stops"])
def test_random_states_keep_closed_what_is_closed_at_the_start(name):
    """Gaps and limits are differenced along the motion of each state."""
    case = load_case(name)
    m, start = case.mechanism, case.initial_state
    if m.stops:
        m = replace(m, stops=(replace(m.stops[0], lower=0.5),))  # the coordinate of the start
    for one in random_states(m, start, 3, 5):
        assert np.array_equal(one.p_WB, start.p_WB)
        assert np.ptp(one.v_WB_W) + np.ptp(one.w_WB_W) > 1e-3 or m.stops
        h, ends = 1e-6, []
        for dt in (-h, h):
            turned = [
                quaternion_product(quaternion_from_rotation_vector(dt * w), q)
                for w, q in zip(one.w_WB_W, one.quat_WB, strict=True)
            ]
            moved = State(one.p_WB + dt * one.v_WB_W, np.array(turned), one.v_WB_W, one.w_WB_W)
            places = [nearest_points(m, moved, part).gap for part in elementary_contacts(m)]
            ends.append(places + [joint_spring_motion(m, moved, x.joint, x.coordinate)[0] for x in m.stops])
        closed = [nearest_points(m, start, part).gap < 1e-9 for part in elementary_contacts(m)] + [True] * len(m.stops)
        assert np.abs(np.subtract(*ends))[closed] / (2 * h) == pytest.approx(np.zeros(sum(closed)), abs=1e-8)


@pytest.mark.parametrize(("feet", "turns"), [(3, True), (4, False)])
def test_random_states_on_more_than_three_feet_of_one_plane_do_not_turn_on_it(feet, turns):
    """How four feet share a load is open: only with one direction of all slips is the motion not open, too."""
    lab, corners = Lab(), [[0.3, 0.2, -0.1], [-0.3, 0.2, -0.1], [0.3, -0.2, -0.1], [-0.3, -0.2, -0.1]]
    mechanism = lab.free_body(2.0, (0.05, 0.07, 0.09), LEVEL, lab.points(corners[:feet], friction=0.3))
    start, reference = lab.state((0, 0, 0.1), (0, 0, 0)), ReferenceEngine()
    states = random_states(mechanism, start, 5, seed=3)
    answer = reference.instant(mechanism, states, reference.methods(mechanism, Question.INSTANT)[0])
    for k, state in enumerate(states):
        arm = state.R_WB[0] @ lab.com
        velocity, spin = lab.axes.T @ (state.v_WB_W[0] + np.cross(state.w_WB_W[0], arm)), lab.axes.T @ state.w_WB_W[0]
        assert abs(velocity[2]) < 1e-12
        assert np.linalg.norm(velocity) > 1e-2
        assert (abs(spin[2]) > 1e-2) == turns
        if not turns:
            a = lab.axes.T @ (answer.a_WB_W[k, 0] + np.cross(answer.alpha_WB_W[k, 0], arm))
            assert a == pytest.approx(-0.3 * G * velocity / np.linalg.norm(velocity), abs=1e-11)


def test_a_box_in_a_corner_shares_its_load_on_each_plane_by_itself():
    lab, sizes = Lab(), np.array([0.3, 0.2, 0.1])
    floor, wall = (
        BoxPlane(
            name, "body", lab.com, sizes, GROUND, lab.origin, lab.axes[:, k], orientation=lab.principal, friction=0.3
        )
        for name, k in (("floor", 2), ("wall", 0))
    )
    mechanism = lab.free_body(2.0, (0.05, 0.07, 0.09), LEVEL, [floor, wall])
    rows = sharing_rows(mechanism, lab.state((0.3, 0, 0.1), (0, 0, 0)))
    np.testing.assert_allclose(rows, [[0, 0, 0, *lab.axes[:, 2]], [0, 0, 0, *lab.axes[:, 0]]], atol=1e-12)


def test_a_disc_parallel_to_its_plane_is_refused_by_name():
    """The slope of the gap of a disc is undefined there: a motion had gaps that are no numbers."""
    lab = Lab()
    disc = DiscPlane("rim", "body", lab.com, lab.principal[:, 2], 0.1, GROUND, lab.origin, lab.axes[:, 2])
    mechanism = lab.free_body(1.0, (0.01, 0.01, 0.02), LEVEL, [disc])
    state, reference = lab.state((0, 0, 0.3), (0, 0, 0)), ReferenceEngine()
    tilted = lab.state((0, 0, 0.3), (0, 0, 0), turn=turned(1e-6, 0.0, 0.0))
    for asked in (
        lambda at: simulate_with_contacts(mechanism, at, [0.0, 0.1]),
        lambda at: reference.instant(mechanism, [at], reference.methods(mechanism, Question.INSTANT)[0]),
    ):
        with pytest.raises(InvalidInput, match="contact 'rim': the disc is parallel to the plane"):
            asked(state)
        asked(tilted)


def test_a_start_that_overlaps_or_is_beyond_a_stop_is_refused():
    together = State(np.zeros((2, 3)), [[1, 0, 0, 0]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    flat = BoxPlane("box", "a", ZERO, [0.1, 0.1, 0.1], GROUND, -0.1 * Z, Z)
    refuse_overlap(mechanism(contacts=(flat,), stops=(Stop("s", "slide", "distance", 0.0),)), together)
    with pytest.raises(InvalidInput, match=r"contact 'box': a and ground overlap by 0\.05 m at the start"):
        refuse_overlap(mechanism(contacts=(replace(flat, point=-0.05 * Z),)), together)
    refuse_overlap(mechanism(contacts=(replace(flat, point=-0.05 * Z, compliance=Compliance(1e4)),)), together)
    with pytest.raises(InvalidInput, match=r"stop 's': angle 0 of 'slide' is beyond the limit 0\.2"):
        refuse_overlap(mechanism(stops=(Stop("s", "slide", "angle", lower=0.2),)), together)
    table = case_table(Case.of(mechanism(contacts=(replace(flat, point=-0.05 * Z),))))
    with pytest.raises(InvalidInput, match=r"^over\.toml: contact 'box': .* overlap"):
        _ = cases_from_tables("over", "over.toml", table)[0].initial_state


def test_a_stop_in_a_driven_coordinate_is_refused():
    drive, stop = Drive("motor", "slide", "angle", linear(1.0)), Stop("s", "slide", "angle", 0.0)
    with pytest.raises(InvalidInput, match="stop 's': drive 'motor' moves this coordinate"):
        mechanism(drives=(drive,), stops=(stop,))


def test_a_contact_force_is_expected_of_a_contact_at_the_start():
    table = case_table(load_case("box_tips"))
    force = next(one for one in table["published"] if "contact" in one)
    for change, message in (
        ({"contact": "roof"}, "there is no contact 'roof'"),
        ({"time": 0.1}, "a contact force is expected at the start"),
        ({"body": "box"}, "name the contact and nothing else"),
    ):
        with pytest.raises(InvalidInput, match=message):
            cases_from_tables("c", "c.toml", table | {"published": [force | change]})
