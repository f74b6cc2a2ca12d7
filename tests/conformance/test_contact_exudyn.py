"""Contacts, stops and dry friction in Exudyn, against closed forms; lumpy bodies in turned worlds."""

from dataclasses import replace

import numpy as np
import pytest

from consilience import Drawing, simulate
from consilience.case import load_case
from consilience.engine import CannotRepresent, Question, Route, defects
from consilience.mechanism import (
    GROUND,
    DiscPlane,
    Drive,
    PointPlane,
    Rolling,
    Skate,
    SpherePlane,
    constant,
    rotation_from_quaternion,
)
from contact_instants import PROBLEMS, error
from contact_problems import BALL, FEET, LEVEL, G, Lab, ball, close, incline, pendulum, stacked, turned

pytest.importorskip("exudyn")

from consilience_exudyn import ExudynEngine, contact_numbers
from consilience_exudyn.contact_samples import refuse_fall, refuse_gain
from consilience_exudyn.contacts import Penalty
from consilience_exudyn.mutants import CONTACT_MUTANTS

I, T = Question.INSTANT, Question.TRAJECTORY
LAB = Lab()
CORNERS = [(x, y, -0.1) for x in (0.3, -0.3) for y in (0.3, -0.3)]
ENGINE = ExudynEngine()


def asked(mechanism, state):
    """Answer at one state."""
    assert ENGINE.unsupported(mechanism, I) == ()
    answer = ENGINE.instant(mechanism, [state], ENGINE.methods(mechanism, I)[0])
    assert defects(answer, I, mechanism, 1) == []
    return answer


def motion(mechanism, state, end, samples=20, level=-1, kind=Route.TUNED):
    assert ENGINE.unsupported(mechanism, T) == ()
    (method,) = [m for m in ENGINE.methods(mechanism, T) if m.route is kind]
    times = np.linspace(0.0, end, samples + 1)
    answer = ENGINE.trajectory(mechanism, state, times, method, (times[1] - times[0]) / method.substeps[level])
    assert defects(answer, T, mechanism, len(times)) == []
    return answer


@pytest.mark.parametrize(("mu", "holds"), [(0.6, True), (0.501, True), (0.499, False)])
def test_friction_holds_a_box_on_a_slope_whatever_its_corners_share(mu, holds):
    """Slope 0.5: the lower corners bear five eighths of the load; of equal shares of friction the upper ones slip."""
    corners = LAB.points([(x, y, -0.2) for x in (0.4, -0.4) for y in (0.3, -0.3)], friction=mu)
    mechanism = LAB.free_body(2.0, (0.05, 0.06, 0.07), np.array([-4.5, 0.0, -9.0]), corners)
    state = LAB.state([0, 0, 0.2], [0, 0, 0])
    if not holds:
        with pytest.raises(CannotRepresent, match="starts to slide"):
            asked(mechanism, state)
        return
    answer = asked(mechanism, state)
    (a, alpha), forces = LAB.acceleration(answer, state), answer.contact_force[0] @ LAB.axes
    close((a, alpha, forces.sum(axis=0)), (np.zeros(3), np.zeros(3), [9.0, 0.0, 18.0]), 1e-12)
    normal, across = forces[:, 2], np.linalg.norm(forces[:, :2], axis=1)
    assert np.all(across <= mu * normal * (1.0 + 1e-8))


@pytest.mark.parametrize("mu", [0.05, 0.5])
def test_a_motion_that_starts_to_slide_has_the_normal_force_of_its_start(mu):
    """``m g cos 20 deg``, whether the ball rolls (mu at least 2/7 tan 20 deg = 0.104) or slides."""
    ball = LAB.free_body(2.0, BALL, incline(20), [LAB.sphere(0.1, friction=mu)])
    (seen,) = contact_numbers.contacts_at_start(ball, LAB.state([0, 0, 0.1], [0, 0, 0]))
    assert seen.normal == pytest.approx(2.0 * G * np.cos(np.radians(20.0)), rel=1e-9)


