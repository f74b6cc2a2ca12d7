"""Profiles and softness: results with an engine's default settings, and the effect of its regularisation.

Expected values: facts that are read from the engines (steps, softness), the equations of soft constraints, and the
dense solution of `truth`.
"""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.case import load_case
from consilience.engine import Profile, Question, Route, defects, load_engine, solve_constrained
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    constraint_residual,
    drawing_state,
    initial_state,
    random_states,
)
from consilience.reference import simulate
from mechanisms import LOOPS, TREES, chain, drawn_joint, states_of
from oracles.shipped import TRAJECTORIES

CASES = {name: load_case(name) for name in TRAJECTORIES}
HINGED = ("four_bar", "slider_crank")
HARD = {"exudyn", "pinocchio", "reference"}
HERE = Frame(np.zeros(3), np.eye(3))

# settings that a default method may name: files, sampling, missing features, how steps become an acceleration
ALLOWED = {
    "exudyn": {"solution.file.write", "solution.sensors.writePeriod", "constraint equations left out"},
    "dart": {"step"},
}


def own_step(name):
    """Time step in s that an engine uses unless told otherwise."""
    if name == "mujoco":
        mujoco = pytest.importorskip("mujoco")
        return mujoco.MjSpec().compile().opt.timestep
    if name == "dart":
        return pytest.importorskip("dartpy").simulation.World().getTimeStep()
    integration = pytest.importorskip("exudyn").SimulationSettings().timeIntegration
    return integration.endTime / integration.numberOfSteps


def of_profile(engine, mechanism, question, profile):
    return [m for m in engine.methods(mechanism, question) if m.profile is profile]


def accelerations(engine, mechanism, states, method):
    answer = engine.instant(mechanism, states, method)
    return np.concatenate([answer.a_WB_W, answer.alpha_WB_W], axis=2)


def true_accelerations(mechanism, states):
    return np.array([np.hstack(truth.solve(mechanism, state)[:2]) for state in states])


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
@pytest.mark.parametrize("question", list(Question)[:3])
def test_the_headline_is_matched_and_a_default_sets_nothing_it_need_not(engine, engine_name, case, question):
    methods = engine.methods(case.mechanism, question)
    assert methods[0].profile is Profile.MATCHED
    defaults = of_profile(engine, case.mechanism, question, Profile.DEFAULT)
    if question is Question.TRAJECTORY and engine_name in ("mujoco", "dart", "exudyn"):
        (default,) = defaults
        first, second, third = default.substeps
        assert case.sample / first == pytest.approx(own_step(engine_name), rel=1e-12)
        assert (second, third) == (2 * first, 4 * first)
    if defaults:
        assert set(defaults[0].settings) <= ALLOWED.get(engine_name, set())
        assert defaults[0].route in (Route.NATIVE, Route.EXTRAPOLATED)


@pytest.mark.parametrize("name", LOOPS)
def test_only_soft_constraints_have_a_softness(engine, engine_name, name):
    mechanism = LOOPS[name]
    for question in (Question.INSTANT, Question.TRAJECTORY):
        methods = engine.methods(mechanism, question)
        if engine_name in HARD:
            assert all(m.softness is None for m in methods)
        else:
            soft = {m.name for m in methods if m.softness == 1.0}
            assert {m.name for m in of_profile(engine, mechanism, question, Profile.DEFAULT)} <= soft
    for question in (Question.INSTANT, Question.TRAJECTORY):
        assert all(m.softness is None for m in engine.methods(TREES["long_chain"], question))


