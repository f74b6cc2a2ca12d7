"""Assembly: held coordinates are met, the rest moves least, and contradictions are refused by name."""

from dataclasses import replace

import numpy as np
import pytest

from consilience import Drawing, linear, sine
from consilience.case import load_case
from consilience.errors import CannotAssemble, InvalidInput
from consilience.mechanism import (
    GROUND,
    Coupling,
    Frame,
    Initial,
    Mechanism,
    State,
    Units,
    assemble_positions,
    assemble_velocities,
    constraint_jacobian,
    constraint_residual,
    determinate_reactions,
    drawing_state,
    free_directions,
    in_units,
    initial_state,
    joint_coordinates,
    joint_frames,
    joint_rates,
    move,
    nearby_states,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    random_states,
    relative_motion,
    rotation_angle_between,
    rotation_from_quaternion,
    through,
    velocity_sizes,
    worst_condition,
)
from mechanisms import LOOPS, TREES, chain, drawn_joint, four_bar, lumpy_body, rotation, slider_crank, states_of

ALL = TREES | LOOPS


def coordinate(mechanism, state, joint, name):
    target = mechanism.joints[mechanism.joint_index[joint]]
    return joint_coordinates(target, relative_motion(mechanism, state, target))[name]


def rate(mechanism, state, joint, name):
    target = mechanism.joints[mechanism.joint_index[joint]]
    return joint_rates(target, relative_motion(mechanism, state, target))[name]


def velocities(state):
    return np.hstack([state.v_WB_W, state.w_WB_W]).ravel()


def assert_consistent(mechanism, state):
    assert np.max(np.abs(constraint_residual(mechanism, state)), initial=0) < 1e-13
    rates = constraint_jacobian(mechanism, state) @ velocities(state)
    assert np.max(np.abs(rates), initial=0) < 1e-12


HELD = {
    "revolute": {"angle": 2.5},
    "prismatic": {"distance": -0.8},
    "cylindrical": {"distance": 0.6, "angle": -1.2},
    "universal": {"angle1": 0.9, "angle2": -0.7},
    "spherical": {"orientation": [0.5, -0.5, 0.5, 0.5]},
    "planar": {"x": 0.4, "y": -0.3, "angle": 1.1},
    "free": {"position": [0.1, 0.2, -0.3], "orientation": [0.1, 0.7, -0.1, 0.7]},
}
RATES = {
    "revolute": {"angle": 3.0},
    "prismatic": {"distance": -2.0},
    "cylindrical": {"distance": 1.0, "angle": -4.0},
    "universal": {"angle1": 1.5, "angle2": -2.5},
    "spherical": {"orientation": [1.0, -2.0, 3.0]},
    "planar": {"x": 1.0, "y": -0.5, "angle": 2.0},
    "free": {"position": [1.0, 2.0, -3.0], "orientation": [0.5, -0.6, 0.7]},
}


@pytest.mark.parametrize("backwards", [(), (1,)], ids=["forwards", "backwards"])
@pytest.mark.parametrize("kind", HELD)
def test_held_coordinates_and_rates_of_every_kind_are_met(kind, backwards):
    mechanism = chain("revolute", kind, seed=90, backwards=backwards)
    initial = Initial(
        coordinates={"j0": {"angle": 0.4}, "j1": HELD[kind]}, rates={"j0": {"angle": -1.0}, "j1": RATES[kind]}
    )
    state = initial_state(mechanism, initial)
    assert_consistent(mechanism, state)
    for joint, values in initial.coordinates.items():
        for name, value in values.items():
            found = coordinate(mechanism, state, joint, name)
            if name == "orientation":
                assert rotation_angle_between(found, value) < 1e-12
            else:
                np.testing.assert_allclose(found, value, rtol=0, atol=1e-12)
    for joint, values in initial.rates.items():
        for name, value in values.items():
            np.testing.assert_allclose(rate(mechanism, state, joint, name), value, rtol=0, atol=1e-11)


def test_an_angle_is_held_modulo_full_turns():
    mechanism = chain("revolute", seed=91)
    one, two = (initial_state(mechanism, Initial({"j0": {"angle": a}})) for a in (0.5, 0.5 - 6 * np.pi))
    np.testing.assert_allclose(one.p_WB, two.p_WB, rtol=0, atol=1e-12)
    assert np.max(rotation_angle_between(one.quat_WB, two.quat_WB)) < 1e-12


