"""Replays on pages: poses, differences, reactions and drift that a page shows are those of the motion."""

import json
import re
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from consilience.case import load_case
from consilience.engine import EngineInfo, Method, Profile, Question, Route, Run, Status, TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.mechanism import (
    Function,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_from_quaternion,
)
from consilience.report.engines import known_findings
from consilience.report.figure3d import figure_of
from consilience.report.html import fragments, render_html, render_replay
from consilience.report.motion import FINE, FRAMES, FULL, chosen_samples, encoded_difference, encoded_poses
from consilience.report.plots_replay import drift, replay_figures
from consilience.report.reactions import can_be_told, drift_over_time, reactions, reactions_over_time
from consilience.report.record import Record, lines
from consilience.report.replay import motion_alone, replay_of, replays
from consilience.report.replayschema import NAME, read_replay
from consilience.report.scene import figure_of_scene, scene
from consilience.report.view import page
from consilience.suite import Results
from mechanisms import chain, states_of


def unpacked(text, bodies, width, frames):
    """Decode numbers as the script of the page does: cumulative sums of 16-bit differences."""
    changes = np.frombuffer(b64decode(text), dtype="<i2").reshape(bodies, width, frames)
    return np.moveaxis(np.cumsum(changes, axis=-1, dtype=np.int16), -1, 0)


def turning(count=200, rate=0.7, shift=0.0):
    """Return two bodies on circles that turn about skew axes; `shift` adds a growing displacement, m and rad."""
    time = np.linspace(0.0, 4.0, count)
    axes = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    p = np.stack([np.stack([np.cos(time + k), np.sin(time + k), 0.1 * time], axis=-1) for k in range(2)], axis=1)
    quats = np.array([[quaternion_from_rotation_vector(rate * t * axis) for axis in axes] for t in time])
    off = np.array([[quaternion_from_rotation_vector([0.0, 0.0, shift * t])] * 2 for t in time])
    moved = p + shift * time[:, None, None] * np.array([1.0, 0.0, 0.0])
    zeros = np.zeros_like(p)
    return TrajectoryAnswer(time, moved, quaternion_product(off, quats), zeros, zeros)


def test_poses_come_back_to_sixteen_bits_and_do_not_change_their_sign():
    answer = turning()
    flipped = TrajectoryAnswer(answer.time, answer.p_WB, answer.quat_WB.copy(), answer.v_WB_W, answer.w_WB_W)
    flipped.quat_WB[50:90] *= -1.0
    samples = chosen_samples(flipped)
    found = encoded_poses(flipped, samples)
    p = found["middle"] + unpacked(found["p"], 2, 3, len(samples)) * found["size"] / FULL
    assert np.allclose(p, answer.p_WB[samples], atol=found["size"] / FULL)
    quats = unpacked(found["quat"], 2, 4, len(samples)) / FULL
    assert np.allclose(quats, answer.quat_WB[samples], atol=1.0 / FULL)


def test_a_difference_has_a_scale_of_its_own():
    """A difference of 1e-9 m and rad per second, below the resolution of the poses, comes back to three digits."""
    reference, answer = turning(), turning(shift=1e-9)
    samples = chosen_samples(reference)
    found = encoded_difference(answer, reference, samples)
    last = reference.time[samples[-1]]
    assert found["away"] == pytest.approx(1e-9 * last, rel=1e-5)
    assert found["turn"] == pytest.approx(1e-9 * last, rel=1e-5)
    away = unpacked(found["p"], 2, 3, len(samples)) * found["away"] / FINE
    turn = unpacked(found["r"], 2, 3, len(samples)) * found["turn"] / FINE
    grown = 1e-9 * reference.time[samples][:, None, None]
    assert np.allclose(away, grown * [1.0, 0.0, 0.0], rtol=0.0, atol=1e-9 * last / FINE)
    assert np.allclose(turn, grown * [0.0, 0.0, 1.0], rtol=0.0, atol=1e-9 * last / FINE)


def test_frames_are_few_and_follow_what_turns_fast():
    slow, fast = turning(count=1001), turning(count=1001, rate=60.0)
    assert len(chosen_samples(slow)) <= FRAMES
    assert chosen_samples(slow)[-1] > 900
    samples = chosen_samples(fast)
    assert samples[1] * 4.0 / 1000 * 60.0 <= 1.0
    assert len(samples) == FRAMES


