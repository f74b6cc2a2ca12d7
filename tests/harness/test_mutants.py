"""Mutant engines, each with an error that adapters are known to make: every error shows as a difference of the model.

Off-centre masses, full inertia tensors and turned axes of the shipped lumpy cases make the errors visible.
"""

from dataclasses import replace

import pytest

from consilience.case import load_case
from consilience.compare import Verdict
from consilience.engine import Question
from consilience.suite import Resources, run_suite

pytestmark = pytest.mark.slow

CASES = ("double_pendulum", "slider_crank")

# mutant: the question and the first quantity that detect it
CAUGHT = {
    "transposed_rotation": (Question.MODEL, "centre of mass"),
    "quaternion_order": (Question.MODEL, "centre of mass"),
    "transposed_joint_frames": (Question.INSTANT, "accelerations"),
    "inertia_about_origin": (Question.MODEL, "inertia of the whole"),
    "dropped_product": (Question.MODEL, "inertia of the whole"),
    "centre_of_mass_lost": (Question.MODEL, "centre of mass"),
    "body_axes_velocity": (Question.INSTANT, "accelerations"),
    "weightless_body": (Question.INSTANT, "accelerations"),
    "acceleration_point": (Question.INSTANT, "accelerations"),
    "reaction_sign": (Question.INSTANT, "reactions"),
    "reaction_sign_of_one": (Question.INSTANT, "reactions"),
    "reaction_axes": (Question.INSTANT, "reactions"),
    "reaction_point": (Question.INSTANT, "reactions"),
}
# mutants with a wrong model must also give wrong accelerations, whatever their answer to `model`
WRONG_EQUATIONS = [name for name, (question, _) in CAUGHT.items() if question is Question.MODEL]


@pytest.fixture(scope="module")
def comparisons(answers_kept):
    cases = [replace(load_case(name), instants=3) for name in CASES]
    questions = [Question.MODEL, Question.INSTANT]
    results = run_suite(cases, ["honest", *CAUGHT], questions, Resources(3, 400.0))  # the first job compiles kernels
    assert not results.missing
    return {(c.engine, c.case, c.question): c for c in results.comparisons if c.method == "descriptor"}


@pytest.mark.parametrize("question", [Question.MODEL, Question.INSTANT])
@pytest.mark.parametrize("case", CASES)
def test_the_engine_they_descend_from_agrees(comparisons, case, question):
    found = comparisons["honest", case, question]
    assert found.verdict is Verdict.AGREES
    assert found.digits > 11


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("mutant", CAUGHT)
def test_every_mutant_is_caught_where_it_errs(comparisons, mutant, case):
    question, quantity = CAUGHT[mutant]
    found = comparisons[mutant, case, question]
    assert found.verdict is Verdict.MODEL
    assert found.why.startswith(f"{quantity}: difference ")
    assert max(q.difference for q in found.quantities) > 1e-4  # in the first digits, not just above the bar


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("mutant", WRONG_EQUATIONS)
def test_a_wrong_model_also_gives_wrong_accelerations(comparisons, mutant, case):
    found = comparisons[mutant, case, Question.INSTANT]
    assert found.verdict is Verdict.MODEL
    assert "accelerations" in [q.name for q in found.quantities if not q.met]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("mutant", [m for m in CAUGHT if m.startswith("reaction")])
def test_a_wrong_reaction_alone_leaves_the_rest_in_agreement(comparisons, mutant, case):
    found = comparisons[mutant, case, Question.INSTANT]
    assert [q.name for q in found.quantities if not q.met] == ["reactions"]
