"""Parameters by path; sensitivities against closed forms, complex steps and independent routes to the derivative."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from consilience import load_case
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    Cone,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Mechanism,
    Spring,
    contact_parts,
    initial_state,
    rotation_vector_from_quaternion,
    rotation_with_z_axis,
)
from consilience.reference import simulate
from consilience.reference.analyses import linearise, static_equilibrium
from consilience.reference.analyses.parameters import parameter, parameter_paths, with_parameter
from consilience.reference.analyses.sensitivity import sensitivity
from consilience.reference.analyses.trajectory_sensitivity import trajectory_sensitivity
from mechanisms import ELEMENTS, LOOPS, TREES, four_bar

ORIGIN = Frame(np.zeros(3), np.eye(3))
DOWN = np.array([0.0, 0.0, -9.81])
M, L, IYY, G, K = 2.0, 0.5, 0.2, 9.81, 50.0


def pendulum():
    """Return a pendulum about y of the world: centre of mass L below the pin, products of inertia without influence."""
    along_y = Frame(np.zeros(3), rotation_with_z_axis([0.0, 1.0, 0.0]))
    inertia = np.array([[0.15, 0.01, -0.02], [0.01, IYY, 0.03], [-0.02, 0.03, 0.25]])
    body = Body("bob", M, np.array([0.0, 0.0, -L]), inertia, ORIGIN)
    return Mechanism("pendulum", DOWN, (body,), (Joint("pin", "revolute", GROUND, "bob", along_y, along_y),))


def sliding():
    body = Body("block", M, np.zeros(3), np.diag([0.1, 0.2, 0.25]), ORIGIN)
    spring = Spring("s", GROUND, "block", np.array([0, 0, 1.5]), np.zeros(3), K, 1.0, 1.2)
    return Mechanism(
        "sliding", DOWN, (body,), (Joint("slide", "prismatic", GROUND, "block", ORIGIN, ORIGIN),), springs=(spring,)
    )


def frequency(mechanism):
    return linearise(mechanism, static_equilibrium(mechanism, initial_state(mechanism))).frequencies


def sound(found, expected, accuracy=1e-9):
    """Assert that derivatives are accurate, and that their errors are at most ten times the estimates."""
    expected = np.asarray(expected)
    scale = np.max(np.abs(expected))
    actual = np.abs(found.derivatives - expected)
    assert np.max(actual) < accuracy * scale
    assert np.all(actual <= 10 * found.errors + 1e-14 * scale)
    assert np.max(found.errors) < 10 * accuracy * scale


# ---------------------------------------------------------------- parameters


@pytest.mark.parametrize(
    "name", ["forced_chain", "loop_rod", "powered", "driven", "coupled", "rolling_torus", "skating"]
)
def test_every_parameter_can_be_read_and_changed_and_nothing_else_changes(name):
    mechanism = (TREES | LOOPS | ELEMENTS)[name]
    paths = parameter_paths(mechanism)
    assert len(set(paths)) == len(paths)
    values = {path: parameter(mechanism, path) for path in paths}
    chosen = [p for p in paths if not p.startswith(("body.", "joint."))][::4] + list(paths[::23])
    for path in chosen:
        changed = with_parameter(mechanism, path, values[path] + 1e-6)
        if ".turn[" in path:  # a rotation increment: zero again in the rotated frame; joint rows show the change
            assert parameter(changed, path) == 0.0
            continue
        others = [p for p in paths[:: len(paths) // 25] if p != path]
        assert [p for p in others if parameter(changed, p) != values[p]] == []
        assert parameter(changed, path) == values[path] + 1e-6
    assert all(parameter(mechanism, path) == values[path] for path in chosen)


def test_counts_of_parameters():
    """Counts: 3 for gravity, 16 for a body, 12 for a joint, 13 for a rod, 9 a spring, 3 a joint spring, 6 a load."""
    assert len(parameter_paths(pendulum())) == 3 + 16 + 12
    assert len(parameter_paths(LOOPS["loop_rod"])) == 3 + 3 * 16 + 4 * 12 + 1
    assert len(parameter_paths(ELEMENTS["single_screw"])) == 3 + 16 + 12 + 1
    forced = TREES["forced_chain"]
    constant = 9 * len(forced.springs) + 3 * len(forced.joint_springs) + 6 * len(forced.loads)
    assert len(parameter_paths(forced)) == 3 + 4 * 16 + 4 * 12 + constant


@pytest.mark.parametrize(
    ("name", "bodies", "expected"),
    [
        # actuators: a sine 3, tables 9 + 9; load histories 3; frictions 3; controls 3, with targets of 3 and 1
        ("powered", 4, (9 + 3) + 3 * (3 + 18) + 4 * (6 + 3) + 2 * 3 + (3 + 3) + (3 + 1)),
        ("driven", 3, (2 + 3) + 3),
        ("coupled", 4, 2 + 2 + (13 + 12)),  # a periodic table has one ordinate less than an open one
        ("rolling_torus", 2, 3 + 3 + 3 + 3 + 2),
        ("skating", 2, 3 + 3),
    ],
)
def test_numbers_of_elements_are_parameters(name, bodies, expected):
    mechanism = ELEMENTS[name]
    assert len(parameter_paths(mechanism)) == 3 + 28 * bodies + expected


def test_a_periodic_table_keeps_its_period_and_a_direction_its_length():
    law = with_parameter(ELEMENTS["coupled"], "coupling.cam.law.table.y[0]", 0.01).couplings[2].law
    assert law.table.y[0] == law.table.y[-1] == 0.01
    before = ELEMENTS["skating"].skates[0].lateral
    after = with_parameter(ELEMENTS["skating"], "skate.edge.lateral.turn[2]", 0.3).skates[0].lateral
    assert np.linalg.norm(after) == pytest.approx(1.0, rel=1e-14)
    assert after[2] == pytest.approx(before[2], rel=1e-13)
    assert np.arctan2(after[1], after[0]) - np.arctan2(before[1], before[0]) == pytest.approx(0.3, rel=1e-12)


BOX = load_case("flat_box_drop").mechanism
CONES = [Cone(), Cone("box", tangent=(1.0, 0.2, 0.0)), Cone("pyramid", 6, 0.1)]


@pytest.mark.parametrize("cone", CONES, ids=lambda cone: cone.kind)
def test_each_parameter_of_a_contact_can_be_changed(cone):
    """A rotation matrix has three parameters, no facet is a parameter, and the vertices of a pyramid alone turn."""
    boxes = tuple(replace(c, cone=cone) for c in BOX.contacts if isinstance(c, BoxPlane))
    assert boxes
    mechanism = replace(BOX, contacts=boxes)
    paths = [p for p in parameter_paths(mechanism) if p.startswith("contact.")]
    for path in paths:
        assert isinstance(with_parameter(mechanism, path, parameter(mechanism, path) + 1e-9), Mechanism)
    assert len([path for path in paths if ".orientation." in path]) == 3 * len(boxes)
    assert len([path for path in paths if path.endswith(".cone.offset")]) == len(boxes) * (cone.kind == "pyramid")


def test_a_box_that_is_turned_has_its_corners_elsewhere():
    """Corners at ``c + R R_y(angle) s`` with the half sizes s of either sign."""
    box = BOX.contacts[0]
    turned = with_parameter(BOX, f"contact.{box.name}.orientation.turn[1]", 0.3).contacts[0]
    turn = np.array([[np.cos(0.3), 0.0, np.sin(0.3)], [0.0, 1.0, 0.0], [-np.sin(0.3), 0.0, np.cos(0.3)]])
    expected = box.center + box.orientation @ turn @ box.half_sizes
    assert contact_parts(turned)[-1].center == pytest.approx(expected, rel=1e-14)


def test_spellings():
    mechanism = pendulum()
    assert parameter(mechanism, "body.bob.inertia[1, 2]") == parameter(mechanism, "body.bob.inertia[2][1]") == 0.03
    changed = with_parameter(mechanism, "body.bob.inertia[2,1]", 0.02)
    assert changed.bodies[0].inertia[1, 2] == changed.bodies[0].inertia[2, 1] == 0.02
    assert mechanism.bodies[0].inertia[1, 2] == 0.03
    assert parameter(mechanism, "gravity[2]") == -9.81


def test_turning_a_frame_turns_it_about_its_own_axis():
    R = with_parameter(pendulum(), "joint.pin.F.turn[0]", 0.3).joints[0].F.R
    before = pendulum().joints[0].F.R
    assert np.allclose(R[:, 0], before[:, 0], rtol=0, atol=1e-15)
    assert before[:, 1] @ R[:, 1] == pytest.approx(np.cos(0.3))
    assert before[:, 2] @ R[:, 1] == pytest.approx(np.sin(0.3))


def test_a_case_has_its_initial_values_as_well():
    case = load_case("double_pendulum")
    paths = [p for p in parameter_paths(case) if p.startswith("initial.")]
    assert paths
    changed = with_parameter(case, paths[0], parameter(case, paths[0]) + 0.01)
    assert np.max(np.abs(changed.initial_state.p_WB - case.initial_state.p_WB)) > 1e-4
    assert changed.mechanism is case.mechanism


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("body.bob.weight", r"There are: body\.bob\.mass, body\.bob\.com\[0\]"),
        ("body.rod.mass", r"There are: body\.bob\.mass"),
        ("joint.pin.F.q[0]", r"There are: joint\.pin\.F\.p\[0\]"),
        ("joint.pin.length", r"There are: joint\.pin\.F"),
        ("mass", "There are: body, gravity, joint"),
        ("body.bob.com[3]", r"There are: body\.bob\.mass"),
    ],
)
def test_unknown_paths_say_what_there_is(path, message):
    with pytest.raises(InvalidInput, match=message):
        with_parameter(pendulum(), path, 1.0)


def test_impossible_values_are_refused_by_the_mechanism():
    with pytest.raises(InvalidInput, match="not positive"):
        with_parameter(pendulum(), "body.bob.mass", -1.0)


# ---------------------------------------------------------------- derivatives of results


def test_frequency_of_a_pendulum():
    found = sensitivity(
        pendulum(), frequency, ["gravity[2]", "body.bob.mass", "body.bob.com[2]", "body.bob.inertia[1,1]", "gravity[0]"]
    )
    J = IYY + M * L**2
    w = np.sqrt(M * G * L / J)
    assert found.value == pytest.approx([w], rel=1e-10)
    expected = [-w / (2 * G), w / 2 * (1 / M - L**2 / J), -w / 2 * (1 / L - 2 * M * L / J), -w / (2 * J), 0.0]
    sound(found, np.array(expected)[:, None], 1e-8)


def test_frequency_of_a_mass_on_a_spring():
    found = sensitivity(sliding(), frequency, ["spring.s.stiffness", "body.block.mass", "spring.s.free_length"])
    w = np.sqrt(K / M)
    sound(found, np.array([w / (2 * K), -w / (2 * M), 0.0])[:, None], 1e-8)


def test_a_result_that_is_no_number_is_refused():
    with pytest.raises(InvalidInput, match=r"result: it is no array of numbers\. Return a number"):
        sensitivity(sliding(), lambda mechanism: mechanism.bodies[0].name, ["body.block.mass"])


def test_static_deflection():
    """The spring hangs from the height 1.5 m: ``z = 1.5 - L0 - m g/k``."""

    def height(mechanism):
        return static_equilibrium(mechanism, initial_state(mechanism)).p_WB[0, 2]

    paths = [
        "spring.s.stiffness",
        "body.block.mass",
        "spring.s.free_length",
        "gravity[2]",
        "spring.s.point_predecessor[2]",
    ]
    found = sensitivity(sliding(), height, paths)
    assert found.value == pytest.approx(1.5 - 1.2 - M * G / K, rel=1e-10)
    sound(found, [M * G / K**2, -G / K, -1.0, M / K, 1.0])


def quarter_period(mechanism):
    """Return the time from rest at 2 rad to the lowest point, by Newton's method on simulated motions."""
    start = initial_state(mechanism, Initial({"pin": {"angle": 2.0}}))
    t = 0.6
    for _ in range(6):
        run = simulate(mechanism, start, np.array([0.0, t]), tolerance=1e-13)
        t -= rotation_vector_from_quaternion(run.quat_WB[-1, 0])[1] / run.w_WB_W[-1, 0, 1]
    return t


