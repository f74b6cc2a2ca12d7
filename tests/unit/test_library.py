"""The library as users meet it: mechanisms drawn part by part, motions by name, agreement as a table."""

import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import consilience as cs
from consilience.case.file.schema import CaseTable
from consilience.errors import InvalidInput
from consilience.mechanism import joint_coordinates, quaternion_from_rotation, relative_motion
from consilience.reference import simulate
from mechanisms import LOOPS, chain, rotation, states_of

RNG = np.random.default_rng(5)


def double_pendulum():
    draw = cs.Drawing("double_pendulum", gravity=(0, 0, -9.81))
    draw.body("upper", cs.bar((0, 0, 0), (0.3, 0, -1), radius=0.02), density=7850)
    draw.body("lower", cs.bar((0.3, 0, -1), (0, 0.4, -2), radius=0.03), mass=3.0)
    draw.joint("shoulder", "revolute", "ground", "upper", at=(0, 0, 0), axis=(0, 1, 0))
    draw.joint("elbow", "universal", "upper", "lower", at=(0.3, 0, -1), axis=(0, 1, 0), second_axis=(1, 0, 0))
    return draw


# ---------------------------------------------------------------- solids


def lattice(inside, low, high, count=120):
    """Volume, centre of mass and inertia of the points of a lattice that lie inside."""
    axes = [np.linspace(a, b, count, endpoint=False) + (b - a) / (2 * count) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[inside(points)]
    volume = len(points) * np.prod((np.array(high) - low) / count)
    com = points.mean(axis=0)
    d = points - com
    tensor = np.sum(d * d) * np.eye(3) - d.T @ d
    return volume, com, tensor * volume / len(points)


def test_a_skew_bar_has_the_volume_and_inertia_of_its_points():
    start, end, radius = np.array([0.2, -0.1, 0.4]), np.array([-0.5, 0.6, 1.1]), 0.25
    length, axis = np.linalg.norm(end - start), (end - start) / np.linalg.norm(end - start)

    def inside(points):
        along = (points - start) @ axis
        across = np.linalg.norm(points - start - along[:, None] * axis, axis=1)
        return (along >= 0) & (along <= length) & (across <= radius)

    low, high = np.minimum(start, end) - radius, np.maximum(start, end) + radius
    volume, com, tensor = lattice(inside, low, high)
    solid = cs.bar(start, end, radius)
    assert solid.volume == pytest.approx(volume, rel=5e-3)
    assert solid.com == pytest.approx(com, abs=5e-3)
    assert solid.second_moment == pytest.approx(tensor, abs=1e-2 * np.max(tensor))


def test_a_ball_has_the_volume_and_inertia_of_its_points():
    volume, com, tensor = lattice(
        lambda p: np.linalg.norm(p - [1.0, 2.0, 3.0], axis=1) <= 0.5, [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]
    )
    solid = cs.ball(0.5, at=(1, 2, 3))
    assert solid.volume == pytest.approx(volume, rel=5e-3)
    assert solid.com == pytest.approx(com, abs=1e-6)
    assert solid.second_moment == pytest.approx(tensor, rel=5e-3, abs=1e-6)


def test_two_halves_of_a_block_are_the_block():
    whole = cs.block((2.0, 0.6, 0.8), at=(1, 2, 3))
    halves = cs.block((1.0, 0.6, 0.8), at=(0.5, 2, 3)) + cs.block((1.0, 0.6, 0.8), at=(1.5, 2, 3))
    for name in ("volume", "com", "second_moment"):
        assert getattr(halves, name) == pytest.approx(getattr(whole, name), rel=1e-14)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: cs.bar((0, 0, 0), (0, 0, 0), 0.1), "the ends coincide"),
        (lambda: cs.ball(-1.0), "not positive"),
        (lambda: cs.block((1, 2)), "shape"),
        (lambda: cs.ball(1.0).mass_properties(), "neither mass nor density"),
        (lambda: cs.ball(1.0).mass_properties(mass=1.0, density=1.0), "both given"),
        (lambda: cs.ball(1.0).mass_properties(mass=0.0), "mass: 0.0 is not positive"),
    ],
)
def test_what_is_no_solid_is_refused(make, words):
    with pytest.raises(InvalidInput, match=words):
        make()


