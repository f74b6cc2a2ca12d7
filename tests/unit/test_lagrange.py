"""Lagrange's equations in joint coordinates against dense NumPy, the descriptor form, closed forms and identities."""

import functools
import itertools
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import truth
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Frame,
    Joint,
    JointKind,
    JointSpring,
    Mechanism,
    State,
    body_point,
    constraint_jacobian,
    constraint_residual,
    determinate_reactions,
    elementary_rotation,
    initial_state,
    joint_spring_motion,
    kinetic_energy,
    potential_energy,
    rotation_angle_between,
    rotation_from_quaternion,
    skew,
    spanning_tree,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from consilience.reference.formulations import lagrange_kinematics
from consilience.reference.formulations.lagrange import Lagrange, unsupported
from consilience.reference.formulations.orientations import SingularOrientation
from mechanisms import (
    ELEMENTS,
    LOOPS,
    TREES,
    chain,
    drawn_joint,
    force_elements,
    four_bar,
    lumpy_body,
    slider_crank,
    states_of,
)

EPS = np.finfo(float).eps


def with_forces(mechanism: Mechanism, seed: int) -> Mechanism:
    """Return the mechanism with all force elements; cylindrical joints have springs along and about the axis."""
    rng = np.random.default_rng(seed)
    extra = force_elements(list(mechanism.joints), [b.name for b in mechanism.bodies], rng)
    along = tuple(
        JointSpring(f"d_{j.name}", j.name, "distance", 5.0, 0.4, -0.1)
        for j in mechanism.joints
        if j.kind == "cylindrical"
    )
    return replace(mechanism, **extra | {"joint_springs": extra["joint_springs"] + along})


def rod_along_x_of_its_frame() -> Mechanism:
    """Return a rod along x of F: fixed axes x and y would not span all its directions."""
    mechanism = chain("rod", seed=31)
    joint = mechanism.joints[0]
    turned = Frame(joint.F.p, joint.F.R @ elementary_rotation(1, -0.5 * np.pi))
    return replace(mechanism, joints=(replace(joint, F=turned),))


def two_hinges(stiffness: float = 2.0) -> Mechanism:
    """Return a body on two sprung coaxial hinges without gravity: all rows of the cut hinge are dependent."""
    rng = np.random.default_rng(9)
    bodies = {"b": lumpy_body("b", rng)}
    at, axes = rng.normal(size=3), rotation_from_quaternion(np.array([0.1, 0.7, -0.5, 0.5]))
    hinges = tuple(
        drawn_joint(name, "revolute", bodies, GROUND, "b", at + shift * axes[:, 2], axes)
        for name, shift in (("one", 0.0), ("two", 0.6))
    )
    springs = tuple(JointSpring(f"k_{j.name}", j.name, "angle", stiffness, 0.0, 0.0) for j in hinges)
    return Mechanism("hinges", np.zeros(3), tuple(bodies.values()), hinges, joint_springs=springs)


FORCED = {
    "forced_backward_chain": with_forces(chain("revolute", "cylindrical", "prismatic", seed=30, backwards=(1, 2)), 50),
    "forced_four_bar": with_forces(four_bar(), 51),
    "forced_slider_crank": with_forces(slider_crank(), 52),
    "forced_four_bar_cylindrical": with_forces(four_bar(closing="cylindrical"), 53),
}
ALL = {**TREES, **LOOPS, **FORCED, "rod_along_x": rod_along_x_of_its_frame(), "two_hinges": two_hinges()}
OPEN = [name for name, mechanism in ALL.items() if not spanning_tree(mechanism)[1]]
CLOSED = [name for name in ALL if name not in (*OPEN, "two_hinges")]  # two coaxial hinges cannot come apart


@functools.cache
def states(name):
    return states_of(ALL[name])


@functools.cache
def formulation(name):
    return Lagrange(ALL[name])


# ---------------------------------------------------------------- at an instant


@pytest.mark.parametrize("name", ALL)
def test_accelerations_are_those_of_dense_numpy(name):
    mechanism = ALL[name]
    for state in states(name):
        found, wanted = np.hstack(formulation(name).accelerations(state)), np.hstack(truth.solve(mechanism, state)[:2])
        bar = 1e-10 + 10 * EPS * mass_matrix_condition(mechanism, state)
        assert np.max(np.abs(found - wanted)) < bar * np.max(np.abs(wanted))


@pytest.mark.parametrize("name", [name for name, m in ALL.items() if m.constraint_count()])
def test_reactions_are_those_of_dense_numpy_where_they_are_determined(name):
    mechanism = ALL[name]
    for state in states(name):
        found, wanted = np.hstack(formulation(name).reactions(state)), np.hstack(truth.solve(mechanism, state)[2:])
        which = determinate_reactions(mechanism, state)
        bar = 1e-10 + 10 * EPS * mass_matrix_condition(mechanism, state)
        assert np.max(np.abs(found - wanted)[which]) < bar * np.max(np.abs(wanted))


