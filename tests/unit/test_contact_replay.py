"""Contacts on pages: forces and points at frames, phases over time, strips of them on the pages of cells and joints."""

import json
from dataclasses import replace

import numpy as np
import pytest

from consilience.case import load_case
from consilience.engine import CONTACT_MODES, EVENT_KINDS, EngineInfo, Method, Question, Route, Run, Status, load_engine
from consilience.engine import TrajectoryAnswer as Answer
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    DryFriction,
    Frame,
    Initial,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    Stop,
    initial_state,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)
from consilience.report.contact_motion import contacts_at_frames, phases
from consilience.report.figure3d import figure_of
from consilience.report.html import fragments, render_replay
from consilience.report.motion import chosen_samples
from consilience.report.phase_strips import WIDTH, phase_chart
from consilience.report.record import Record, lines
from consilience.report.replay import replay_of, replay_of_motion, replays
from consilience.report.replayschema import NAME, read_replay
from consilience.report.view import page
from consilience.suite import Results

APART, SLIDES, STICKS = range(len(CONTACT_MODES))
TURN = np.array([0.4, -0.3, 0.9])
HALF = np.array([0.3, 0.2, 0.1])
CENTER = np.array([0.05, -0.02, 0.03])


def test_a_motion_with_stops_alone_has_no_contacts_to_show():
    case, engine = load_case("pendulum_at_a_stop"), load_engine("reference")
    method = engine.methods(case.mechanism, Question.TRAJECTORY)[0]
    answer = engine.trajectory(case.mechanism, case.initial_state, case.times, method, 1e-9)
    assert answer.contact_impulse is not None
    assert contacts_at_frames(case.mechanism, answer, chosen_samples(answer)) == []


def box_on_skew_plane(count=121, raised=0.25):
    """A box flat on a plane that no axis is along, lifted off it for the second half of its motion."""
    R = rotation_from_quaternion(quaternion_from_rotation_vector(TURN))
    body = Body("box", 2.0, np.array([0.01, 0.02, -0.03]), np.diag([0.03, 0.04, 0.05]), Frame(np.zeros(3), R))
    foot = BoxPlane("floor", "box", CENTER, HALF, GROUND, R @ (CENTER - [0.0, 0.0, 0.1]), R[:, 2], friction=0.5)
    flight = Joint("flight", "free", GROUND, "box", Frame(np.zeros(3), np.eye(3)), Frame(np.zeros(3), np.eye(3)))
    mechanism = Mechanism("boxed", np.array([0.0, 0.0, -9.81]), (body,), (flight,), contacts=(foot,))
    time = np.linspace(0.0, 2.4, count)
    away = np.where(time > 1.2, raised, 0.0)
    p = away[:, None, None] * R[:, 2]
    quats = np.tile(quaternion_from_rotation_vector(TURN), (count, 1, 1))
    force = np.where(time[:, None, None] > 1.2, 0.0, R @ [3.0, -1.0, 20.0])
    impulse = force * np.diff(time, prepend=0.0)[:, None, None]
    modes = np.where(time > 1.2, APART, np.where(time > 0.6, STICKS, SLIDES))[:, None]
    still = np.zeros_like(p)
    return mechanism, Answer(
        time, p, quats, still, still, contact_gap=away[:, None], contact_impulse=impulse, contact_mode=modes
    )


def test_forces_at_frames_are_impulses_over_time_at_the_middle_of_the_face_that_touches():
    """Two samples a frame: both impulses count. The face, its force and its normal are turned with the box."""
    mechanism, answer = box_on_skew_plane()
    R = rotation_from_quaternion(quaternion_from_rotation_vector(TURN))
    (found,) = contacts_at_frames(mechanism, answer, chosen_samples(answer))
    assert len(found["force"]) == 61
    middle = R @ (CENTER - [0.0, 0.0, HALF[2]])
    for frame in (0, 12, 30):
        assert found["force"][frame] == pytest.approx(R @ [3.0, -1.0, 20.0], rel=1e-4)
        assert found["body"][frame] == pytest.approx(middle, abs=1e-5)
    assert found["force"][40] == [0.0, 0.0, 0.0]
    assert found["gap"][40] == pytest.approx(0.25)
    assert np.subtract(found["body"][40], found["partner"][40]) == pytest.approx(0.25 * R[:, 2], abs=1e-4)
    assert [found["mode"][frame] for frame in (5, 20, 40)] == ["sliding", "sticking", "separated"]


