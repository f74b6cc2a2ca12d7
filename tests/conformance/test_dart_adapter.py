"""Conversions and guards of the DART adapter; the rows of its README name the tests of this file."""

import dataclasses

import dartpy
import numpy as np
import pytest

import truth
from consilience.engine import Profile, Question, Route
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    State,
    initial_state,
    potential_energy,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)
from consilience.reference import simulate
from consilience_dart import DartEngine
from consilience_dart.dynamics import body_accelerations, forward_dynamics
from consilience_dart.loads import Forces
from consilience_dart.redundancy import rank_limit
from consilience_dart.state import from_state, read, send
from consilience_dart.stepping import CONSTRAINT_FORCE_MIXING, ERROR_REDUCTION_TRAJECTORY, set_softness, stepper
from consilience_dart.translation import build
from mechanisms import LOOPS, TREES, chain, drawn_joint, four_bar, lumpy_body, states_of

HERE = Frame(np.zeros(3), np.eye(3))
G = np.array([0.0, 0.0, -10.0])


@pytest.fixture
def engine():
    return DartEngine()


def by_route(engine, mechanism, question, route):
    return next(m for m in engine.methods(mechanism, question) if m.route is route)


def matched(engine, mechanism, question):
    return [m for m in engine.methods(mechanism, question) if m.profile is Profile.MATCHED]


def placed(mechanism):
    """Skeleton of a mechanism, with one of its random states set."""
    model, state = build(mechanism), states_of(mechanism)[1]
    send(model, from_state(model, state))
    return model, state


def ball_at(rotvec, w):
    """One body on a ball joint with F in the world frame and M in the body frame: state of given rotation and rate."""
    rng = np.random.default_rng(4)
    body = dataclasses.replace(lumpy_body("b", rng), drawing=HERE)
    mechanism = Mechanism("ball", G, (body,), (Joint("j", "spherical", GROUND, "b", HERE, HERE),))
    quat = quaternion_from_rotation_vector(rotvec)
    return mechanism, State(np.zeros((1, 3)), quat[None], np.zeros((1, 3)), np.array([w], dtype=float))


def bricard():
    """Bricard's mechanism, six revolutes along the edges of a cube: one of its thirty constraint rows is dependent."""
    rng = np.random.default_rng(1)
    p = [np.array(x, float) for x in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1))]
    bodies = {f"b{i}": lumpy_body(f"b{i}", rng) for i in range(5)}
    names = [GROUND, *bodies, GROUND]
    joints = []
    for i in range(6):
        x = p[(i + 1) % 6] - p[i]
        z = np.cross(p[i] - p[i - 1], x)
        axes = np.column_stack([x, np.cross(z, x), z])
        joints.append(drawn_joint(f"j{i}", "revolute", bodies, names[i], names[i + 1], p[i], axes))
    return Mechanism("bricard", np.array([1.3, -2.1, -9.4]), tuple(bodies.values()), tuple(joints))


def test_a_free_joint_has_rotation_vector_then_origin_and_world_rates():
    mechanism = chain("free", seed=9)
    model, state = placed(mechanism)
    frame = model.tree.links[0].body_frame
    R_WB = rotation_from_quaternion(state.quat_WB[0])
    R_WL = R_WB @ frame.R.T
    arm = R_WL @ frame.p
    q, v = model.skeleton.getPositions(), model.skeleton.getVelocities()
    R_q = rotation_from_quaternion(quaternion_from_rotation_vector(q[:3]))
    np.testing.assert_allclose(R_q, R_WL, atol=1e-13)
    np.testing.assert_allclose(q[3:], state.p_WB[0] - arm, atol=1e-13)
    np.testing.assert_allclose(v[:3], state.w_WB_W[0], atol=1e-13)
    np.testing.assert_allclose(v[3:], state.v_WB_W[0] - np.cross(state.w_WB_W[0], arm), atol=1e-13)
    # DART interprets the numbers as the harness does
    np.testing.assert_allclose(model.nodes[0].getAngularVelocity(), state.w_WB_W[0], atol=1e-13)
    np.testing.assert_allclose(model.nodes[0].getLinearVelocity(frame.p), state.v_WB_W[0], atol=1e-13)