@pytest.mark.parametrize("name", ["double_pendulum", "spatial_pendulum"])
def test_on_a_tree_the_defaults_lead_where_the_matched_settings_lead(engine, engine_name, name):
    """Same order, same limit: on a tree the profiles differ in the step only."""
    case = CASES[name]
    defaults = of_profile(engine, case.mechanism, Question.TRAJECTORY, Profile.DEFAULT)
    if not defaults:
        assert engine_name in HARD
        return
    times = case.times[:21]

    def ladder(method):
        return [
            engine.trajectory(case.mechanism, case.initial_state, times, method, case.sample / n).p_WB
            for n in method.substeps[-3:]
        ]

    x, y, z = ladder(defaults[0])
    order = np.log2(np.linalg.norm(x - y) / np.linalg.norm(y - z))
    assert order == pytest.approx(defaults[0].order, abs=0.15)
    limit, band = z + (z - y) / (2.0 ** defaults[0].order - 1.0), 1.25 * np.max(np.abs(z - y))
    matched = next(m for m in engine.methods(case.mechanism, Question.TRAJECTORY))
    _, a, b = ladder(matched)
    reference = b + (b - a) / (2.0**matched.order - 1.0)
    assert np.max(np.abs(limit - reference)) < 0.05 * band


# ---------------------------------------------------------------- MuJoCo


@pytest.fixture
def mujoco_engine():
    pytest.importorskip("mujoco")
    return load_engine("mujoco")


def parallelogram(angle, length=1.0):
    """Three slender rods of 1 kg; crank and rocker at an angle to the horizontal, the coupler horizontal."""
    c, s = length * np.cos(angle), length * np.sin(angle)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, length]]) / length
    inertia = np.diag([1e-4, 1.0, 1.0]) * length**2 / 12.0
    middle = np.array([length / 2, 0.0, 0.0])
    poses = {
        "crank": Frame(np.zeros(3), turned),
        "coupler": Frame(np.array([c, s, 0.0]), np.eye(3)),
        "rocker": Frame(np.array([length, 0.0, 0.0]), turned),
    }
    bodies = tuple(Body(n, 1.0, middle, inertia, pose) for n, pose in poses.items())
    end = Frame(np.array([length, 0.0, 0.0]), np.eye(3))
    joints = (
        Joint("a", "revolute", GROUND, "crank", HERE, HERE),
        Joint("b", "revolute", "crank", "coupler", end, HERE),
        Joint("d", "revolute", GROUND, "rocker", end, HERE),
        Joint("c", "revolute", "coupler", "rocker", end, end),
    )
    return Mechanism("parallelogram", np.array([0.0, -9.81, 0.0]), bodies, joints)


def test_stock_welds_let_a_parallelogram_accelerate_wrongly(mujoco_engine):
    """At rest ``(2 m l^2 / 3 + m l^2) alpha = -(m l + m l) g cos``, because the coupler does not rotate."""
    angle = 2.4
    mechanism = parallelogram(angle)
    exact = -2.0 * 9.81 * np.cos(angle) / (5.0 / 3.0)
    state = drawing_state(mechanism)
    matched, _, stock, *_ = mujoco_engine.methods(mechanism, Question.INSTANT)
    found = {m.profile: mujoco_engine.instant(mechanism, [state], m).alpha_WB_W[0, 0, 2] for m in (matched, stock)}
    assert found[Profile.MATCHED] == pytest.approx(exact, rel=1e-12)
    # the halves of a split body are lighter than the bodies of a connect constraint, so that softness has more effect
    assert found[Profile.DEFAULT] / exact - 1.0 == pytest.approx(-0.049, abs=1e-3)
    # plain MJCF with a connect constraint, without the adapter
    import mujoco

    degrees = np.degrees(angle)
    rod = '<inertial pos=".5 0 0" mass="1" diaginertia="1e-4 0.0833333333333 0.0833333333333"/>'
    hinge = '<joint axis="0 0 1"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 -9.81 0"/><worldbody><body euler="0 0 {degrees}">{hinge}{rod}'
        f'<body pos="1 0 0" euler="0 0 {-degrees}">{hinge}{rod}<site name="a" pos="1 0 0"/></body></body>'
        f'<body pos="1 0 0" euler="0 0 {degrees}">{hinge}{rod}<site name="b" pos="1 0 0"/></body></worldbody>'
        '<equality><connect site1="a" site2="b"/></equality></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.qacc[0] / exact - 1.0 == pytest.approx(-0.016, abs=1e-3)