# ---------------------------------------------------------------- drawings


def test_a_drawn_mechanism_is_the_one_that_its_file_says(tmp_path):
    """Drawn, saved, loaded: the same numbers bit by bit; orientations by matrix, quaternion or frame alike."""
    R = rotation(RNG)
    inertia = R @ np.diag([0.2, 0.3, 0.4]) @ R.T
    inertia = (inertia + inertia.T) / 2.0
    q, p = quaternion_from_rotation(R), np.array([0.1, 0.2, 0.3])
    poses = (cs.frame(p, R), cs.frame(p, q), cs.Frame(p, R))
    made = []
    for pose in poses:
        draw = cs.Drawing("one", gravity=(1.0, 2.0, 3.0))
        draw.body("a", mass=2.0, com=(0.1, 0, 0), inertia=inertia, at=pose)
        draw.joint("j", "screw", "ground", "a", at=p, axis=R[:, 1], pitch=0.1)
        draw.add("joint_spring", "s", joint="j", coordinate="angle", stiffness=3.0, damping=0.2, rest=0.1)
        made.append(draw.case(start={"j": 0.3}, rates={"j": -0.2}, duration=1.0, sample=0.1))
    for case in made:
        (body,) = case.mechanism.bodies
        assert np.allclose(body.drawing.R, R, atol=1e-15)
        assert np.allclose(body.inertia, inertia, atol=0.0)
        assert np.allclose(case.mechanism.joints[0].F.R[:, 2], R[:, 1], atol=1e-15)
    read = cs.load_case(cs.save_case(made[0], tmp_path / "one.toml"))
    for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
        assert np.allclose(getattr(read.initial_state, name), getattr(made[0].initial_state, name), atol=1e-14)
    angle = joint_coordinates(
        read.mechanism.joints[0], relative_motion(read.mechanism, read.initial_state, read.mechanism.joints[0])
    )
    assert angle["angle"] == pytest.approx(0.3, abs=1e-13)


@pytest.mark.slow
def test_what_is_drawn_built_saved_and_loaded_is_one_case_with_the_same_answers(tmp_path):
    """One digest, of what is asked; the answers of an engine and of the reference are the same to the last bit."""
    drawn = double_pendulum().case(start={"shoulder": 0.4}, rates={"elbow": {"angle1": 0.3}}, duration=0.1)
    built = cs.Case.of(drawn.mechanism, drawn.initial, duration=0.1, sample=drawn.sample)
    loaded = [cs.load_case(cs.save_case(case, tmp_path / f"{n}.toml")) for n, case in enumerate((drawn, built))]
    cases = [drawn, built, *loaded]
    assert {case.digest for case in cases} == {drawn.digest}
    others = double_pendulum().case(), drawn.with_span(0.2, None), replace(drawn, instants=3)
    assert len({drawn.digest, *(case.digest for case in others)}) == 4
    answers = [
        [run.answer for run in cs.compare(case, ["mujoco"], [cs.Question.INSTANT]).results.runs] for case in cases
    ]
    for name in ("a_WB_W", "alpha_WB_W", "force_F", "kinetic"):
        found = [[getattr(answer, name) for answer in own] for own in answers]
        assert all(np.array_equal(own, found[0]) for own in found)


def test_a_drawn_drive_is_the_function_or_its_table():
    motions = (cs.sine(0.5, 4.0), {"harmonics": [[0.5, 4.0, 0.0]]})
    driven = []
    for motion in motions:
        draw = double_pendulum()
        draw.add("drive", "motor", joint="shoulder", coordinate="angle", motion=motion)
        driven.append(draw.mechanism().drives[0].motion.at(0.3))
    expected = (0.5 * np.sin(1.2), 2.0 * np.cos(1.2), -8.0 * np.sin(1.2))
    assert [np.ravel(found) for found in driven] == [pytest.approx(expected, abs=1e-14)] * 2