def test_a_ball_joint_turns_by_its_rotation_vector_and_its_velocity_is_in_axes_of_the_link():
    rotvec, w = np.array([0.4, -1.1, 0.7]), np.array([0.3, 2.0, -0.9])
    mechanism, state = ball_at(rotvec, w)
    model = build(mechanism)
    send(model, from_state(model, state))
    R = rotation_from_quaternion(state.quat_WB[0])
    np.testing.assert_allclose(model.skeleton.getPositions(), rotvec, atol=1e-14)
    np.testing.assert_allclose(model.skeleton.getVelocities(), R.T @ w, atol=1e-14)
    np.testing.assert_allclose(model.nodes[0].getWorldTransform().rotation(), R, atol=1e-14)
    np.testing.assert_allclose(model.nodes[0].getAngularVelocity(), w, atol=1e-14)


@pytest.mark.parametrize("name", ["branched", "floating_chain", "backward_free", "loop_universal"])
def test_states_come_back_as_they_were_sent(name):
    model, state = placed((TREES | LOOPS)[name])
    p, quat, v, w = read(model)
    np.testing.assert_allclose(p, state.p_WB, atol=1e-13)
    np.testing.assert_allclose(np.abs(np.sum(quat * state.quat_WB, axis=1)), 1.0, atol=1e-13)
    np.testing.assert_allclose(v, state.v_WB_W, atol=1e-13)
    np.testing.assert_allclose(w, state.w_WB_W, atol=1e-13)


def test_the_inertia_of_a_node_is_about_its_centre_of_mass():
    mechanism = chain("revolute", seed=9)
    model = build(mechanism)
    body, R = mechanism.bodies[0], model.tree.links[0].body_frame.R
    held = model.nodes[0].getInertia()
    np.testing.assert_allclose(R.T @ held.getMoment() @ R, body.inertia, atol=1e-14)
    np.testing.assert_allclose(held.getLocalCOM(), model.tree.links[0].body_frame.p + R @ body.com, atol=1e-14)


def test_small_angles_of_a_ball_joint_are_sent_as_nearly_a_full_turn():
    rotvec = np.array([3e-4, -6e-4, 5e-4])
    mechanism, state = ball_at(rotvec, [1.0, -2.0, 1.5])
    model, expected = build(mechanism), rotation_from_quaternion(state.quat_WB[0])
    send(model, from_state(model, state))
    np.testing.assert_allclose(model.nodes[0].getWorldTransform().rotation(), expected, atol=5e-15)
    model.skeleton.setPositions(rotvec)  # without the detour; if these agree one day, the detour can go
    assert np.max(np.abs(model.nodes[0].getWorldTransform().rotation() - expected)) > 1e-11


@pytest.mark.parametrize("backward", [False, True])
def test_the_reaction_carries_a_hanging_weight(engine, backward):
    body = Body("b", 2.0, np.array([0.0, 0.5, 0.0]), 0.1 * np.eye(3), HERE)
    ends = ("b", GROUND) if backward else (GROUND, "b")
    mechanism = Mechanism("weight", G, (body,), (Joint("j", "rigid", *ends, HERE, HERE),))
    state = initial_state(mechanism)
    sign = -1.0 if backward else 1.0
    for method in engine.methods(mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, [state], method)
        np.testing.assert_allclose(answer.force_F[0, 0], sign * np.array([0.0, 0.0, 20.0]), atol=1e-13)
        np.testing.assert_allclose(answer.torque_F[0, 0], sign * np.array([10.0, 0.0, 0.0]), atol=1e-13)