def soft_solution(translation, factor):
    """Solve ``M a = f + J^T lam, J a + factor R lam = aref`` in NumPy with MuJoCo's terms at the state of its data."""
    import mujoco

    from consilience_mujoco.evaluate import constraint_jacobian

    model, data = translation.model, translation.data
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    J, R = constraint_jacobian(translation), np.array(data.efc_R[: data.nefc])
    system = np.block([[M, -J.T], [J, np.diag(factor * R)]])
    solved = np.linalg.solve(system, np.concatenate([data.qfrc_smooth, data.efc_aref[: data.nefc]]))
    return solved[: model.nv]


@pytest.mark.parametrize("name", [n for n in LOOPS])
def test_the_softness_of_mujoco_scales_its_regularisation(mujoco_engine, name):
    mechanism = LOOPS[name]
    states = states_of(mechanism)[:2]
    exact = true_accelerations(mechanism, states)
    stock = of_profile(mujoco_engine, mechanism, Question.INSTANT, Profile.DEFAULT)[0]
    for state in states:
        accelerations(mujoco_engine, mechanism, [state], stock)
        terms = mujoco_engine._last[1]
        for softness in (0.1, 2.0, 4.0):
            expected = soft_solution(terms, softness)
            accelerations(mujoco_engine, mechanism, [state], replace(stock, softness=softness))
            found = mujoco_engine._last[1].data.qacc
            np.testing.assert_allclose(found, expected, atol=1e-9 * np.max(np.abs(expected)))
    # with less softness the error is proportional to it; with more, it may saturate: the welds hardly hold
    errors = [
        relative(accelerations(mujoco_engine, mechanism, states, replace(stock, softness=s)), exact)
        for s in (1.0, 1e-3, 5e-4)
    ]
    assert errors[0] > 0.1
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.02)


def test_the_matched_welds_stay_at_rounding_whatever_their_softness(mujoco_engine):
    for name in HINGED:
        case = CASES[name]
        exact = true_accelerations(case.mechanism, case.states)
        matched = mujoco_engine.methods(case.mechanism, Question.INSTANT)[0]
        for softness in (0.5, 1.0, 2.0, 4.0):
            found = accelerations(mujoco_engine, case.mechanism, case.states, replace(matched, softness=softness))
            assert relative(found, exact) < 1e-11


@pytest.mark.parametrize("name", LOOPS)
def test_one_soft_problem_has_one_solution_by_every_code_path(mujoco_engine, name):
    """Newton or CG, dense or sparse: the problem of the soft welds is the same, hence the answer."""
    mechanism = LOOPS[name]
    states = states_of(mechanism)
    stock, *others = of_profile(mujoco_engine, mechanism, Question.INSTANT, Profile.DEFAULT)
    found = accelerations(mujoco_engine, mechanism, states, stock)
    assert {m.name for m in others} == {"mj_forward, defaults but sparse", "mj_forward, defaults but CG"}
    for method in others:
        assert relative(accelerations(mujoco_engine, mechanism, states, method), found) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("name", HINGED)
def test_stock_welds_lead_elsewhere_and_tuned_ones_do_not(mujoco_engine, name):
    case = CASES[name]
    times = case.times[:41]
    run = {
        (m.profile, n): mujoco_engine.trajectory(case.mechanism, case.initial_state, times, m, case.sample / n)
        for m in mujoco_engine.methods(case.mechanism, Question.TRAJECTORY)
        for n in (*m.substeps[-2:], 80)
    }
    gap = {
        key: max(np.max(np.abs(constraint_residual(case.mechanism, answer.state(k)))) for k in range(len(times)))
        for key, answer in run.items()
    }
    assert gap[Profile.MATCHED, 80] < 1e-10
    assert gap[Profile.DEFAULT, 100] > 1e-4
    tuned = run[Profile.MATCHED, 80].p_WB
    coarse, fine = (np.max(np.abs(run[Profile.DEFAULT, n].p_WB - tuned)) for n in (50, 100))
    assert fine > 1e-3
    assert fine > 0.6 * coarse  # half the step does not halve the difference