def test_a_free_joint_has_no_reaction():
    mechanism, state = ALL["single_free"], states("single_free")[0]
    weight = mechanism.bodies[0].mass * np.linalg.norm(mechanism.gravity)
    np.testing.assert_allclose(np.hstack(formulation("single_free").reactions(state)), 0.0, atol=1e-13 * weight)


def test_forced_mechanisms_have_springs_on_cut_joints():
    """FORCED has springs on cut joints, whose angles come from the pose of M in F, not from joint coordinates y."""
    sprung = {
        (mechanism.joints[k].kind, spring.coordinate)
        for mechanism in FORCED.values()
        for k in spanning_tree(mechanism)[1]
        for spring in mechanism.joint_springs
        if spring.joint == mechanism.joints[k].name
    }
    assert sprung >= {("revolute", "angle")}


# ---------------------------------------------------------------- coordinates


@pytest.mark.parametrize("name", ALL)
def test_coordinates_give_back_their_state(name):
    for state in states(name):
        back = formulation(name).state(formulation(name).coordinates(state))
        for one, other in ((back.p_WB, state.p_WB), (back.v_WB_W, state.v_WB_W), (back.w_WB_W, state.w_WB_W)):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
        assert np.max(rotation_angle_between(back.quat_WB, state.quat_WB)) < 1e-13


def freedom(mechanism):
    return sum(JOINT_KINDS[mechanism.joints[k].kind].freedom for k, _ in spanning_tree(mechanism)[0])


def anywhere(name, rng):
    """Return coordinates of a tree well inside its charts, with random rates."""
    n = freedom(ALL[name])
    u = formulation(name).coordinates(states(name)[0])
    u[: 2 * n] += rng.uniform(-0.7, 0.7, size=2 * n)
    return u


def along(name, u, h=1e-5):
    """Return states just before and after on the tangent of the motion, and the time between them."""
    rate = formulation(name).derivative(0.0, u)
    return formulation(name).state(u - h * rate), formulation(name).state(u + h * rate), 2 * h


@pytest.mark.parametrize("name", OPEN)
def test_any_coordinates_meet_the_tree_joints(name):
    state = formulation(name).state(anywhere(name, np.random.default_rng(4)))
    velocities = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    assert np.max(np.abs(constraint_residual(ALL[name], state)), initial=0.0) < 1e-13
    assert np.max(np.abs(constraint_jacobian(ALL[name], state) @ velocities), initial=0.0) < 1e-12


