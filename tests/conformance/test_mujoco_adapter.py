"""Conventions and pitfalls of the MuJoCo adapter: one test for each row of its README."""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.engine import Question, Route
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    body_point,
    drawing_state,
    initial_state,
    mass_properties,
    potential_energy,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_angle_between,
    rotation_from_quaternion,
)
from mechanisms import ELEMENTS, GRAVITY, LOOPS, TREES, chain, four_bar, lumpy_body, rotation, states_of

pytest.importorskip("mujoco")

import mujoco

from consilience_mujoco import MujocoEngine
from consilience_mujoco.evaluate import evaluate_bodies
from consilience_mujoco.messages import EngineWarningError
from consilience_mujoco.methods import configured
from consilience_mujoco.states import poses_and_velocities, set_state
from consilience_mujoco.translate import principal_inertia, translate

ALL = TREES | LOOPS | ELEMENTS


@pytest.fixture
def mujoco_engine():
    return MujocoEngine()


def forward(mechanism, state):
    method = MujocoEngine().methods(mechanism, Question.INSTANT)[0]
    translation = configured(translate(mechanism), method)
    set_state(translation, state)
    mujoco.mj_forward(translation.model, translation.data)
    return translation


def answer_of(engine, mechanism, states):
    return engine.instant(mechanism, states, engine.methods(mechanism, Question.INSTANT)[0])


def method_with(method, settings):
    return replace(method, settings=method.settings | settings)


def ask(engine, mechanism, state, question, method):
    if question is Question.TRAJECTORY:
        return engine.trajectory(mechanism, state, np.array([0.0, 0.05]), method, 0.001)
    if question is Question.MODEL:
        return engine.model(mechanism, state, method)
    return engine.instant(mechanism, [state], method)


def one_body(kind, *, backwards=False, inertia=None, **elements):
    """A lumpy body on one joint to the ground, in a skew frame away from both origins."""
    rng = np.random.default_rng(12)
    body = lumpy_body("b", rng)
    if inertia is not None:
        body = replace(body, inertia=inertia)
    R, at = rotation(rng), rng.normal(size=3)
    on_body = Frame(body.drawing.R.T @ (at - body.drawing.p), body.drawing.R.T @ R)
    ends = [(GROUND, Frame(at, R)), ("b", on_body)]
    (i, F), (j, M) = ends[::-1] if backwards else ends
    return Mechanism("one", GRAVITY, (body,), (Joint("j", kind, i, j, F, M),), **elements)


@pytest.mark.parametrize("com", [np.zeros(3), np.array([2e-7, -1e-7, 3e-7])])
@pytest.mark.parametrize("kind", ["revolute", "spherical", "free"])
def test_tilts_and_offsets_of_1e_7_act(mujoco_engine, kind, com):
    """MuJoCo's compiler takes frames for equal that differ by less than 1e-6; equations of motion in dense NumPy."""
    tilt = rotation_from_quaternion(quaternion_from_rotation_vector([1e-7, 2e-7, -3e-7]))
    body = replace(lumpy_body("b", np.random.default_rng(3)), drawing=Frame(np.zeros(3), np.eye(3)), com=com)
    body = replace(body, inertia=tilt @ np.diag([0.1, 0.2, 0.25]) @ tilt.T)
    at = Frame(np.array([2e-7, 1e-7, 4e-7]), tilt @ tilt)
    mechanism = Mechanism("tilted", GRAVITY, (body,), (Joint("j", kind, GROUND, "b", at, at),))
    states = states_of(mechanism)
    found = mujoco_engine.instant(mechanism, states, mujoco_engine.methods(mechanism, Question.INSTANT)[0])
    for n, state in enumerate(states):
        a, alpha, *_ = truth.solve(mechanism, state)
        np.testing.assert_allclose(found.a_WB_W[n], a, rtol=0, atol=1e-13 * np.max(np.abs(GRAVITY)))
        np.testing.assert_allclose(found.alpha_WB_W[n], alpha, rtol=0, atol=1e-12 * (1.0 + np.max(np.abs(alpha))))
        translation = translate(mechanism)
        set_state(translation, state)
        p, quat, _, _ = poses_and_velocities(translation)
        np.testing.assert_allclose(p, state.p_WB, rtol=0, atol=1e-15)
        assert np.max(rotation_angle_between(quat, state.quat_WB)) < 1e-14