@pytest.mark.parametrize("backward", [(), (0,)])
def test_several_springs_on_one_joint_act_and_store_energy_as_each_alone(engine, backward):
    mechanism = chain("cylindrical", "revolute", seed=12, backwards=backward)
    springs = (
        JointSpring("a", "j0", "angle", 3.0, 0.2, 0.7),
        JointSpring("b", "j0", "angle", 5.0, 0.0, -0.2),
        JointSpring("c", "j0", "distance", 4.0, 0.3, 0.1),
    )
    mechanism = dataclasses.replace(mechanism, joint_springs=springs)
    states = states_of(mechanism)
    for method in engine.methods(mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, states, method)
        for n, state in enumerate(states):
            a, alpha, force, torque = truth.solve(mechanism, state)
            np.testing.assert_allclose(answer.a_WB_W[n], a, atol=1e-11)
            np.testing.assert_allclose(answer.alpha_WB_W[n], alpha, atol=1e-11)
            np.testing.assert_allclose(answer.force_F[n], force, atol=1e-11)
            np.testing.assert_allclose(answer.torque_F[n], torque, atol=1e-11)
            assert answer.potential[n] == pytest.approx(potential_energy(mechanism, state), rel=1e-12)


def test_negative_springs_are_refused_and_dart_does_set_them_to_zero(engine, capfd):
    mechanism = chain("revolute", seed=12)
    for k, c in ((-1.0, 0.0), (1.0, -0.1)):
        sprung = dataclasses.replace(mechanism, joint_springs=(JointSpring("s", "j0", "angle", k, c, 0.0),))
        assert engine.unsupported(sprung, Question.INSTANT)
        assert engine.unsupported(sprung, Question.TRAJECTORY)
        assert not engine.unsupported(sprung, Question.MODEL)
        joint = build(sprung).joints[0]
        assert min(joint.getSpringStiffness(0), joint.getDampingCoefficient(0)) == 0.0
    capfd.readouterr()


def test_no_method_leaves_anything_behind_for_the_next(engine):
    mechanism = TREES["forced_chain"]
    states = states_of(mechanism)
    articulated, matrix = engine.methods(mechanism, Question.INSTANT)
    first = engine.instant(mechanism, states, articulated)
    engine.trajectory(
        mechanism, states[0], np.array([0.0, 0.01]), engine.methods(mechanism, Question.TRAJECTORY)[0], 1e-3
    )
    engine.instant(mechanism, states, matrix)
    again = engine.instant(mechanism, states, articulated)
    np.testing.assert_array_equal(again.a_WB_W, first.a_WB_W)
    np.testing.assert_array_equal(again.force_F, first.force_F)


def test_the_constraint_parameters_of_the_process_do_not_leak_in(engine):
    mechanism = LOOPS["slider_crank"]
    states = states_of(mechanism)[:1]
    native = by_route(engine, mechanism, Question.INSTANT, Route.EXTRAPOLATED)
    clean = engine.instant(mechanism, states, native)
    try:
        dartpy.constraint.BallJointConstraint.setErrorReductionParameter(0.3)
        dartpy.constraint.BallJointConstraint.setConstraintForceMixing(1e-3)
        np.testing.assert_array_equal(engine.instant(mechanism, states, native).a_WB_W, clean.a_WB_W)
    finally:
        set_softness(0.01, CONSTRAINT_FORCE_MIXING)


def test_one_step_of_dart_from_a_state_does_not_know_the_acceleration(engine):
    mechanism = LOOPS["four_bar"]
    state = states_of(mechanism)[1]  # moves at 1 rad/s: the error is one of the velocity term
    stepping = stepper(mechanism, state)
    c = from_state(stepping.model, state)
    set_softness(0.0, CONSTRAINT_FORCE_MIXING)
    stepping.world.setTimeStep(1e-5)
    errors = []
    a, _, _, _ = truth.solve(mechanism, state)
    for skipped in (0, 1):
        send(stepping.model, c)
        stepping.step(skipped)
        before = np.array(stepping.model.skeleton.getVelocities())
        stepping.step(1)
        difference = (stepping.model.skeleton.getVelocities() - before) / 1e-5
        send(stepping.model, c)
        stepping.model.skeleton.setAccelerations(difference)
        errors.append(np.max(np.abs(body_accelerations(stepping.model)[0] - a)) / np.max(np.abs(a)))
    assert errors[0] > 1e-2
    assert errors[1] < 1e-3


