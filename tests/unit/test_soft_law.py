"""Softness of contacts that is proved: the reference solves the law, and the verdict says what is left."""

import math
from dataclasses import replace

import pytest

from consilience.case import load_case
from consilience.compare.evidence import EXPLAINED, OTHER_LAW, Evidence
from consilience.compare.result import Verdict
from consilience.compare.rules import decide
from consilience.compare.softness import Softness
from consilience.engine import Manifest, Method, Question, Route, Run, Status
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan
from consilience.mechanism import Compliance, Cone, ContactLaw, Regularisation
from consilience.suite.other_laws import laws_to_solve, runs_under_other_laws, with_law

FINEST = 1e-3
SOFT = Evidence(
    asked=1e-8,
    judged=1.0,
    duration=1.0,
    reference=1e-12,
    finest=FINEST,
    softness=Softness(order=1.0, shift=FINEST, limit=1e-6),
    touching=True,
)
LAW = ContactLaw(
    regularisation=(
        Regularisation(
            pull=2e3, decay=1e2, least=0.9, most=0.95, width=1e-3, midpoint=0.5, power=2.0, inverse_mass=0.5
        ),
    )
)


@pytest.mark.parametrize(
    ("off", "said"),
    [
        (0.5 * OTHER_LAW * FINEST, "soft; differs by 2.5e-05 from the reference's motion with their law"),
        (2.0 * OTHER_LAW * FINEST, "not proved by re-solving: 0.0001 from the reference with their law"),
        (math.inf, "not proved by re-solving"),
    ],
)
def test_the_verdict_says_whether_the_softness_is_proved(off, said):
    rule, why = decide(replace(SOFT, off_soft=off))
    assert (rule.name, rule.verdict) == ("softness", Verdict.REGULARISATION)
    assert why.endswith(said)


def test_softness_of_what_has_no_contacts_is_not_said_to_lack_a_proof():
    assert "proved" not in decide(replace(SOFT, touching=False))[1]


def test_a_proof_narrows_what_other_errors_pass_over():
    """Only a twentieth of the difference is left, not a quarter: an error that makes a tenth of it is seen."""
    open_, proved = (replace(SOFT, off_soft=off, effects={"mass": FINEST}) for off in (math.inf, 1e-9))
    assert open_.passes == EXPLAINED * FINEST
    assert proved.passes == OTHER_LAW * FINEST
    assert open_.unseen == "mass"
    assert proved.unseen == ""


@pytest.mark.parametrize(("softness", "count"), [((1.0,), 0), ((1.0, 0.01), 1)])
def test_the_reference_is_asked_with_the_soft_law_where_the_softness_was_varied(softness, count):
    method = Method("m", Route.NATIVE, 1, (10, 20, 40), softness=1.0, soft_law=LAW)
    runs = [
        Run("c", "e", Question.TRAJECTORY, replace(method, softness=s), 0, 0.1, Status.ANSWERED, None) for s in softness
    ]
    assert laws_to_solve(runs) == [(Question.TRAJECTORY, LAW)] * count


def test_another_law_of_impact_is_that_of_rigid_contacts_and_another_cone_that_of_rough_ones():
    case = load_case("ball_slips")
    (ball,) = case.mechanism.contacts
    soft = replace(ball, name="soft", compliance=Compliance(1e4))
    mechanism = replace(case.mechanism, contacts=(ball, soft, replace(ball, name="smooth", friction=0.0)))
    stepped = with_law(mechanism, ContactLaw(impact_law="moreau", rebound_threshold=0.1, cone=Cone("box"))).contacts
    assert [(c.impact_law, c.rebound_threshold) for c in stepped] == [("moreau", 0.1), ("newton", 0.0), ("newton", 0.1)]
    assert [c.cone.kind for c in stepped] == ["box", "box", "circle"]
    bounces = replace(mechanism, contacts=(replace(ball, restitution=0.5, impact_law="poisson"),))
    (softened,) = with_law(bounces, ContactLaw(compliance=Compliance(2e4))).contacts
    assert (softened.restitution, softened.impact_law, softened.compliance) == (0.0, "newton", Compliance(2e4))


def test_motions_at_coprime_steps_ask_the_reference_for_no_law():
    method = Method("m", Route.NATIVE, 1, (10, 20, 40), softness=0.01, soft_law=LAW)
    run = Run("c", "e", Question.TRAJECTORY, method, 0, 0.1, Status.ANSWERED, coprime=True)
    assert laws_to_solve([run]) == []


def test_a_case_that_the_reference_refuses_is_not_asked_of_it_with_another_law():
    """An engine that answers such a case, and declares its law, must not cost other cases their answers."""

    class Reference:
        engine = "reference"

        def ask(self, request):
            assert request.question is None, "a question that the plan refuses was asked"
            return Reply(Plan({Question.TRAJECTORY: ()}, {}, Manifest()), False, "", 0.0)

    method = Method("m", Route.NATIVE, 1, (10, 20, 40), law=LAW)
    runs = [Run("c", "e", Question.TRAJECTORY, method, 0, 0.1, Status.ANSWERED, None)]
    assert list(runs_under_other_laws(Reference(), load_case("ball_slips"), runs)) == []
