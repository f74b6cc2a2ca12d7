"""Identities of contact: the reference and the engines fulfil them; each identity detects answers with an error."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from consilience.audit.identities import check
from consilience.audit.identities.check import CONTACT_IDENTITIES, check_case
from consilience.audit.identities.contact import gauge
from consilience.audit.identities.contact_motion import ROUNDING, energy_growth, normal_power
from consilience.audit.identities.result import IdentityOutcome, NotApplicableError
from consilience.case import load_case
from consilience.cli.main import app
from consilience.engine import Profile, Question, load_engine
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan, perform
from consilience.mechanism import Cone, nearest_points

NAMES = [identity.name for identity in CONTACT_IDENTITIES]


@cache
def case():
    """A lumpy ball that slips on an incline, with a wall of the same law that it does not reach."""
    slips = load_case("ball_slips").with_span(0.2, None)
    (floor,) = slips.mechanism.contacts
    wall = {"name": "wall", "point": floor.point + 3.0 * floor.normal, "normal": -floor.normal}
    return replace(slips, mechanism=replace(slips.mechanism, contacts=(floor, replace(floor, **wall))))


@cache
def honest(question, step):
    """The reference's answer to one question about the case; steps are tolerances."""
    engine, one = load_engine("reference"), case()
    method = engine.methods(one.mechanism, question)[0]
    if question is Question.INSTANT:
        return engine.instant(one.mechanism, one.states[:2], method)
    return engine.trajectory(one.mechanism, one.initial_state, one.times, method, step)


def findings(instant=lambda answer: answer, trajectory=lambda answer: answer):
    """Finding of each identity about the reference's answers, changed by functions."""

    def ask(request):
        if request.question is Question.INSTANT:
            return Reply(instant(honest(Question.INSTANT, None)), returned=True)
        if request.question is Question.TRAJECTORY:
            return Reply(trajectory(honest(Question.TRAJECTORY, request.step)), returned=True)
        return Reply(perform(load_engine("reference"), request), returned=True)

    found = {}
    for finding in check_case(ask, "test", case(), 2):
        found.setdefault(finding.identity, finding)
    return found


def normals():
    """Normals of both contacts, shape (2, 3): both planes are at rest."""
    m, start = case().mechanism, case().initial_state
    return np.array([nearest_points(m, start, contact).normal for contact in m.contacts])


def split(force):
    """Normal and tangential parts of forces or impulses, shape (n, contacts, 3)."""
    n = normals()
    pushed = np.einsum("tci,ci->tc", force, n)[..., None] * n
    return pushed, force - pushed


def forces(change):
    return lambda answer: replace(answer, contact_force=change(*split(answer.contact_force)))


def impulses(change):
    return lambda answer: replace(answer, contact_impulse=change(*split(answer.contact_impulse)))


def along(**shift):
    """Shift fields of a motion along the normal of the floor, in m or m/s."""
    return lambda answer: replace(answer, **{k: getattr(answer, k) + x * normals()[0] for k, x in shift.items()})


def falling(answer):
    """Accelerations of free fall: the contact is missed, its force reported."""
    return replace(answer, a_WB_W=np.broadcast_to(case().mechanism.gravity, answer.a_WB_W.shape))


PLANTED = {
    "the contact pulls": ({"instant": forces(lambda N, T: T - N)}, {"no pull"}),
    "half as much friction again": ({"instant": forces(lambda N, T: N + 1.5 * T)}, {"friction cone"}),
    "friction drives": ({"instant": forces(lambda N, T: N - T)}, {"friction against slip"}),
    "friction is turned": ({"instant": forces(lambda N, T: N + np.cross(normals(), T))}, {"friction against slip"}),
    "the wall pushes from afar": (
        {"instant": forces(lambda N, T: N + T + [[0.0], [0.01]] * normals())},
        {"gap times force"},
    ),
    "a missed contact": ({"instant": falling}, {"gap times force"}),
    "the ball is sunk": ({"trajectory": along(p_WB=-1e-6)}, {"no overlap"}),
    "the ball sinks": ({"trajectory": along(v_WB_W=-1e-6)}, {"no power of the normal force"}),
    "impulses pull": ({"trajectory": impulses(lambda N, T: T - N)}, {"impulses within the cone"}),
    "impulses leave the cone": ({"trajectory": impulses(lambda N, T: N + 1.01 * T)}, {"impulses within the cone"}),
    "the ball speeds up": (
        {"trajectory": lambda answer: replace(answer, v_WB_W=1.5 * answer.v_WB_W)},
        {"energy never grows"},
    ),
}


@pytest.mark.parametrize("name", PLANTED)
def test_an_error_of_contact_is_caught_by_the_identity_that_shows_it(name):
    error, expected = PLANTED[name]
    violated = {i for i, finding in findings(**error).items() if finding.outcome is IdentityOutcome.VIOLATED}
    assert expected <= violated
    other = "trajectory" if "instant" in error else "instant"
    measured = {i.name for i in CONTACT_IDENTITIES if (i.measure is None) == (other == "trajectory")}
    assert not violated & measured