def test_a_joint_is_drawn_at_a_place_or_by_its_frames(tmp_path):
    """Frames that are apart in the drawing are those of `Joint`, and keep all digits in a file."""
    F, M = (cs.Frame(RNG.normal(size=3), rotation(RNG)) for _ in range(2))
    draw = cs.Drawing("apart", gravity=(0, 0, -9.81))
    draw.body("b", cs.block((0.1, 0.2, 0.3)), mass=2.0, at=cs.frame((0.1, 0, 0), rotation(RNG)))
    draw.joint("j", "revolute", "ground", "b", F=F, M=M)
    mechanism = draw.mechanism()
    for made in (mechanism, cs.load_case(mechanism.save(tmp_path / "apart.toml")).mechanism):
        for frame, given in ((made.joints[0].F, F), (made.joints[0].M, M)):
            assert np.array_equal(frame.p, given.p)
            assert np.array_equal(frame.R, given.R)


def test_inertia_by_three_numbers_six_or_the_tensor_is_the_same():
    tensors = []
    for given in ([0.2, 0.3, 0.4], [0.2, 0.3, 0.4, 0.0, 0.0, 0.0], np.diag([0.2, 0.3, 0.4])):
        draw = cs.Drawing("one", gravity=(0, 0, 0))
        draw.body("a", mass=1.0, inertia=given)
        draw.joint("j", "free", "ground", "a", at=(0, 0, 0))
        tensors.append(draw.mechanism().bodies[0].inertia)
        tensors.append(cs.Body("a", 1.0, com=(0, 0, 0), inertia=given, drawing=cs.frame((0, 0, 0))).inertia)
    assert np.array_equal(tensors[0], np.diag([0.2, 0.3, 0.4]))
    assert all(np.array_equal(tensors[0], other) for other in tensors)


def test_an_orientation_and_its_rate_are_given_alike_everywhere(tmp_path):
    """Drawn, as `Initial` and in a file: a matrix is its quaternion, `angular_velocity` is the rate."""
    R, w = rotation(RNG), (0.3, -0.2, 0.5)
    draw = cs.Drawing("ball", gravity=(0, 0, -9.81))
    draw.body("b", cs.block((0.1, 0.2, 0.3), at=(0.1, 0, 0)), mass=2.0)
    draw.joint("j", "spherical", "ground", "b", at=(0, 0, 0))
    cases = [draw.case(start={"j": q}, rates={"j": w}) for q in (R, quaternion_from_rotation(R))]
    cases.append(draw.case(start={"j": {"orientation": R}}, rates={"j": {"angular_velocity": w}}))
    for q in (R, quaternion_from_rotation(R)):
        initial = cs.Initial({"j": {"orientation": q}}, {"j": {"angular_velocity": w}})
        cases.append(cs.Case.of(draw.mechanism(), initial))
        cases.append(cs.load_case(cs.save_case(cases[-1], tmp_path / "ball.toml")))
    frame = cases[0].mechanism.joints[0].F.R
    for case in cases:
        assert np.allclose(case.initial_state.R_WB[0], frame @ R @ frame.T, atol=1e-12)
        assert np.allclose(case.initial_state.w_WB_W[0], frame @ w, atol=1e-12)