@pytest.mark.parametrize("name", ALL)
def test_an_assembled_drawing_stays_where_it_is_drawn(name):
    mechanism = ALL[name]
    drawn, found = drawing_state(mechanism), initial_state(mechanism)
    np.testing.assert_allclose(found.p_WB, drawn.p_WB, rtol=0, atol=1e-13)
    assert np.max(rotation_angle_between(found.quat_WB, drawn.quat_WB)) < 1e-13
    assert np.all(velocities(found) == 0)


@pytest.mark.parametrize("make", [four_bar, slider_crank], ids=["four_bar", "slider_crank"])
def test_a_loop_closes_when_one_angle_is_held_and_all_other_bodies_follow(make):
    mechanism = make()
    first = mechanism.joints[0].name
    state = initial_state(mechanism, Initial({first: {"angle": 0.25}}, {first: {"angle": 2.0}}))
    assert_consistent(mechanism, state)
    assert coordinate(mechanism, state, first, "angle") == pytest.approx(0.25, abs=1e-12)
    assert rate(mechanism, state, first, "angle") == pytest.approx(2.0, abs=1e-12)
    # one degree of freedom: the velocities are the null vector of Q, scaled to the held rate
    N = free_directions(mechanism, state)[:, 0]
    np.testing.assert_allclose(velocities(state), N * (velocities(state) @ N), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["loop_universal", "loop_rod", "loop_spherical", "long_chain"])
def test_a_disturbed_pose_moves_no_further_than_it_must(name):
    """To first order the displacement is orthogonal to all free directions: assembly adds no admissible motion.

    Rad and characteristic lengths are alike in the product.
    """
    mechanism = ALL[name]
    guess = drawing_state(mechanism)
    size = 1e-5
    disturbed = move(guess, size * np.random.default_rng(4).normal(size=6 * len(mechanism.bodies)))
    state = assemble_positions(mechanism, disturbed)
    turn = [
        2.0 * _vector_part(a, b) for a, b in zip(disturbed.quat_WB, state.quat_WB, strict=True)
    ]  # small rotation vectors
    step = np.hstack([state.p_WB - disturbed.p_WB, turn]).ravel()
    assert np.linalg.norm(step) > 0.1 * size
    along = free_directions(mechanism, state).T @ (step / velocity_sizes(mechanism) ** 2)
    assert np.max(np.abs(along)) < 1e-3 * np.linalg.norm(step)


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("name", ["four_bar", "slider_crank"])
def test_a_redundant_loop_moves_no_further_than_it_was_disturbed(name, size):
    """Dependent rows look independent off the constraint manifold; their small singular values must not move bodies."""
    mechanism = ALL[name]
    disturbed = move(drawing_state(mechanism), size * np.random.default_rng(2).normal(size=6 * len(mechanism.bodies)))
    state = assemble_positions(mechanism, disturbed)
    assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-13
    assert np.max(np.abs(state.p_WB - disturbed.p_WB)) < 10 * size


def _vector_part(a, b):
    """Return the vector part of ``b a^-1``: half the small rotation vector, in world axes, from a to b."""
    R = rotation_from_quaternion(b) @ rotation_from_quaternion(a).T
    return quaternion_from_rotation(R)[1:]


@pytest.mark.parametrize("name", ["four_bar", "loop_rod", "branched"])
def test_velocities_change_no_more_than_they_must(name):
    """The change of the velocities lies in the row space of Q: orthogonal to the free directions.

    Rad and characteristic lengths are alike in the product.
    """
    mechanism = ALL[name]
    placed = initial_state(mechanism)
    rng = np.random.default_rng(5)
    wanted = State(placed.p_WB, placed.quat_WB, rng.normal(size=placed.p_WB.shape), rng.normal(size=placed.p_WB.shape))
    found = assemble_velocities(mechanism, wanted)
    assert_consistent(mechanism, found)
    change = velocities(found) - velocities(wanted)
    assert np.linalg.norm(change) > 0.1
    alike = change / velocity_sizes(mechanism) ** 2
    np.testing.assert_allclose(free_directions(mechanism, found).T @ alike, 0, atol=1e-13)