def test_a_foot_with_a_heavy_cart_above_stands_still_to_rounding():
    """The weight of 40 kg on a drive 0.9 m up, beside a foot of 0.1 kg m^2: nothing moves, to 1e-13 of gravity."""
    draw = Drawing("foot", gravity=(0.0, 0.0, -9.81))
    draw.body("foot", mass=8.0, inertia=(0.1, 0.1, 0.1), at=(0.0, 0.0, 0.03))
    draw.body("cart", mass=40.0, inertia=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.9))
    draw.joint("flight", "free", "ground", "foot", at=(0.0, 0.0, 0.03))
    draw.joint("rail", "prismatic", "foot", "cart", at=(0.0, 0.0, 0.9), axis=(1.0, 0.0, 0.0))
    draw.add("drive", "motor", joint="rail", coordinate="distance", motion=constant(0.0))
    sole = {"at": (0.0, 0.0, 0.03), "half_sizes": (0.02, 0.05, 0.03), "friction": 0.8}
    draw.add("contact", "sole", body="foot", point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), **sole)
    case = draw.case()
    answer = asked(case.mechanism, case.initial_state)
    assert max(np.max(np.abs(answer.a_WB_W)), np.max(np.abs(answer.alpha_WB_W))) < 1e-13 * 9.81
    assert answer.contact_force[0, 0] == pytest.approx([0.0, 0.0, 48.0 * 9.81], rel=1e-12, abs=1e-11)


def test_an_instant_of_an_impact_is_refused():
    with pytest.raises(RuntimeError, match=r"closes at 0\.5 m/s"):
        asked(ball(LAB, 0.1, (0, 0, 0)), LAB.state([0, 0, 0.1], [0, 0, -0.5]))


def test_overlaps_are_not_lost_in_the_rounding_of_a_wide_plane():
    """A block slides 2 m: rounding of triangles of 11 m would move it by 2e-8 m (closed form: hodograph)."""
    case, engine = load_case("thrown_across_slides"), ExudynEngine()
    method = engine.methods(case.mechanism, Question.TRAJECTORY)[-1]
    answer = engine.trajectory(case.mechanism, case.initial_state, case.times, method, case.sample / 40)
    for value in (v for v in case.published if v.observable == "p_WBcm"):
        sample = round(value.time / case.sample)
        R = rotation_from_quaternion(answer.quat_WB[sample, 0])
        found = answer.p_WB[sample, 0] + R @ case.mechanism.bodies[0].com
        assert found[value.component] == pytest.approx(value.value, abs=1e-8)


def test_a_block_that_slides_up_an_incline_stays_there():
    mechanism = LAB.free_body(2.0, (0.02, 0.03, 0.04), incline(20), LAB.points(CORNERS, friction=0.5))
    state = LAB.state([0, 0, 0.1], [-3.0, 0, 0])
    answer = motion(mechanism, state, 1.0, 40, 1, Route.EXTRAPOLATED)
    close((LAB.centre(answer)[0],), ([-0.565013610587311, 0, 0.1],), 1e-5)
    assert np.all(answer.contact_mode[-5:] == 2)
    creeps = [np.linalg.norm(LAB.centre(motion(mechanism, state, 1.0, 40, n))[1]) for n in (0, 1)]
    assert creeps[0] / creeps[1] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(("mu", "share"), [(0.0, 1.0), (0.5, 5 / 7)])
def test_what_rests_does_not_rebound(mu, share):
    """A ball in axes of the world, whose speed of approach is no rounding but zero, slides, or rolls with 5/7 of g."""
    draw = Drawing("rests", gravity=(1.5, 0.0, -G))
    draw.body("ball", mass=1.3, at=(0.0, 0.0, 0.1), inertia=(0.4 * 1.3 * 0.01,) * 3)
    draw.joint("flight", "free", "ground", "ball", at=(0.0, 0.0, 0.1))
    law = {"friction": mu, "restitution": 0.5}
    draw.add("contact", "floor", body="ball", at=(0, 0, 0.1), radius=0.1, point=(0, 0, 0), normal=(0, 0, 1.0), **law)
    case = draw.case(duration=0.2, sample=0.02)
    answer = motion(case.mechanism, case.initial_state, 0.2)
    np.testing.assert_allclose(answer.p_WB[-1, 0], [0.5 * share * 1.5 * 0.2**2, 0.0, 0.1], atol=1e-4)


def test_what_rests_and_is_hit_later_is_refused_with_its_restitution():
    """A smooth block under gravity, on which a ball falls from 0.2 m."""
    draw = Drawing("hit", gravity=(0.0, 0.0, -G))
    draw.body("block", mass=2.0, at=(0.0, 0.0, 0.1), inertia=(0.02, 0.03, 0.04))
    draw.body("ball", mass=1.0, at=(0.0, 0.0, 0.5), inertia=(0.004, 0.004, 0.004))
    for name, z in (("block", 0.1), ("ball", 0.5)):
        draw.joint(f"flight_of_{name}", "free", "ground", name, at=(0.0, 0.0, z))
    floor = {"point": (0.0, 0.0, 0.0), "normal": (0.0, 0.0, 1.0), "restitution": 0.5}
    draw.add("contact", "floor", body="block", at=(0.0, 0.0, 0.1), radius=0.1, **floor)
    draw.add(
        "contact",
        "top",
        body="ball",
        at=(0.0, 0.0, 0.5),
        radius=0.1,
        partner="block",
        **(floor | {"point": (0.0, 0.0, 0.2)}),
    )
    case = draw.case(duration=0.4, sample=0.02)
    with pytest.raises(CannotRepresent, match=r"'floor', closed at the start, hits later .* restitution begins"):
        motion(case.mechanism, case.initial_state, 0.4)