def wrong(change):
    draw = double_pendulum()
    change(draw)
    return draw.case()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.body("x", mass=1.0), "body 'x': inertia: it is missing"),
        (lambda d: d.body("x", inertia=[1, 1, 1]), "body 'x': mass: it is missing"),
        (lambda d: d.body("x", mass=1.0, inertia=[1, 1]), r"body 'x': inertia: shape \(2,\)"),
        (lambda d: d.body("x", mass=1.0, inertia=np.array([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]])), "not symmetric"),
        (lambda d: d.body("x", cs.ball(1.0), inertia=[1, 1, 1]), "the solid has it"),
        (lambda d: d.body("x", mass=1.0, inertia=[1, 1, 1], at=(0, 0)), "frame: p: shape"),
        (lambda d: d.body("x", mass=1.0, inertia=[1, 1, 1], at=cs.frame((0, 0, 0), [1, 0, 0])), "a quaternion"),
        (lambda d: d.body("x", mass=1.0, inertia=[1, 1, 1], at=cs.frame((0, 0, 0), [2, 0, 0, 0])), "has norm 2"),
        (lambda d: d.joint("x", "hinge", "upper", "lower", at=(0, 0, 0)), "'hinge' is not a joint kind"),
        (lambda d: d.joint("x", "revolute", "upper", "lower", at=(0, 0, 0)), "joint 'x': axis: the field is missing"),
        (lambda d: d.add("motor", "x", joint="elbow"), "'motor' is no kind of element"),
        (lambda d: d.add("spring", "x", stiff=3.0), "spring 'x'"),
        (lambda d: d.case(start={"knee": 0.1}), "joint 'knee': it is not drawn"),
        (lambda d: d.case(start={"elbow": 0.1}), "has 2 coordinates. Name them: angle1, angle2"),
        (cs.Case.of, "a Drawing, not a Mechanism. Give a Mechanism: .* draw.mechanism()"),
        (lambda d: cs.save_case(d, "no.toml"), "a Drawing, not a Mechanism"),
        (lambda d: cs.Case.of(d.mechanism(), {"elbow": 0.1}), "a dict, not an Initial"),
        (lambda d: cs.Case.of(d.mechanism(), duration=1.0, sample=0.3), "1 s and 0.3 s. Give a positive sample that"),
        (lambda d: cs.Case.of(d.mechanism(), sample=0.0), "sample: 0 is out of range. Give a time above zero"),
    ],
)
def test_a_mistake_names_part_and_field(change, words):
    with pytest.raises(InvalidInput, match=words):
        wrong(change)


def test_every_table_of_elements_of_a_case_file_can_be_drawn():
    named = {name for name, field in CaseTable.model_fields.items() if "list[" in str(field) and "Table" in str(field)}
    for element in named - {"body", "joint", "published"}:
        with pytest.raises(InvalidInput, match=element.replace("_", ".")):  # known, and its fields are missing
            wrong(lambda d, element=element: d.add(element, "x"))


# ---------------------------------------------------------------- motions


@pytest.fixture(scope="module")
def motion():
    case = double_pendulum().case(
        start={"shoulder": 2.5, "elbow": {"angle2": 0.4}}, rates={"shoulder": 3.0}, duration=2.0
    )
    return case, cs.simulate(case)


def test_a_motion_begins_as_asked_and_conserves_energy(motion):
    case, found = motion
    assert found.coordinates("shoulder")[0] == pytest.approx(2.5, abs=1e-12)
    assert found.coordinates("elbow", "angle2")[0] == pytest.approx(0.4, abs=1e-12)
    assert found.rates("shoulder")[0] == pytest.approx(3.0, abs=1e-12)
    total = found.energy()["total"]
    assert np.ptp(total) < 1e-9 * np.max(found.energy()["kinetic"])
    assert found.time == pytest.approx(case.times)


def test_coordinates_count_turns_and_their_rates_are_their_derivatives(motion):
    _, found = motion
    fine = cs.simulate(motion[0], times=np.linspace(0.0, 0.1, 401))
    for names in (("shoulder",), ("elbow", "angle1"), ("elbow", "angle2")):
        slopes = np.gradient(fine.coordinates(*names), fine.time, edge_order=2)
        assert slopes == pytest.approx(fine.rates(*names), abs=1e-5)
    turning = replace(motion[0], duration=3.0)
    draw = cs.Drawing("wheel", gravity=(0, 0, 0))
    draw.body("w", cs.ball(0.5), mass=1.0)
    draw.joint("j", "revolute", "ground", "w", at=(0, 0, 0), axis=(0, 0, 1))
    wheel = cs.simulate(draw.case(rates={"j": 10.0}, duration=turning.duration))
    assert wheel.coordinates("j") == pytest.approx(10.0 * wheel.time, abs=1e-9)
    assert len(found.coordinates("shoulder")) == len(found.time)


