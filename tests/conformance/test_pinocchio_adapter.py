"""Conversions and guards of the Pinocchio adapter; each test fails if the conversion in its name is wrong."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import truth
from consilience.engine import Question, Route
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    State,
    determinate_reactions,
    kinetic_energy,
    potential_energy,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)
from consilience_pinocchio import PinocchioEngine, charts
from consilience_pinocchio.dynamics import PROXIMAL, Solution, solve, weld_rows
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.forces import Forces
from consilience_pinocchio.observe import poses
from consilience_pinocchio.reactions import reactions
from consilience_pinocchio.translate import configuration, translate
from mechanisms import LOOPS, TREES, chain, force_elements, states_of

AT_ORIGIN = Frame(np.zeros(3), np.eye(3))
TURN = quaternion_from_rotation_vector([0.3, -0.5, 0.7])
NO_GRAVITY = np.zeros(3)
HEAVY = np.array([0.0, 0.0, -9.0])


def one_body(kind, gravity=NO_GRAVITY, com=(0.2, -0.1, 0.4), backward=False, F=AT_ORIGIN, M=AT_ORIGIN, **more):
    """A lumpy body on one joint; F lies at the origin of the ground, M at the origin of the body."""
    inertia = np.array([[0.5, 0.02, -0.03], [0.02, 0.6, 0.05], [-0.03, 0.05, 0.7]])
    body = Body("body", 2.0, np.array(com), inertia, AT_ORIGIN)
    ends = ("body", GROUND) if backward else (GROUND, "body")
    frames = (M, F) if backward else (F, M)
    length = 0.5 if kind == "rod" else 0.0
    return Mechanism("one", gravity, (body,), (Joint("j", kind, *ends, *frames, length),), **more)


def state_of_one(p=(0.0, 0, 0), quat=(1.0, 0, 0, 0), v=(0.0, 0, 0), w=(0.0, 0, 0)):
    return State(*(np.array([x], dtype=float) for x in (p, quat, v, w)))


def answer(mechanism, state, which=0):
    engine = PinocchioEngine()
    return engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[which])


def with_forces(mechanism):
    bodies = [b.name for b in mechanism.bodies]
    return replace(mechanism, **force_elements(list(mechanism.joints), bodies, np.random.default_rng(9)))


def agrees_with_the_truth(mechanism, state):
    for which in range(2):
        found = answer(mechanism, state, which)
        a, alpha, force, torque = truth.solve(mechanism, state)
        scale = max(1.0, np.max(np.abs([a, alpha])))
        np.testing.assert_allclose([found.a_WB_W[0], found.alpha_WB_W[0]], [a, alpha], atol=1e-11 * scale)
        known = determinate_reactions(mechanism, state)
        expected = np.hstack([force, torque])[known]
        scale = max(1.0, np.max(np.abs(expected)))
        np.testing.assert_allclose(
            np.hstack([found.force_F[0], found.torque_F[0]])[known], expected, atol=1e-10 * scale
        )
        assert found.potential[0] == pytest.approx(potential_energy(mechanism, state), rel=1e-12)
    return found


def test_quaternions_are_scalar_last():
    q, _ = configuration(translate(one_body("spherical")), state_of_one(quat=TURN))
    np.testing.assert_allclose(q, np.roll(TURN, -1), atol=1e-15)


def test_velocity_of_a_free_body_is_in_its_own_axes_linear_first():
    v_W, w_W, R = np.array([1.0, 2, 3]), np.array([-4.0, 5, 6]), rotation_from_quaternion(TURN)
    q, v = configuration(translate(one_body("free")), state_of_one((7, 8, 9), TURN, v_W, w_W))
    np.testing.assert_allclose(q[:3], [7, 8, 9])
    np.testing.assert_allclose(v, np.concatenate([R.T @ v_W, R.T @ w_W]), atol=1e-14)


@pytest.mark.parametrize("name", TREES | LOOPS)
def test_poses_and_velocities_come_back(name):
    mechanism = (TREES | LOOPS)[name]
    translation = translate(mechanism)
    for state in states_of(mechanism, 2):
        pin.forwardKinematics(translation.model, translation.data, *configuration(translation, state))
        p, quat, v, w = poses(translation)
        np.testing.assert_allclose(p, state.p_WB, atol=1e-12)
        np.testing.assert_allclose(rotation_from_quaternion(quat), rotation_from_quaternion(state.quat_WB), atol=1e-12)
        np.testing.assert_allclose(v, state.v_WB_W, atol=1e-11)
        np.testing.assert_allclose(w, state.w_WB_W, atol=1e-11)


def test_inertia_is_about_the_centre_of_mass_in_axes_of_the_link():
    M = Frame(np.array([0.1, 0.2, 0.3]), rotation_from_quaternion(TURN))
    mechanism = one_body("revolute", M=M)
    body, inertia = mechanism.bodies[0], translate(mechanism).model.inertias[1]
    assert inertia.mass == body.mass
    np.testing.assert_allclose(inertia.lever, M.R.T @ (body.com - M.p), atol=1e-15)
    np.testing.assert_allclose(inertia.inertia, M.R.T @ body.inertia @ M.R, atol=1e-15)


def test_accelerations_are_classical_and_of_the_body_origin():
    # without gravity a body rotates uniformly about z: its origin, 0.3 m off the axis, has a centripetal acceleration
    mechanism = one_body("revolute", com=(0.3, 0, 0), M=Frame(np.array([0.3, 0, 0]), np.eye(3)))
    balanced = replace(mechanism, bodies=(replace(mechanism.bodies[0], inertia=np.diag([0.5, 0.6, 0.7])),))
    found = answer(balanced, state_of_one((-0.3, 0, 0), v=(0, -0.6, 0), w=(0, 0, 2)))
    np.testing.assert_allclose(found.a_WB_W[0, 0], [1.2, 0, 0], atol=1e-14)  # the spatial acceleration would be zero
    np.testing.assert_allclose(found.alpha_WB_W[0, 0], 0, atol=1e-14)


@pytest.mark.parametrize("frame", ["world", "body"])
def test_forces_push_in_the_axes_they_are_given_in(frame):
    force = np.array([3.0, -2.0, 1.0])
    com = np.array([0.2, -0.1, 0.4])
    load = Load("push", "force", "body", force, frame, com)
    found = answer(one_body("free", HEAVY, loads=(load,)), state_of_one(quat=TURN))
    R = rotation_from_quaternion(TURN)
    expected = HEAVY + (force if frame == "world" else R @ force) / 2.0  # through the centre of mass: no rotation
    np.testing.assert_allclose(found.a_WB_W[0, 0], expected, atol=1e-13)
    np.testing.assert_allclose(found.alpha_WB_W[0, 0], 0, atol=1e-13)


@pytest.mark.parametrize("kind", ["spherical", "rigid"])
@pytest.mark.parametrize("backward", [False, True])
def test_a_hanging_weight_is_held_up_on_the_successor(kind, backward):
    F = Frame(np.array([0.5, 0, 0]), rotation_from_quaternion(TURN))
    mechanism = one_body(
        kind, HEAVY, (0, 0, -0.7), backward, F, AT_ORIGIN if kind == "spherical" else Frame(F.p * 0, F.R)
    )
    found = answer(mechanism, state_of_one(F.p))
    up = -18.0 if backward else 18.0  # reversed, the successor is the ground, which the weight pulls down
    axes = mechanism.joints[0].F.R
    np.testing.assert_allclose(axes @ found.force_F[0, 0], [0, 0, up], atol=1e-13)
    np.testing.assert_allclose(found.torque_F[0, 0], 0, atol=1e-13)


def test_a_welded_arm_carries_moment_and_what_is_welded_to_the_ground_keeps_its_potential_energy():
    found = answer(one_body("rigid", HEAVY, (0.7, 0, 0.5)), state_of_one())
    np.testing.assert_allclose(found.torque_F[0, 0], [0, -12.6, 0], atol=1e-13)
    assert found.potential[0] == pytest.approx(2.0 * 9.0 * 0.5)


@pytest.mark.parametrize(
    "kinds", [("rigid", "revolute", "rigid", "rigid", "spherical"), ("revolute", "rigid", "rigid")]
)
def test_forces_on_welded_bodies_reach_the_right_joint(kinds):
    mechanism = with_forces(chain(*kinds, seed=2, backwards=(1, 2)))
    for state in states_of(mechanism):
        agrees_with_the_truth(mechanism, state)


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize(("kind", "coordinate"), [("revolute", "angle"), ("prismatic", "distance")])
def test_joint_springs_pull_back_and_stay_out_of_the_reaction(kind, coordinate, backward):
    spring = JointSpring("k", "j", coordinate, 3.0, 0.2, 0.1)
    mechanism = one_body(kind, HEAVY, backward=backward, joint_springs=(spring,))
    for state in states_of(mechanism):
        found = agrees_with_the_truth(mechanism, state)
        along = found.torque_F if kind == "revolute" else found.force_F
        assert abs(along[0, 0, 2]) < 1e-12


@pytest.mark.parametrize("name", LOOPS)
def test_forces_on_loops(name):
    mechanism = with_forces(LOOPS[name])
    for state in states_of(mechanism, 2):
        agrees_with_the_truth(mechanism, state)


def test_views_of_the_kinematics_are_live():
    mechanism = TREES["forced_chain"]
    translation = translate(mechanism)
    old = Forces(translation)
    for state in states_of(mechanism, 3):
        pin.forwardKinematics(translation.model, translation.data, *configuration(translation, state))
        np.testing.assert_array_equal(old.wrenches(), Forces(translation).wrenches())
        assert np.any(old.wrenches())


def test_joints_stand_depth_first_so_that_the_mass_matrix_is_right():
    mechanism = TREES["branched"]
    translation = translate(mechanism)
    assert translation.model.check(translation.data)
    for state in states_of(mechanism):
        q, v = configuration(translation, state)
        M = pin.crba(translation.model, translation.data, q)
        assert 0.5 * v @ M @ v == pytest.approx(kinetic_energy(mechanism, state), rel=1e-12)


def test_the_engines_check_catches_joints_that_are_not_depth_first():
    model = pin.Model()
    roots = [model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name) for name in "ab"]
    for root in roots:
        model.addJoint(root, pin.JointModelRZ(), pin.SE3.Identity(), f"on_{root}")
    assert not model.check(model.createData())


def test_a_failed_check_is_an_error(monkeypatch):
    monkeypatch.setattr(pin.Model, "check", lambda *_: False)
    with pytest.raises(RuntimeError, match="check"):
        translate(TREES["branched"])


def test_dependent_rows_need_the_proximal_settings():
    default, ours = [], []
    for name in ("four_bar", "slider_crank", "four_bar_cylindrical"):
        t = translate(LOOPS[name])
        method = PinocchioEngine().methods(LOOPS[name], Question.INSTANT)[0]
        loops = (t.constraints, t.constraint_data)
        for state in states_of(LOOPS[name]):
            q, v = configuration(t, state)
            J, gamma = weld_rows(t, q, v)
            a = solve(t, Elements(t), method, q, v).a
            # gamma vanishes with the squares of the velocities, the rounding of J a does not
            ours.append(np.max(np.abs(J @ a - gamma)) / np.max(np.abs(J) @ np.abs(a)))
            tau = np.zeros(t.model.nv)
            a = pin.constraintDynamics(t.model, t.data, q, v, tau, *loops, pin.ProximalSettings())
            default.append(np.max(np.abs(J @ a - gamma)))
    assert not np.all(np.isfinite(default))  # the factorisation meets a pivot at rounding level, of either sign
    assert max(ours) < 1e-13


def test_nothing_is_stabilised_and_every_knob_is_named():
    engine = PinocchioEngine()
    for constraint in translate(LOOPS["slider_crank"]).constraints:
        assert not np.any(constraint.m_baumgarte_parameters.Kp)
        assert not np.any(constraint.m_baumgarte_parameters.Kd)
    for question in (Question.INSTANT, Question.TRAJECTORY):
        assert engine.methods(LOOPS["slider_crank"], question)[0].settings == PROXIMAL
        assert all(not method.settings for method in engine.methods(TREES["branched"], question))
    routes = {q: [m.route for m in engine.methods(LOOPS["four_bar"], q)] for q in Question}
    assert routes[Question.INSTANT] == [Route.TUNED, Route.HARNESS_SOLVE, Route.NATIVE]
    assert routes[Question.TRAJECTORY] == [Route.HARNESS_INTEGRATOR]


@pytest.mark.parametrize("name", ["long_chain", "four_bar", "loop_rod"])
def test_wrong_constraint_forces_are_refused(name):
    """A tree has none: accelerations that rounding spoils are answered, and seen as such."""
    mechanism = (TREES | LOOPS)[name]
    t, state = translate(mechanism), states_of(mechanism)[0]
    elements = Elements(t)
    method = PinocchioEngine().methods(mechanism, Question.INSTANT)[0]
    right = solve(t, elements, method, *configuration(t, state))
    force, _ = reactions(mechanism, t, elements, right, state)
    wrong = Solution(right.q, right.v, right.a * (1 + 1e-6), right.tau, right.wrenches)
    if name in TREES:
        found, _ = reactions(mechanism, t, elements, wrong, state)
        np.testing.assert_allclose(found, force, rtol=0, atol=1e-4 * np.max(np.abs(force)))
        return
    with pytest.raises(ArithmeticError, match="inverse dynamics"):
        reactions(mechanism, t, elements, wrong, state)


def trajectory(mechanism, state, duration, substeps):
    engine = PinocchioEngine()
    times = np.arange(round(duration / 0.05) + 1) * 0.05
    method = engine.methods(mechanism, Question.TRAJECTORY)[0]
    return engine.trajectory(mechanism, state, times, method, 0.05 / substeps)


def test_the_integration_keeps_order_four_on_quaternions():
    mechanism = TREES["floating_chain"]
    runs = [trajectory(mechanism, states_of(mechanism)[0], 0.4, n) for n in (4, 8, 16)]
    steps = [np.max(np.abs(a.p_WB - b.p_WB)) for a, b in pairwise(runs)]
    assert np.log2(steps[0] / steps[1]) == pytest.approx(4, abs=0.3)
    np.testing.assert_allclose(np.linalg.norm(runs[0].quat_WB, axis=-1), 1, atol=1e-15)


@pytest.mark.parametrize("backward", [False, True])
def test_the_angle_of_a_joint_spring_counts_full_turns(backward):
    # a flywheel on a torsion spring: q = 12 sin t, nearly two turns
    spring = JointSpring("k", "j", "angle", 0.7, 0.0, 0.0)
    mechanism = one_body("revolute", com=(0, 0, 0), backward=backward, joint_springs=(spring,))
    found = trajectory(mechanism, state_of_one(w=(0, 0, 12)), 3.0, 40)
    np.testing.assert_allclose(found.w_WB_W[:, 0, 2], 12 * np.cos(found.time), atol=1e-7)


def rod_along(direction, backward):
    """A body on a rod that leaves the ground along `direction` in axes of F, in motion, its centre of mass below."""
    mechanism = one_body("rod", HEAVY, (0.1, 0.2, -0.3), backward)
    d = np.array(direction) / np.linalg.norm(direction)
    return mechanism, state_of_one(0.5 * d, TURN if not backward else (1, 0, 0, 0), np.cross([0.2, 0.5, 0.3], d))


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("direction", [(1.0, 0, 0), (-1.0, 0, 0), (1.0, 1e-9, 0), (0.2, 0.5, 0.7)])
def test_a_rod_has_no_singular_pose(direction, backward):
    mechanism, state = rod_along(direction, backward)
    agrees_with_the_truth(mechanism, state)
    found = trajectory(mechanism, state, 0.1, 20)
    energy = potential_energy(mechanism, state) + kinetic_energy(mechanism, state)
    for k in range(len(found.time)):
        later = State(found.p_WB[k], found.quat_WB[k], found.v_WB_W[k], found.w_WB_W[k])
        now = potential_energy(mechanism, later) + kinetic_energy(mechanism, later)
        assert now == pytest.approx(energy, abs=1e-7)
        assert np.linalg.norm(later.p_WB[0]) == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize("name", ["single_rod", "backward_rod", "loop_rod"])
def test_changing_the_chart_of_a_rod_keeps_the_motion(name):
    mechanism = (TREES | LOOPS)[name]
    for state in states_of(mechanism):
        before = translate(mechanism)
        q, v = configuration(before, state)
        after, q, v = charts.ChartWatch(before).change(q, v)
        q_expected, v_expected = configuration(after, state)
        np.testing.assert_allclose(v, v_expected, atol=1e-11)
        assert np.sum(np.abs(q_expected) < 1e-12) >= 2  # the two angles of the rod
        pin.forwardKinematics(after.model, after.data, q, v)
        p, quat, *_ = poses(after)
        np.testing.assert_allclose(p, state.p_WB, atol=1e-12)
        np.testing.assert_allclose(rotation_from_quaternion(quat), rotation_from_quaternion(state.quat_WB), atol=1e-12)
        np.testing.assert_allclose(np.abs(q), np.abs(q_expected), atol=1e-11)


def test_a_rod_changes_its_chart_under_way():
    mechanism = TREES["single_rod"]
    state = states_of(mechanism)[0]
    found = trajectory(mechanism, state, 5.0, 80)
    assert found.counters["chart changes"] > 0
    energy = [
        potential_energy(mechanism, s) + kinetic_energy(mechanism, s)
        for s in (State(*x) for x in zip(found.p_WB, found.quat_WB, found.v_WB_W, found.w_WB_W, strict=True))
    ]
    np.testing.assert_allclose(energy, energy[0], atol=1e-3 * max(1, abs(energy[0])))


def test_translations_are_kept_by_identity():
    engine = PinocchioEngine()
    mechanism = TREES["long_chain"]
    kept = engine._translated(mechanism)
    assert engine._translated(mechanism) is kept
    assert engine._translated(chain("revolute", seed=1)) is not kept