def test_velocities_asked_for_a_body_are_kept_where_the_joints_allow_it():
    mechanism = chain("free", seed=92)
    state = initial_state(mechanism, Initial(velocities={"b0": ([1.0, 2.0, 3.0], [0.1, -0.2, 0.3])}))
    np.testing.assert_allclose(state.v_WB_W[0], [1.0, 2.0, 3.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(state.w_WB_W[0], [0.1, -0.2, 0.3], rtol=0, atol=1e-15)


def test_a_pose_given_for_a_body_replaces_the_drawing_as_the_guess():
    mechanism = chain("free", seed=93)
    pose = Frame(np.array([1.0, 2.0, 3.0]), rotation(np.random.default_rng(6)))
    state = initial_state(mechanism, Initial(poses={"b0": pose}))
    np.testing.assert_allclose(state.p_WB[0], pose.p, rtol=0, atol=1e-15)
    np.testing.assert_allclose(rotation_from_quaternion(state.quat_WB[0]), pose.R, rtol=0, atol=1e-15)


# ---------------------------------------------------------------- far away, and of any size


@pytest.mark.parametrize(
    ("kind", "coordinate_name", "value", "size"),
    [
        ("prismatic", "distance", 100.0, 1.0),
        ("prismatic", "distance", 500.0, 3e-3),
        ("revolute", "angle", 2.4, 60.0),
        ("screw", "angle", 200.0 * np.pi + 0.3, 1.0),
    ],
)
def test_what_is_held_far_from_the_drawing_is_reached(kind, coordinate_name, value, size):
    """Slides, a hinge of long arms, a hundred turns of a screw; closed form: a screw motion about the joint's z."""
    mechanism = in_units(chain(kind, seed=97), length=size)
    body, joint = mechanism.bodies[0], mechanism.joints[0]
    state = initial_state(mechanism, Initial({"j0": {coordinate_name: value}}))
    z = joint.F.R[:, 2]
    angle, advance = (0.0, value) if kind == "prismatic" else (value, joint.pitch * value / (2.0 * np.pi))
    turn = rotation_from_quaternion(quaternion_from_rotation_vector(angle * z))
    expected = joint.F.p + turn @ (body.drawing.p - joint.F.p) + advance * z
    np.testing.assert_allclose(state.p_WB[0], expected, rtol=0, atol=2e-11 * np.max(np.abs(expected)))
    np.testing.assert_allclose(state.R_WB[0], turn @ body.drawing.R, rtol=0, atol=1e-11)


@pytest.mark.parametrize("units", [Units(2.0**-20), Units(2.0**20), Units(1e-6, 1e6), Units(1e6, 1e-6)])
@pytest.mark.parametrize("name", ["four_bar", "loop_rod", "forced_chain", "loop_universal"])
def test_random_states_have_the_same_angles_at_any_size(name, units):
    """A mechanism in other units has the same states in these units, and the same ranks."""
    mechanism = ALL[name]
    states = random_states(mechanism, initial_state(mechanism), 4, 8)
    other = in_units(mechanism, *units)
    found = random_states(other, initial_state(other), 4, 8)
    for state, twin in zip(states, map(units.inverse.convert, found), strict=True):
        np.testing.assert_allclose(twin.p_WB, state.p_WB, rtol=0, atol=1e-11)
        assert np.max(rotation_angle_between(twin.quat_WB, state.quat_WB)) < 1e-11
        np.testing.assert_allclose(twin.w_WB_W, state.w_WB_W, rtol=0, atol=1e-10)
        same = units.convert(state)
        assert free_directions(other, same).shape == free_directions(mechanism, state).shape
        np.testing.assert_array_equal(determinate_reactions(other, same), determinate_reactions(mechanism, state))
        assert worst_condition(other, same) == pytest.approx(worst_condition(mechanism, state), rel=1e-6)


# ---------------------------------------------------------------- refusals


def test_contradictory_rates_are_refused_and_the_joint_is_named():
    """A four-bar has one degree of freedom: the rates of its two cranks are not independent."""
    mechanism = four_bar()
    asked = Initial(rates={"j0": {"angle": 1.0}, "j3": {"angle": 100.0}})
    with pytest.raises(CannotAssemble, match=r"joint 'j\d', .*the held rates contradict the joints"):
        initial_state(mechanism, asked)


def test_a_rate_beside_a_drive_is_refused_with_what_the_drive_makes_it():
    drawing = Drawing("belt", gravity=(0.0, 0.0, -9.81))
    drawing.body("belt", mass=5.0, at=(0.1, 0.2, 0.3), com=(0.01, 0.02, 0.03), inertia=(1.0, 2.0, 2.5))
    drawing.joint("track", "prismatic", "ground", "belt", at=(0.0, 0.0, 0.0), axis=(1.0, 2.0, 2.0))
    drawing.add("drive", "motor", joint="track", coordinate="distance", motion=sine(0.1, 12.0))
    with pytest.raises(CannotAssemble, match=r"joint 'track', .* is to be -3, but .*drives.* make it 1\.2:"):
        _ = drawing.case(rates={"track": {"distance": -3.0}}, duration=1.0).initial_state


def test_a_held_coordinate_against_a_drive_is_named_with_it():
    """Held at 0.3 m and driven to 0.1 m: half of the difference is left in each, the least sum of squares."""
    drawing = Drawing("belt", gravity=(0.0, 0.0, -9.81))
    drawing.body("belt", mass=2.0, com=(0.1, 0.0, 0.0), inertia=(0.1, 0.2, 0.25))
    drawing.joint("track", "prismatic", "ground", "belt", at=(0.0, 0.0, 0.0), axis=(1.0, 2.0, 2.0))
    drawing.add("drive", "motor", joint="track", coordinate="distance", motion=linear(0.5, 0.1))
    with pytest.raises(
        CannotAssemble, match=r"it stays violated by 0\.1 after \d+ iterations, beside .* \(0\.1\)"
    ) as told:
        _ = drawing.case(start={"track": 0.3}, duration=1.0).initial_state
    assert "drive 'motor'" in str(told.value)
    assert "joint 'track', held distance" in str(told.value)
    assert drawing.case(start={"track": 0.1}, duration=1.0).initial_state.p_WB[0] @ [1, 2, 2] == pytest.approx(0.3)


def test_rates_that_agree_with_the_loop_may_be_held_twice():
    mechanism = four_bar()
    once = initial_state(mechanism, Initial(rates={"j0": {"angle": 1.0}}))
    follower = float(rate(mechanism, once, "j3", "angle"))
    twice = initial_state(mechanism, Initial(rates={"j0": {"angle": 1.0}, "j3": {"angle": follower}}))
    np.testing.assert_allclose(velocities(twice), velocities(once), rtol=0, atol=1e-11)


def test_an_angle_out_of_reach_is_refused_with_what_stays_violated():
    """Crank 0.5, links 0.4 and 0.3, base 1.0: at half a turn the gap is 1.5, more than both links reach."""
    rng = np.random.default_rng(7)
    corners = [np.array(p) for p in ([0.0, 0, 0], [0.5, 0.0, 0], [0.72, 0.2, 0], [1.0, 0.0, 0])]
    bodies = {n: lumpy_body(n, rng) for n in ("a", "b", "c")}
    names = [GROUND, *bodies, GROUND]
    joints = [drawn_joint(f"j{n}", "revolute", bodies, names[n], names[n + 1], corners[n], np.eye(3)) for n in range(4)]
    mechanism = Mechanism("short", np.zeros(3), tuple(bodies.values()), tuple(joints))
    initial_state(mechanism)  # the loop closes in the drawing
    with pytest.raises(CannotAssemble, match=r"mechanism 'short': joint 'j\d', .*it stays violated by 0\.\d"):
        initial_state(mechanism, Initial({"j0": {"angle": np.pi}}))


@pytest.mark.parametrize(("kind", "axis"), [("revolute", 0), ("prismatic", 2), ("rigid", 0)])
def test_a_joint_that_closes_flipped_over_is_refused(kind, axis):
    """D13 = D23 = 0 also hold with z reversed, D12 = 0 with x reversed: after half a turn about x, or about z."""
    mechanism = chain(kind, seed=94)
    body, joint = mechanism.bodies[0], mechanism.joints[0]
    half = rotation_from_quaternion(quaternion_from_rotation_vector(np.pi * joint.F.R[:, axis]))
    p = joint.F.p + half @ (body.drawing.p - joint.F.p)
    with pytest.raises(CannotAssemble, match=r"joint 'j0'.*flipped over"):
        initial_state(mechanism, Initial(poses={"b0": Frame(p, half @ body.drawing.R)}))


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (Initial({"elbow": {"angle": 1.0}}), "no joint 'elbow'. Joints are: j0"),
        (Initial({"j0": {"distance": 1.0}}), "joint 'j0'.*a revolute joint has no 'distance'. It has: angle"),
        (Initial(rates={"elbow": {"angle": 1.0}}), "no joint 'elbow'"),
        (Initial(rates={"j0": {"x": 1.0}}), "has no 'x'"),
        (Initial(poses={"hand": Frame(np.zeros(3), np.eye(3))}), "no body 'hand'. Bodies are: b0"),
        (Initial(velocities={GROUND: (np.zeros(3), np.zeros(3))}), "no body 'ground'"),
    ],
    ids=lambda x: "" if isinstance(x, str) else None,
)
def test_initial_conditions_of_unknown_joints_coordinates_and_bodies_are_refused(initial, message):
    with pytest.raises(InvalidInput, match=message):
        initial_state(chain("revolute", seed=95), initial)