def test_gravity_reaches_the_skeleton_in_a_world():
    mechanism = TREES["long_chain"]
    stepping = stepper(mechanism, states_of(mechanism)[0])
    np.testing.assert_array_equal(stepping.model.skeleton.getGravity(), mechanism.gravity)
    assert not stepping.world.getDeactivationOptions().mEnabled


def test_a_slow_body_is_not_put_to_sleep(engine):
    body = Body("b", 1.0, np.zeros(3), np.eye(3), HERE)
    mechanism = Mechanism("slow", np.zeros(3), (body,), (Joint("j", "revolute", GROUND, "b", HERE, HERE),))
    rest = initial_state(mechanism)
    state = State(rest.p_WB, rest.quat_WB, rest.v_WB_W, np.array([[0.0, 0.0, 1e-3]]))
    times = np.linspace(0.0, 2.0, 3)
    for method in matched(engine, mechanism, Question.TRAJECTORY):
        answer = engine.trajectory(mechanism, state, times, method, 0.01)
        angle = rotation_vector_from_quaternion(answer.quat_WB[-1, 0])[2]
        assert angle == pytest.approx(2e-3, rel=1e-9)


def test_the_angle_of_a_spring_is_counted_over_full_turns(engine):
    # q'' = -k q with k = 1: from q = 0 at 9 rad/s the rotor swings to 9 rad, well beyond half a turn
    body = Body("b", 1.0, np.zeros(3), np.eye(3), HERE)
    joint = Joint("j", "revolute", GROUND, "b", HERE, HERE)
    spring = JointSpring("s", "j", "angle", 1.0, 0.0, 0.0)
    mechanism = Mechanism("rotor", np.zeros(3), (body,), (joint,), joint_springs=(spring,))
    rest = initial_state(mechanism)
    state = State(rest.p_WB, rest.quat_WB, rest.v_WB_W, np.array([[0.0, 0.0, 9.0]]))
    times = np.linspace(0.0, 3.0, 61)
    for method, bar in zip(matched(engine, mechanism, Question.TRAJECTORY), (1e-2, 1e-6), strict=True):
        answer = engine.trajectory(mechanism, state, times, method, 0.05 / method.substeps[-1])
        np.testing.assert_allclose(answer.w_WB_W[:, 0, 2], 9.0 * np.cos(times), atol=bar)


def test_a_state_that_is_not_finite_is_an_error(engine, capfd):
    model, state = placed(chain("revolute", seed=9))
    c = from_state(model, state)
    with pytest.raises(FloatingPointError):
        send(model, dataclasses.replace(c, v=np.array([np.nan])))
    model.skeleton.setPositions([np.nan])
    with pytest.raises(FloatingPointError):
        read(model)
    np.testing.assert_array_equal(model.nodes[0].getRelativeTransform().rotation()[2, :2], 0.0)  # DART hides the NaN
    capfd.readouterr()


def test_massless_links_cost_no_accuracy_and_no_noise(capfd):
    mechanism = chain("universal", "planar", "cylindrical", "rod", seed=31)
    model, state = placed(mechanism)
    assert sum(link.mass == 0.0 for link in model.tree.links) == 6
    forward_dynamics(model, Forces(model))
    a, alpha, _, _ = truth.solve(mechanism, state)
    found = np.hstack(body_accelerations(model))
    expected = np.hstack([a, alpha])
    assert np.max(np.abs(found - expected)) < 1e-11 * np.max(np.abs(expected))
    assert capfd.readouterr().err == ""


def test_the_mass_matrix_checks_the_articulated_bodies(engine):
    # behind ball joints and a large mass ratio, the articulated-body algorithm loses more digits than the mass matrix
    mechanism = chain("revolute", "prismatic", "spherical", "revolute", "spherical", seed=3)
    tip = mechanism.bodies[-1]
    heavy = dataclasses.replace(tip, mass=1e6 * tip.mass, inertia=1e6 * tip.inertia)
    mechanism = dataclasses.replace(mechanism, bodies=(*mechanism.bodies[:-1], heavy))
    states = states_of(mechanism)
    answers = [engine.instant(mechanism, states, m) for m in engine.methods(mechanism, Question.INSTANT)]
    expected = np.array([truth.solve(mechanism, state)[0] for state in states])
    errors = [np.max(np.abs(answer.a_WB_W - expected)) / np.max(np.abs(expected)) for answer in answers]
    assert errors[1] < 1e-8
    assert errors[0] > 5 * errors[1]