@pytest.mark.parametrize(("first", "right"), [("HINGE", True), ("BALL", False)])
def test_a_slide_behind_a_ball_has_a_wrong_jacobian_derivative_in_mujoco(mujoco_engine, first, right):
    """MuJoCo alone: half of the Coriolis acceleration is missing. Once it is right, the adapter need not refuse."""
    import mujoco

    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="b", mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
    body.add_joint(type=getattr(mujoco.mjtJoint, f"mjJNT_{first}"))
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[-2:] = 1.0  # a slide along x at 1 m/s on a body that turns about z at 1 rad/s: 2 w x v = (0, 2, 0)
    mujoco.mj_forward(model, data)
    dJ, dJ_turning = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacDot(model, data, dJ, dJ_turning, np.zeros(3), 1)
    assert np.allclose(dJ @ data.qvel, [0.0, 2.0, 0.0]) is right
    assert right or np.allclose(dJ @ data.qvel, [0.0, 1.0, 0.0])


def loop_over(kind, backwards, seed=3):
    """A loop: revolute, a joint of the given kind, revolute, and a ball joint that closes the loop with the ground."""
    base = chain("revolute", kind, "revolute", seed=seed, backwards=(1,) if backwards else ())
    bodies = {body.name: body for body in base.bodies}
    ball = drawn_joint("ball", "spherical", bodies, GROUND, "b2", np.array([0.3, -0.4, 0.8]), np.eye(3))
    return replace(base, joints=(*base.joints, ball))


@pytest.mark.parametrize("kind", ["point_on_line", "point_in_plane"])
@pytest.mark.parametrize("backwards", [False, True])
def test_loops_over_a_slide_behind_a_ball_are_refused(mujoco_engine, kind, backwards):
    mechanism = loop_over(kind, backwards)
    states = states_of(mechanism)[:2]
    if backwards:
        for question in (Question.INSTANT, Question.TRAJECTORY):
            (reason,) = mujoco_engine.unsupported(mechanism, question)
            assert "'j1'" in reason.feature
            assert "mj_jacDot" in reason.reason
        assert mujoco_engine.unsupported(mechanism, Question.MODEL) == ()
    else:
        assert mujoco_engine.unsupported(mechanism, Question.INSTANT) == ()
    exact = true_accelerations(mechanism, states)
    for method in mujoco_engine.methods(mechanism, Question.INSTANT)[:2]:
        error = relative(accelerations(mujoco_engine, mechanism, states, method), exact)
        assert error > 1e-3 if backwards else error < 1e-10


def test_a_loop_through_a_free_joint_behind_such_a_joint_is_refused(mujoco_engine):
    """MuJoCo hangs what is free on the world, so that one end of the weld alone has the error."""
    base = chain("revolute", "point_on_line", "revolute", seed=8, backwards=(1,))
    bodies = {body.name: body for body in base.bodies}
    free = drawn_joint("free", "free", bodies, "b1", "b2", np.array([0.3, -0.4, 0.8]), np.eye(3))
    mechanism = replace(base, joints=(*base.joints, free))
    (reason,) = mujoco_engine.unsupported(mechanism, Question.INSTANT)
    assert "'j1'" in reason.feature
    states = states_of(mechanism)[:2]
    method = mujoco_engine.methods(mechanism, Question.INSTANT)[0]
    found = accelerations(mujoco_engine, mechanism, states, method)
    assert relative(found, true_accelerations(mechanism, states)) > 1e-3


def test_a_loop_that_hangs_as_a_whole_behind_such_a_joint_is_right(mujoco_engine):
    """Both ends of the weld have the same error, which cancels."""
    base = chain("revolute", "point_on_line", "revolute", "revolute", seed=8, backwards=(1,))
    bodies = {body.name: body for body in base.bodies}
    ball = drawn_joint("ball", "spherical", bodies, "b1", "b3", np.array([0.3, -0.4, 0.8]), np.eye(3))
    mechanism = replace(base, joints=(*base.joints, ball))
    states = states_of(mechanism)[:2]
    assert mujoco_engine.unsupported(mechanism, Question.INSTANT) == ()
    exact = true_accelerations(mechanism, states)
    for method in mujoco_engine.methods(mechanism, Question.INSTANT)[:2]:
        assert relative(accelerations(mujoco_engine, mechanism, states, method), exact) < 1e-10