# ---------------------------------------------------------------- random states


@pytest.mark.parametrize("name", ALL)
def test_random_states_are_consistent_unflipped_and_all_different(name):
    mechanism = ALL[name]
    states = states_of(mechanism, count=6, seed=8)
    for state in states:
        assert_consistent(mechanism, state)
        for joint in mechanism.joints:
            if "D13" in joint.rows:
                f = joint_frames(mechanism, state, joint)
                assert f.U[:, 2] @ f.W[:, 2] == pytest.approx(1.0, abs=1e-12)
    speeds = [velocities(s) for s in states]
    if any(j.kind != "rigid" for j in mechanism.joints):
        assert min(np.linalg.norm(a - b) for i, a in enumerate(speeds) for b in speeds[:i]) > 1e-3


def test_random_states_come_from_their_seed():
    mechanism = LOOPS["four_bar"]
    start = initial_state(mechanism)
    one, same, other = (random_states(mechanism, start, 2, seed)[1] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.p_WB, same.p_WB)
    np.testing.assert_array_equal(one.v_WB_W, same.v_WB_W)
    assert np.max(np.abs(one.v_WB_W - other.v_WB_W)) > 1e-3


def test_random_states_of_one_freedom_never_return_to_a_pose():
    """Steps of one size would lead a slide to the same few places, among them where a spring has no length."""
    mechanism = chain("prismatic", seed=91)
    states = random_states(mechanism, initial_state(mechanism), 40, 3)
    places = np.sort([coordinate(mechanism, state, "j0", "distance") for state in states])
    assert np.min(np.diff(places)) > 1e-6
    assert np.max(np.abs(places)) > 0.5