def test_an_overconstrained_spatial_loop(engine):
    mechanism = bricard()
    states = states_of(mechanism)[:3]
    assert engine.model(mechanism, states[0], engine.methods(mechanism, Question.MODEL)[0]).freedom == 1
    for method, bar in zip(matched(engine, mechanism, Question.INSTANT), (1e-10, 1e-8), strict=True):
        answer = engine.instant(mechanism, states, method)
        for n, state in enumerate(states):
            a, _, _, _ = truth.solve(mechanism, state)
            assert np.max(np.abs(answer.a_WB_W[n] - a)) < bar * np.max(np.abs(a)), method.name
    assert rank_limit(build(mechanism), states[0]) == 5
    assert rank_limit(build(four_bar()), states_of(four_bar())[0]) is None
    native, runge_kutta = matched(engine, mechanism, Question.TRAJECTORY)
    times = np.linspace(0.0, 0.4, 9)
    p = [engine.trajectory(mechanism, states[0], times, native, 0.05 / n).p_WB for n in native.substeps]
    # without error reduction this loop drifts and locks, and the differences do not halve
    assert np.max(np.abs(p[1] - p[0])) < 1e-3
    assert np.max(np.abs(p[1] - p[0])) / np.max(np.abs(p[2] - p[1])) == pytest.approx(2.0, abs=0.1)
    reference = simulate(mechanism, states[0], times, 1e-12).p_WB
    errors = [
        np.max(np.abs(engine.trajectory(mechanism, states[0], times, runge_kutta, 0.05 / n).p_WB - reference))
        for n in runge_kutta.substeps[:2]
    ]
    assert errors[1] < 1e-6
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.15)


def test_loads_keep_the_axes_they_are_fixed_in(engine):
    mechanism = chain("free", seed=9)
    vector, point = np.array([1.0, 2.0, -0.5]), np.array([0.3, -0.2, 0.4])
    for kind in ("force", "torque"):
        for frame in ("world", "body"):
            loaded = dataclasses.replace(mechanism, loads=(Load("l", kind, "b0", vector, frame, point),))
            for state in states_of(loaded)[:2]:
                answer = engine.instant(loaded, [state], engine.methods(loaded, Question.INSTANT)[0])
                a, alpha, _, _ = truth.solve(loaded, state)
                np.testing.assert_allclose(answer.a_WB_W[0], a, atol=1e-12)
                np.testing.assert_allclose(answer.alpha_WB_W[0], alpha, atol=1e-12)


def test_a_load_on_the_ground_moves_nothing(engine):
    mechanism = chain("free", "revolute", seed=9)
    loaded = dataclasses.replace(mechanism, loads=(Load("l", "force", GROUND, np.ones(3), "world"),))
    states = states_of(mechanism)
    bare, pushed = (engine.instant(m, states, engine.methods(m, Question.INSTANT)[0]) for m in (mechanism, loaded))
    np.testing.assert_array_equal(bare.a_WB_W, pushed.a_WB_W)


def test_only_methods_that_dart_carries_alone_are_called_native(engine):
    tree, loop = TREES["long_chain"], LOOPS["four_bar"]
    routes = {
        question: [[m.route for m in matched(engine, mechanism, question)] for mechanism in (tree, loop)]
        for question in (Question.INSTANT, Question.TRAJECTORY)
    }
    assert routes[Question.INSTANT] == [[Route.NATIVE, Route.HARNESS_SOLVE], [Route.HARNESS_SOLVE, Route.EXTRAPOLATED]]
    assert routes[Question.TRAJECTORY] == [
        [Route.NATIVE, Route.HARNESS_INTEGRATOR],
        [Route.TUNED, Route.HARNESS_INTEGRATOR],
    ]