@pytest.mark.parametrize("name", ["double_wishbone", "stewart_platform", "flyball_governor", "slider_crank"])
def test_everything_drawn_is_fixed_to_the_body_that_carries_it(name):
    """Figure elements are fixed to bodies: the scene of one state, in the poses of another, is the other figure."""
    case = load_case(name)
    mechanism, state = case.mechanism, case.states[1]
    drawn = scene(mechanism, case.initial_state)
    moved = figure_of_scene(drawn | {"p": state.p_WB.tolist(), "quat": state.quat_WB.tolist()})
    expected = figure_of(mechanism, state)
    size = np.max(np.abs(expected.points))
    for one, other in zip((*moved.joints, *moved.bodies), (*expected.joints, *expected.bodies), strict=True):
        assert (one.name, one.letter) == (other.name, other.letter)
        assert np.allclose(one.point, other.point, atol=1e-5 * size)
        assert (one.axis is None) == (other.axis is None)
        assert one.axis is None or np.allclose(one.axis, other.axis, atol=1e-5)
    for kind in ("body", "spring", "rod"):
        ours, theirs = ([line.points for line in f.lines if line.kind == kind] for f in (moved, expected))
        assert all(np.allclose(a, b, atol=1e-5 * size) for a, b in zip(ours, theirs, strict=True))


def pendulum(name="simple_pendulum-large"):
    """Return a case at rest in its initial pose, with two samples."""
    case = load_case(name)
    mechanism, state = case.mechanism, case.initial_state
    still = np.zeros((2, *state.p_WB.shape))
    quats = np.array([state.quat_WB] * 2)
    answer = TrajectoryAnswer(np.array([0.0, 0.1]), np.array([state.p_WB] * 2), quats, still, still)
    return case, mechanism, state, answer


def hinged():
    """Return a lumpy body on a skew hinge, at rest, with two samples."""
    mechanism = chain("revolute")
    state = states_of(mechanism)[1]
    still = np.zeros((2, *state.p_WB.shape))
    answer = TrajectoryAnswer(
        np.array([0.0, 0.1]), np.array([state.p_WB] * 2), np.array([state.quat_WB] * 2), still, still.copy()
    )
    return mechanism, state, answer


@pytest.mark.parametrize("speed", [0.0, 1.7])
def test_reactions_of_a_pendulum_are_those_of_newton_and_euler(speed):
    """``I alpha`` about the hinge is the moment of the weight; the reaction is ``m (a_C - g)`` [any textbook]."""
    mechanism, state, answer = hinged()
    (body,), (joint,) = mechanism.bodies, mechanism.joints
    R = rotation_from_quaternion(state.quat_WB[0])
    axis, arm = R @ joint.M.R[:, 2], R @ (body.com - joint.M.p)
    about = axis @ R @ body.inertia @ R.T @ axis + body.mass * np.sum(np.cross(axis, arm) ** 2)
    alpha = axis @ np.cross(arm, body.mass * mechanism.gravity) / about
    turning_in = np.cross(speed * axis, np.cross(speed * axis, arm))
    force = body.mass * (np.cross(alpha * axis, arm) + turning_in - mechanism.gravity)
    answer.w_WB_W[:] = speed * axis
    answer.v_WB_W[:] = np.cross(speed * axis, -R @ joint.M.p)
    found = reactions_over_time(mechanism, answer, np.array([0, 1]))
    assert can_be_told(mechanism)
    assert found[:, 0, 0] == pytest.approx([np.linalg.norm(force)] * 2, rel=1e-12)


def test_reactions_that_equilibrium_leaves_open_are_left_out():
    """A planar four-bar at rest, loaded out of its plane: dependent rows carry the whole load."""
    case = load_case("four_bar")
    mechanism, state = replace(case.mechanism, gravity=np.array([0.0, -9.81, 0.0])), case.initial_state
    still = np.zeros((1, *state.p_WB.shape))
    answer = TrajectoryAnswer(np.array([0.0]), np.array([state.p_WB]), np.array([state.quat_WB]), still, still)
    assert np.max(np.abs(reactions(mechanism, answer.state(0), 0.0))) > 1.0
    assert np.max(reactions_over_time(mechanism, answer, np.array([0]))) < 1e-12


