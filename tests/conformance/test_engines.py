"""All engines on every joint kind and element: trees and loops, lumpy bodies, skew frames.

Expected values are those of `truth`, a dense NumPy solution in maximal coordinates that shares no dynamics with any
engine. A mechanism that an engine cannot represent must be declared `unsupported`; such questions are not asked.
"""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import truth
from consilience.compare.uncertainty import MOST_LEVELS, needs_another_level
from consilience.engine import Profile, Question, Route, defects
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Frame,
    Initial,
    Joint,
    JointSpring,
    State,
    determinate_reactions,
    euler_parameter_matrix,
    free_directions,
    initial_state,
    joint_spring_motion,
    kinetic_energy,
    mass_properties,
    potential_energy,
    relative_motion,
    rotation_angle_between,
    rotation_from_quaternion,
    rotation_with_z_axis,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import simulate
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

ALL = TREES | LOOPS
EPS = np.finfo(float).eps

# native velocity-level solvers cannot be more accurate; the README of the adapter states why
NATIVE_SOLVER_BAR = {"dart": {Route.EXTRAPOLATED: 1e-8}}


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


def supported_methods(engine, mechanism, question):
    reasons = engine.unsupported(mechanism, question)
    if reasons:
        assert all(r.feature and r.reason for r in reasons)
        pytest.skip("; ".join(f"{r.feature}: {r.reason}" for r in reasons))
    methods = [m for m in engine.methods(mechanism, question) if m.profile is Profile.MATCHED]
    assert methods
    return methods


@pytest.mark.parametrize("name", ELEMENTS)
def test_elements_are_answered_or_refused(engine, name):
    """An element without a translation is refused by name, never left out in silence."""
    mechanism = ELEMENTS[name]
    (state,) = states_of(mechanism, 1)
    reasons = engine.unsupported(mechanism, Question.INSTANT)
    if reasons:
        named = {
            x.name
            for group in (
                "springs",
                "joint_springs",
                "loads",
                "frictions",
                "controls",
                "drives",
                "couplings",
                "rollings",
                "skates",
                "joints",
            )
            for x in getattr(mechanism, group)
        }
        for reason in reasons:
            assert any(f"'{x}'" in reason.feature for x in named)
            assert reason.reason
        return
    expected = np.hstack(truth.solve(mechanism, state)[:2])
    for method in supported_methods(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, [state], method)
        assert relative(np.hstack([answer.a_WB_W[0], answer.alpha_WB_W[0]]), expected) < 1e-11


@pytest.mark.parametrize("name", ALL)
def test_model(engine, name):
    mechanism = ALL[name]
    state = states_of(mechanism)[1]
    for method in supported_methods(engine, mechanism, Question.MODEL):
        answer = engine.model(mechanism, state, method)
        assert defects(answer, Question.MODEL, mechanism, 1) == []
        mass, com, inertia = mass_properties(mechanism, state)
        assert answer.mass == pytest.approx(mass, rel=1e-12)
        assert np.max(np.abs(answer.com - com)) < 1e-12 * max(1, np.max(np.abs(com)))
        assert relative(answer.inertia, inertia) < 1e-12
        assert answer.freedom == free_directions(mechanism, state).shape[1]


@functools.cache
def conditions(name):
    """Condition number of the mass matrix, and which reactions are determined, at each state."""
    mechanism = ALL[name]
    return [(mass_matrix_condition(mechanism, s), determinate_reactions(mechanism, s)) for s in states_of(mechanism)]


@pytest.mark.parametrize("name", ALL)
def test_instant(engine, engine_name, name):
    mechanism = ALL[name]
    states = states_of(mechanism)
    for method in supported_methods(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, states, method)
        assert defects(answer, Question.INSTANT, mechanism, len(states)) == []
        bar = NATIVE_SOLVER_BAR.get(engine_name, {}).get(method.route, 1e-11)
        for n, (state, (condition, known)) in enumerate(zip(states, conditions(name), strict=True)):
            a, alpha, force, torque = truth.solve(mechanism, state)
            expected = np.hstack([a, alpha])
            found = np.hstack([answer.a_WB_W[n], answer.alpha_WB_W[n]])
            assert relative(found, expected) < bar + 4 * EPS * condition, method.name
            if answer.force_F is not None:
                expected = np.hstack([force, torque])
                found = np.hstack([answer.force_F[n], answer.torque_F[n]])
                if np.max(np.abs(expected[known])) > 1e-6:  # zero if all joints are free joints
                    assert relative(found[known], expected[known]) < max(1e-10, 10 * bar), method.name
            T, V = kinetic_energy(mechanism, state), potential_energy(mechanism, state)
            assert answer.kinetic[n] == pytest.approx(T, rel=1e-12)
            assert answer.potential[n] == pytest.approx(V, rel=1e-12, abs=1e-12 * max(1.0, T))