def test_balls_that_touch_in_a_chain_are_refused_and_two_are_not():
    """Of three that touched, levels ended 7e-3, 1e5 and 24 m off: the dampers of both contacts have no bound."""
    chain = load_case("balls_in_line:balls=4,restitution=0.8,gap=0")
    with pytest.raises(CannotRepresent, match=r"'pair_2' and 'pair_3', at rest until they are hit"):
        motion(chain.mechanism, chain.initial_state, 0.2, 20, 0)
    two = load_case("balls_in_line:balls=3,restitution=0.8,gap=0")
    found = motion(two.mechanism, two.initial_state, 0.2, 20, 0)
    np.testing.assert_allclose(found.v_WB_W[-1], simulate(two).v_WB_W[-1], atol=0.03)


def test_a_motion_that_gains_energy_is_refused():
    """A ball that falls for 0.2 s without getting lower, and is twice as fast: ``m/2 (4 (v^2 + (g t)^2) - v^2)``."""
    mechanism, state = LAB.free_body(1.3, BALL, LEVEL, [LAB.sphere(0.1)]), LAB.state([0, 0, 1.0], [1.0, 0, 0])
    flies = motion(mechanism, state, 0.2)
    refuse_gain(mechanism, flies)
    faster = flies.v_WB_W * np.linspace(1.0, 2.0, 21)[:, None, None]
    gains = replace(flies, p_WB=flies.p_WB[:1].repeat(21, axis=0), v_WB_W=faster)
    with pytest.raises(RuntimeError, match=f"gains {0.65 * (4.0 * (1.0 + (0.2 * G) ** 2) - 1.0):.3g} J from nothing"):
        refuse_gain(mechanism, gains)


@pytest.mark.parametrize("substeps", [40, 80, 320])
def test_a_contact_that_opens_at_the_start_never_acts(substeps):
    """The ball leaves the wall at once. By rounding it touched in the first step, and was off by 1e-3, 6e-4, 1e-4 m."""
    case = load_case("ball_in_corner-leaves")
    native = ENGINE.methods(case.mechanism, T)[0]
    found = ENGINE.trajectory(case.mechanism, case.initial_state, case.times, native, case.sample / substeps)
    exact = simulate(case)
    np.testing.assert_allclose(found.p_WB, exact.p_WB, rtol=0.0, atol=4e-5 * 40 / substeps)


def test_a_rod_falls_over_whose_upper_end_would_touch_too():
    """``w^2 = 3 g/l (cos th_0 - cos th)`` while the lower end sticks: numbers of both ends follow the step alike."""
    mechanism = LAB.free_body(1.0, (1 / 12, 1 / 12, 1e-4), LEVEL, LAB.points([[0, 0, -0.5], [0, 0, 0.5]], friction=0.3))
    state = LAB.state([0.5 * np.sin(0.2), 0, 0.5 * np.cos(0.2)], [0, 0, 0], turn=turned(0, 0.2, 0))
    place, velocity = LAB.centre(motion(mechanism, state, 0.3, 6, kind=Route.EXTRAPOLATED))[:2]
    w = np.linalg.norm(velocity) / 0.5
    assert w**2 == pytest.approx(3 * G * (np.cos(0.2) - place[2] / 0.5), rel=1e-6)


def test_a_sphere_that_falls_through_its_plane_is_refused():
    mechanism = LAB.free_body(1.0, BALL, LEVEL, LAB.points(FEET))
    numbers = [Penalty(1e6, 1e3, 1e-3, radius=1e-3)] * 3
    refuse_fall(mechanism, np.array([[0.0, -1e-4, -9e-4]]), numbers)
    with pytest.raises(CannotRepresent, match=r"'foot 2'.*deeper than its radius"):
        refuse_fall(mechanism, np.array([[0.0, 0.0, 0.0], [0.0, -1e-4, -2e-3]]), numbers)


