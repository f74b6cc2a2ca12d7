"""Published values: reading them from cases and motions; a reference that contradicts them fails no engine."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truth
from consilience.case import Published, later_equations, load_case, read_motion
from consilience.case.file.reader import load_file
from consilience.cli.commands.values import found_values
from consilience.compare import Verdict
from consilience.compare.instants import Instants
from consilience.compare.motion import Scales
from consilience.compare.published import against_published, dispute, start_against_published
from consilience.engine import Question, TrajectoryAnswer, load_engine
from consilience.errors import InvalidInput
from consilience.mechanism import Initial, JointSpring, determinate_reactions, initial_state
from consilience.reference import accelerations
from consilience.suite import run_suite
from mechanisms import ELEMENTS, LOOPS, TREES, states_of
from situations import MECHANISM, TIMES, TRUE

BODY = MECHANISM.bodies[0].name
SPREAD = np.full(len(TIMES), 1e-9)


def known(value, uncertainty=1e-10, observable="p_WB", component=0, time=1.0):
    return Published(observable, BODY, component, time, value, uncertainty, "a closed form")


def test_the_bar_is_the_sum_of_both_uncertainties():
    """The body moves on the unit circle: x = cos t."""
    (found,) = against_published(MECHANISM, [known(np.cos(1.0) + 5e-10)], [TRUE], SPREAD)
    assert found.difference == pytest.approx(5e-10, rel=1e-5)
    assert found.bar == pytest.approx(1e-10 + 1e-9 * Scales.of(MECHANISM, TRUE).size, rel=1e-9)
    assert found.met
    assert dispute([found]) == ""


@pytest.mark.parametrize(
    ("observable", "component", "value"), [("p_WB", 1, np.sin(1.0)), ("v_WB_W", 0, -np.sin(1.0)), ("w_WB_W", 2, 1.0)]
)
def test_every_observable_is_read_at_its_time_and_component(observable, component, value):
    right, wrong = (known(value + d, 1e-10, observable, component) for d in (0.0, 1e-6))
    found = against_published(MECHANISM, [right, wrong], [TRUE], SPREAD)
    assert [q.met for q in found] == [True, False]
    assert f"{observable} of {BODY}" in dispute(found)


def test_only_the_known_components_of_a_vector_are_compared(tmp_path):
    (case,) = load_file(written(tmp_path, {"value": "{ x = 0.0, z = -1.2 }"}))
    assert [(k.component, k.value) for k in case.published] == [(0, 0.0), (2, -1.2)]


def test_centre_of_mass_and_axes_follow_from_the_pose_of_a_lumpy_body():
    """``p + R c`` and ``v + w x R c``, for a random pose and random velocities."""
    mechanism, rng = TREES["floating_chain"], np.random.default_rng(4)
    (state,) = states_of(mechanism, 1)
    motion = TrajectoryAnswer(np.zeros(1), *(x[None] for x in (state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W)))
    i = int(rng.integers(len(mechanism.bodies)))
    body, R = mechanism.bodies[i], Rotation.from_quat(state.quat_WB[i], scalar_first=True).as_matrix()
    expected = {
        "w_WB_B": R.T @ state.w_WB_W[i],
        "p_WBcm": state.p_WB[i] + R @ body.com,
        "v_WBcm_W": state.v_WB_W[i] + np.cross(state.w_WB_W[i], R @ body.com),
        "x_axis": R[:, 0],
        "y_axis": R[:, 1],
        "z_axis": R[:, 2],
    }
    for name, vector in expected.items():
        found = [read_motion(mechanism, Published(name, body.name, k, 0.0, 0.0, 1.0, ""), motion) for k in range(3)]
        np.testing.assert_allclose(found, vector, atol=1e-14, err_msg=name)


def test_joint_coordinates_and_rates_are_read_and_angles_compared_modulo_full_turns():
    """Coordinates and rates of a planar joint come back from the state that assembly finds for them."""
    mechanism = TREES["single_planar"]
    held = {"x": 0.3, "y": -0.2, "angle": 3.0}
    rates = {"x": 0.5, "y": 0.7, "angle": -1.1}
    name = mechanism.joints[0].name
    state = initial_state(mechanism, Initial({name: held}, {name: rates}))
    motion = TrajectoryAnswer(np.zeros(1), *(x[None] for x in (state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W)))
    for suffix, values in (("", held), ("_rate", rates)):
        for coordinate, value in values.items():
            expected = Published(f"{coordinate}{suffix}", name, 0, 0.0, value, 1e-12, "")
            assert expected.off(read_motion(mechanism, expected, motion)) < 1e-12
    assert Published("angle", name, 0, 0.0, 3.0, 1e-12, "").off(3.0 + 4 * np.pi) < 1e-12
    assert Published("angle", name, 0, 0.0, 3.0 + 4 * np.pi, 1e-12, "").off(3.0) == pytest.approx(4 * np.pi)
    assert Published("angle_rate", name, 0, 0.0, 3.0 + 4 * np.pi, 1e-12, "").off(3.0) > 1.0


def test_values_of_the_start_are_accelerations_and_reactions():
    """A lumpy body on a hinge against the dense solution in maximal coordinates; one wrong value is a dispute."""
    mechanism = TREES["single_revolute"]
    (state,) = states_of(mechanism, 1)
    answer, instants = accelerations(mechanism, [state]), Instants.of(mechanism, [state])
    a, alpha, force, torque = truth.solve(mechanism, state)
    body, joint = mechanism.bodies[0].name, mechanism.joints[0].name
    values = {"a_WB_W": (body, a), "alpha_WB_W": (body, alpha), "force_F": (joint, force), "torque_F": (joint, torque)}
    for name, (of, vectors) in values.items():
        right = [Published(name, of, k, 0.0, vectors[0, k], 1e-12, "") for k in range(3)]
        assert dispute(start_against_published(mechanism, right, answer, instants)) == ""
        wrong = replace(right[1], value=right[1].value + 1e-6)
        assert f"{name} of {of}, y at 0 s" in dispute(start_against_published(mechanism, [wrong], answer, instants))


def sampled(states, times):
    return TrajectoryAnswer(
        np.array(times),
        *(np.array([getattr(s, name) for s in states]) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")),
    )


@pytest.mark.parametrize(
    "name", ["forced_chain", "four_bar", "powered", "driven", "coupled", "rolling_torus", "skating"]
)
def test_later_accelerations_and_reactions_are_those_of_newton_and_euler(name):
    """Against the dense solution in maximal coordinates, drives and loads at the time of the sample."""
    mechanism = (TREES | LOOPS | ELEMENTS)[name]
    (state,) = states_of(mechanism, 1)
    found = later_equations(mechanism, sampled([state], [0.7]), 0)
    known = determinate_reactions(mechanism, state)
    a, alpha, force, torque = truth.solve(mechanism, state, 0.7)
    scale = max(np.max(np.abs(a)), np.max(np.abs(alpha)))
    np.testing.assert_allclose([found["a_WB_W"], found["alpha_WB_W"]], [a, alpha], atol=1e-10 * scale)
    expected, wrench = np.hstack([force, torque])[known], np.hstack([found["force_F"], found["torque_F"]])[known]
    np.testing.assert_allclose(wrench, expected, atol=1e-9 * np.max(np.abs(expected)))


def turning(rates):
    """A lumpy body on a sprung hinge, turned in steps of 2 rad a sample; the states, and the mechanism."""
    base = TREES["single_revolute"]
    spring = JointSpring("k", base.joints[0].name, "angle", 3.0, 0.0, 0.1)
    mechanism = replace(base, joint_springs=(spring,))
    name = base.joints[0].name
    held = [{name: {"angle": float(np.remainder(2.0 * k + np.pi, 2 * np.pi) - np.pi)}} for k in range(4)]
    return mechanism, [initial_state(mechanism, Initial(at, {name: {"angle": rates}})) for at in held]


def test_angles_count_their_turns_along_the_motion():
    """After three steps of 2 rad the angle is 6 rad, not 6 - 2 pi; the spring is wound up by 5.9 rad."""
    mechanism, states = turning(20.0)
    motion = sampled(states, 0.1 * np.arange(4))
    joint, body = mechanism.joints[0].name, mechanism.bodies[0].name
    right = Published("angle", joint, 0, 0.3, 6.0, 1e-9, "")
    assert read_motion(mechanism, right, motion) == pytest.approx(6.0, abs=1e-12)
    whole = replace(right, value=6.0 - 2 * np.pi)  # within half a turn: modulo
    short = replace(right, value=6.0 + 2 * np.pi)
    measured = [q.met for q in against_published(mechanism, [right, whole, short], [motion], np.full(4, 1e-12))]
    assert measured == [True, True, False]
    unwound = replace(mechanism, joint_springs=(replace(mechanism.joint_springs[0], rest=0.1 - 2 * np.pi),))
    alpha = truth.solve(unwound, states[3], 0.3)[1][0]
    for k in range(3):
        found = read_motion(mechanism, Published("alpha_WB_W", body, k, 0.3, 0.0, 1.0, ""), motion)
        assert found == pytest.approx(alpha[k], abs=1e-10 * np.max(np.abs(alpha)))


def test_a_later_acceleration_disputes_the_reference_like_a_position():
    """An acceleration of the small pendulum by the dense solution at its state, in a run as in `consilience values`."""
    case = replace(load_case("simple_pendulum-small"), duration=0.5)
    engine = load_engine("reference")
    motion = engine.trajectory(
        case.mechanism, case.initial_state, case.times, engine.methods(case.mechanism, Question.TRAJECTORY)[0], 1e-12
    )
    state = motion.state(len(case.times) - 1)
    a = truth.solve(case.mechanism, state)[0][0]
    axis = int(np.argmax(np.abs(a)))
    assert abs(a[axis]) > 0.01
    for off, met in ((0.0, True), (1e-6, False)):
        known = Published("a_WB_W", "bob", axis, 0.5, float(a[axis]) + off, 1e-9, "Newton and Euler")
        changed = replace(case, published=(known,))
        (comparison, *_) = run_suite([changed], [], [Question.TRAJECTORY]).comparisons
        assert (comparison.verdict is Verdict.AGREES) is met
        (found,) = found_values(changed)
        assert found.met is met


def test_values_and_run_judge_by_the_same_bar():
    case = replace(load_case("simple_pendulum-small"), duration=10.0)
    shown = [q for c in run_suite([case], [], [Question.TRAJECTORY]).comparisons for q in c.quantities]
    bars = {q.name: q.bar for q in shown}
    found = list(found_values(case))
    assert len(found) == len(case.published)
    for one in found:
        assert bars[one.measured.known.name] == pytest.approx(one.measured.bar, rel=1e-12)


def test_a_disputed_start_fails_no_engine():
    case = replace(load_case("double_pendulum"), instants=2)
    for value, verdict in ((0.0, Verdict.UNRESOLVED), (None, Verdict.AGREES)):
        known = () if value is None else (Published("alpha_WB_W", "upper", 0, 0.0, value, 1e-9, "a misprint"),)
        results = run_suite([replace(case, published=known)], [], [Question.INSTANT])
        assert {c.verdict for c in results.comparisons} == {verdict}


def test_a_disputed_reference_fails_no_engine():
    case = replace(load_case("simple_pendulum-small"), duration=0.5)
    wrong = Published("p_WB", "bob", 0, 0.5, 1.0, 1e-3, "a misprint")
    for published, verdict in (((), Verdict.AGREES), ((wrong,), Verdict.UNRESOLVED)):
        results = run_suite([replace(case, published=published)], [], [Question.TRAJECTORY])
        assert {c.verdict for c in results.comparisons} == {verdict}
    assert "the reference is disputed: p_WB of bob, x at 0.5 s differs by" in results.comparisons[0].why


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("body", '"bab"', r"published\[0\].body: there is no body 'bab'"),
        ("time", "0.07", r"published\[0\].time: 0.07 s is no sample"),
        ("time", "11.0", r"published\[0\].time: 11 s is no sample"),
        ("uncertainty", "0.0", r"uncertainty"),
        ("observable", '"energy"', r"observable"),
        ("observable", '"angle"', r"angle is an observable of a joint; name the joint"),
        ("value", "1.0", r"p_WB has another shape; give three numbers"),
        ("value", "{ }", r"the value has no component"),
        ("origin", '"computed"', r"a computed value has a second, independent computation"),
        ("origin", '"guessed"', r"origin"),
    ],
)
def test_a_value_that_cannot_be_compared_is_refused(tmp_path, field, value, message):
    with pytest.raises(InvalidInput, match=message):
        load_file(written(tmp_path, {field: value}))


def written(tmp_path, fields):
    """Write a case file with one expected value; return its path."""
    entry = {
        "body": '"bob"',
        "observable": '"p_WB"',
        "time": "0.5",
        "value": "[0.0, 0.0, 0.0]",
        "uncertainty": "1e-9",
        "origin": '"printed"',
        "source": '"mine"',
    } | fields
    text = (
        'title = "t"\nsources = ["s"]\ngravity = [0.0, 0.0, -9.81]\n[trajectory]\nduration = 1.0\n'
        '[[body]]\nname = "bob"\nmass = 1.0\nat = [0.0, 0.0, 0.0]\ninertia = { xx = 1.0, yy = 1.0, zz = 1.0 }\n'
        '[[joint]]\nname = "j"\nkind = "free"\npredecessor = "ground"\nsuccessor = "bob"\nat = [0.0, 0.0, 0.0]\n'
        "axis = [0.0, 0.0, 1.0]\n[[published]]\n" + "\n".join(f"{k} = {v}" for k, v in entry.items())
    )
    path = tmp_path / "c.toml"
    path.write_text(text, encoding="utf-8")
    return path