@functools.cache
def motion(name, duration=0.4, sample=0.05):
    """Motion of `truth`: DOP853 on poses and velocities of all bodies."""
    mechanism = ALL[name]
    start = states_of(mechanism)[0]
    n = len(mechanism.bodies)

    def unpack(y):
        p, quat, v, w = np.split(y, [3 * n, 7 * n, 10 * n])
        quat = quat.reshape(n, 4)
        unit = quat / np.linalg.norm(quat, axis=1)[:, None]
        return State(p.reshape(n, 3), unit, v.reshape(n, 3), w.reshape(n, 3))

    def derivative(_, y):
        state = unpack(y)
        a = truth.accelerations(mechanism, state)[0]
        R = rotation_from_quaternion(state.quat_WB)
        body_rates = np.einsum("bji,bj->bi", R, state.w_WB_W)
        rates = [0.5 * euler_parameter_matrix(q).T @ w for q, w in zip(state.quat_WB, body_rates, strict=True)]
        return np.concatenate([state.v_WB_W.ravel(), np.ravel(rates), a[:, :3].ravel(), a[:, 3:].ravel()])

    times = np.arange(round(duration / sample) + 1) * sample
    y0 = np.concatenate([start.p_WB.ravel(), start.quat_WB.ravel(), start.v_WB_W.ravel(), start.w_WB_W.ravel()])
    solution = solve_ivp(derivative, (0, duration), y0, "DOP853", times, rtol=1e-11, atol=1e-12)
    return times, start, [unpack(y) for y in solution.y.T]


def error(answer, states):
    p = max(np.max(np.abs(answer.p_WB[k] - s.p_WB)) for k, s in enumerate(states))
    angle = max(np.max(rotation_angle_between(answer.quat_WB[k], s.quat_WB)) for k, s in enumerate(states))
    return max(p, angle)


def ladder(engine, mechanism, start, times, method):
    """Motions at the levels of a method, and at finer levels until the observed order has settled, as in a suite."""
    steps = [(times[1] - times[0]) / n for n in method.substeps] or list(method.tolerances)
    answers = [engine.trajectory(mechanism, start, times, method, step) for step in steps]
    while method.substeps and len(steps) < MOST_LEVELS and needs_another_level(answers, method, steps):
        steps.append(steps[-1] / 2.0)
        answers.append(engine.trajectory(mechanism, start, times, method, steps[-1]))
    return answers


MOVING = ["long_chain", "floating_chain", "forced_chain", "branched", "four_bar", "slider_crank"]
MOVING += ["single_rod", "loop_universal", "loop_rod"]


@pytest.mark.parametrize("name", MOVING)
def test_trajectory_converges_to_the_truth_with_the_declared_order(engine, name):
    mechanism = ALL[name]
    for method in supported_methods(engine, mechanism, Question.TRAJECTORY):
        times, start, states = motion(name)
        errors = []
        for answer in ladder(engine, mechanism, start, times, method):
            assert defects(answer, Question.TRAJECTORY, mechanism, len(times)) == []
            np.testing.assert_allclose(answer.time, times, atol=1e-12)
            errors.append(error(answer, states))
            v = max(np.max(np.abs(answer.v_WB_W[k] - s.v_WB_W)) for k, s in enumerate(states))
            w = max(np.max(np.abs(answer.w_WB_W[k] - s.w_WB_W)) for k, s in enumerate(states))
            assert max(v, w) < 1e3 * errors[-1] + 1e-8, method.name
        assert errors[-1] < 0.05, method.name
        if method.order is not None and errors[-1] > 1e-10:
            assert np.log2(errors[-2] / errors[-1]) == pytest.approx(method.order, abs=0.3), (method.name, errors)