def test_period_of_large_swings():
    """``T/4 = K(sin(1 rad)) / w`` with w of small oscillations: the relative derivatives are those of 1/w."""
    found = sensitivity(pendulum(), quarter_period, ["gravity[2]", "body.bob.com[2]"])
    J = IYY + M * L**2
    T = ellipk(np.sin(1.0) ** 2) * np.sqrt(J / (M * G * L))
    assert found.value == pytest.approx(T, rel=1e-11)
    sound(found, [T / (2 * G), T / 2 * (1 / L - 2 * M * L / J)], 1e-8)


def test_geometry_changes_the_assembled_pose():
    """A body at the end of a rod of length 0.7, at 0.4 rad: the derivative by the length is parallel to the rod."""

    def end(mechanism):
        return initial_state(mechanism).p_WB[0]

    at = 0.7 * np.array([np.sin(0.4), 0.0, -np.cos(0.4)])
    body = Body("bob", M, np.zeros(3), np.diag([0.1, 0.2, 0.25]), Frame(at, np.eye(3)))
    mechanism = Mechanism("rod", DOWN, (body,), (Joint("rod", "rod", GROUND, "bob", ORIGIN, ORIGIN, 0.7),))
    found = sensitivity(mechanism, end, ["joint.rod.length"])
    sound(found, (at / 0.7)[None], 1e-10)