def event(kinds):
    """Return fields of events of time, index and kind."""
    times, where, what = zip(*kinds, strict=True)
    kinds = np.array([EVENT_KINDS.index(kind) for kind in what])
    return {"event_time": np.array(times), "event_contact": np.array(where), "event_kind": kinds}


def test_phases_change_at_events_and_without_events_at_the_sample_that_shows_the_change():
    mechanism, answer = box_on_skew_plane()
    told = replace(
        answer, **event([(0.0, 0, "impact"), (0.605, 0, "impact"), (0.61, 0, "sticks"), (1.215, 0, "opens")])
    )
    (found,) = phases(mechanism, told)
    assert found["pieces"] == [[0.0, 0.61, "sliding"], [0.61, 1.215, "sticking"], [1.215, 2.4, "separated"]]
    assert found["impacts"] == [0.0, 0.605]
    (found,) = phases(mechanism, answer)
    assert [piece[0] for piece in found["pieces"]] == pytest.approx([0.0, 0.62, 1.22])
    assert phases(mechanism, replace(answer, contact_mode=None)) == []


def test_phases_of_stops_and_dry_frictions_are_told_by_their_events():
    """The state before the first event is the one that the event ends; what has no event is left out."""
    mechanism, answer = box_on_skew_plane()
    hinge = replace(mechanism.joints[0], name="hinge", kind="revolute")
    acting = {
        "stops": (Stop("stop", "hinge", "angle", lower=-1.0), Stop("far", "hinge", "angle", upper=9.0)),
        "dry_frictions": (DryFriction("pin", "hinge", "angle", bound=1.0),),
    }
    held = replace(mechanism, contacts=(), joints=(hinge,), **acting)
    events = [(0.3, 0, "impact"), (0.5, 0, "bounces end"), (0.7, 2, "sticks"), (1.0, 0, "opens"), (1.1, 2, "slips")]
    moved = replace(answer, contact_mode=None, contact_impulse=None, contact_gap=None, **event(events))
    stop, pin = phases(held, moved)
    assert stop["pieces"] == [[0.0, 0.5, "separated"], [0.5, 1.0, "closed"], [1.0, 2.4, "separated"]]
    assert (stop["impacts"], stop["joint"]) == ([0.3], "hinge")
    assert pin["pieces"] == [[0.0, 0.7, "sliding"], [0.7, 1.1, "sticking"], [1.1, 2.4, "sliding"]]


def test_phases_between_two_samples_are_those_of_the_events():
    """Samples at 0.58 and 0.60 s slide, at 0.62 s sticks; at 1.20 s it sticks, at 1.22 and 1.24 s it is apart."""
    mechanism, answer = box_on_skew_plane()
    grips = [(0.585, 0, "sticks"), (0.59, 0, "slips"), (0.61, 0, "sticks")]
    hops = [(1.205, 0, "opens"), (1.225, 0, "impact"), (1.23, 0, "impact"), (1.232, 0, "slips"), (1.235, 0, "opens")]
    (found,) = phases(mechanism, replace(answer, **event([*grips, *hops])))
    assert [tuple(piece) for piece in found["pieces"]] == [
        (0.0, 0.585, "sliding"),
        (0.585, 0.59, "sticking"),
        (0.59, 0.61, "sliding"),
        (0.61, 1.205, "sticking"),
        (1.205, 1.23, "separated"),
        (1.23, 1.232, "sticking"),
        (1.232, 1.235, "sliding"),
        (1.235, 2.4, "separated"),
    ]
    touches = [(1.205, 0, "opens"), (1.225, 0, "closes"), (1.235, 0, "opens")]
    (found,) = phases(mechanism, replace(answer, **event(touches)))
    assert [1.225, 1.235, "closed"] in found["pieces"]