def test_a_softness_without_a_meaning_is_refused(mujoco_engine):
    mechanism = LOOPS["four_bar"]
    method = mujoco_engine.methods(mechanism, Question.INSTANT)[0]
    with pytest.raises(ValueError, match="positive"):
        mujoco_engine.instant(mechanism, states_of(mechanism)[:1], replace(method, softness=0.0))


# ---------------------------------------------------------------- DART


@pytest.fixture
def dart_engine():
    pytest.importorskip("dartpy")
    return load_engine("dart")


def with_scaled_velocity_term(mechanism, state, factor):
    """Accelerations if the welds fulfil ``J a = -factor dJ/dt v``: DART's terms, solved by the harness."""
    from consilience_dart.constraints import weld_terms
    from consilience_dart.dynamics import body_accelerations, impose
    from consilience_dart.loads import Forces
    from consilience_dart.state import from_state, send
    from consilience_dart.translation import build

    model = build(mechanism)
    skeleton = model.skeleton
    send(model, from_state(model, state))
    Forces(model).apply(0.0)
    skeleton.setAccelerations(np.zeros(skeleton.getNumDofs()))
    skeleton.computeInverseDynamics(True, True, True)
    f = -np.asarray(skeleton.getForces())
    J, bias = weld_terms(model)
    impose(model, *solve_constrained(np.asarray(skeleton.getMassMatrix()), f, J, -factor * bias))
    return np.hstack(body_accelerations(model))


@pytest.mark.parametrize("name", LOOPS)
def test_the_error_reduction_of_dart_adds_half_of_itself_to_the_velocity_term(dart_engine, name):
    """With DART's reduction of 0.01: ``J a = -(1 + softness reduction / 2) dJ/dt v`` (`consilience_dart.stepping`)."""
    mechanism = LOOPS[name]
    (stock,) = of_profile(dart_engine, mechanism, Question.INSTANT, Profile.DEFAULT)
    states = random_states(mechanism, initial_state(mechanism), 2, seed=3, speed=20.0)  # velocity terms dominate
    exact = true_accelerations(mechanism, states)
    for softness in (0.25, 1.0, 4.0):
        found = accelerations(dart_engine, mechanism, states, replace(stock, softness=softness))
        for n, state in enumerate(states):
            expected = with_scaled_velocity_term(mechanism, state, 1.0 + softness * 0.01 / 2.0)
            plateau = np.max(np.abs(expected - exact[n]))
            assert plateau > 1e-4 * softness * np.max(np.abs(exact[n]))
            np.testing.assert_allclose(found[n], expected, atol=1e-3 * plateau)


@pytest.mark.parametrize("name", HINGED)
def test_the_gap_of_dart_along_a_motion_is_that_of_its_error_reduction(dart_engine, name):
    """Steps add a drift of order h^2 and remove a fraction of the gap; the gap is proportional to h^2 / reduction."""
    case = CASES[name]
    times = case.times[:11]
    matched = dart_engine.methods(case.mechanism, Question.TRAJECTORY)[0]

    def gap(softness, substeps):
        method = replace(matched, softness=softness)
        answer = dart_engine.trajectory(case.mechanism, case.initial_state, times, method, case.sample / substeps)
        return max(np.max(np.abs(constraint_residual(case.mechanism, answer.state(k)))) for k in range(len(times)))

    coarse, _, fine = matched.substeps
    start = gap(1.0, coarse)
    for softness in (0.5, 2.0, 4.0):
        reduction = 1.0 - 0.5 ** (1.0 / softness)  # half of the gap is removed in `softness` steps
        assert gap(softness, coarse) / start == pytest.approx(0.5 / reduction, rel=0.04)
    assert start / gap(1.0, fine) == pytest.approx(16.0, rel=0.02)


def test_defaults_of_dart_spoil_the_order_of_a_loop_and_the_matched_settings_keep_it(dart_engine):
    case = CASES["slider_crank"]
    times = case.times[:41]
    reference = simulate(case.mechanism, case.initial_state, times, 1e-12).p_WB
    errors = {
        m.profile: [
            np.max(
                np.abs(
                    dart_engine.trajectory(case.mechanism, case.initial_state, times, m, case.sample / n).p_WB
                    - reference
                )
            )
            for n in m.substeps
        ]
        for m in dart_engine.methods(case.mechanism, Question.TRAJECTORY)
        if m.order == 1
    }
    order = {profile: np.log2(e[1] / e[2]) for profile, e in errors.items()}
    assert order[Profile.MATCHED] == pytest.approx(1.0, abs=0.05)
    assert order[Profile.DEFAULT] > 1.3