@pytest.mark.parametrize("name", ["branched", "loop_rod", "backward_universal", "floating_chain"])
def test_poses_and_velocities_go_in_and_come_back(name):
    mechanism = ALL[name]
    for state in states_of(mechanism):
        translation = translate(mechanism)
        set_state(translation, state)
        p, quat, v, w = poses_and_velocities(translation)
        np.testing.assert_allclose(p, state.p_WB, atol=1e-13)
        assert np.max(rotation_angle_between(quat, state.quat_WB)) < 1e-13
        np.testing.assert_allclose(v, state.v_WB_W, atol=1e-12)
        np.testing.assert_allclose(w, state.w_WB_W, atol=1e-12)


def test_free_joint_has_linear_velocity_in_world_axes_and_angular_velocity_in_body_axes():
    mechanism = one_body("free")
    state, h = states_of(mechanism)[0], 1e-6
    translation = translate(mechanism)
    set_state(translation, state)
    mujoco.mj_integratePos(translation.model, translation.data.qpos, translation.data.qvel, h)
    p, quat, _, _ = poses_and_velocities(translation)
    np.testing.assert_allclose((p - state.p_WB) / h, state.v_WB_W, atol=1e-4)
    turned = quaternion_product(quaternion_from_rotation_vector(h * state.w_WB_W[0]), state.quat_WB[0])
    assert rotation_angle_between(quat[0], turned) < 1e-11


def test_a_body_on_a_free_joint_hangs_from_the_world_whatever_its_predecessor():
    mechanism = chain("revolute", "free", seed=3)
    translation = translate(mechanism)
    carrier = translation.tree.carrier(1)
    assert translation.model.body_parentid[translation.link_body[carrier]] == 0
    assert mujoco.mjtJoint(translation.model.jnt_type[translation.link_joint[carrier]]).name == "mjJNT_FREE"