def test_results_of_any_shape_and_of_no_parameters():
    found = sensitivity(
        pendulum(), lambda m: np.outer([m.bodies[0].mass, 1.0], m.gravity), ["body.bob.mass", "gravity[1]"]
    )
    assert found.derivatives.shape == found.errors.shape == (2, 2, 3)
    assert np.allclose(found.derivatives[0], [DOWN, [0, 0, 0]], rtol=0, atol=1e-12)
    assert np.allclose(found.derivatives[1], [[0, M, 0], [0, 1, 0]], rtol=0, atol=1e-12)
    assert sensitivity(pendulum(), lambda m: 1.0, []).derivatives.shape == (0,)


def test_a_rough_result_says_that_it_is_rough():
    rng = np.random.default_rng(5)
    found = sensitivity(pendulum(), lambda m: m.bodies[0].mass ** 3 + 1e-6 * rng.normal(), ["body.bob.mass"])
    actual = abs(found.derivatives[0] - 3 * M**2)
    assert 1e-9 < actual < 10 * found.errors[0]


def test_pins_of_a_redundant_loop_cannot_be_moved_one_by_one_out_of_its_plane():
    mechanism = four_bar()

    def crank(m):
        return initial_state(m).p_WB[0]

    normal = mechanism.joints[2].F.R[:, 2]
    k = int(np.argmax(np.abs(normal)))
    with pytest.raises(InvalidInput, match=rf"joint\.j2\.F\.p\[{k}\]': no small change of it leaves a result"):
        sensitivity(mechanism, crank, [f"joint.j2.F.p[{k}]"])