def test_the_harness_is_told_of_no_trajectory_by_runge_kutta_with_rods(engine):
    for name in ("single_rod", "loop_rod"):
        assert [m.name for m in matched(engine, (TREES | LOOPS)[name], Question.TRAJECTORY)] == ["World.step"]


def test_the_copies_of_a_split_body_stay_together():
    mechanism = LOOPS["loop_universal"]
    stepping = stepper(mechanism, states_of(mechanism)[0])
    stepping.world.setTimeStep(1e-4)
    set_softness(ERROR_REDUCTION_TRAJECTORY, CONSTRAINT_FORCE_MIXING)
    nodes, links = stepping.model.nodes, stepping.model.tree.links

    def origin(link):
        T = nodes[link].getWorldTransform()
        return T.translation() + T.rotation() @ links[link].body_frame.p

    (weld,) = stepping.model.tree.welds
    np.testing.assert_allclose(origin(weld.copy), origin(weld.original), atol=1e-13)
    stepping.step(2000)
    np.testing.assert_allclose(origin(weld.copy), origin(weld.original), atol=1e-6)


def beside_a_loop(damping):
    """A four-bar, and beside it a light jaw on a damped slide of its own."""
    base, rng = four_bar(), np.random.default_rng(8)
    light = dataclasses.replace(lumpy_body("jaw", rng), mass=0.02)
    axes = rotation_from_quaternion(quaternion_from_rotation_vector([0.4, -0.9, 0.2]))
    slide = drawn_joint("slide", "prismatic", {"jaw": light}, GROUND, "jaw", np.array([0.3, 2.0, 0.1]), axes)
    damper = JointSpring("damper", "slide", "distance", 0.0, damping, 0.0)
    bodies, joints = (*base.bodies, light), (*base.joints, slide)
    return dataclasses.replace(base, bodies=bodies, joints=joints, joint_springs=(damper,)), axes[:, 2]


def nearly_dependent():
    """A slide and a hinge to a second body, whose centre is held in a plane nearly through the hinge's path."""
    rest, one = np.zeros(3), np.eye(3)
    bodies = tuple(Body(name, 1.0, rest, one, HERE) for name in ("b0", "b2"))
    off = Frame(np.array([1.0, -1.0, 1.0]), one)
    normal = np.array([-0.1253337133730115, -0.9909152650217727, 0.04876882035646739])
    second = np.cross([0.0, 0.0, 1.0], normal)
    second /= np.linalg.norm(second)
    plane = Frame(rest, np.column_stack([second, np.cross(normal, second), normal]))
    joints = (
        Joint("j3", "revolute", "b0", "b2", off, off),
        Joint("j0", "prismatic", GROUND, "b0", HERE, HERE),
        Joint("j7", "point_in_plane", GROUND, "b2", plane, plane),
    )
    return Mechanism("nearly dependent", np.zeros(3), bodies, joints)


@pytest.mark.parametrize("damping", [0.5, 1000.0])
def test_extrapolation_to_step_zero_holds_beside_a_stiff_damper(engine, damping):
    """The jaw alone: a = g . z - d v / m, at rates d / m of 25 and 5e4 1/s."""
    mechanism, z = beside_a_loop(damping)
    method = by_route(engine, mechanism, Question.INSTANT, Route.EXTRAPOLATED)
    for state in states_of(mechanism, 3):
        a = engine.instant(mechanism, [state], method).a_WB_W[0, -1]
        expected = mechanism.gravity @ z - damping * state.v_WB_W[-1] @ z / 0.02
        assert a @ z == pytest.approx(expected, rel=1e-8)


def test_extrapolation_to_step_zero_holds_where_constraints_are_nearly_dependent(engine):
    mechanism = nearly_dependent()
    method = by_route(engine, mechanism, Question.INSTANT, Route.EXTRAPOLATED)
    for state in states_of(mechanism, 4):
        found = engine.instant(mechanism, [state], method)
        expected = np.hstack(truth.solve(mechanism, state)[:2])
        error = np.max(np.abs(np.hstack([found.a_WB_W[0], found.alpha_WB_W[0]]) - expected))
        assert error < 1e-8 * np.max(np.abs(expected))