@pytest.mark.parametrize(
    ("name", "element", "changes", "modes"),
    [
        # half-periods of pi/sqrt(k/m) about the edges of the dead band; the sixth ends within it
        ("dry_spring", "guide", [6.0 * np.pi / np.sqrt(50.0)], ["sliding", "sticking"]),
        ("bead_on_turning_rod-inward", "fit", [], ["sliding"]),  # it turns back without rest
        # 0.5 = 3 t - M t^2/(2 I), M = 0.2 N m, I = 0.926311 kg m^2 about the hinge; no rebound, and the bearing holds
        ("wheel_caught_by_stop", "stops", [0.1676784], ["separated", "closed"]),
        ("pendulum_at_a_stop", "stop", [], ["separated"]),
    ],
)
def test_phases_of_joints_that_move_at_the_start_or_are_caught_by_a_stop(name, element, changes, modes):
    case, engine = load_case(name), load_engine("reference")
    method = engine.methods(case.mechanism, Question.TRAJECTORY)[0]
    answer = engine.trajectory(case.mechanism, case.initial_state, case.times, method, 1e-10)
    (own,) = [one for one in phases(case.mechanism, answer) if one["name"] == element]
    assert [mode for *_, mode in own["pieces"]] == modes
    assert [a for a, *_ in own["pieces"]] == pytest.approx([0.0, *changes], abs=1e-6)


def test_strips_are_proportional_to_time_and_say_the_same_in_words():
    mechanism, answer = box_on_skew_plane()
    told = replace(answer, **event([(0.6, 0, "impact"), (0.61, 0, "sticks"), (1.215, 0, "opens")]))
    chart = phase_chart({"reference": phases(mechanism, told), "e": phases(mechanism, answer)}, ["e"])
    ((name, (own, other)),) = chart.groups
    assert (name, own.engine, other.engine) == ("floor", "reference", "e")
    assert own.pieces[1][:3] == (
        pytest.approx(WIDTH * 0.61 / 2.4, abs=0.01),
        pytest.approx(252.09, abs=0.02),
        "sticking",
    )
    assert own.impacts == (pytest.approx(WIDTH / 4),)
    assert own.words == "sliding to 0.61 s, sticking to 1.215 s, then separated; an impact at 0.6 s"
    assert [label for _, label in chart.ticks] == ["0", "0.5", "1", "1.5", "2"]
    assert [place for place, _ in chart.ticks] == pytest.approx([100.0 * k / 4.8 for k in range(5)])


def test_what_is_apart_throughout_on_all_engines_is_named_without_strips():
    far, near = ({"name": name, "pieces": [[0.0, 2.4, "separated"]], "impacts": []} for name in ("far", "near"))
    touches = near | {"pieces": [[0.0, 1.2, "separated"], [1.2, 2.4, "sliding"]]}
    chart = phase_chart({"reference": [far, near], "e": [far, touches]}, ["e"])
    assert [(name, len(strips)) for name, strips in chart.groups] == [("near", 2)]
    assert chart.apart == ("far",)
    assert phase_chart({"reference": [near | {"impacts": [0.5]}]}, []).apart == ()


@pytest.fixture
def moving():
    """A case with the contact, its runs by the reference and two engines, of which one tells no modes."""
    mechanism, answer = box_on_skew_plane()
    case = replace(load_case("ball_slips"), name="boxed", mechanism=mechanism, initial=Initial())
    method = Method("RK4", Route.NATIVE, 4, (1,))
    answers = {"reference": answer, "e": answer, "mute": replace(answer, contact_mode=None)}
    return case, [
        Run("boxed", engine, Question.TRAJECTORY, method, 0, 0.02, Status.ANSWERED, own)
        for engine, own in answers.items()
    ]