# ---------------------------------------------------------------- derivatives of a motion


def swing_of(parameters, times, rate):
    """Return angle and rate of the pendulum by its scalar equation of motion, also for complex parameters."""
    mass, arm, gravity, inertia = parameters
    w2 = mass * gravity * arm / (inertia + mass * arm**2)
    start = np.array([1.2, rate], dtype=complex)
    return solve_ivp(
        lambda t, u: [u[1], -w2 * np.sin(u[0])], (0, times[-1]), start, "DOP853", times, rtol=1e-13, atol=1e-14
    ).y


def test_a_swinging_pendulum_against_complex_steps_in_its_one_equation():
    times = np.linspace(0.0, 1.2, 4)
    paths = ["body.bob.mass", "body.bob.com[2]", "gravity[2]", "body.bob.inertia[1,1]"]
    signs = np.array([1.0, -1.0, -1.0, 1.0])  # com[2] and gravity[2] are minus arm and gravity

    def start(mechanism):
        return initial_state(mechanism, Initial({"pin": {"angle": 1.2}}, {"pin": {"angle": 0.7}}))

    found = trajectory_sensitivity(pendulum(), start, times, paths)
    for n, sign in enumerate(signs):
        values = np.array([M, L, G, IYY], dtype=complex)
        values[n] += 1e-30j
        angle, rate = swing_of(values, times, 0.7).imag / 1e-30
        assert np.max(np.abs(found.turn_W[n, :, 0, 1] - sign * angle)) < 1e-8 * np.max(np.abs(angle))
        assert np.max(np.abs(found.w_WB_W[n, :, 0, 1] - sign * rate)) < 1e-8 * np.max(np.abs(rate))
    assert np.max(found.drift) < 1e-8
    assert np.max(np.abs(found.p_WB)) < 1e-9  # the body origin is at the pin