def test_only_the_defaults_of_dart_may_put_bodies_to_sleep(dart_engine):
    from consilience_dart.engine import _stepper

    case = CASES["double_pendulum"]
    for method in dart_engine.methods(case.mechanism, Question.TRAJECTORY):
        options = _stepper(case.mechanism, case.initial_state, method).world.getDeactivationOptions()
        assert options.mEnabled is (method.profile is Profile.DEFAULT)


def test_a_softness_without_a_meaning_is_refused_by_dart_too(dart_engine):
    mechanism = LOOPS["four_bar"]
    state = states_of(mechanism)[0]
    (stock,) = of_profile(dart_engine, mechanism, Question.INSTANT, Profile.DEFAULT)
    for softness in (0.0, 200.0):
        with pytest.raises(ValueError, match="softness"):
            dart_engine.instant(mechanism, [state], replace(stock, softness=softness))


# ---------------------------------------------------------------- Exudyn


@pytest.mark.parametrize(
    "kinds", [("revolute", "prismatic", "revolute"), ("universal", "cylindrical"), ("planar", "revolute")]
)
def test_kinematic_tree_and_rigid_bodies_accelerate_alike(kinds):
    pytest.importorskip("exudyn")
    engine = load_engine("exudyn")
    mechanism = chain(*kinds, seed=31, backwards=(1,), forces=True)
    states = states_of(mechanism)
    bodies, tree = (engine.instant(mechanism, states, m) for m in engine.methods(mechanism, Question.INSTANT))
    exact = true_accelerations(mechanism, states)
    assert relative(np.concatenate([tree.a_WB_W, tree.alpha_WB_W], axis=2), exact) < 1e-11
    np.testing.assert_allclose(tree.kinetic, bodies.kinetic, rtol=1e-12)
    np.testing.assert_allclose(tree.potential, bodies.potential, atol=1e-12 * np.max(np.abs(bodies.potential)))
    assert tree.force_F is None


def test_defaults_of_exudyn_stop_at_dependent_rows():
    """Hence the adapter leaves out dependent rows in the default profile, too."""
    pytest.importorskip("exudyn")
    from consilience_exudyn.library import QUIET
    from consilience_exudyn.maximal import build, full_axes
    from consilience_exudyn.trajectory import Integration, maximal_answer

    case = CASES["four_bar"]
    model = build(case.mechanism, case.initial_state)
    with pytest.raises(RuntimeError, match="GeneralizedAlpha"):
        maximal_answer(model, full_axes(case.mechanism), Integration("GeneralizedAlpha", QUIET), case.times[:3], 0.01)


# ---------------------------------------------------------------- Pinocchio


def test_defaults_of_pinocchio_do_for_independent_rows_and_fail_on_dependent_ones():
    pytest.importorskip("pinocchio")
    engine = load_engine("pinocchio")

    def default(mechanism, states):
        (method,) = of_profile(engine, mechanism, Question.INSTANT, Profile.DEFAULT)
        return engine.instant(mechanism, states, method)

    for name in ("loop_spherical", "loop_universal", "four_bar_spherical"):
        states = states_of(LOOPS[name])
        found = default(LOOPS[name], states)
        both = np.concatenate([found.a_WB_W, found.alpha_WB_W], axis=2)
        assert relative(both, true_accelerations(LOOPS[name], states)) < 1e-11
    planar = [(CASES[n].mechanism, CASES[n].states) for n in HINGED]
    planar += [(LOOPS[n], states_of(LOOPS[n])) for n in ("four_bar", "slider_crank", "four_bar_cylindrical")]
    # the factorisation meets a pivot at rounding level, of either sign
    assert any(defects(default(m, states), Question.INSTANT, m, len(states)) for m, states in planar)
