"""Nothing of one case ends another: cases that cannot be answered have marked cells, and all others their answers."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case
from consilience.compare import Verdict
from consilience.compare.judge import judge_case
from consilience.engine import Question, Status
from consilience.mechanism import (
    GROUND,
    Body,
    Coupling,
    Drive,
    Frame,
    Initial,
    Joint,
    Mechanism,
    Spring,
    linear,
    through,
)
from consilience.report.pages import write_pages
from consilience.report.record import read_record, write_record
from consilience.suite import run_suite
from mechanisms import chain, lumpy_body, rotation

EVERY = tuple(Question)


def case_of(name, mechanism, initial=None, **given):
    spans = {"duration": 0.5, "sample": 0.05, "digits": 8, "instants": 3, "seed": 1} | given
    return Case(name, f"{name}.toml", name, replace(mechanism, name=name), initial or Initial(), **spans)


def driven_hinge():
    """A lumpy body on a skew hinge whose drive turns it by 5 t."""
    mechanism = chain("revolute", seed=41)
    return case_of("driven", replace(mechanism, drives=(Drive("d", "j0", "angle", linear(5.0)),)))


def preloaded_frame():
    """Two bars on hinges and a ball joint between them, without freedom, and a stiff spring in the triangle."""
    turn = rotation(np.random.default_rng(42))

    def at(x, y, z):
        return turn @ np.array([x, y, z])

    body = lumpy_body("a", np.random.default_rng(43))
    a = Body("a", body.mass, turn.T @ at(0.3, 0.02, 0.3), body.inertia, Frame(at(0, 0, 0), turn))
    b = Body("b", body.mass, turn.T @ at(-0.3, 0.0, 0.31), body.inertia, Frame(at(1, 0, 0), turn))
    y = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]).T  # z of the frame along y of the body
    joints = (
        Joint("pa", "revolute", GROUND, "a", Frame(at(0, 0, 0), turn @ y), Frame(np.zeros(3), y)),
        Joint("pb", "revolute", GROUND, "b", Frame(at(1, 0, 0), turn @ y), Frame(np.zeros(3), y)),
        Joint("top", "spherical", "a", "b", Frame([0.5, 0, 0.7], np.eye(3)), Frame([-0.5, 0, 0.7], np.eye(3))),
    )
    tie = Spring("tie", "a", "b", np.array([0.2, 0, 0.3]), np.array([-0.2, 0, 0.35]), 1e8, 0.0, 0.55)
    return case_of("frame", Mechanism("frame", at(0, 0, -9.81), (a, b), joints, springs=(tie,)))


def spring_without_length():
    """A spring of some free length between two points that coincide at the start: its force has no direction."""
    mechanism = chain("revolute", seed=45)
    body = mechanism.bodies[0]
    spring = Spring("s", GROUND, "b0", body.drawing.p, np.zeros(3), 50.0, 0.1, 0.3)
    return case_of("point", replace(mechanism, springs=(spring,)))


def torn():
    """A hinge held where a drive does not hold it."""
    mechanism = chain("revolute", seed=44)
    driven = replace(mechanism, drives=(Drive("d", "j0", "angle", linear(1.0)),))
    return case_of("torn", driven, Initial({"j0": {"angle": 1.0}}))


def leaving():
    """A cam that turns out of its table after 0.3 s."""
    cam, guide = chain("revolute", seed=46), chain("prismatic", seed=47)
    x = np.linspace(-0.3, 0.3, 7)
    law = Coupling("cam", "j0", "angle", "guide", "distance", through(x, 0.1 * x**2))
    mechanism = Mechanism(
        "leaving",
        np.zeros(3),
        (*cam.bodies, replace(guide.bodies[0], name="follower")),
        (*cam.joints, replace(guide.joints[0], name="guide", successor="follower")),
        couplings=(law,),
    )
    return case_of("leaving", mechanism, Initial(rates={"j0": {"angle": 1.0}}))


@pytest.fixture(scope="module")
def results():
    sound = case_of("sound", chain("revolute", "spherical", seed=48), Initial(rates={"j0": {"angle": 1.0}}))
    return run_suite([torn(), spring_without_length(), leaving(), driven_hinge(), preloaded_frame(), sound], [], EVERY)


def cells(results, case):
    return {(c.question, c.method): c for c in results.comparisons if c.case == case}


@pytest.mark.parametrize("case", ["sound", "frame", "driven"])
def test_sound_cases_agree_beside_the_others(results, case):
    """Without freedom accelerations vanish, and their scale is that of the spring; what is driven has a horizon."""
    found = cells(results, case)
    assert {question for question, _ in found} == {Question.INSTANT, Question.TRAJECTORY}
    assert {c.verdict for c in found.values()} == {Verdict.AGREES}, [c.why for c in found.values()]


@pytest.mark.parametrize(
    ("case", "question", "says"),
    [
        ("torn", Question.MODEL, "joint 'j0', held angle: it stays violated by 0.5"),
        ("torn", Question.INSTANT, "joint 'j0', held angle: it stays violated by 0.5"),
        ("torn", Question.TRAJECTORY, "joint 'j0', held angle: it stays violated by 0.5"),
        ("point", Question.INSTANT, "spring 's' has no length at the start"),
        ("point", Question.TRAJECTORY, "spring 's' has no length at the start"),
        ("leaving", Question.TRAJECTORY, "coupling 'cam' has no value beyond its table"),
    ],
)
def test_a_case_without_an_answer_says_why_in_its_cells(results, case, question, says):
    found = [c for (asked, _), c in cells(results, case).items() if asked is question]
    assert found
    assert {c.verdict for c in found} == {Verdict.FAILED}
    assert says in found[0].why


def test_the_record_of_such_a_suite_is_written_and_read(results, tmp_path):
    write_record(results, 1.0, tmp_path)
    write_pages(tmp_path)
    assert [case["name"] for case in read_record(tmp_path).cases] == [case.name for case in results.cases]


def test_the_motion_of_a_reference_that_failed_is_not_one_from_a_displaced_start(results):
    runs = [r for r in results.runs if r.case == "sound" and r.question is Question.TRAJECTORY]
    displaced = [r for r in runs if "displaced" in r.method.name]
    assert displaced
    failed = [replace(r, status=Status.FAILED, answer=None, reason="x") for r in runs if r not in displaced]
    found = judge_case(next(c for c in results.cases if c.name == "sound"), [*failed, *displaced])
    assert {c.verdict for c in found} == {Verdict.FAILED}