def test_random_states_where_the_law_of_a_cam_ends_stay_within_its_table():
    """Between -0.3 and 0.3 rad: a walk of 40 steps without a wall would leave it."""
    mechanism = chain("revolute", seed=91)
    follower = chain("prismatic", seed=92)
    bodies = (*mechanism.bodies, replace(follower.bodies[0], name="follower"))
    joints = (*mechanism.joints, replace(follower.joints[0], name="guide", successor="follower"))
    x = np.linspace(-0.3, 0.3, 7)
    cam = Coupling("cam", "j0", "angle", "guide", "distance", through(x, 0.1 * x**2))
    coupled = replace(mechanism, bodies=bodies, joints=joints, couplings=(cam,))
    angles = [
        float(coordinate(coupled, s, "j0", "angle")) for s in random_states(coupled, initial_state(coupled), 40, 3)
    ]
    assert 0.2 < max(np.abs(angles)) <= 0.3
    with pytest.raises(CannotAssemble, match=r"coupling 'cam': its table reaches from -0.3 to 0.3, .* 'j0' is 0.5"):
        initial_state(coupled, Initial({"j0": {"angle": 0.5}}))


@pytest.mark.parametrize("seed", range(3))
def test_random_states_of_a_four_bar_stay_on_the_branch_they_start_on(seed):
    """The coupler's pin changes sides of the diagonal only through a dead centre."""
    mechanism = four_bar()
    start = initial_state(mechanism)

    def side(state):
        points = [joint_frames(mechanism, state, j) for j in mechanism.joints]
        b, c, d = (state.p_WB[k] + f.s_i for k, f in enumerate(points[1:]))  # pins of crank, coupler and rocker
        normal = mechanism.joints[0].F.R[:, 2]
        return np.sign(normal @ np.cross(d - b, c - b))

    states = random_states(mechanism, start, 8, seed)
    assert {side(s) for s in states} == {side(start)}


