"""Published values: reading them from cases and motions; a reference that contradicts them fails no engine."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truth
from consilience.case import Published, load_case, read_motion
from consilience.case.file.reader import load_file
from consilience.compare import Verdict
from consilience.compare.instant import Instants
from consilience.compare.motion import Scales
from consilience.compare.published import against_published, dispute, start_against_published
from consilience.engine import Question, TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.mechanism import Initial, initial_state
from consilience.reference import accelerations
from consilience.suite import run_suite
from mechanisms import TREES, states_of
from situations import MECHANISM, TIMES, TRUE

BODY = MECHANISM.bodies[0].name
SPREAD = np.full(len(TIMES), 1e-9)


def known(value, uncertainty=1e-10, observable="p_WB", component=0, time=1.0):
    return Published(observable, BODY, component, time, value, uncertainty, "a closed form")


def test_the_bar_is_the_sum_of_both_uncertainties():
    """The body moves on the unit circle: x = cos t."""
    (found,) = against_published(MECHANISM, [known(np.cos(1.0) + 5e-10)], TRUE, SPREAD)
    assert found.difference == pytest.approx(5e-10, rel=1e-5)
    assert found.bar == pytest.approx(1e-10 + 1e-9 * Scales.of(MECHANISM, TRUE).size, rel=1e-9)
    assert found.met
    assert dispute([found]) == ""


@pytest.mark.parametrize(
    ("observable", "component", "value"), [("p_WB", 1, np.sin(1.0)), ("v_WB_W", 0, -np.sin(1.0)), ("w_WB_W", 2, 1.0)]
)
def test_every_observable_is_read_at_its_time_and_component(observable, component, value):
    right, wrong = (known(value + d, 1e-10, observable, component) for d in (0.0, 1e-6))
    found = against_published(MECHANISM, [right, wrong], TRUE, SPREAD)
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
    turned = Published("angle", name, 0, 0.0, 3.0 + 4 * np.pi, 1e-12, "")
    assert turned.off(3.0) < 1e-12
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
        ("observable", '"alpha_WB_W"', r"alpha_WB_W is compared at the initial state; give the time 0"),
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
