"""Elements beyond constant forces in DART: trees and loops, lumpy bodies, skew frames.

Accelerations and reactions are compared with `truth`, motions with the reference solver, single effects with closed
forms.
"""

import dataclasses

import dartpy
import numpy as np
import pytest

import truth
from consilience.engine import Profile, Question, Route
from consilience.mechanism import (
    GROUND,
    Body,
    Control,
    Coupling,
    Drive,
    Frame,
    Friction,
    Function,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Skate,
    Spring,
    State,
    constant,
    constraint_residual,
    determinate_reactions,
    free_directions,
    initial_state,
    kinetic_energy,
    linear,
    potential_energy,
    rotation_angle_between,
    rotation_vector_from_quaternion,
    sine,
    through,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from consilience_dart import DartEngine
from consilience_dart.efforts import efforts
from consilience_dart.translation import build
from mechanisms import ELEMENTS, LOOPS, PITCH, chain, drawn_joint, hardening, lumpy_body, rotation, states_of

EPS = np.finfo(float).eps
HERE = Frame(np.zeros(3), np.eye(3))
SWEEP = Function(np.array([0.2, 1.5, 0.7]), np.array([[0.3, 4.0, 0.1]]))
WAVE = sine(2.0, 3.0, 0.4)
RISE = Function(np.array([1.0, -0.4, 0.3]))
CAM = through(np.linspace(0.0, 2 * np.pi, 13), 0.2 * np.sin(np.linspace(0.0, 2 * np.pi, 13)) ** 2, True)


def powered_loop(base):
    """A loop with every force element that is not constant, on its first joint and on its closing joint."""
    first, last = base.joints[0].name, base.joints[-1]
    coordinate = "distance" if last.kind == "prismatic" else "angle"
    rng = np.random.default_rng(60)
    tip = base.bodies[1].name
    point = rng.normal(scale=0.3, size=3)
    return dataclasses.replace(
        base,
        name=f"powered_{base.name}",
        springs=(Spring("s", GROUND, tip, rng.normal(size=3), point, 12.0, 0.7, 0.4, WAVE),),
        joint_springs=(JointSpring("k", last.name, coordinate, 3.0, 0.2, 0.1, RISE),),
        loads=tuple(
            Load(f"{kind}_{frame}", kind, tip, rng.normal(size=3), frame, point, RISE)
            for kind in ("force", "torque")
            for frame in ("world", "body")
        ),
        frictions=(Friction("f", last.name, coordinate, 0.3, 1.1, 0.2), Friction("g", first, "angle", 0.1, 0.4, 0.5)),
        controls=(Control("c", first, "angle", sine(0.5, 2.0), 20.0, 7.0, 1.5),),
    )


def driven_loop(base, joint, coordinate, motion):
    return dataclasses.replace(base, name=f"driven_{base.name}", drives=(Drive("d", joint, coordinate, motion),))


def geared_loop(seed=61):
    """A four-bar whose crank drives a flywheel by a gear pair, and whose rocker drives a rack by a cam."""
    base, rng = LOOPS["four_bar"], np.random.default_rng(seed)
    new = {"wheel": lumpy_body("wheel", rng), "rack": lumpy_body("rack", rng)}
    joints = tuple(
        drawn_joint(f"to_{name}", kind, new, GROUND, name, rng.normal(scale=0.5, size=3), rotation(rng))
        for name, kind in (("wheel", "revolute"), ("rack", "prismatic"))
    )
    couplings = (
        Coupling("gears", "j0", "angle", "to_wheel", "angle", linear(-2.5, 0.1)),
        Coupling("cam", "j3", "angle", "to_rack", "distance", CAM),
    )
    bodies = (*base.bodies, *new.values())
    return dataclasses.replace(base, name="geared", bodies=bodies, joints=(*base.joints, *joints), couplings=couplings)


def screw_loop(kinds):
    """The loop of revolute, two spherical joints and revolute, with some joints replaced by other kinds."""
    base = LOOPS["loop_spherical"]
    joints = (
        dataclasses.replace(j, kind=kinds.get(j.name, j.kind), pitch=PITCH if kinds.get(j.name) == "screw" else 0.0)
        for j in base.joints
    )
    return dataclasses.replace(base, name="screw_loop", joints=tuple(joints))


def edge(body):
    return (Skate("edge", body, np.array([0.2, 0.1, -0.1]), np.array([0.3, -0.5, 0.8])),)


def worked(base, joint):
    """The same mechanism with friction and a controller added on a joint."""
    return dataclasses.replace(
        base,
        name=f"worked_{base.name}",
        frictions=(Friction("f", joint, "angle", 0.3, 0.5, 0.3),),
        controls=(Control("c", joint, "angle", sine(0.5, 2.0), 6.0, 2.0, 0.5),),
    )


def backward():
    """Joints that the tree passes from successor to predecessor, each with an element."""
    base = chain("revolute", "cylindrical", "screw", seed=78, backwards=(1, 2))
    return dataclasses.replace(
        base,
        name="backward",
        drives=(Drive("d", "j1", "angle", sine(0.5, 3.0, 0.7)),),
        frictions=(Friction("f", "j2", "angle", 0.2, 0.4, 0.3),),
        controls=(Control("c", "j1", "distance", constant(0.3), 40.0, 10.0, 3.0),),
    )


def double_well():
    """Springs whose linear parts push away from their rests, and a damper whose linear part drives."""
    base = hardening()
    springs = (dataclasses.replace(s, stiffness=-3.0) for s in base.joint_springs)
    first, *rest = springs
    first = dataclasses.replace(first, damping=-0.1, higher_damping=(0.0, 0.4))
    return dataclasses.replace(base, name="double_well", joint_springs=(first, *rest))


MORE = {
    "powered_four_bar": powered_loop(LOOPS["four_bar"]),
    "powered_slider_crank": powered_loop(LOOPS["slider_crank"]),
    "driven_crank": driven_loop(LOOPS["slider_crank"], "a", "angle", SWEEP),
    "driven_slider": driven_loop(LOOPS["slider_crank"], "d", "distance", sine(0.1, 5.0)),
    "driven_spatial": driven_loop(LOOPS["loop_spherical"], "j0", "angle", SWEEP),
    "geared_loop": geared_loop(),
    "driven_gears": driven_loop(geared_loop(62), "to_wheel", "angle", SWEEP),
    "backward_elements": backward(),
    "screw_in_loop": screw_loop({"j0": "screw"}),
    "screw_closes_loop": screw_loop({"j2": "screw", "j3": "cylindrical"}),
    "skate_in_loop": dataclasses.replace(LOOPS["loop_spherical"], skates=edge("b")),
    "hardening": hardening(),
    "double_well": double_well(),
    "worked_rolling": worked(ELEMENTS["rolling_disc"], "j1"),
    "driven_rolling": driven_loop(ELEMENTS["rolling_torus"], "j1", "angle", SWEEP),
}
ALL = ELEMENTS | MORE


@pytest.fixture
def engine():
    return DartEngine()


def matched(engine, mechanism, question):
    assert engine.unsupported(mechanism, question) == ()
    return [m for m in engine.methods(mechanism, question) if m.profile is Profile.MATCHED]


@pytest.mark.parametrize("name", ALL)
def test_accelerations_reactions_and_energies_are_those_of_the_truth(engine, name):
    mechanism = ALL[name]
    states = states_of(mechanism, 3)
    for method in matched(engine, mechanism, Question.INSTANT):
        bar = 1e-8 if method.route is Route.EXTRAPOLATED else 1e-11
        answer = engine.instant(mechanism, states, method)
        for n, state in enumerate(states):
            a, alpha, force, torque = truth.solve(mechanism, state)
            expected, found = np.hstack([a, alpha]), np.hstack([answer.a_WB_W[n], answer.alpha_WB_W[n]])
            size = np.max(np.abs(expected))
            condition = mass_matrix_condition(mechanism, state)
            assert np.max(np.abs(found - expected)) < (bar + 4 * EPS * condition) * size, method.name
            assert answer.kinetic[n] == pytest.approx(kinetic_energy(mechanism, state), rel=1e-12)
            assert answer.potential[n] == pytest.approx(potential_energy(mechanism, state), rel=1e-12, abs=1e-12)
            if answer.force_F is not None:
                known = determinate_reactions(mechanism, state)
                expected, found = np.hstack([force, torque]), np.hstack([answer.force_F[n], answer.torque_F[n]])
                assert np.max(np.abs(found - expected)[known]) < 1e-10 * np.max(np.abs(expected[known]))


@pytest.mark.parametrize("name", ALL)
def test_freedom_counts_every_row(engine, name):
    mechanism = ALL[name]
    state = states_of(mechanism, 1)[0]
    (method,) = engine.methods(mechanism, Question.MODEL)
    assert engine.model(mechanism, state, method).freedom == free_directions(mechanism, state).shape[1]


def distance(answer, other):
    return max(np.max(np.abs(answer.p_WB - other.p_WB)), np.max(rotation_angle_between(answer.quat_WB, other.quat_WB)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_motions_lead_to_the_reference_with_the_declared_order(engine, name):
    mechanism = ALL[name]
    start, times = states_of(mechanism, 1)[0], np.linspace(0.0, 0.1, 3)
    reference = simulate(mechanism, start, times, 1e-13)
    for method in matched(engine, mechanism, Question.TRAJECTORY):
        substeps = method.substeps[:2]
        errors = [
            distance(engine.trajectory(mechanism, start, times, method, times[1] / n), reference) for n in substeps
        ]
        assert errors[-1] < (2e-3 if method.order != 4 else 1e-6)
        assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.15), (method.name, errors)


def rotor(**elements):
    """One body of unit inertia that turns about the world's z axis without gravity."""
    body = Body("b", 1.0, np.zeros(3), np.eye(3), HERE)
    joint = Joint("j", "revolute", GROUND, "b", HERE, HERE)
    return Mechanism("rotor", np.zeros(3), (body,), (joint,), **elements)


def turning(mechanism, rate):
    rest = initial_state(mechanism)
    return State(rest.p_WB, rest.quat_WB, rest.v_WB_W, np.array([[0.0, 0.0, rate]]))


def test_friction_far_too_steep_for_the_step_brakes_without_chatter(engine):
    # w' = -F tanh(w / v) has sinh(w / v) = sinh(w0 / v) exp(-F t / v); the step is ten time constants
    mechanism = rotor(frictions=(Friction("f", "j", "angle", 0.0, 2.0, 0.002),))
    start, times = turning(mechanism, 1.0), np.linspace(0.0, 0.6, 7)
    native = matched(engine, mechanism, Question.TRAJECTORY)[0]
    answer = engine.trajectory(mechanism, start, times, native, 0.01)
    np.testing.assert_allclose(answer.w_WB_W[:, 0, 2], np.maximum(1.0 - 2.0 * times, 0.0), atol=2e-3)
    assert np.all(answer.w_WB_W[:, 0, 2] > -1e-12)


def test_dampers_of_one_answer_are_not_left_in_the_next(engine):
    mechanism = ELEMENTS["powered"]
    states = states_of(mechanism, 2)
    native, matrix = engine.methods(mechanism, Question.INSTANT)
    first = engine.instant(mechanism, states, native)
    engine.instant(mechanism, states, matrix)
    np.testing.assert_array_equal(engine.instant(mechanism, states, native).a_WB_W, first.a_WB_W)


def test_a_brake_is_split_into_a_damper_and_a_rest_that_give_it_back(engine):
    mechanism = ELEMENTS["powered"]
    model = build(mechanism)
    for _, law in efforts(model, np.zeros(2)):
        value, steepness = law(0.3, 0.4, 0.7)
        ahead, behind = (law(0.3, 0.4, 0.7 + d)[0] for d in (1e-6, -1e-6))
        assert steepness == pytest.approx(-(ahead - behind) / 2e-6, abs=1e-7)
        assert np.isfinite(value)


def test_an_integral_starts_at_zero_in_every_run(engine):
    # q'' = I int (1 - q) dt: q = I t^3 / 6 for short times
    mechanism = rotor(controls=(Control("c", "j", "angle", constant(1.0), 0.0, 5.0, 0.0),))
    start, times = turning(mechanism, 0.0), np.linspace(0.0, 0.2, 3)
    for method in matched(engine, mechanism, Question.TRAJECTORY):
        runs = [engine.trajectory(mechanism, start, times, method, 0.1 / 400) for _ in range(2)]
        np.testing.assert_array_equal(runs[0].quat_WB, runs[1].quat_WB)
        assert rotation_vector_from_quaternion(runs[0].quat_WB[-1, 0])[2] == pytest.approx(5.0 * 0.2**3 / 6, rel=0.01)


def test_a_drive_of_a_step_keeps_its_position_to_second_order(engine):
    mechanism = driven_loop(rotor(), "j", "angle", sine(0.8, 4.0))
    start, times, h = turning(mechanism, 3.2), np.linspace(0.0, 3.0, 7), 0.005
    native = matched(engine, mechanism, Question.TRAJECTORY)[0]
    answer = engine.trajectory(mechanism, start, times, native, h)
    angle = [rotation_vector_from_quaternion(q[0])[2] for q in answer.quat_WB]
    # the error recursion e+ = h^2 f'' / 2 + e / 2 converges to h^2 f''
    assert np.max(np.abs(angle - 0.8 * np.sin(4.0 * times))) < 1.1 * h**2 * 0.8 * 4.0**2


def test_full_turns_of_a_drive_are_only_a_name(engine):
    base = chain("revolute", "spherical", seed=31)
    near, far = (driven_loop(base, "j0", "angle", Function(np.array([0.7 + turns, 2.0]))) for turns in (0, 4 * np.pi))
    start, times = initial_state(near), np.linspace(0.0, 0.2, 3)
    for method in matched(engine, far, Question.TRAJECTORY):
        a, b = (engine.trajectory(m, start, times, method, 0.01) for m in (near, far))
        np.testing.assert_allclose(b.p_WB, a.p_WB, atol=1e-12)


def test_a_cam_is_read_over_full_turns(engine):
    profile = Function(np.array([0.0, 0.1, 0.02]))  # not periodic, so that a lost turn shows
    base = chain("revolute", "prismatic", seed=77)
    mechanism = dataclasses.replace(
        base,
        couplings=(Coupling("cam", "j0", "angle", "j1", "distance", profile),),
        drives=(Drive("d", "j0", "angle", linear(7.0, 0.1)),),
    )
    start, times = initial_state(mechanism), np.linspace(0.0, 1.5, 16)
    (method,) = matched(engine, mechanism, Question.TRAJECTORY)
    answer = engine.trajectory(mechanism, start, times, method, 0.1 / 8)
    angle = 0.1 + 7.0 * times
    for k in range(len(times)):
        before = {"j0": angle[k]}
        assert np.max(np.abs(constraint_residual(mechanism, answer.state(k), times[k], before))) < 1e-5
    assert angle[-1] > 3 * np.pi


def test_a_screw_reads_its_turns_off_its_displacement(engine):
    base = chain("revolute", "screw", seed=36, backwards=(1,))
    mechanism = dataclasses.replace(
        base,
        joint_springs=(JointSpring("s", "j1", "angle", 3.0, 0.2, 0.1),),
        controls=(Control("c", "j1", "angle", constant(0.4), 5.0, 1.0, 0.3),),
    )
    state = initial_state(mechanism, Initial({"j1": {"angle": 9.0}}, {"j0": {"angle": 0.7}, "j1": {"angle": -1.2}}))
    expected = np.hstack(truth.solve(mechanism, state)[:2])
    for method in matched(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, [state], method)
        np.testing.assert_allclose(
            np.hstack([answer.a_WB_W[0], answer.alpha_WB_W[0]]), expected, rtol=1e-11, atol=1e-11
        )
        assert answer.potential[0] == pytest.approx(potential_energy(mechanism, state), rel=1e-12)


def test_a_driven_joint_has_no_reaction_about_its_axis(engine):
    mechanism = ELEMENTS["driven"]
    states = states_of(mechanism, 2)
    for method in matched(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, states, method)
        np.testing.assert_allclose(answer.torque_F[:, 0, 2], 0.0, atol=1e-13)
        np.testing.assert_allclose(answer.force_F[:, 2, 2], 0.0, atol=1e-13)


def test_the_routes_say_who_does_the_work(engine):
    def routes(name, question):
        return [m.route for m in matched(engine, ALL[name], question)]

    native, solved, integrated = Route.NATIVE, Route.HARNESS_SOLVE, Route.HARNESS_INTEGRATOR
    for name in ("single_screw", "powered", "driven", "backward_elements"):
        assert routes(name, Question.INSTANT) == [native, solved]
        assert routes(name, Question.TRAJECTORY) == [native, integrated]
    for name in ("powered_four_bar", "driven_crank", "screw_in_loop"):
        assert routes(name, Question.INSTANT) == [solved, Route.EXTRAPOLATED]
        assert routes(name, Question.TRAJECTORY) == [Route.TUNED, integrated]
    for name in ("coupled", "rolling_torus", "skating", "geared_loop", "skate_in_loop"):
        assert routes(name, Question.INSTANT) == [solved]
        assert routes(name, Question.TRAJECTORY) == [integrated]


def test_what_neither_stepping_nor_runge_kutta_can_move_is_refused_by_name(engine):
    base = chain("revolute", "rod", "revolute", seed=79)
    coupled = dataclasses.replace(base, couplings=(Coupling("gears", "j0", "angle", "j2", "angle", linear(0.5)),))
    assert engine.unsupported(coupled, Question.INSTANT) == ()
    (refused,) = engine.unsupported(coupled, Question.TRAJECTORY)
    assert "'gears'" in refused.feature
    assert refused.reason
    assert engine.unsupported(base, Question.TRAJECTORY) == ()


def mimicking(multiplier):
    """Two equal rotors, the second coupled to the first by DART's own coupler."""
    skeleton = dartpy.dynamics.Skeleton("pair")
    joints = []
    for _ in range(2):
        joint, node = skeleton.createRevoluteJointAndBodyNodePair(None)
        joint.setAxis([0.0, 0.0, 1.0])
        node.setInertia(dartpy.dynamics.Inertia(1.0, np.zeros(3), np.eye(3)))
        joints.append(joint)
    mimic = dartpy.dynamics.MimicDofProperties()
    mimic.mReferenceJoint, mimic.mReferenceDofIndex, mimic.mMultiplier, mimic.mOffset = joints[0], 0, multiplier, 0.0
    mimic.mConstraintType = dartpy.dynamics.MimicConstraintType.Coupler
    properties = joints[1].getRevoluteJointProperties()
    properties.mMimicDofProps = [mimic]
    properties.mActuatorType = dartpy.dynamics.ActuatorType.MIMIC
    joints[1].setProperties(properties)
    world = dartpy.simulation.World()
    world.addSkeleton(skeleton)
    return world, skeleton


def test_the_coupler_of_dart_is_no_gear_pair():
    # at matching speeds neither rotor should accelerate; DART's coupler stops the second for a step and passes its
    # momentum to the first, and oscillates with growing amplitude if the second outweighs the first
    for multiplier, grows in ((0.5, False), (2.0, True)):
        world, skeleton = mimicking(multiplier)
        skeleton.setVelocities([1.0, multiplier])
        world.step()
        after = np.array(skeleton.getVelocities())
        np.testing.assert_allclose(after, [1.0 + multiplier**2, 0.0], atol=1e-6)
        for _ in range(20):
            world.step()
        assert bool(np.max(np.abs(skeleton.getVelocities())) > 1e3) is grows
