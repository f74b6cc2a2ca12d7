"""Freedom, equilibrium, linearisation and inverse dynamics against closed forms, other methods and counts by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import truth
from consilience.errors import ConsilienceError, InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Body,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    State,
    body_point,
    centres_of_mass,
    constraint_jacobian,
    constraint_residual,
    initial_state,
    joint_coordinates,
    joint_frames,
    joint_rates,
    move,
    relative_motion,
    rotation_from_quaternion,
    rotation_with_z_axis,
    world_inertias,
)
from consilience.reference import accelerations
from consilience.reference.analyses import NoEquilibrium, count_freedom, inverse_dynamics, linearise, static_equilibrium
from mechanisms import GRAVITY, LOOPS, TREES, chain, drawn_joint, four_bar, lumpy_body, rotation, states_of
from oracles.double_pendulum import DoublePendulum
from oracles.four_bar import linkage
from oracles.planar import Plane, dot

ORIGIN = Frame(np.zeros(3), np.eye(3))
DOWN = np.array([0.0, 0.0, -9.81])


def block(name="block", mass=2.0):
    return Body(name, mass, np.zeros(3), np.diag([0.1, 0.2, 0.25]), ORIGIN)


def sliding(gravity=DOWN, **elements):
    """Return a mechanism of one block on a vertical slide."""
    joint = Joint("slide", "prismatic", GROUND, "block", ORIGIN, ORIGIN)
    return Mechanism("sliding", gravity, (block(),), (joint,), **elements)


def parallel_double_pendulum(seed=11):
    """Return two lumpy bodies in a chain of two hinges with parallel axes, drawn in a skew plane."""
    rng = np.random.default_rng(seed)
    R = rotation(rng)
    bodies = {n: lumpy_body(n, rng) for n in ("upper", "lower")}
    joints = (
        drawn_joint("shoulder", "revolute", bodies, GROUND, "upper", R @ [0.1, 0.2, 0.3], R),
        drawn_joint("elbow", "revolute", bodies, "upper", "lower", R @ [0.7, 0.1, 0.0], R),
    )
    return Mechanism("double_pendulum", GRAVITY, tuple(bodies.values()), joints)


def named_four_bar():
    """Return a lumpy four-bar with the joint names that the closed-form oracle expects, and the oracle."""
    mechanism = four_bar()
    names = ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot")
    joints = tuple(replace(j, name=n) for j, n in zip(mechanism.joints, names, strict=True))
    mechanism = replace(mechanism, joints=joints)
    return mechanism, linkage(SimpleNamespace(mechanism=mechanism))


def potential(oracle, q):
    return oracle.energy(np.array([[q, 0.0]]))[1][0]


def lowest_crank_angle(oracle):
    """Return the angle of least potential energy: a scan of the whole turn, then the root of the generalised force."""
    grid = np.linspace(-np.pi, np.pi, 721)
    best = grid[np.argmin([potential(oracle, q) for q in grid])]
    step = grid[1] - grid[0]
    return scipy.optimize.brentq(lambda q: oracle.coefficients(q)[2], best - step, best + step, xtol=1e-14)


def angle_of(mechanism, state, joint):
    target = mechanism.joints[mechanism.joint_index[joint]]
    return float(joint_coordinates(target, relative_motion(mechanism, state, target))["angle"])


def axis_and_arm(mechanism, state):
    """Return the axis of the first joint, and the normal from the axis to the centre of mass of the first body."""
    frames = joint_frames(mechanism, state, mechanism.joints[0])
    axis = frames.U[:, 2]
    arm = centres_of_mass(mechanism, state)[0][0] - frames.s_i
    return axis, arm - (arm @ axis) * axis


# ---------------------------------------------------------------- degrees of freedom


def test_four_bar_with_its_grounded_link_counts_minus_two_by_kutzbach_and_one_in_truth():
    loop = four_bar()
    frame = replace(block("frame"), drawing=ORIGIN)
    joints = tuple(
        replace(
            j,
            predecessor="frame" if j.predecessor == GROUND else j.predecessor,
            successor="frame" if j.successor == GROUND else j.successor,
        )
        for j in loop.joints
    )
    joints += (Joint("base", "rigid", GROUND, "frame", ORIGIN, ORIGIN),)
    mechanism = replace(loop, bodies=(*loop.bodies, frame), joints=joints)
    count = count_freedom(mechanism, initial_state(mechanism))
    assert mechanism.constraint_count() == 26
    assert (count.kutzbach, count.planar, count.freedom) == (-2, 1, 1)
    assert (count.rank, count.redundant) == (23, 3)
    assert count.undetermined == ("j0", "j1", "j2", "j3")


def test_double_pendulum_counts_two_every_way():
    mechanism = parallel_double_pendulum()
    count = count_freedom(mechanism, initial_state(mechanism))
    assert (count.kutzbach, count.planar, count.freedom, count.redundant) == (2, 2, 2, 0)
    assert count.undetermined == ()


@pytest.mark.parametrize("name", TREES)
def test_a_tree_has_the_freedom_of_its_joints_and_nothing_redundant(name):
    mechanism = TREES[name]
    count = count_freedom(mechanism, states_of(mechanism, 1)[0])
    freedom = sum(JOINT_KINDS[j.kind].freedom for j in mechanism.joints)
    assert (count.kutzbach, count.freedom, count.redundant, count.undetermined) == (freedom, freedom, 0, ())


@pytest.mark.parametrize(
    ("name", "kutzbach", "planar", "freedom"),
    [
        ("four_bar", -2, 1, 1),
        ("slider_crank", -2, 1, 1),
        ("four_bar_spherical", 0, None, 1),
        ("four_bar_cylindrical", -1, None, 1),
        ("loop_spherical", 2, None, 2),
        ("loop_universal", 1, None, 1),
        ("loop_rod", 4, None, 4),
    ],
)
def test_freedom_of_loops(name, kutzbach, planar, freedom):
    mechanism = LOOPS[name]
    for state in states_of(mechanism, 2):
        count = count_freedom(mechanism, state)
        assert (count.kutzbach, count.planar, count.freedom) == (kutzbach, planar, freedom)
        assert count.redundant == freedom - kutzbach
        assert count.rank == np.linalg.matrix_rank(constraint_jacobian(mechanism, state), tol=1e-6)
        assert bool(count.undetermined) == (count.redundant > 0)


def gantry(*directions):
    """Return a chain of bodies on slides along the given directions."""
    frames = [Frame(np.zeros(3), rotation_with_z_axis(d)) for d in directions]
    names = [GROUND, *(f"b{n}" for n in range(len(directions)))]
    joints = tuple(Joint(f"j{n}", "prismatic", names[n], names[n + 1], f, f) for n, f in enumerate(frames))
    return Mechanism("gantry", DOWN, tuple(block(n) for n in names[1:]), joints)


def test_translations_alone_are_planar_while_their_axes_share_a_plane():
    flat, spatial = gantry([1, 0, 0], [1, 2, 0]), gantry([1, 0, 0], [1, 2, 0], [0, 1, 1])
    assert count_freedom(flat, initial_state(flat)).planar == 2
    assert count_freedom(spatial, initial_state(spatial)).planar is None


# ---------------------------------------------------------------- static equilibrium


@pytest.mark.parametrize("angle", [-3.0, -1.5, 0.0, 1.0, 2.5])
def test_a_pendulum_hangs_below_its_axis_from_wherever_it_starts(angle):
    mechanism = chain("revolute", seed=30)
    guess = initial_state(mechanism, Initial({"j0": {"angle": angle}}))
    state = static_equilibrium(mechanism, guess)
    axis, arm = axis_and_arm(mechanism, state)
    down = GRAVITY - (GRAVITY @ axis) * axis
    assert np.allclose(arm / np.linalg.norm(arm), down / np.linalg.norm(down), rtol=0, atol=1e-12)
    assert not np.any(state.v_WB_W)
    assert not np.any(state.w_WB_W)
    assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-13


def test_a_horizontal_pendulum_has_no_stiffness_and_still_falls():
    body = replace(block(), com=np.array([0.5, 0.0, 0.0]))
    along_y = Frame(np.zeros(3), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))
    mechanism = Mechanism("level", DOWN, (body,), (Joint("j", "revolute", GROUND, "block", along_y, along_y),))
    state = static_equilibrium(mechanism, initial_state(mechanism))
    assert np.allclose(centres_of_mass(mechanism, state)[0][0], [0, 0, -0.5], rtol=0, atol=1e-12)


@pytest.mark.parametrize("stiffness", [3.0, 400.0, 1e7])
def test_a_weight_on_a_spring_sags_by_m_g_over_k(stiffness):
    by_joint = sliding(joint_springs=(JointSpring("k", "slide", "distance", stiffness, 1.0, 0.0),))
    state = static_equilibrium(by_joint, initial_state(by_joint))
    assert state.p_WB[0, 2] == pytest.approx(-2.0 * 9.81 / stiffness, rel=1e-9)
    above = np.array([0.0, 0.0, 1.5])
    by_points = sliding(springs=(Spring("k", GROUND, "block", above, np.zeros(3), stiffness, 1.0, 1.5),))
    state = static_equilibrium(by_points, initial_state(by_points))
    assert state.p_WB[0, 2] == pytest.approx(-2.0 * 9.81 / stiffness, rel=1e-9)


def test_double_pendulum_hangs_with_both_moments_zero():
    mechanism = parallel_double_pendulum()
    state = static_equilibrium(mechanism, initial_state(mechanism, Initial({"elbow": {"angle": 2.0}})))
    frames = [joint_frames(mechanism, state, j) for j in mechanism.joints]
    com = centres_of_mass(mechanism, state)[0]
    weights = [b.mass * GRAVITY for b in mechanism.bodies]
    axis = frames[0].U[:, 2]
    shoulder, elbow = frames[0].s_i, state.p_WB[0] + frames[1].s_i
    down = GRAVITY - (GRAVITY @ axis) * axis
    assert abs(axis @ np.cross(com[1] - elbow, weights[1])) < 1e-11
    assert abs(axis @ sum(np.cross(c - shoulder, f) for c, f in zip(com, weights, strict=True))) < 1e-11
    assert (com[1] - elbow) @ down > 0


@pytest.mark.parametrize("start", [-2.0, 0.0, 1.7])
def test_four_bar_rests_at_the_least_potential_of_a_scan(start):
    mechanism, oracle = named_four_bar()
    guess = initial_state(mechanism)
    for angle in np.linspace(0.0, start, 9)[1:]:  # approach the angle in steps, to stay on the branch of the guess
        poses = {
            b.name: Frame(p, R)
            for b, p, R in zip(mechanism.bodies, guess.p_WB, rotation_from_quaternion(guess.quat_WB), strict=True)
        }
        guess = initial_state(mechanism, Initial({"crank_pivot": {"angle": angle}}, poses=poses))
    state = static_equilibrium(mechanism, guess)
    assert angle_of(mechanism, state, "crank_pivot") == pytest.approx(lowest_crank_angle(oracle), abs=1e-10)


@pytest.mark.parametrize(
    "name", ["long_chain", "four_bar_spherical", "loop_spherical", "loop_universal", "backward_rod"]
)
def test_nothing_accelerates_at_an_equilibrium(name):
    mechanism = (TREES | LOOPS)[name]
    if name == "long_chain":  # without a spring, its slide has no equilibrium
        mechanism = replace(mechanism, joint_springs=(JointSpring("k", "j1", "distance", 50.0, 0.0, 0.1),))
    state = static_equilibrium(mechanism, initial_state(mechanism))
    a, alpha, _, _ = truth.solve(mechanism, state)
    assert max(np.max(np.abs(a)), np.max(np.abs(alpha))) < 1e-8


def test_loads_without_a_potential_are_balanced():
    torque = Load("t", "torque", "b0", np.array([0.1, 0.2, 0.3]), "body")
    push = Load("f", "force", "b1", np.array([0.3, 0.2, 0.5]), "body", np.array([0.1, 0.0, 0.2]))
    mechanism = replace(chain("revolute", "revolute", seed=31), loads=(torque, push))
    state = static_equilibrium(mechanism, initial_state(mechanism))
    a, alpha, _, _ = truth.solve(mechanism, state)
    assert max(np.max(np.abs(a)), np.max(np.abs(alpha))) < 1e-10


def test_a_falling_body_has_no_equilibrium_and_the_message_says_what_is_left():
    mechanism = Mechanism("falling", DOWN, (block(),), (Joint("j", "free", GROUND, "block", ORIGIN, ORIGIN),))
    with pytest.raises(NoEquilibrium, match=r"'falling': no static equilibrium: forces of 19\.6 "):
        static_equilibrium(mechanism, initial_state(mechanism), iterations=5)
    assert issubclass(NoEquilibrium, ConsilienceError)


# ---------------------------------------------------------------- linearisation


def test_frequency_of_a_physical_pendulum():
    mechanism = chain("revolute", seed=30)
    state = static_equilibrium(mechanism, initial_state(mechanism))
    axis, arm = axis_and_arm(mechanism, state)
    down = GRAVITY - (GRAVITY @ axis) * axis
    mass, d = mechanism.bodies[0].mass, np.linalg.norm(arm)
    inertia = axis @ world_inertias(mechanism, state)[0] @ axis + mass * d**2
    found = linearise(mechanism, state)
    expected = np.sqrt(mass * np.linalg.norm(down) * d / inertia)
    assert found.frequencies == pytest.approx([expected], rel=1e-10)
    assert found.frequencies_hz == pytest.approx([expected / (2 * np.pi)], rel=1e-10)
    assert found.damping_ratios == pytest.approx([0.0], abs=1e-10)
    assert found.stable
    turn = found.modes[0, 0, 3:]
    assert np.allclose(np.abs(turn / np.linalg.norm(turn)), np.abs(axis), rtol=0, atol=1e-12)


def test_the_tension_of_a_rod_is_all_the_stiffness_of_a_weight_that_hangs_on_it():
    body = replace(block(), drawing=Frame(np.array([0.0, 0.0, -0.7]), np.eye(3)))
    rod = Joint("rod", "rod", GROUND, "block", ORIGIN, ORIGIN, 0.7)
    mechanism = Mechanism("hanging", DOWN, (body,), (rod,))
    found = linearise(mechanism, static_equilibrium(mechanism, initial_state(mechanism)))
    assert found.frequencies[-2:] == pytest.approx([np.sqrt(9.81 / 0.7)] * 2, rel=1e-10)
    assert np.all(found.frequencies[:-2] < 1e-6)


@pytest.mark.parametrize("name", ["loop_rod", "loop_spherical", "single_rod"])
def test_forces_with_a_potential_have_a_symmetric_stiffness(name):
    mechanism = (TREES | LOOPS)[name]
    K = linearise(mechanism, static_equilibrium(mechanism, initial_state(mechanism))).K
    assert np.max(np.abs(K - K.T)) < 1e-9 * np.max(np.abs(K))


def test_an_inverted_pendulum_is_unstable():
    body = replace(block(), com=np.array([0.0, 0.0, 0.5]))
    along_x = Frame(np.zeros(3), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    mechanism = Mechanism("inverted", DOWN, (body,), (Joint("j", "revolute", GROUND, "block", along_x, along_x),))
    found = linearise(mechanism, initial_state(mechanism))
    rate = np.sqrt(2.0 * 9.81 * 0.5 / (0.1 + 2.0 * 0.25))
    assert sorted(found.eigenvalues.real) == pytest.approx([-rate, rate], rel=1e-10)
    assert not found.stable


@pytest.mark.parametrize("damping", [0.0, 3.0, 30.0])
@pytest.mark.parametrize("element", ["joint", "points"])
def test_spring_mass_damper(element, damping):
    stiffness = 50.0
    elements = {
        "joint": {"joint_springs": (JointSpring("k", "slide", "distance", stiffness, damping, 0.0),)},
        "points": {
            "springs": (Spring("k", GROUND, "block", np.array([0, 0, 1.5]), np.zeros(3), stiffness, damping, 1.0),)
        },
    }
    mechanism = sliding(**elements[element])
    found = linearise(mechanism, static_equilibrium(mechanism, initial_state(mechanism)))
    assert found.M.ravel() == pytest.approx([2.0], rel=1e-14)
    assert found.K.ravel() == pytest.approx([stiffness], rel=1e-10)
    assert found.D.ravel() == pytest.approx([damping], rel=1e-12, abs=1e-12)
    omega, ratio = np.sqrt(stiffness / 2.0), damping / (2 * np.sqrt(stiffness * 2.0))
    if ratio < 1:
        assert found.frequencies == pytest.approx([omega], rel=1e-10)
        assert found.damping_ratios == pytest.approx([ratio], rel=1e-10, abs=1e-12)
    else:
        roots = omega * (-ratio + np.array([1, -1]) * np.sqrt(ratio**2 - 1))
        assert found.eigenvalues == pytest.approx(roots, rel=1e-10)
        assert found.damping_ratios == pytest.approx([1.0, 1.0], rel=1e-12)


def test_double_pendulum_against_its_generalised_eigenproblem():
    mechanism = parallel_double_pendulum()
    state = static_equilibrium(mechanism, initial_state(mechanism))
    plane = Plane(mechanism, "shoulder")
    A, B = plane.pin("shoulder"), plane.pin("elbow")
    one, two = plane.bodies()
    c = DoublePendulum(one.mass, two.mass, one.inertia, two.inertia, one.com - A, two.com - B, B - A, plane.gravity)
    first = c.mass_1 * c.arm_1 + c.mass_2 * c.link
    # hanging equilibrium: the first moments of mass of both bodies are parallel to gravity
    link = c.link * abs(first) / first
    coupling = c.mass_2 * dot(link, abs(c.arm_2))
    M = np.array(
        [
            [c.inertia_1 + c.mass_1 * abs(c.arm_1) ** 2 + c.mass_2 * abs(c.link) ** 2, coupling],
            [coupling, c.inertia_2 + c.mass_2 * abs(c.arm_2) ** 2],
        ]
    )
    K = abs(c.gravity) * np.diag([abs(first), c.mass_2 * abs(c.arm_2)])
    squares, shapes = scipy.linalg.eigh(K, M)
    found = linearise(mechanism, state)
    assert found.frequencies == pytest.approx(np.sqrt(squares), rel=1e-9)
    assert np.max(np.abs(found.K - found.K.T)) < 1e-9
    for mode, shape in zip(found.modes, shapes.T, strict=True):
        rates = mode[:, 3:] @ plane.normal
        assert rates[1] / rates[0] == pytest.approx(shape[1] / shape[0], rel=1e-8)
        assert np.max(np.abs(constraint_jacobian(mechanism, state) @ mode.ravel())) < 1e-12


def test_four_bar_against_its_equation_of_motion():
    mechanism, oracle = named_four_bar()
    found = linearise(mechanism, static_equilibrium(mechanism, initial_state(mechanism)))
    q = lowest_crank_angle(oracle)

    def slope(h):
        return -(oracle.coefficients(q + h)[2] - oracle.coefficients(q - h)[2]) / (2 * h)

    stiffness = (4 * slope(5e-4) - slope(1e-3)) / 3
    assert found.frequencies == pytest.approx([np.sqrt(stiffness / oracle.coefficients(q)[0])], rel=1e-8)


def test_a_joint_spring_at_rest_near_half_a_turn_is_not_unwound_by_the_differences():
    joint = Joint("hinge", "revolute", GROUND, "block", ORIGIN, ORIGIN)
    spring = JointSpring("k", "hinge", "angle", 5.0, 0.0, 3.14)
    mechanism = Mechanism("turned", np.zeros(3), (block(),), (joint,), joint_springs=(spring,))
    found = linearise(mechanism, initial_state(mechanism, Initial({"hinge": {"angle": 3.14}})))
    assert found.frequencies == pytest.approx([np.sqrt(5.0 / 0.25)], rel=1e-10)


def test_a_neutral_direction_has_no_frequency_and_no_damping_ratio():
    body = replace(block(), com=np.array([0.0, 0.0, -0.5]))
    mechanism = Mechanism("ball", DOWN, (body,), (Joint("j", "spherical", GROUND, "block", ORIGIN, ORIGIN),))
    found = linearise(mechanism, static_equilibrium(mechanism, initial_state(mechanism)))
    swinging = np.sort(np.sqrt(2 * 9.81 * 0.5 / (np.array([0.1, 0.2]) + 0.5)))
    assert found.frequencies[-2:] == pytest.approx(swinging, rel=1e-9)
    assert np.all(found.frequencies[:-2] < 1e-5 * swinging[0])
    assert np.all(np.isnan(found.damping_ratios[:-2]))
    assert found.stable


def test_states_that_are_no_equilibrium_are_refused():
    mechanism = chain("revolute", seed=30)
    with pytest.raises(NoEquilibrium, match="are left along"):
        linearise(mechanism, initial_state(mechanism))
    with pytest.raises(InvalidInput, match="the state moves"):
        linearise(mechanism, states_of(mechanism, 1)[0])


def test_a_mechanism_that_cannot_move_rests_and_has_no_modes():
    mechanism = chain("rigid")
    state = static_equilibrium(mechanism, initial_state(mechanism))
    found = linearise(mechanism, state)
    assert count_freedom(mechanism, state).freedom == 0
    assert found.M.shape == found.D.shape == found.K.shape == (0, 0)
    assert found.modes.shape == (0, 1, 6)
    assert found.stable


# ---------------------------------------------------------------- inverse dynamics

SCALAR_TREES = {
    "all_kinds": chain("revolute", "prismatic", "universal", "cylindrical", "planar", "rigid", seed=33),
    "backwards": chain("planar", "universal", "cylindrical", "revolute", seed=34, backwards=(0, 1, 2, 3)),
    "forced": chain("revolute", "cylindrical", "prismatic", "universal", seed=35, forces=True),
}


def as_loads(mechanism, state, efforts):
    """Return the mechanism with the efforts as world-fixed forces and torques on both bodies of each joint."""
    R = dict(zip(mechanism.body_index, [np.eye(3), *rotation_from_quaternion(state.quat_WB)], strict=True))
    p = dict(zip(mechanism.body_index, [np.zeros(3), *state.p_WB], strict=True))
    loads = []
    for name, by_coordinate in efforts.items():
        joint = mechanism.joints[mechanism.joint_index[name]]
        f = joint_frames(mechanism, state, joint)
        at = body_point(mechanism, state, joint.successor, joint.M.p)[0]
        for coordinate, effort in by_coordinate.items():
            axis = {"x": f.U[:, 0], "y": f.U[:, 1], "angle2": f.W[:, 0]}.get(coordinate, f.U[:, 2])
            kind = "torque" if coordinate.startswith("angle") else "force"
            for body, sign in ((joint.successor, 1.0), (joint.predecessor, -1.0)):
                point = R[body].T @ (at - p[body])
                if body != GROUND:
                    label = f"{name}_{coordinate}_{body}"
                    loads.append(Load(label, kind, body, sign * effort * axis, "world", point))
    return replace(mechanism, loads=(*mechanism.loads, *loads))


def rate_differences(mechanism, state, a, h):
    """Return joint accelerations by central differences of joint rates along a motion with the body accelerations a."""
    v = np.hstack([state.v_WB_W, state.w_WB_W])
    rates = []
    for t in (h, -h):
        moved = move(state, (v * t + 0.5 * a * t * t).ravel())
        there = State(moved.p_WB, moved.quat_WB, (v + a * t)[:, :3], (v + a * t)[:, 3:])
        rates.append(
            {
                (j.name, name): float(rate)
                for j in mechanism.joints
                for name, rate in joint_rates(j, relative_motion(mechanism, there, j)).items()
            }
        )
    return {key: (rates[0][key] - rates[1][key]) / (2 * h) for key in rates[0]}


@pytest.mark.parametrize("name", SCALAR_TREES)
def test_forward_dynamics_undo_inverse_dynamics(name):
    mechanism = SCALAR_TREES[name]
    rng = np.random.default_rng(4)
    for state in states_of(mechanism, 3):
        asked = {
            j.name: {c: rng.normal(scale=3.0) for c in JOINT_KINDS[j.kind].coordinates}
            for j in mechanism.joints
            if j.kind != "rigid"
        }
        found = inverse_dynamics(mechanism, state, asked)
        forward = accelerations(as_loads(mechanism, state, found.efforts), [state])
        a = np.hstack([forward.a_WB_W[0], forward.alpha_WB_W[0]])
        coarse, fine = (rate_differences(mechanism, state, a, h) for h in (2e-4, 1e-4))
        for joint, by_coordinate in asked.items():
            for coordinate, value in by_coordinate.items():
                limit = (4 * fine[joint, coordinate] - coarse[joint, coordinate]) / 3
                assert limit == pytest.approx(value, abs=1e-7 * np.max(np.abs(a)))
        scale = max(np.max(np.abs(forward.force_F)), np.max(np.abs(forward.torque_F)))
        assert np.max(np.abs(found.force_F - forward.force_F[0])) < 1e-10 * scale
        assert np.max(np.abs(found.torque_F - forward.torque_F[0])) < 1e-10 * scale


@pytest.mark.parametrize("name", SCALAR_TREES)
def test_body_accelerations_ask_for_the_same_efforts(name):
    mechanism = SCALAR_TREES[name]
    for state in states_of(mechanism, 2):
        free = accelerations(mechanism, [state])
        a = np.hstack([free.a_WB_W[0], free.alpha_WB_W[0]])
        efforts = [e for by in inverse_dynamics(mechanism, state, a).efforts.values() for e in by.values()]
        scale = max(np.max(np.abs(free.force_F)), np.max(np.abs(free.torque_F)))
        assert np.max(np.abs(efforts)) < 1e-10 * scale  # inverse dynamics of a free motion needs no effort


def test_effort_of_a_pendulum():
    mechanism = chain("revolute", seed=30)
    state = states_of(mechanism, 1)[0]
    axis, arm = axis_and_arm(mechanism, state)
    body = mechanism.bodies[0]
    inertia = axis @ world_inertias(mechanism, state)[0] @ axis + body.mass * arm @ arm
    effort = inverse_dynamics(mechanism, state, {"j0": {"angle": 2.5}}).efforts["j0"]["angle"]
    assert effort == pytest.approx(inertia * 2.5 - axis @ np.cross(arm, body.mass * GRAVITY), rel=1e-11)


@pytest.mark.parametrize(
    ("mechanism", "asked", "message"),
    [
        (four_bar(), {}, "loop"),
        (chain("spherical"), {}, "no scalar coordinates"),
        (chain("revolute"), {}, "'angle' of joint 'j0': it is missing"),
        (chain("revolute"), {"j0": {"angle": 1.0, "distance": 2.0}}, "'distance' of joint 'j0': there is no such"),
        (chain("revolute"), np.zeros((2, 6)), "shape"),
        (chain("revolute"), np.ones((1, 6)), "violate the joints"),
    ],
)
def test_inverse_dynamics_refuses(mechanism, asked, message):
    with pytest.raises(InvalidInput, match=message):
        inverse_dynamics(mechanism, initial_state(mechanism), asked)