def test_acceleration_is_classical_and_of_the_origin_of_the_body(mujoco_engine):
    mechanism = one_body("free")
    body, state = mechanism.bodies[0], states_of(mechanism)[0]
    R, w = rotation_from_quaternion(state.quat_WB[0]), state.w_WB_W[0]
    inertia, arm = R @ body.inertia @ R.T, -R @ body.com
    alpha = -np.linalg.solve(inertia, np.cross(w, inertia @ w))
    a = GRAVITY + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))
    answer = answer_of(mujoco_engine, mechanism, [state])
    np.testing.assert_allclose(answer.alpha_WB_W[0, 0], alpha, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(answer.a_WB_W[0, 0], a, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_rigid_support_carries_the_weight(mujoco_engine, backwards):
    mechanism = one_body("rigid", backwards=backwards)
    body, joint = mechanism.bodies[0], mechanism.joints[0]
    state = drawing_state(mechanism)
    U, at = (joint.M if backwards else joint.F).R, (joint.M if backwards else joint.F).p
    arm = state.p_WB[0] + body.drawing.R @ body.com - at
    force = -body.mass * GRAVITY * (-1.0 if backwards else 1.0)  # on the successor, which may be the ground
    answer = answer_of(mujoco_engine, mechanism, [state])
    np.testing.assert_allclose(answer.force_F[0, 0], U.T @ force, atol=1e-12)
    np.testing.assert_allclose(answer.torque_F[0, 0], U.T @ np.cross(arm, force), atol=1e-12)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize(("kind", "coordinate"), [("revolute", "angle"), ("cylindrical", "distance")])
def test_springs_of_a_joint_act_by_its_own_coordinate_and_are_no_reaction(mujoco_engine, kind, coordinate, backwards):
    springs = (
        JointSpring("k", "j", coordinate, 30.0, 2.0, 1.1),  # 1.1 taken as degrees would show
        JointSpring("l", "j", coordinate, 11.0, 0.3, -0.7),
    )
    mechanism = one_body(kind, backwards=backwards, joint_springs=springs)
    states = states_of(mechanism)
    answer = answer_of(mujoco_engine, mechanism, states)
    for n, state in enumerate(states):
        found = (answer.a_WB_W[n], answer.alpha_WB_W[n], answer.force_F[n], answer.torque_F[n])
        for value, expected in zip(found, truth.solve(mechanism, state), strict=True):
            np.testing.assert_allclose(value, expected, atol=1e-11 * np.max(np.abs(expected)))
        along = answer.torque_F if coordinate == "angle" else answer.force_F
        assert abs(along[n, 0, 2]) < 1e-11
        assert answer.potential[n] == pytest.approx(potential_energy(mechanism, state), rel=1e-12)


def test_joint_springs_count_full_turns(mujoco_engine):
    spring = JointSpring("k", "j", "angle", 2.0, 0.0, 15.0)
    inertia = np.diag([0.2, 0.3, 0.4])
    axis = Frame(np.zeros(3), np.eye(3))
    body = Body("b", 1.0, np.zeros(3), inertia, axis)
    joint = Joint("j", "revolute", GROUND, "b", axis, axis)
    mechanism = Mechanism("wound", np.zeros(3), (body,), (joint,), joint_springs=(spring,))
    times = np.arange(41) * 0.05
    method = mujoco_engine.methods(mechanism, Question.TRAJECTORY)[0]
    found = mujoco_engine.trajectory(mechanism, drawing_state(mechanism), times, method, 0.05 / 50)
    rate = np.sqrt(2.0 / 0.4)
    assert np.max(15.0 * (1.0 - np.cos(rate * times))) > 4 * np.pi
    np.testing.assert_allclose(found.w_WB_W[:, 0, 2], 15.0 * rate * np.sin(rate * times), atol=1e-6)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
def test_laminae_compile_and_inertia_keeps_its_axes(mujoco_engine, size):
    rng = np.random.default_rng(4)
    for _ in range(20):
        R, (a, b) = rotation(rng), size * rng.uniform(0.1, 1.0, size=2)
        inertia = R @ np.diag([a, b, a + b]) @ R.T
        inertia = (inertia + inertia.T) / 2
        moments, _ = principal_inertia(inertia)
        assert moments[0] + moments[1] >= moments[2]  # otherwise MuJoCo's compiler refuses the inertia
        mechanism = one_body("revolute", inertia=inertia)
        state = states_of(mechanism)[0]
        answer = mujoco_engine.model(mechanism, state, mujoco_engine.methods(mechanism, Question.MODEL)[0])
        _, _, expected = mass_properties(mechanism, state)
        np.testing.assert_allclose(answer.inertia, expected, atol=1e-13 * size)


def test_mujocos_specification_without_a_centre_of_mass_drops_the_principal_axes():
    quat = quaternion_from_rotation_vector([0.3, 0.2, -0.4])
    for centre, kept in (({}, False), ({"ipos": [0.0, 0.0, 0.0]}, True)):
        spec = mujoco.MjSpec()
        spec.worldbody.add_body(mass=1.0, inertia=[1.0, 2.0, 2.5], iquat=quat, explicitinertial=True, **centre)
        assert np.allclose(spec.compile().body_iquat[1], quat) is kept


@pytest.mark.parametrize("frame", ["world", "body"])
@pytest.mark.parametrize("kind", ["force", "torque"])
def test_load_actuators_do_what_the_applied_wrench_does(kind, frame):
    load = Load("l", kind, "b1", np.array([3.0, -5.0, 7.0]), frame, np.array([0.4, 0.2, -0.3]))
    bare = chain("revolute", "spherical", seed=6)
    state = states_of(bare)[0]
    loaded = forward(replace(bare, loads=(load,)), state)
    by_hand = forward(bare, state)
    body = by_hand.link_body[by_hand.tree.carrier(1)]
    R = rotation_from_quaternion(state.quat_WB[1])
    vector = load.vector if frame == "world" else R @ load.vector
    if kind == "force":
        point, _ = body_point(bare, state, "b1", load.point)
        by_hand.data.xfrc_applied[body] = [*vector, *np.cross(point - by_hand.data.xipos[body], vector)]
    else:
        by_hand.data.xfrc_applied[body, 3:] = vector
    mujoco.mj_forward(by_hand.model, by_hand.data)
    np.testing.assert_allclose(loaded.data.qacc, by_hand.data.qacc, rtol=1e-12)
    mujoco.mj_rnePostConstraint(by_hand.model, by_hand.data)
    mujoco.mj_rnePostConstraint(loaded.model, loaded.data)
    assert not np.allclose(loaded.data.cfrc_int[1:], by_hand.data.cfrc_int[1:])  # without actuators
    evaluate_bodies(loaded)
    np.testing.assert_allclose(loaded.data.cfrc_int[1:], by_hand.data.cfrc_int[1:], atol=1e-11)
    assert not np.any(loaded.data.xfrc_applied)


def test_no_joint_needs_a_massless_body():
    for name in ("single_rod", "single_universal", "single_planar", "single_cylindrical"):
        model = translate(TREES[name]).model
        assert model.nbody == 2  # the world and the body
        assert model.body_mass[1] == pytest.approx(TREES[name].bodies[0].mass, rel=1e-15)


def test_springs_between_points_are_tendons(mujoco_engine):
    spring = Spring("s", GROUND, "b1", np.array([1.0, 0.5, -0.2]), np.array([0.1, -0.3, 0.2]), 40.0, 6.0, 0.4)
    mechanism = replace(chain("revolute", "spherical", seed=6), springs=(spring,))
    state = states_of(mechanism)[1]
    answer = answer_of(mujoco_engine, mechanism, [state])
    _, _, force, torque = truth.solve(mechanism, state)
    np.testing.assert_allclose(answer.force_F[0], force, atol=1e-11 * np.max(np.abs(force)))
    np.testing.assert_allclose(answer.torque_F[0], torque, atol=1e-11 * np.max(np.abs(torque)))
    translation = forward(mechanism, state)
    ends = [
        body_point(mechanism, state, spring.predecessor, spring.point_predecessor)[0],
        body_point(mechanism, state, spring.successor, spring.point_successor)[0],
    ]
    assert translation.data.ten_length[0] == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=1e-13)
    np.testing.assert_array_equal(translation.model.tendon_lengthspring[0], [spring.free_length] * 2)


OPTION_NAMES = ("solver", "tolerance", "iterations", "jacobian", "integrator", "disableflags", "enableflags")


@pytest.mark.parametrize("name", ["long_chain", "four_bar", "driven", "rolling_torus"])
@pytest.mark.parametrize("question", list(Question)[:3])
def test_settings_name_every_option_that_is_not_at_its_default(mujoco_engine, name, question):
    mechanism = ALL[name]
    spec = mujoco.MjSpec()
    spec.worldbody.add_site(name="a"), spec.worldbody.add_site(name="b")
    spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_SITE, name1="a", name2="b")
    default = spec.compile()
    for method in mujoco_engine.methods(mechanism, question):
        ask(mujoco_engine, mechanism, states_of(mechanism)[0], question, method)
        model = mujoco_engine._last[1].model
        changed = {f"opt.{n}" for n in OPTION_NAMES if getattr(model.opt, n) != getattr(default.opt, n)}
        assert changed == {n for n in method.settings if n.startswith("opt.")}
        bits = (
            getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}").value
            for name in method.settings.get("opt.disableflags", ())
        )
        assert sum(bits) == model.opt.disableflags & ~default.opt.disableflags
        welds = {
            n for n in ("eq_solref", "eq_solimp") if model.neq and np.any(getattr(model, n) != getattr(default, n))
        }
        assert welds == {n for n in method.settings if n.startswith("eq_")}