def poses_and_velocities(mechanism, start, times):
    run = simulate(mechanism, start(mechanism), times, tolerance=1e-13)
    return np.array([run.p_WB, run.v_WB_W, run.w_WB_W])


MOTIONS = {
    "forced_chain": [
        "spring.s.stiffness",
        "joint_spring.k_j1.damping",
        "load.torque_body.vector[1]",
        "joint.j1.F.p[0]",
    ],
    "loop_spherical": ["body.b.mass", "body.a.com[0]", "joint.j1.M.p[1]", "joint.j3.F.turn[1]"],
    "loop_rod": ["joint.j2.length", "body.c.inertia[0,1]", "gravity[1]"],
    "four_bar": ["body.coupler.mass", "body.crank.com[1]", "gravity[0]"],
    "powered": ["body.b3.mass", "control.c0.integral"],
}


@pytest.mark.parametrize("name", MOTIONS)
def test_the_direct_route_agrees_with_differences_of_whole_motions(name):
    mechanism, times = (TREES | LOOPS | ELEMENTS)[name], np.array([0.0, 0.1, 0.25])
    found = trajectory_sensitivity(mechanism, initial_state, times, MOTIONS[name])
    other = sensitivity(mechanism, lambda m: poses_and_velocities(m, initial_state, times), MOTIONS[name])
    direct = np.stack([found.p_WB, found.v_WB_W, found.w_WB_W], axis=1)
    for mine, its, error in zip(direct, other.derivatives, other.errors, strict=True):
        scale = np.max(np.abs(its))
        assert np.max(np.abs(mine - its)) < 1e-7 * scale + 10 * np.max(error)
        assert np.max(error) < 1e-6 * scale
    assert np.max(found.drift) < 1e-8 * np.max(np.abs(direct))


def test_springs_counted_over_turns_keep_their_count():
    """A wheel that has made three turns against its torsion spring is a linear oscillator: ``q = (w0/w) sin(w t)``."""
    body = Body("wheel", M, np.zeros(3), np.diag([0.1, 0.2, 0.25]), ORIGIN)
    mechanism = Mechanism(
        "wheel",
        DOWN,
        (body,),
        (Joint("axle", "revolute", GROUND, "wheel", ORIGIN, ORIGIN),),
        joint_springs=(JointSpring("k", "axle", "angle", 0.25, 0.0, 0.0),),
    )
    times = np.array([0.0, 0.5, 1.5, 2.5])
    found = trajectory_sensitivity(
        mechanism,
        lambda m: initial_state(m, Initial({}, {"axle": {"angle": 25.0}})),
        times,
        ["joint_spring.k.stiffness"],
    )
    # w^2 = k / 0.25 = 1; dq/dk = w0 d(sin(w t)/w)/dw dw/dk with dw/dk = 1/(2 * 0.25)
    expected = 25.0 * (times * np.cos(times) - np.sin(times)) * 2.0
    assert found.turn_W[0, :, 0, 2] == pytest.approx(expected, rel=1e-8, abs=1e-8)


def test_initial_values_of_a_case():
    case = load_case("double_pendulum")
    path = next(p for p in parameter_paths(case) if p.startswith("initial.coordinates"))
    times = np.array([0.0, 0.4])
    found = trajectory_sensitivity(case, lambda c: c.initial_state, times, [path])
    other = sensitivity(case, lambda c: simulate(c.mechanism, c.initial_state, times, tolerance=1e-13).p_WB, [path])
    assert np.max(np.abs(found.p_WB - other.derivatives)) < 1e-8


def test_what_cannot_be_integrated_is_refused():
    with pytest.raises(InvalidInput, match="do not increase"):
        trajectory_sensitivity(pendulum(), initial_state, [1.0, 0.0], ["gravity[2]"])
    with pytest.raises(InvalidInput, match="'gravity\\[3\\]'"):
        trajectory_sensitivity(pendulum(), initial_state, [0.0, 1.0], ["gravity[3]"])