@pytest.mark.parametrize("name", OPEN)
def test_derivative_moves_the_state_with_its_velocities_and_the_accelerations_of_dense_numpy(name):
    """Away from the centres of the charts: velocities and accelerations are central differences of the state."""
    u = anywhere(name, np.random.default_rng(5))
    state = formulation(name).state(u)
    before, after, span = along(name, u)
    a, alpha = truth.solve(ALL[name], state)[:2]
    R_dot = (rotation_from_quaternion(after.quat_WB) - rotation_from_quaternion(before.quat_WB)) / span
    spin = np.array([skew(w) for w in state.w_WB_W]) @ rotation_from_quaternion(state.quat_WB)
    size = max(1.0, np.max(np.abs(a)), np.max(np.abs(alpha)))
    np.testing.assert_allclose((after.p_WB - before.p_WB) / span, state.v_WB_W, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose(R_dot, spin, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose((after.v_WB_W - before.v_WB_W) / span, a, rtol=0, atol=1e-7 * size)
    np.testing.assert_allclose((after.w_WB_W - before.w_WB_W) / span, alpha, rtol=0, atol=1e-7 * size)


def power(mechanism, state):
    """Return the power of all dampers and loads, from the definitions of the force elements."""
    R, total = rotation_from_quaternion(state.quat_WB), 0.0
    for s in mechanism.springs:
        p_i, v_i = body_point(mechanism, state, s.predecessor, s.point_predecessor)
        p_j, v_j = body_point(mechanism, state, s.successor, s.point_successor)
        total -= s.damping * ((p_j - p_i) @ (v_j - v_i)) ** 2 / ((p_j - p_i) @ (p_j - p_i))
    for s in mechanism.joint_springs:
        total -= s.damping * joint_spring_motion(mechanism, state, s.joint, s.coordinate)[1] ** 2
    for load in mechanism.loads:
        b = mechanism.body_index[load.body]
        vector = R[b] @ load.vector if load.frame == "body" else load.vector
        v = body_point(mechanism, state, load.body, load.point)[1]
        total += vector @ (v if load.kind == "force" else state.w_WB_W[b])
    return total


@pytest.mark.parametrize("name", ["forced_chain", *FORCED])
def test_energy_changes_by_the_power_of_dampers_and_loads(name):
    mechanism = ALL[name]
    for state in states(name):
        ends = along(name, formulation(name).coordinates(state))
        before, after = (kinetic_energy(mechanism, s) + potential_energy(mechanism, s) for s in ends[:2])
        wanted = power(mechanism, state)
        assert abs((after - before) / ends[2] - wanted) < 1e-7 * (abs(wanted) + kinetic_energy(mechanism, state))


# ---------------------------------------------------------------- projection


@pytest.mark.parametrize("name", CLOSED)
def test_settling_closes_the_loops(name):
    mechanism, rng = ALL[name], np.random.default_rng(6)
    u = formulation(name).coordinates(states(name)[0])
    n = freedom(mechanism)
    u[: 2 * n] += 1e-4 * rng.normal(size=2 * n)
    assert np.max(np.abs(constraint_residual(mechanism, formulation(name).state(u)))) > 1e-6
    settled = formulation(name).settle(0.0, u)
    state = formulation(name).state(settled)
    velocities = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-13
    assert np.max(np.abs(constraint_jacobian(mechanism, state) @ velocities)) < 1e-12
    np.testing.assert_allclose(settled, u, rtol=0, atol=1e-2)


@pytest.mark.parametrize("name", CLOSED)
def test_velocities_change_by_the_least_kinetic_energy(name):
    """At the same pose ``T(before) = T(after) + T(change)``: the change is M-orthogonal to admissible velocities."""
    mechanism, rng = ALL[name], np.random.default_rng(7)
    u = formulation(name).coordinates(states(name)[0])
    n = freedom(mechanism)
    u = formulation(name).settle(0.0, u)
    u[n : 2 * n] += rng.normal(size=n)
    before, after = formulation(name).state(u), formulation(name).state(formulation(name).settle(0.0, u))
    change = State(before.p_WB, before.quat_WB, before.v_WB_W - after.v_WB_W, before.w_WB_W - after.w_WB_W)
    T = [kinetic_energy(mechanism, s) for s in (before, after, change)]
    assert T[2] > 1e-3
    assert T[0] == pytest.approx(T[1] + T[2], rel=1e-11)


@pytest.mark.parametrize("name", ["single_spherical", "single_free", "backward_rod", "branched"])
def test_a_new_chart_changes_the_numbers_and_not_the_motion(name):
    n = freedom(ALL[name])
    chosen = formulation(name)
    u = chosen.coordinates(states(name)[0])
    assert chosen.settle(0.0, u) is u
    for slot in lagrange_kinematics.layout(ALL[name]).charted:
        u[slot.columns] += [0.5, 1.2, -0.8][: slot.columns.stop - slot.columns.start]
    settled = chosen.settle(0.0, u)
    assert np.max(np.abs(settled[:n] - u[:n])) > 1.0
    before, after = chosen.state(u), chosen.state(settled)
    assert np.max(rotation_angle_between(before.quat_WB, after.quat_WB)) < 1e-13
    for one, other in zip(motion_of(before), motion_of(after), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    for one, other in zip(along(name, u)[:2], along(name, settled)[:2], strict=True):  # the same accelerations, too
        np.testing.assert_allclose(one.w_WB_W, other.w_WB_W, rtol=0, atol=1e-8)


def motion_of(state):
    return state.p_WB, state.v_WB_W, state.w_WB_W


def test_a_chart_left_behind_is_named():
    u = formulation("single_spherical").coordinates(states("single_spherical")[0])
    u[1] = -0.5 * np.pi
    with pytest.raises(SingularOrientation, match=r"j0.*beta"):
        formulation("single_spherical").derivative(0.0, u)


# ---------------------------------------------------------------- motion


def motion(chosen, state, times):
    """Return the states at the times, and the number of chart changes; SciPy's DOP853, projected at every sample."""
    u, changes, found = chosen.coordinates(state), 0, [state]
    for start, stop in itertools.pairwise(times):
        end = solve_ivp(chosen.derivative, (start, stop), u, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        u = chosen.settle(stop, end)
        changes += np.max(np.abs(u - end)) > 0.1
        found.append(chosen.state(u))
    return found, changes


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("single_spherical", 2),
        ("single_rod", 1),
        ("branched", 1),
        ("loop_spherical", 0),
        ("loop_rod", 0),
        ("four_bar", 0),
        ("forced_chain", 0),
        ("forced_four_bar", 0),
    ],
)
def test_motion_is_that_of_the_descriptor_form(name, changes):
    mechanism, times = ALL[name], np.linspace(0.0, 1.0, 21)
    state = states(name)[2]  # one whose orientations leave their charts
    found, switched = motion(formulation(name), state, times)
    wanted = simulate(mechanism, state, times, tolerance=1e-12)
    assert switched >= changes
    speed = max(1.0, np.max(np.abs(wanted.w_WB_W)), np.max(np.abs(wanted.v_WB_W)))
    assert np.max(rotation_angle_between([s.quat_WB for s in found], wanted.quat_WB)) < 1e-9
    np.testing.assert_allclose([s.p_WB for s in found], wanted.p_WB, rtol=0, atol=1e-9)
    np.testing.assert_allclose([s.v_WB_W for s in found], wanted.v_WB_W, rtol=0, atol=1e-9 * speed)
    np.testing.assert_allclose([s.w_WB_W for s in found], wanted.w_WB_W, rtol=0, atol=1e-9 * speed)


def test_springs_of_tree_and_cut_joints_count_full_turns():
    """Two coaxial sprung hinges: ``J theta'' = -2 k theta`` in closed form, over more than a turn each way."""
    mechanism = two_hinges(stiffness=2.0)
    assert len(spanning_tree(mechanism)[1]) == 1
    body, hinge = mechanism.bodies[0], mechanism.joints[0]
    axis, at = hinge.M.R[:, 2], hinge.F.p
    arm = np.cross(axis, body.com - hinge.M.p)
    omega = np.sqrt(2 * 2.0 / (axis @ body.inertia @ axis + body.mass * arm @ arm))
    rest = initial_state(mechanism)
    w = 8.0 * omega * hinge.F.R[:, 2]  # amplitude of 8 rad
    moving = State(rest.p_WB, rest.quat_WB, np.cross(w, rest.p_WB - at), w[None])
    times = np.linspace(0.0, 2 * np.pi / omega, 21)
    found, _ = motion(formulation("two_hinges"), moving, times)
    rates = [s.w_WB_W[0] @ hinge.F.R[:, 2] for s in found]
    np.testing.assert_allclose(rates, 8.0 * omega * np.cos(omega * times), rtol=0, atol=1e-9 * 8.0 * omega)


# ---------------------------------------------------------------- what is supported


@pytest.mark.parametrize(
    ("rows", "coordinates"),
    [
        (("X", "Y"), ("distance", "orientation")),
        (("Z",), ("x", "y", "orientation")),
        (("D13", "D23"), ("position", "angle")),
    ],
)
@pytest.mark.parametrize("backwards", [(), (1,)])
def test_a_new_kind_with_known_rows_and_coordinates_needs_no_code(monkeypatch, rows, coordinates, backwards):
    monkeypatch.setitem(JOINT_KINDS, "new", JointKind(rows, coordinates))
    mechanism = chain("revolute", "new", seed=60, backwards=backwards)
    chosen = Lagrange(mechanism)
    for state in states_of(mechanism, 2):
        found, wanted = np.hstack(chosen.accelerations(state)), np.hstack(truth.solve(mechanism, state)[:2])
        assert np.max(np.abs(found - wanted)) < 1e-10 * np.max(np.abs(wanted))


@pytest.mark.parametrize(
    "kind", [JointKind(("X", "Y", "D13", "D23", "pitch"), ("angle",)), JointKind(("X", "Y"), ("angle", "wander"))]
)
def test_an_unsupported_joint_kind_is_refused_by_name(monkeypatch, kind):
    monkeypatch.setitem(JOINT_KINDS, "odd", kind)
    base = chain("revolute", seed=61)
    joint = base.joints[0]
    mechanism = replace(base, joints=(Joint("strange", "odd", GROUND, "b0", joint.F, joint.M),))
    assert [refusal.feature for refusal in unsupported(mechanism)] == ["joint 'strange': odd"]
    with pytest.raises(InvalidInput, match=r"strange.*Choose another formulation"):
        Lagrange(mechanism)


@pytest.mark.parametrize("name", ALL)
def test_every_mechanism_of_the_tests_is_supported(name):
    assert unsupported(ALL[name]) == ()


def test_without_casadi_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(InvalidInput, match=r"pip install 'consilience\[lagrange\]'"):
        Lagrange(TREES["single_revolute"])


@pytest.mark.parametrize("name", ELEMENTS)
def test_an_element_without_a_term_is_refused_and_never_left_out(name):
    mechanism = ELEMENTS[name]
    named = [
        e.name
        for group in ("frictions", "controls", "drives", "couplings", "rollings", "skates")
        for e in getattr(mechanism, group)
    ]
    features = [refusal.feature for refusal in unsupported(mechanism)]
    assert all(f"element '{element}'" in features for element in named)