def test_a_cell_shows_the_reference_and_its_own_engine_and_a_joint_what_touches_its_bodies(moving, tmp_path):
    case, runs = moving
    (tmp_path / NAME).write_text(replays([case], runs), encoding="utf-8")
    found = read_replay(tmp_path)
    assert found["boxed"]["motion"]["contacts"] == replay_of(case, runs)["motion"]["contacts"]
    engines = {name: EngineInfo(name, "1", "1") for name in ("e", "mute")}
    header, described, *_ = lines(Results([case], [], engines=engines), 0.0)
    record = Record(header, [described], [], [], [], {"exit_code": 0})
    pages = dict(fragments(page(record), found, {"joint.boxed.flight"}))

    def strips(place):
        return [name for name in ("reference", "e", "mute") if f'aria-label="floor, {name}: sliding to' in pages[place]]

    assert strips("case.boxed") == ["reference", "e"]
    assert strips("boxed.e") == ["reference", "e"]
    assert strips("boxed.mute") == ["reference"]
    assert strips("joint.boxed.flight") == ["reference", "e"]


def test_a_replay_with_too_few_forces_is_refused(moving, tmp_path):
    raw = json.loads(replays([moving[0]], moving[1]))
    raw["cases"][0]["motion"]["contacts"][0]["force"].pop()
    (tmp_path / NAME).write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(InvalidInput, match="not as many as frames"):
        read_replay(tmp_path)


def test_one_motion_with_contact_is_a_page_with_its_phases():
    mechanism, answer = box_on_skew_plane()
    text = render_replay("boxed", "boxed", replay_of_motion(mechanism, answer.state(0), answer))
    assert 'aria-label="floor, reference: sliding to 0.62 s, sticking to 1.22 s, then separated"' in text


def test_a_body_that_touches_at_points_is_drawn_to_these_points():
    mechanism, answer = box_on_skew_plane()
    (floor,), corners = mechanism.contacts, np.array([[0.3, 0.0, -0.1], [-0.2, 0.25, -0.1], [-0.2, -0.25, -0.1]])
    feet = [PointPlane(f"foot {k}", "box", c, GROUND, floor.point, floor.normal) for k, c in enumerate(corners)]
    drawn = figure_of(replace(mechanism, contacts=tuple(feet)), answer.state(0))
    points = np.vstack([line.points for line in drawn.lines if line.kind == "body"])
    R = rotation_from_quaternion(quaternion_from_rotation_vector(TURN))
    for corner in corners:
        assert np.min(np.linalg.norm(points - R @ corner, axis=1)) < 1e-12


def test_the_figure_of_a_pendulum_reaches_the_sphere_at_its_end():
    """The rod is 1 m long, its centre of mass half way; a ball that flies has no line from its centre."""
    z, here = np.array([0.0, 0.0, 1.0]), Frame(np.zeros(3), np.eye(3))
    rod, ball = (Body(name, 1.0, com, 0.1 * np.eye(3), here) for name, com in (("rod", -0.5 * z), ("ball", 0.0 * z)))
    pin, flight = (
        Joint("pin", "revolute", GROUND, "rod", here, here),
        Joint("flight", "free", GROUND, "ball", here, here),
    )
    tip = SpherePlane("tip", "rod", -z, 0.1, GROUND, -2.0 * z, z)
    for contact in (tip, SphereSphere("tip", "ball", np.zeros(3), 0.1, "rod", -z, 0.1)):
        mechanism = Mechanism("pair", -9.81 * z, (rod, ball), (pin, flight), contacts=(contact,))
        drawn = figure_of(mechanism, initial_state(mechanism))
        (line,) = [line.points for line in drawn.lines if line.kind == "body" and line.body == 0]
        assert line == pytest.approx(np.array([0.0 * z, -z]), abs=1e-12)
        assert not [line for line in drawn.lines if line.kind == "body" and line.body == 1]