@pytest.mark.parametrize("name", ["single_rod", "backward_rod", "loop_rod"])
def test_a_rod_may_lie_along_any_axis_of_its_frames(engine, engine_name, name):
    """A rod holds a distance only: no axis of its frames is special, not at a state and not for a motion from there."""
    base = ALL[name]
    times, state, states = motion(name)
    joints = []
    for joint in base.joints:
        if joint.kind == "rod":
            along = relative_motion(base, state, joint).p
            back = replace(joint, predecessor=joint.successor, successor=joint.predecessor, F=joint.M, M=joint.F)
            F = Frame(joint.F.p, joint.F.R @ rotation_with_z_axis(along)[:, [2, 0, 1]])
            M = Frame(joint.M.p, joint.M.R @ rotation_with_z_axis(relative_motion(base, state, back).p)[:, [2, 0, 1]])
            joints.append(replace(joint, F=F, M=M))
        else:
            joints.append(joint)
    mechanism = replace(base, joints=tuple(joints))
    expected = np.hstack(truth.solve(mechanism, state)[:2])
    for method in supported_methods(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, [state], method)
        bar = NATIVE_SOLVER_BAR.get(engine_name, {}).get(method.route, 1e-11)
        assert relative(np.hstack([answer.a_WB_W[0], answer.alpha_WB_W[0]]), expected) < bar, method.name
        if answer.force_F is not None:
            force, known = truth.solve(mechanism, state)[2], determinate_reactions(mechanism, state)[:, :3]
            assert relative(answer.force_F[0][known], force[known]) < max(1e-10, 10 * bar), method.name
    for method in supported_methods(engine, mechanism, Question.TRAJECTORY):
        step = (times[1] - times[0]) / method.substeps[-1] if method.substeps else method.tolerances[-1]
        found = error(engine.trajectory(mechanism, state, times, method, step), states)
        assert found < {1: 0.05, 2: 1e-3}.get(method.order, 1e-4), method.name


@pytest.mark.parametrize("step", [0.2, 0.03, 0.0, -0.01, np.nan])
def test_a_step_that_does_not_divide_the_sample_interval_is_refused(engine, step):
    """Such a step ends on no sample: what came out would be a motion at other times, or the initial state."""
    mechanism = ALL["four_bar"]
    (state,) = states_of(mechanism, 1)
    for method in engine.methods(mechanism, Question.TRAJECTORY):
        if method.substeps:
            with pytest.raises(InvalidInput, match=r"does not divide the sample interval of 0\.05 s"):
                engine.trajectory(mechanism, state, np.arange(3) * 0.05, method, step)


def test_sample_times_at_unequal_intervals_are_refused(engine):
    """The step of an engine divides the first interval alone: what came out would be a motion at other times."""
    mechanism = ALL["four_bar"]
    (state,) = states_of(mechanism, 1)
    for method in engine.methods(mechanism, Question.TRAJECTORY):
        if method.substeps:
            with pytest.raises(InvalidInput, match=r"sample intervals from 0\.05 to 0\.07 s"):
                engine.trajectory(mechanism, state, np.array([0.0, 0.05, 0.12]), method, 0.05)


def test_a_weld_on_a_slide_carries_the_weight_along_it(engine):
    """One coordinate, and a weld that holds it: no acceleration, no freedom, along the slide a reaction of m g . z."""
    base = ALL["single_prismatic"]
    body, slide = base.bodies[0], base.joints[0]
    hold = Joint("hold", "rigid", GROUND, body.name, body.drawing, Frame(np.zeros(3), np.eye(3)))
    mechanism = replace(base, joints=(slide, hold))
    state = initial_state(mechanism)
    along = slide.F.R[:, 2]
    weight = body.mass * base.gravity @ along
    for method in supported_methods(engine, mechanism, Question.MODEL):
        assert engine.model(mechanism, state, method).freedom == 0
    for method in supported_methods(engine, mechanism, Question.INSTANT):
        answer = engine.instant(mechanism, [state], method)
        assert np.max(np.abs([answer.a_WB_W, answer.alpha_WB_W])) < 1e-7, method.name
        if answer.force_F is not None:
            force = hold.F.R @ answer.force_F[0][1]
            assert force @ along == pytest.approx(-weight, rel=1e-8), method.name


def test_the_angle_of_a_nonlinear_joint_spring_counts_full_turns(engine):
    """A spring that is wound up by more than a turn, on a joint passed backwards too; without gravity."""
    stiffness, damping = (0.004, 0.002), (0.002, 0.0005)
    springs = tuple(JointSpring(f"k{n}", f"j{n}", "angle", 0.05, 0.01, 0.3, None, stiffness, damping) for n in range(2))
    base = chain("revolute", "revolute", seed=91, backwards=(1,))
    mechanism = replace(base, gravity=np.zeros(3), joint_springs=springs)
    start = initial_state(mechanism, Initial({}, {"j0": {"angle": 5.0}, "j1": {"angle": 20.0}}))
    times = np.linspace(0.0, 1.5, 31)
    expected = simulate(mechanism, start, times, 1e-12, "relative")
    turned = [joint_spring_motion(mechanism, expected.state(k), "j1", "angle")[1] for k in range(len(times))]
    assert np.trapezoid(turned, times) > 2.2 * np.pi
    for method in supported_methods(engine, mechanism, Question.TRAJECTORY):
        if method.order is None or method.order < 2:
            continue
        coarse, fine = (
            np.max(np.abs(engine.trajectory(mechanism, start, times, method, 0.05 / n).p_WB - expected.p_WB))
            for n in method.substeps[:2]
        )
        assert fine < 0.02, method.name
        assert np.log2(coarse / fine) > method.order - 0.5, method.name
