"""The spring and damper of MuJoCo's rebounds as a law that the reference solves, against the closed form of a case."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import load_case
from consilience.compare.evidence import OTHER_LAW
from consilience.compare.other_laws import hardened
from consilience.engine import Profile, Question, Run, Status
from consilience.engine.worker.own_units import SETTING
from consilience.engine.worker.requests import offer
from consilience.reference.contact import simulate_with_contacts
from consilience.suite import Resources, run_suite
from consilience.suite.other_laws import laws_to_solve, with_law

pytest.importorskip("mujoco")

from consilience_mujoco import MujocoEngine
from consilience_mujoco.contact_motion import BOUNCE, rebound_gains
from consilience_mujoco.rebound_law import rebound_law

CASE = load_case("linkage_at_a_stop")
LINK, INERTIA = 0.6, 2.0 * (0.03 + 1.0 * 0.3**2) + 3.0 * 0.6**2
"""Length of the links in m, and inertia of the linkage about their pins in kg m^2, as the case states them."""

SOFT = 0.023
"""Difference that the softness makes, in rad: twice 3.6 rad/s for half of the 13 ms that the hit takes."""


def test_the_law_has_the_inertia_of_the_linkage_at_the_stop_in_si_units():
    """The stop sees I / l^2; MuJoCo's gains are in the units of time of the method."""
    _, methods = offer(MujocoEngine(), CASE.mechanism, Question.TRAJECTORY, [CASE.initial_state])
    time = methods[0].settings[SETTING][2]
    b, k = rebound_gains(0.5, BOUNCE)
    law = methods[0].law.compliance
    assert time != 1.0
    np.testing.assert_allclose(law.stiffness, k / time**2 * INERTIA / LINK**2, rtol=1e-12)
    np.testing.assert_allclose(law.damping, b / time * INERTIA / LINK**2, rtol=1e-12)


def under_hard_law(restitution):
    """Angle of the linkage in the case, by the reference with the hard law of an adapter that sees a restitution."""
    contact = replace(CASE.mechanism.contacts[0], restitution=restitution)
    law = hardened(rebound_law(replace(CASE.mechanism, contacts=(contact,))))
    motion, _ = simulate_with_contacts(with_law(CASE.mechanism, law), CASE.initial_state, CASE.times, 1e-9)
    return 2.0 * np.arctan2(-motion.quat_WB[:, 0, 2], motion.quat_WB[:, 0, 0])


@pytest.mark.parametrize(("restitution", "leads_to_the_case"), [(0.5, True), (0.47, False)])
def test_a_hard_law_leads_to_the_case_unless_its_damper_is_wrong(restitution, leads_to_the_case):
    """Closed form of the case at 0.6 s: an adapter with the wrong restitution declares the law that it solves."""
    (truth,) = [p for p in CASE.published if p.observable == "angle" and p.time == 0.6]
    at = int(np.argmin(np.abs(CASE.times - truth.time)))
    off = abs(under_hard_law(restitution)[at] - truth.value)
    assert (off < OTHER_LAW * SOFT) == leads_to_the_case


def test_the_reference_is_asked_with_the_law_and_with_the_hard_one():
    method = MujocoEngine().methods(CASE.mechanism, Question.TRAJECTORY)[0]
    runs = [Run(CASE.name, "e", Question.TRAJECTORY, method, 0, 1e-3, Status.ANSWERED, None)]
    assert laws_to_solve(runs) == [(Question.TRAJECTORY, law) for law in (method.law, hardened(method.law))]
    np.testing.assert_allclose(
        hardened(method.law).compliance.damping / method.law.compliance.damping,
        np.sqrt(hardened(method.law).compliance.stiffness / method.law.compliance.stiffness),
    )


@pytest.mark.parametrize("name", ["crank_at_a_stop", "bouncing_sphere", "balls_touching", "box_tips"])
def test_no_law_is_named_where_the_contact_is_open_in_the_drawing_or_not_alone(name):
    assert rebound_law(load_case(name).mechanism) is None


@pytest.mark.slow
def test_the_verdict_names_the_compliance():
    """Through the workers, from the adapter's law to the rule."""
    results = run_suite([CASE], ["mujoco"], [Question.TRAJECTORY], resources=Resources(limit=400.0))
    (found,) = [c for c in results.comparisons if c.engine == "mujoco" and c.profile is Profile.MATCHED]
    assert found.rule == "compliance"
    assert all(power.limit < 0.1 for power in found.power)