@pytest.mark.parametrize("law", [Function(np.array([0.0, -0.1])), Function(np.array([0.0, 0.1, 0.02]))])
def test_reactions_of_coupled_shafts_are_those_of_newton_and_euler(law):
    """An eccentric wheel, geared: ``T + s R = J_1 a``, ``-R = J_2 (s a + f'' w^2)``; its shaft bears m a_C alone.

    Over more than a turn: a nonlinear law needs counted turns.
    """
    mechanism = load_case("gear_pair").mechanism  # J = 10 and 100 kg m^2, torque of 6 N m on the first
    wheels = (replace(mechanism.bodies[0], com=np.array([0.2, 0.0, 0.0])), mechanism.bodies[1])
    mechanism = replace(mechanism, bodies=wheels, couplings=(replace(mechanism.couplings[0], law=law),))
    angle, rate = np.linspace(0.0, 7.5, 31), 1.3
    jets = np.array([law.jet(x) for x in angle])
    _, slope, bend = jets.T
    z = np.array([0.0, 0.0, 1.0])
    q = np.array([angle, jets[:, 0]]).T
    quats = np.array([[quaternion_from_rotation_vector(x * z) for x in both] for both in q])
    w = np.stack([np.full(31, rate), slope * rate], axis=1)[:, :, None] * z
    answer = TrajectoryAnswer(
        np.linspace(0.0, 1.0, 31),
        np.tile([[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], (31, 1, 1)),
        quats,
        np.zeros((31, 2, 3)),
        w,
    )
    alpha = (6.0 - 100.0 * slope * bend * rate**2) / (10.0 + 50.0 * 0.2**2 + 100.0 * slope**2)
    expected = 50.0 * 0.2 * np.hypot(alpha, rate**2)
    found = reactions_over_time(mechanism, answer, np.array([0, 14, 30]))
    assert found[:, 0, 0] == pytest.approx(expected[[0, 14, 30]], rel=1e-12)
    assert np.max(found[:, 1]) < 1e-12
    assert np.max(found[:, 0, 1]) < 1e-12


def test_a_body_off_its_joint_drifts_by_as_much():
    mechanism, _, answer = hinged()
    off = answer.p_WB.copy()
    off[1] += [0.0, 0.0, 3e-4]
    along = mechanism.joints[0].F.R.T @ [0.0, 0.0, 3e-4]  # joint rows use the axes of F, here on the ground
    moved = TrajectoryAnswer(answer.time, off, answer.quat_WB, answer.v_WB_W, answer.w_WB_W)
    assert drift_over_time(mechanism, moved, np.array([0, 1])) == pytest.approx([0.0, np.max(np.abs(along))], abs=1e-12)


def runs_of(case, answer):
    """Return the runs of an engine at two matched levels and one at its defaults, and of the reference."""

    def run(engine, name, step, shift, profile=Profile.MATCHED):
        moved = answer.p_WB + np.linspace(0.0, shift, len(answer.time))[:, None, None]
        own = TrajectoryAnswer(answer.time, moved, answer.quat_WB, answer.v_WB_W, answer.w_WB_W)
        method = Method(name, Route.NATIVE, 4, (1, 2), profile=profile)
        return Run(case.name, engine, Question.TRAJECTORY, method, 0, step, Status.ANSWERED, own)

    return [
        run("reference", "descriptor", 1e-12, 0.0),
        run("e", "as it comes", 1e-5, 0.5, Profile.DEFAULT),
        run("e", "RK4", 0.02, 1e-2),
        run("e", "RK4", 0.01, 1e-3),
        run("e", "RK8", 0.005, 1e-6),
    ]


def test_an_engine_is_shown_by_its_first_matched_method_at_its_finest_level():
    case, _, _, answer = pendulum()
    found = replay_of(case, runs_of(case, answer))
    assert found["motion"]["engines"]["e"]["how"] == "RK4, step 0.01 s"
    assert found["motion"]["engines"]["e"]["away"] == pytest.approx(1e-3)
    assert found["seed"] == case.seed
    own = found["along"]["engines"]["e"]["drift"]
    assert len(own) == len(found["along"]["drift_times"])
    assert (own[0], own[1]) == (pytest.approx(0.0, abs=1e-12), pytest.approx(1e-3, rel=1e-2))
    assert replay_of(case, [])["motion"] is None


def test_the_violation_of_joints_is_drawn_at_more_samples_than_reactions():
    case, _, _, answer = pendulum()
    times = np.linspace(0.0, 1.0, 901)
    long = TrajectoryAnswer(times, *(np.repeat(v[:1], 901, axis=0) for v in vars(answer).values() if np.ndim(v) == 3))
    along = replay_of(case, runs_of(case, long))["along"]
    assert len(along["times"]) == 31
    assert np.diff(along["drift_times"]) == pytest.approx(3.0 / 900.0, rel=1e-3)
    figure = drift(along, ["reference", "e"])
    assert all(len(trace["x"]) == len(trace["y"]) == 301 for trace in figure["data"])


@pytest.fixture
def folder(tmp_path):
    case, _, _, answer = pendulum()
    (tmp_path / NAME).write_text(replays([case], runs_of(case, answer)), encoding="utf-8")
    return tmp_path


def test_replays_come_back_and_are_packed_into_the_page(folder):
    case, *_ = pendulum()
    found = read_replay(folder)
    assert list(found) == [case.name]
    header, described, *_ = lines(Results([case], []), 0.0)
    text = render_html(Record(header, [described], [], [], [], {"exit_code": 0}), found)
    assert 'id="replays"' in text
    assert read_replay(folder / "elsewhere") == {}


def test_a_joint_has_a_page_of_its_coordinates_rates_and_reactions():
    case, _, _, answer = pendulum("double_pendulum")
    replays_ = {case.name: replay_of(case, runs_of(case, answer))}
    header, described, *_ = lines(Results([case], [], engines={"e": EngineInfo("e", "1", "1")}), 0.0)
    record = Record(header, [described], [], [], [], {"exit_code": 0})
    drawings, joint = replay_figures(record, replays_), case.mechanism.joints[0].name
    place = f"joint.{case.name}.{joint}"
    pages = dict(fragments(page(record), replays_, set(drawings)))
    assert f'href="#{place}"' in pages[f"case.{case.name}"]
    assert f'data-figure="{place}"' in pages[place]
    layout = drawings[place]["layout"]
    assert [a["text"] for a in layout["annotations"]] == ["angle", "rate of angle", "reaction force", "reaction torque"]
    units = [layout[axis]["title"]["text"] for axis in ("yaxis", "yaxis2", "yaxis3", "yaxis4")]
    assert units == ["rad", "rad/s", "N", "N m"]
    (angle,) = [t for t in drawings[place]["data"] if t["yaxis"] == "y"]
    assert angle["y"] == drawings[f"coordinates.{case.name}"]["data"][0]["y"]


def test_a_case_called_engine_does_not_hide_the_page_of_an_engine():
    case = replace(load_case("engine"), name="engine")
    asked = Results([case], [], engines={"dart": EngineInfo("dart", "1", "1")})
    header, described, *_ = lines(asked, 0.0)
    view = page(Record(header, [described], [], [], [], {"exit_code": 0}))
    anchors = [anchor for anchor, _ in fragments(view, {}, set())]
    assert len(set(anchors)) == len(anchors)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: one["motion"]["reference"].update(p="AAAA"), "another number of values"),
        (lambda one: one["motion"]["reference"].update(quat="<b>"), "no base64"),
        (lambda one: one["scene"]["joints"][0].update(body=7), "not there"),
        (lambda one: one["along"]["engines"]["e"]["drift"].append(0.0), "not as many as their times"),
        (lambda one: one["scene"]["gravity"].append(1.0), "at most 3 items"),
        (lambda one: one["curves"][0]["values"][0].pop(), "not as many as times"),
        (lambda one: one["curves"][0]["open"].pop(), "not as many as names"),
    ],
)
def test_a_replay_that_was_tampered_with_is_refused(folder, change, said):
    raw = json.loads((folder / NAME).read_text(encoding="utf-8"))
    change(raw["cases"][0])
    (folder / NAME).write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(InvalidInput, match=said):
        read_replay(folder)


def test_one_case_in_motion_is_a_page_of_its_own():
    case, _, _, answer = pendulum()
    text = render_replay(case.name, "<b>title</b>", motion_alone(case, answer, "descriptor"))
    assert "&lt;b&gt;title" in text
    assert "default-src 'none'" in text
    assert "<svg" in text
    assert len(text) < 500_000


def test_findings_of_the_engines_are_all_rows_of_their_tables():
    tables = (Path(__file__).parents[2] / "reports" / "findings" / "README.md").read_text(encoding="utf-8")
    names = {found.name for engine in known_findings().values() for found in engine}
    assert names == set(re.findall(r"^\| \[(\w+)\]", tables, re.MULTILINE))
    assert set(known_findings()) == {"dart", "exudyn", "mujoco", "pinocchio"}