def test_the_reference_obeys_all_of_them_and_each_can_be_violated():
    found = findings()
    assert list(found) == NAMES
    assert {finding.outcome for finding in found.values()} == {IdentityOutcome.HOLDS}
    assert set().union(*(expected for _, expected in PLANTED.values())) == set(NAMES)


def rolling():
    return load_case("ball_rolls").with_span(0.1, None)


def resting():
    """The ball of `rolling`, which starts at rest, with gravity across the plane: it stays where it is."""
    (floor,) = rolling().mechanism.contacts
    level = replace(rolling().mechanism, gravity=-9.81 * floor.normal)
    return replace(rolling(), mechanism=level)


@pytest.mark.parametrize("start", [rolling, resting])
@pytest.mark.parametrize("engine", ["dart", "exudyn", "mujoco", "pinocchio"])
def test_installed_engines_obey_the_identities_of_contact(engine, start):
    chosen, loaded = start(), load_engine(engine)

    def ask(request):
        value = perform(loaded, request)
        if isinstance(value, Plan):
            value = replace(
                value,
                methods={
                    q: tuple(m for m in ways if m.profile is Profile.MATCHED)[:1] for q, ways in value.methods.items()
                },
            )
        return Reply(value, returned=True)

    found = check_case(ask, engine, chosen, 2)
    assert not [f for f in found if f.outcome in (IdentityOutcome.VIOLATED, IdentityOutcome.NO_ANSWER)]
    assert sum(f.outcome is IdentityOutcome.HOLDS for f in found) >= 7 - (start is resting)


def test_speeds_of_what_rests_are_measured_by_those_that_its_forces_give_in_a_sample_interval():
    """The ball falls by ``g dt``: noise below 1e-10 of that is none, a hundredth of it is one."""
    chosen = resting()
    m, method = chosen.mechanism, load_engine("reference").methods(chosen.mechanism, Question.TRAJECTORY)[0]
    still = load_engine("reference").trajectory(m, chosen.initial_state, chosen.times, method, 1e-12)
    signs = np.resize([1.0, -1.0], (len(still.time), 1, 1))
    fall = 9.81 * (still.time[1] - still.time[0]) * m.contacts[0].normal
    noisy, moving = (replace(still, v_WB_W=still.v_WB_W + size * signs * fall) for size in (1e-10, 1e-2))
    assert max(np.max(measure(m, noisy)) for measure in (normal_power, energy_growth)) < ROUNDING
    assert np.max(normal_power(m, moving)) > 1e-3
    assert np.max(energy_growth(m, replace(moving, v_WB_W=np.cumsum(moving.v_WB_W**2, axis=0)))) > ROUNDING


@pytest.mark.parametrize(("share", "outcome"), [(1.0, IdentityOutcome.HOLDS), (0.0, IdentityOutcome.VIOLATED)])
def test_an_overlap_that_vanishes_with_softness_violates_nothing(share, outcome):
    """A ball sunk by 1e-5 m: by as much again with twice the softness, or by the same however soft."""
    method = replace(load_engine("reference").methods(case().mechanism, Question.TRAJECTORY)[0], softness=1.0)

    def ask(request):
        if request.question is None:
            plan = perform(load_engine("reference"), request)
            return Reply(replace(plan, methods=plan.methods | {Question.TRAJECTORY: (method,)}), returned=True)
        if request.question is Question.INSTANT:
            return Reply(honest(Question.INSTANT, None), returned=True)
        sunk = 1e-5 * (1.0 - share + share * request.method.softness)
        return Reply(along(p_WB=-sunk)(honest(Question.TRAJECTORY, request.step)), returned=True)

    found = {finding.identity: finding.outcome for finding in check_case(ask, "test", case(), 1)}
    assert found["no overlap"] is outcome


def test_the_command_checks_a_case_with_contact():
    result = CliRunner().invoke(app, ["check", "bounces_to_rest", "-e", "reference", "--states", "1", "-f", "markdown"])
    assert result.exit_code == 0, result.output
    assert "| energy never grows" in result.output
    assert "| power balance" not in result.output


def test_what_the_cones_allow_is_the_least_normal_force_of_each():
    """Circle: the length. Box: the larger component. A square with a vertex on t1: the sum of both."""
    force = np.array([[3.0, 4.0], [-3.0, 0.0]])
    assert gauge(Cone(), force) == pytest.approx([5.0, 3.0])
    assert gauge(Cone("box"), force) == pytest.approx([4.0, 3.0])
    assert gauge(Cone("pyramid", 4), force) == pytest.approx([7.0, 3.0])


def test_an_identity_that_no_state_has_is_not_applicable():
    """As of a contact that an associated cone lifts off at every state."""
    found = check._measured(lambda subject: iter(()), None)
    assert isinstance(found, NotApplicableError)