def test_reactions_are_those_of_the_reference(motion):
    """Two independent solutions: dense least norm along the motion, and the descriptor form at its states."""
    case, found = motion
    for joint, index in case.mechanism.joint_index.items():
        answer = cs.accelerations(case.mechanism, [found.state(k) for k in (0, 20)])
        told = np.hstack([answer.force_F[:, index], answer.torque_F[:, index]])
        assert found.reactions(joint)[[0, 20]] == pytest.approx(told, abs=1e-9 * np.max(np.abs(told)))
        assert np.array_equal(found.reactions()[:, index], found.reactions(joint))


def test_the_default_form_is_the_fast_one_and_any_other_agrees():
    mechanism = LOOPS["four_bar"]
    (state,) = states_of(mechanism, 1)
    times = np.linspace(0.0, 0.3, 4)
    fast, dense = cs.simulate(mechanism, state, times), cs.simulate(mechanism, state, times, formulation="descriptor")
    assert fast.p_WB == pytest.approx(dense.p_WB, abs=1e-10)
    named = cs.simulate(mechanism, state, times, formulation="relative")
    assert np.array_equal(fast.p_WB, named.p_WB)
    assert fast.counters == named.counters != dense.counters


def test_motions_mechanisms_and_results_show_themselves(motion, tmp_path):
    case, found = motion
    assert repr(found) == "Simulation of 'double_pendulum': 2 bodies, 41 samples from 0 to 2 s"
    assert repr(case.mechanism) == "Mechanism 'double_pendulum': 2 bodies, 2 joints"
    assert repr(case) == "Case 'double_pendulum': 2 bodies, 2 joints, 41 samples over 2 s"
    assert repr(double_pendulum()) == "Drawing 'double_pendulum': 2 bodies, 2 joints, 0 elements"
    parts = (case.initial_state, case.mechanism.bodies[0], case.mechanism.joints[0], cs.ball(1.0))
    answers = (cs.accelerations(case.mechanism, case.states), simulate(case.mechanism, case.initial_state, case.times))
    assert all(len(repr(shown)) < 80 for shown in (*parts, *answers))
    assert cs.Drawing("empty", gravity=(0, 0, 0))._repr_html_() is None
    drawings = [shown._repr_html_() for shown in (found, case, case.mechanism, double_pendulum())]
    assert all("<svg" in drawn for drawn in drawings)
    assert drawings[2] == drawings[3] != drawings[1]  # in the drawing; at the start
    assert found.plot()._repr_png_().startswith(b"\x89PNG")  # shown without pyplot, too
    assert found.plot().axes[0].get_ylabel() == "shoulder: angle [rad]"
    assert len(found.plot().axes) == 3
    page = found.animate()
    assert page.save(tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert "<iframe srcdoc=" in page._repr_html_()
    assert ' title="Mechanism in motion"' in page._repr_html_()  # a frame has a name for readers of screens
    assert len(repr(page)) < 80
    assert found.to_xarray().p_WB.shape == (41, 2, 3)
    for ask, words in (
        (lambda: found.coordinates("knee"), "there is no joint 'knee'"),
        (lambda: found.rates("elbow"), "angle1, angle2"),
    ):
        with pytest.raises(InvalidInput, match=words):
            ask()


def test_a_mechanism_without_times_is_no_motion():
    with pytest.raises(InvalidInput, match="times: they are missing"):
        cs.simulate(double_pendulum().mechanism())


def test_a_drawing_moves_as_its_case_does_and_one_state_is_a_list_of_one():
    draw = double_pendulum()
    case = draw.case()
    assert np.array_equal(cs.simulate(draw).p_WB, cs.simulate(case).p_WB)
    one, listed = (cs.accelerations(case.mechanism, s) for s in (case.initial_state, [case.initial_state]))
    assert one.a_WB_W.shape == (1, 2, 3)
    others = cs.accelerations(draw), cs.accelerations(case), cs.accelerations(case, [case.initial_state])
    assert all(np.array_equal(one.a_WB_W, other.a_WB_W) for other in (listed, *others))
    released = draw.case(start={"shoulder": 0.4})
    assert np.array_equal(
        cs.accelerations(released).a_WB_W, cs.accelerations(released.mechanism, released.initial_state).a_WB_W
    )


# ---------------------------------------------------------------- agreement


def test_a_comparison_prints_as_a_table_and_saves_its_report(tmp_path):
    case = chain("revolute", seed=3)
    with pytest.raises(InvalidInput, match=r"engine 'mujco': it is not installed. Nearest: mujoco"):
        cs.compare(case, ["mujco"])
    found = cs.compare(case, ["mujoco"], [cs.Question.MODEL, cs.Question.INSTANT])
    lines = str(found).splitlines()
    assert lines[0].split() == ["case", "mujoco"]
    assert lines[2].startswith(f"{case.name}  ✓")
    assert repr(found) == str(found)
    assert "<td>" in found._repr_html_()
    assert found.save(tmp_path / "report").is_file()
    assert len(repr(found.results)) < 500
    assert all(len(repr(one)) < 100 for one in (*found.results.runs, *found.results.comparisons))


def test_names_of_the_library_are_listed_and_the_room_compare_can_be_called():
    code = """
import consilience as cs
listed = set(dir(cs))
assert {name for name in listed if not name.startswith("__")} == set(cs.__all__)
assert callable(cs.compare)
import consilience.compare as room
from consilience.compare import Verdict
assert room.Verdict is Verdict and cs.compare is room and callable(room)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


# ---------------------------------------------------------------- types


def test_the_script_that_mypy_checks_runs(tmp_path):
    """Strictly typed in the files of mypy (pyproject.toml): what a user's checker sees of the library."""
    script = runpy.run_path(str(Path(__file__).parents[1] / "typed" / "user.py"))
    case = script["pendulum"](1.0)
    found = script["answers"](case, tmp_path)
    # rod of length L about its end, radius r: I = m (L^2 / 3 + r^2 / 4), alpha = -m g (L / 2) sin(0.3) / I about +y
    inertia = 1.0 / 3.0 + 0.01**2 / 4.0
    assert found["acceleration"] == pytest.approx(-9.81 * 0.5 * np.sin(0.3) / inertia, rel=1e-12)
    assert found["angle"] == pytest.approx(found["of a state"], abs=1e-7)
    assert (found["bodies of a file"], found["failures"]) == (1.0, 0.0)
    assert all(path.is_file() for path in script["shown"](case, tmp_path))
    assert script["driven"](tmp_path).drives[0].motion.at(0.0)[1] == pytest.approx(2.0)
    assert "pendulum" in script["compared"](case.mechanism, tmp_path)


def test_accelerations_and_forces_of_a_block_that_slides_are_coulombs():
    """N = m g, and mu g against the velocity; the four shares of the load are open, their sum is the contact's."""
    draw = cs.Drawing("block", gravity=(0, 0, -9.81))
    draw.body("block", mass=2.0, inertia=(0.03, 0.03, 0.05), at=(0, 0, 0.1))
    draw.joint("flight", "free", "ground", "block", at=(0, 0, 0.1))
    box = {"body": "block", "at": (0, 0, 0.1), "half_sizes": (0.2, 0.2, 0.1), "point": (0, 0, 0), "normal": (0, 0, 1)}
    draw.add("contact", "floor", **box, friction=0.5)
    case = draw.case(rates={"flight": {"position": (3.0, 4.0, 0.0)}}, duration=0.1)
    for answer in (cs.accelerations(case), cs.accelerations(case.mechanism, [case.initial_state])):
        assert answer.a_WB_W[0, 0] == pytest.approx(0.5 * 9.81 * np.array([-0.6, -0.8, 0.0]), abs=1e-12)
        assert answer.contact_force[0, 0] == pytest.approx(2.0 * 9.81 * np.array([-0.3, -0.4, 1.0]), abs=1e-11)


@pytest.mark.parametrize("chosen", [{"formulation": "null_space"}, {"integrator": "radau13"}])
def test_a_motion_with_contacts_has_no_formulation_or_integrator_to_choose(chosen):
    with pytest.raises(InvalidInput, match="contact_instant"):
        cs.simulate(cs.load_case("box_tips"), **chosen)