def rod_that_hits(velocity):
    """A rod of half-length 1 m at 45 deg over a floor, mu 0.3, e 0.5; its state at a velocity."""
    c = np.sqrt(0.5)
    tip = PointPlane("tip", "body", LAB.in_body([c, 0, -c]), GROUND, LAB.origin, LAB.axes[:, 2], friction=0.3,
                     restitution=0.5)  # fmt: skip
    return LAB.free_body(1.0, (1 / 3, 1 / 3, 1 / 3), np.zeros(3), [tip]), LAB.state([0, 0, c + 1e-4], velocity)


def test_a_slip_that_reverses_within_an_impact_is_refused():
    """The normal impulse alone turns a backward slip of 0.2 m/s at an approach of 1 m/s into one of 0.7 m/s forward."""
    mechanism, state = rod_that_hits([-0.2, 0, -1.0])
    with pytest.raises(CannotRepresent, match=r"'tip', whose slip reverses within an impact"):
        motion(mechanism, state, 0.01, 1, 0)


def test_the_end_of_a_rod_hits_a_rough_floor():
    """Slipping one way, the rod rebounds alike by Newton's and by Poisson's law."""
    mechanism, state = rod_that_hits([0.5, 0, -1.0])
    N = 0.731707317073171
    answer = motion(mechanism, state, 0.01, 1, 0)
    close((answer.contact_impulse[-1, 0] @ LAB.axes,), ([-0.3 * N, 0.0, N],), 5e-3)
    close((LAB.centre(answer)[1],), ([0.5 - 0.3 * N, 0.0, N - 1.0],), 5e-3)


def test_a_ball_bounces_with_its_restitution_whatever_its_mass():
    """The spring holds the ball for pi / 2000 s; a softness of a half is four times the stiffness."""
    t1, u = np.sqrt(2.0 / G), np.sqrt(2.0 * G)
    later = 0.7 - t1
    truth = [0, 0, 0.1 + 0.5 * u * later - 0.5 * G * later**2], [0, 0, 0.5 * u - G * later]
    for mass, softness, bar in ((1.3, 1.0, 3e-2), (40.0, 0.5, 1.8e-2)):
        mechanism = LAB.free_body(mass, [0.4 * mass * 0.01] * 3, LEVEL, [LAB.sphere(0.1, restitution=0.5)])
        method = replace(ENGINE.methods(mechanism, T)[0], softness=softness)
        answer = ENGINE.trajectory(
            mechanism, LAB.state([0, 0, 1.1], [0, 0, 0]), np.linspace(0, 0.7, 15), method, 1.25e-5
        )
        close(LAB.centre(answer)[:2], truth, bar)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (lambda: LAB.sphere(0.1, friction=0.1, rolling=0.01), "no moments"),
        (lambda: LAB.sphere(0.1, friction=0.1, static_friction=0.2), "one coefficient"),
        (
            lambda: DiscPlane("d", "body", LAB.com, np.array([1.0, 0, 0]), 0.1, GROUND, LAB.origin, LAB.axes[:, 2]),
            "rim",
        ),
    ],
)
def test_what_exudyn_cannot_represent_is_named_with_the_reason(contact, words):
    refused = ENGINE.unsupported(LAB.free_body(2.0, BALL, LEVEL, [contact()]), T)
    assert len(refused) == 1
    assert words in refused[0].reason


def test_motions_with_constraints_are_refused_and_instants_are_not():
    mechanism, _ = stacked(LAB, 0.0)
    held = replace(mechanism, joints=(mechanism.joints[0], replace(mechanism.joints[1], kind="spherical")))
    assert ENGINE.unsupported(held, I) == ()
    (refused,) = ENGINE.unsupported(held, T)
    assert "explicit integrators" in refused.reason


@pytest.mark.parametrize(
    ("constraint", "words"),
    [
        ({"skates": (Skate("blade", "body", np.zeros(3), np.array([0.0, 1.0, 0.0])),)}, "beside skate"),
        (
            {"rollings": (Rolling("rim", "body", np.zeros(3), LAB.axes[:, 0], 0.1, LAB.origin, LAB.axes[:, 2]),)},
            "rolling",
        ),
    ],
    ids=["skate", "rolling"],
)
def test_constraints_of_free_bodies_are_not_left_out_of_a_motion(constraint, words):
    free = LAB.free_body(2.0, BALL, LEVEL, [LAB.sphere(0.1)])
    assert ENGINE.unsupported(free, T) == ()
    (refused,) = ENGINE.unsupported(replace(free, **constraint), T)
    assert words in refused.feature
    assert "explicit integrators" in refused.reason