def test_softness_of_the_welds_is_linear_in_the_scale_and_below_the_bar(mujoco_engine):
    mechanism = LOOPS["four_bar_spherical"]
    state = states_of(mechanism)[0]
    a, _, _, _ = truth.solve(mechanism, state)
    method = mujoco_engine.methods(mechanism, Question.INSTANT)[0]

    def error(scale):
        scaled = method_with(method, {"body_invweight0, factor": scale})
        found = mujoco_engine.instant(mechanism, [state], scaled).a_WB_W[0]
        return np.max(np.abs(found - a)) / np.max(np.abs(a))

    assert error(1e-5) / error(1e-6) == pytest.approx(10.0, rel=0.01)
    assert error(1e-6) / error(1e-7) == pytest.approx(10.0, rel=0.01)
    assert error(method.settings["body_invweight0, factor"]) < 1e-11


def test_native_welds_and_the_harness_agree(mujoco_engine):
    for mechanism in LOOPS.values():
        states = states_of(mechanism)
        native, borrowed, *_ = mujoco_engine.methods(mechanism, Question.INSTANT)
        assert (native.route, borrowed.route) == (Route.TUNED, Route.HARNESS_SOLVE)
        a, b = (mujoco_engine.instant(mechanism, states, m).a_WB_W for m in (native, borrowed))
        assert np.max(np.abs(a - b)) < 1e-11 * np.max(np.abs(b))