# ---------------------------------------------------------------- which reactions equilibrium determines


@pytest.mark.parametrize("name", TREES)
def test_all_reactions_of_a_tree_are_determined(name):
    assert determinate_reactions(TREES[name], states_of(TREES[name])[0]).all()


def test_of_a_planar_four_bar_forces_in_the_plane_are_determined_and_nothing_else():
    """Four revolutes with parallel z. In the plane: 9 equations, 8 forces, 1 freedom, so Fx and Fy are determined.
    Out of the plane: 9 equations, 12 unknowns Fz, Mx, My, three open. Mz is zero at an ideal hinge, so determined."""
    mechanism = four_bar()
    expected = np.array([True, True, False, False, False, True])
    for state in states_of(mechanism):
        np.testing.assert_array_equal(determinate_reactions(mechanism, state), np.tile(expected, (4, 1)))


def test_a_four_bar_with_a_cylindrical_joint_has_determinate_forces():
    """A cylindrical joint transmits no Fz, so the Fz of all joints are determined; moments Mx, My stay open."""
    mechanism = four_bar(closing="cylindrical")
    found = determinate_reactions(mechanism, states_of(mechanism)[1])
    assert found[:, [0, 1, 2, 5]].all()  # forces, and the moment about the axis
    assert not found[:, 3:5].all()


def test_a_four_bar_with_a_spherical_joint_has_one_state_of_self_stress():
    """18 rows of rank 17: one state of self-stress, out of the plane."""
    mechanism = four_bar(closing="spherical")
    found = determinate_reactions(mechanism, states_of(mechanism)[1])
    assert found[:, [0, 1, 5]].all()
    assert not found.all()
    assert found[3, 3:].all()  # a spherical joint transmits no moment


def test_a_free_joint_has_nothing_to_determine():
    mechanism = chain("free", seed=96)
    assert determinate_reactions(mechanism, initial_state(mechanism)).all()


def test_a_beam_clamped_at_both_ends_has_nothing_determined():
    """Equilibrium does not determine how two welds to the ground share the weight."""
    rng = np.random.default_rng(9)
    body = lumpy_body("b", rng)
    joints = tuple(drawn_joint(n, "rigid", {"b": body}, GROUND, "b", rng.normal(size=3), rotation(rng)) for n in "ab")
    mechanism = Mechanism("clamped", np.zeros(3), (body,), joints)
    assert not determinate_reactions(mechanism, initial_state(mechanism)).any()
    hung = replace(mechanism, joints=joints[:1])
    assert determinate_reactions(hung, initial_state(hung)).all()


def test_a_rod_whose_ends_meet_on_the_way_is_refused_by_name():
    """There the rod has no direction to grow in."""
    draw = Drawing("string", gravity=[0.0, 0.0, -9.81])
    draw.body("bob", mass=1.0, inertia=[0.1, 0.2, 0.2], at=[0.0, 0.0, -1.0])
    draw.joint("rod", "rod", "ground", "bob", at=[0.0, 0.0, 0.0], to=[0.0, 0.0, -1.0])
    mechanism = draw.mechanism()
    met = replace(drawing_state(mechanism), p_WB=np.zeros((1, 3)))
    with pytest.raises(CannotAssemble, match="the ends of a rod meet"):
        assemble_positions(mechanism, met)


def test_a_search_for_states_that_finds_none_ends(monkeypatch):
    def never(*_):
        raise CannotAssemble("a joint", "it stays open", "Draw it closed.")

    case = load_case("double_pendulum")
    start = case.initial_state
    monkeypatch.setattr(nearby_states, "assemble_positions", never)
    with pytest.raises(CannotAssemble, match="50 random steps"):
        random_states(case.mechanism, start, 3, seed=1)