def test_a_drive_on_a_tree_is_what_is_named():
    driven = replace(
        pendulum(LAB, bound=0.5), drives=(Drive("motor", "hinge", "angle", constant(0.0)),), dry_frictions=()
    )
    touching = replace(driven, contacts=(SpherePlane("tip", "rod", LAB.com, 0.1, GROUND, LAB.origin, LAB.axes[:, 2]),))
    (refused,) = ENGINE.unsupported(touching, T)
    assert refused.feature.endswith("beside drive")


def test_only_the_declared_pairs_collide():
    """The upper box has no contacts: it falls through the lower one."""
    mechanism, state = stacked(LAB, 0.0, upper=False)
    answer = motion(mechanism, state, 0.2, 4, 0)
    close((LAB.axes[:, 2] @ answer.v_WB_W[-1, 1],), ([-0.2 * G],), 1e-9)


def at_instant(name):
    assert error(ENGINE, PROBLEMS[name]()) < 1e-11


PLANTED = {
    "friction of one partner, Exudyn": lambda: at_instant("ball that slides, pushed"),
    "restitution squared, Exudyn": test_the_end_of_a_rod_hits_a_rough_floor,
    "normal of the partner, Exudyn": lambda: at_instant("ball that rolls, pushed"),
    "contact at another point, Exudyn": lambda: at_instant("ball that slides, pushed"),
    "Hunt and Crossley's restitution": test_the_end_of_a_rod_hits_a_rough_floor,
}
"""Tests that catch errors planted in the adapter."""


@pytest.mark.parametrize("mutant", CONTACT_MUTANTS, ids=lambda mutant: mutant.name)
def test_planted_errors_are_caught(mutant, monkeypatch):
    with mutant.plant(ExudynEngine(), mutant.magnitudes[0]) as planted:
        monkeypatch.setitem(globals(), "ENGINE", planted)
        with pytest.raises(AssertionError):
            PLANTED[mutant.name]()


def test_an_impact_without_rebound_follows_routh_s_path():
    """A rod whose slip turns within its impact: friction opposes the slip of each instant, as steps vanish.

    ``du_t/dN = G_tn - mu G_tt`` until the slip ends, then ``G_tn + mu G_tt``, until u_n = 0; the zone of friction, in
    which slip is slow, is in proportion to the step. Moreau's law has the second from the start.
    """
    arm, moment, mu, slip, fall = -np.sqrt(0.5), 1.0 / 3.0, 0.3, 0.2, 1.0
    lever = arm**2 / moment
    direct, coupled = 1.0 + lever, -lever
    first = slip / (mu * direct - coupled)
    second = (fall - (direct - mu * coupled) * first) / (direct + mu * coupled)
    assert second > 0.0
    assert coupled + mu * direct < 0.0
    normal, across = first + second, mu * (second - first)
    after = [slip + across, normal - fall, arm * (across - normal) / moment]
    mechanism = LAB.free_body(1.0, (moment, moment, 1e-3), np.zeros(3), LAB.points([[0.0, 0.0, -1.0]], friction=mu))
    state = LAB.state((0.0, 0.0, 0.02 - arm), (slip, 0.0, -fall), turn=turned(0.0, np.pi / 4.0, 0.0))
    drawn = load_case("rod_hits_floor-backward").mechanism  # above the floor
    (method,) = ENGINE.methods(replace(drawn, contacts=(replace(drawn.contacts[0], restitution=0.0),)), T)
    assert method.law is not None
    assert method.law.impact_law == "poisson"
    assert method.substeps[0] >= 500
    errors = []
    for steps in (500, 2000, 8000):
        found = ENGINE.trajectory(mechanism, state, np.linspace(0.0, 0.04, 3), method, 0.02 / steps)
        _, v, w = LAB.centre(found)
        errors.append(np.max(np.abs(np.array([v[0], v[2], w[1]]) - after)))
    assert errors[1] < 0.65 * errors[0]
    assert errors[2] < 0.5 * errors[1] < 0.01


def test_what_cannot_hit_with_friction_keeps_its_long_steps():
    """Closed in the drawing, or smooth above the floor."""
    drawn = load_case("rod_hits_floor-backward").mechanism
    smooth = replace(drawn, contacts=(replace(drawn.contacts[0], restitution=0.0, friction=0.0),))
    for mechanism in (load_case("ball_slips").mechanism, smooth):
        assert [method.substeps[0] for method in ENGINE.methods(mechanism, T)] == [50, 20]