def test_a_solver_that_runs_out_of_iterations_is_refused(mujoco_engine):
    mechanism = LOOPS["loop_universal"]
    state = states_of(mechanism)[0]
    for question in (Question.INSTANT, Question.TRAJECTORY):
        method = mujoco_engine.methods(mechanism, question)[0]
        with pytest.raises(EngineWarningError, match="residual"):
            ask(mujoco_engine, mechanism, state, question, method_with(method, {"opt.iterations": 4}))


def test_welds_between_bodies_that_cannot_move_hold_nothing(mujoco_engine):
    mechanism = chain("rigid", "revolute", seed=9)
    twice = replace(mechanism, joints=(*mechanism.joints, replace(mechanism.joints[0], name="again")))
    state = states_of(twice)[0]
    for method in mujoco_engine.methods(twice, Question.INSTANT)[:2]:
        found = mujoco_engine.instant(twice, [state], method)
        np.testing.assert_allclose(found.a_WB_W[0], truth.solve(mechanism, state)[0], atol=1e-12)
    assert mujoco_engine.model(twice, state, mujoco_engine.methods(twice, Question.MODEL)[0]).freedom == 1


def test_divergence_raises_and_leaves_no_log_file(mujoco_engine, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    spring = Spring("s", GROUND, "b", np.ones(3), np.zeros(3), 1e12, 0.0, 0.1)
    mechanism = one_body("spherical", springs=(spring,))
    method = mujoco_engine.methods(mechanism, Question.TRAJECTORY)[0]
    with pytest.raises(EngineWarningError, match="unstable"):
        mujoco_engine.trajectory(mechanism, states_of(mechanism)[0], np.array([0.0, 5.0]), method, 0.05)
    assert list(tmp_path.iterdir()) == []


def test_samples_belong_to_the_end_of_the_step(mujoco_engine):
    mechanism = TREES["long_chain"]
    method = mujoco_engine.methods(mechanism, Question.TRAJECTORY)[0]
    h = 0.01
    found = mujoco_engine.trajectory(mechanism, states_of(mechanism)[0], np.array([0.0, h]), method, h)
    mean = (found.v_WB_W[0] + found.v_WB_W[1]) / 2
    np.testing.assert_allclose((found.p_WB[1] - found.p_WB[0]) / h, mean, atol=0.01 * np.max(np.abs(mean)))
    assert np.max(np.abs(found.p_WB[1] - found.p_WB[0])) > 1e-3  # old fields would repeat the start


def test_euler_takes_damping_explicitly(mujoco_engine):
    mechanism = one_body("revolute", joint_springs=(JointSpring("k", "j", "angle", 0.0, 5.0, 0.0),))
    state, h = initial_state(mechanism, Initial(rates={"j": {"angle": 2.0}})), 0.01
    method = mujoco_engine.methods(mechanism, Question.TRAJECTORY)[1]
    assert method.name == "Euler"
    found = mujoco_engine.trajectory(mechanism, state, np.array([0.0, h]), method, h)
    _, alpha, _, _ = truth.solve(mechanism, state)
    np.testing.assert_allclose(found.w_WB_W[1, 0], state.w_WB_W[0] + h * alpha[0], rtol=1e-12)


def test_what_cannot_be_represented_is_said(mujoco_engine):
    spring = Spring("s", GROUND, "crank", np.ones(3), np.zeros(3), 1.0, 0.0, -0.1)
    pair = tuple(JointSpring(f"k{k}", "j0", "angle", k, 0.0, 0.3 * k) for k in (5.0, -5.0))
    mechanism = four_bar()
    pin = mechanism.bodies[0].drawing
    damper = Spring("d", GROUND, mechanism.bodies[0].name, pin.p, np.zeros(3), 0.0, 2.0, 0.0)
    for elements, word in (
        ({"springs": (spring,)}, "no negative rest length"),
        ({"springs": (damper,)}, "a tendon of no length"),
        ({"joint_springs": pair}, "stiffness"),
    ):
        mechanism = replace(four_bar(), **elements)
        (found,) = mujoco_engine.unsupported(mechanism, Question.INSTANT)
        assert word in found.reason


def test_a_stiff_damper_gets_an_implicit_method():
    """A body on a slide, rate d / m = 5e4 1/s: x = u t + (v - u) (1 - exp(-d t / m)) m / d, with u = m g . z / d."""
    base = TREES["single_prismatic"]
    body = replace(base.bodies[0], mass=0.02)
    damper = JointSpring("damper", base.joints[0].name, "distance", 0.0, 1000.0, 0.0)
    mechanism = replace(base, bodies=(body,), joint_springs=(damper,))
    state = initial_state(mechanism, Initial(rates={base.joints[0].name: {"distance": 3.0}}))
    z = state.R_WB[0] @ base.joints[0].M.R[:, 2]
    times, u, tau = np.linspace(0.0, 0.2, 5), 0.02 * mechanism.gravity @ z / 1000.0, 0.02 / 1000.0
    expected = u * times + (3.0 - u) * tau * (1.0 - np.exp(-times / tau))
    engine = MujocoEngine()
    rk4, implicit, *_ = engine.methods(mechanism, Question.TRAJECTORY)
    errors = []
    for substeps in (2000, 4000):
        found = engine.trajectory(mechanism, state, times, implicit, 0.05 / substeps).p_WB[:, 0]
        errors.append(np.max(np.abs((found - found[0]) @ z - expected)))
    assert implicit.name == "implicitfast"
    assert implicit.order == 1
    assert errors[1] < 1e-6
    with pytest.raises(EngineWarningError, match="unstable"):
        engine.trajectory(mechanism, state, times, rk4, 0.05 / rk4.substeps[-1])
    soft = replace(mechanism, joint_springs=(replace(damper, damping=1.0),))
    assert "implicitfast" not in [m.name for m in engine.methods(soft, Question.TRAJECTORY)]


@pytest.mark.parametrize(("mass", "moment"), [(1e-16, 1.0), (1.0, 5e-16)])
def test_bodies_below_the_bound_of_mujoco_are_unsupported(mass, moment):
    base = TREES["single_revolute"]
    inertia = np.diag([moment, 1.1 * moment, 1.2 * moment])
    mechanism = replace(base, bodies=(replace(base.bodies[0], mass=mass, inertia=inertia),))
    for question in Question:
        (refusal,) = MujocoEngine().unsupported(mechanism, question)
        assert refusal.feature == f"body 'b0': {min(mass, moment):g} kg or kg m^2"
        assert "1e-15" in refusal.reason
    with pytest.raises(ValueError, match="mjMINVAL"):
        translate(mechanism)
