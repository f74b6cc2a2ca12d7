"""Rules of the verdicts, on invented answers: errors of known size and order added to a known motion."""

from dataclasses import replace

import numpy as np
import pytest

import consilience as cs
from consilience.compare import (
    Quantity,
    ReferenceMotion,
    Verdict,
    compare_instant,
    compare_model,
    compare_trajectory,
    reference_spread,
)
from consilience.compare.instant import relative_difference
from consilience.compare.instants import Instants
from consilience.compare.motion import difference_over_time, kept_samples, size_of_motion
from consilience.compare.result import digits_of
from consilience.compare.softness import SCALES
from consilience.compare.uncertainty import richardson
from consilience.engine import (
    CONTACT_MODES,
    EVENT_KINDS,
    InstantAnswer,
    Method,
    ModelAnswer,
    Profile,
    Question,
    Route,
    Run,
    Status,
    TrajectoryAnswer,
)
from consilience.mechanism import Frame, quaternion_from_rotation_vector, quaternion_product, rotation_from_quaternion
from mechanisms import chain
from situations import SITUATIONS

EPS = np.finfo(float).eps

# ---------------------------------------------------------------- trajectory

MECHANISM = chain("free", seed=1)
TIMES = np.linspace(0.0, 2.0, 41)
SHAPE = np.sin(3 * TIMES) * TIMES / 2.0
"""Shape of the errors over time: zero at the start, largest 0.73 at t = 1.7."""


def motion(displacement=0.0, turn=0.0, sign=1.0):
    """A body on the unit circle, turning at unit rate; `SHAPE` times the arguments is added along z and about x."""
    t, zero = TIMES, 0 * TIMES
    p = np.column_stack([np.cos(t), np.sin(t), displacement * SHAPE])[:, None]
    steady = [quaternion_from_rotation_vector([0, 0, x]) for x in t]
    extra = [quaternion_from_rotation_vector([turn * s, 0, 0]) for s in SHAPE]
    quat = sign * np.array([quaternion_product(a, b) for a, b in zip(extra, steady, strict=True)])[:, None]
    v = np.column_stack([-np.sin(t), np.cos(t), zero])[:, None]
    w = np.column_stack([zero, zero, 1 + zero])[:, None]
    return TrajectoryAnswer(t, p, quat, v, w)


REFERENCE = motion()
STEPS = (0.02, 0.01, 0.005)


def judge(errors, order=2, digits=8, spread=0.0, turns=None, cpu=1.0):
    """Return the comparison for levels with given errors along z (relative to the size of the motion) and about x."""
    size = size_of_motion(MECHANISM, REFERENCE)
    method = Method("m", Route.NATIVE, order, (10, 20, 40)[: len(errors)])
    turns = turns or [0.0] * len(errors)
    runs = [
        Run("c", "e", Question.TRAJECTORY, method, n, h, Status.ANSWERED, motion(size * e, turn), cpu=cpu + n)
        for n, (h, e, turn) in enumerate(zip(STEPS, errors, turns, strict=False))
    ]
    return compare_trajectory(MECHANISM, runs, ReferenceMotion(REFERENCE, np.full(len(TIMES), spread), digits))


def powers(constant, order, plateau=0.0):
    return [plateau + constant * h**order for h in STEPS]


def test_size_of_motion_is_the_widest_travel_along_an_axis():
    """On the arc from 0 to 2 rad, x goes from 1 to cos 2: the largest extent along any axis."""
    assert size_of_motion(MECHANISM, REFERENCE) == pytest.approx(1 - np.cos(2.0), rel=1e-15)


def test_origins_that_stay_where_they_are_are_measured_by_the_reach_of_the_bodies():
    """Origins that do not move: the size of the bodies is the scale, else rounding would be a relative error of 1."""
    (body,), (joint,) = MECHANISM.bodies, MECHANISM.joints
    still = replace(REFERENCE, p_WB=1e-17 * np.random.default_rng(0).normal(size=(41, 1, 3)))
    size = size_of_motion(MECHANISM, still)
    assert size == pytest.approx(max(np.linalg.norm(body.com), np.linalg.norm(joint.M.p)), rel=1e-15)
    assert np.max(difference_over_time(replace(still, p_WB=0 * still.p_WB), still, size)) < 1e-15
    bare = replace(
        MECHANISM, bodies=(replace(body, com=np.zeros(3)),), joints=(replace(joint, M=Frame(np.zeros(3), np.eye(3))),)
    )
    gyration = np.sqrt(np.max(np.linalg.eigvalsh(body.inertia)) / body.mass)
    assert size_of_motion(bare, still) == pytest.approx(gyration, rel=1e-14)


def test_a_reference_less_certain_than_the_digits_asked_decides_nothing():
    assert judge([0.0, 0.0, 0.0], spread=2e-8).verdict is Verdict.UNRESOLVED
    assert judge([0.0, 0.0, 0.0], spread=np.nan).verdict is Verdict.UNRESOLVED
    assert judge([0.0, 0.0, 0.0], spread=0.5e-8).verdict is Verdict.AGREES


def test_difference_is_distance_over_size_or_angle_whichever_is_larger():
    size = size_of_motion(MECHANISM, REFERENCE)
    np.testing.assert_allclose(
        difference_over_time(motion(0.3), REFERENCE, size), 0.3 * np.abs(SHAPE) / size, rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(
        difference_over_time(motion(0.0, 0.2, sign=-1.0), REFERENCE, size), 0.2 * np.abs(SHAPE), rtol=0, atol=1e-15
    )
    both = difference_over_time(motion(0.3, 0.9), REFERENCE, size)
    np.testing.assert_allclose(both, 0.9 * np.abs(SHAPE), rtol=0, atol=1e-15)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_observed_orders_are_those_of_the_errors(order):
    found = judge(powers(0.5 / 0.005**order * 1e-4, order), order)
    assert found.order == pytest.approx(order, abs=1e-6)
    assert found.self_order == pytest.approx(order, abs=1e-6)
    assert found.declared_order == order


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_richardson_limit_of_pure_powers_is_exact(order, sign):
    coarse, fine = motion(1e-3 * 2.0**order, 1e-5 * 2.0**order, sign), motion(1e-3, 1e-5)
    limit = richardson(coarse, fine, order)
    np.testing.assert_allclose(limit.p_WB, REFERENCE.p_WB, rtol=0, atol=1e-15)
    assert np.max(difference_over_time(limit, REFERENCE, 1.0)) < 1e-8  # rotations do not add exactly: (2^P 1e-5)^2
    np.testing.assert_allclose(np.linalg.norm(limit.quat_WB, axis=-1), 1.0, rtol=0, atol=1e-15)


def test_agrees_where_the_finest_level_has_the_digits_asked():
    found = judge(powers(1e-4, 2), digits=8)  # finest level: 0.73 * 1e-4 * 2.5e-5 = 1.8e-9
    assert found.verdict is Verdict.AGREES
    assert found.levels[-1].largest == pytest.approx(np.max(np.abs(SHAPE)) * 1e-4 * 0.005**2, rel=1e-6)
    assert found.digits == pytest.approx(-np.log10(found.levels[-1].largest))


@pytest.mark.parametrize(("spread", "verdict"), [(1e-8, Verdict.AGREES), (0.0, Verdict.DISCRETISATION)])
def test_the_spread_of_the_reference_is_granted(spread, verdict):
    largest = 1.5e-8 / np.max(np.abs(SHAPE)) / 0.005**2
    assert judge(powers(largest, 2), digits=8, spread=spread).verdict is verdict


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_differs_by_discretisation_where_the_limit_is_the_reference(order, turning):
    errors = powers(1e-3 / 0.005**order / 10, order)
    found = judge([0.0] * 3, order, turns=errors) if turning else judge(errors, order)
    assert found.verdict is Verdict.DISCRETISATION
    assert found.levels[-1].largest > 1e-5
    assert found.limit_digits > found.digits + 2
    # grid convergence index at the declared order: 1.25 |x3 - x2| / (2^P - 1), which is 1.25 times the error itself
    assert found.band == pytest.approx(1.25 * found.levels[-1].largest, rel=1e-3)


def test_unresolved_where_the_order_is_not_the_declared_one():
    found = judge(powers(0.1, 1), order=2)
    assert found.verdict is Verdict.UNRESOLVED
    assert "observed order 1.00, declared 2" in found.why
    change = 0.1 * 0.005 * np.max(np.abs(SHAPE))
    assert found.band == pytest.approx(3.0 * change / (2.0**1 - 1.0), rel=1e-6)  # safety factor 3, observed order 1


@pytest.mark.parametrize(("off", "verdict"), [(0.45, Verdict.DISCRETISATION), (0.55, Verdict.UNRESOLVED)])
def test_the_window_of_the_order_is_a_half(off, verdict):
    """Orders above the declared one: the Richardson limit is over-corrected, but lies within the band."""
    assert judge(powers(1.0, 2 + off), order=2).verdict is verdict


def test_unresolved_where_rounding_hides_the_order():
    found = judge([3e-12, 2e-12, 1.9e-12], digits=13)
    assert found.verdict is Verdict.UNRESOLVED
    assert "hidden by rounding" in found.why
    assert found.order is None


def test_the_order_is_read_where_rounding_does_not_hide_it():
    found = judge([4e-9, 1e-9, 5e-12], digits=13)
    assert found.order == pytest.approx(2.0, abs=1e-3)


def test_differs_in_the_model_where_the_levels_converge_to_something_else():
    """Levels converge with order 2 to a motion 1e-2 away: order and Richardson limit are sharp, the limit is wrong."""
    found = judge(powers(2.0, 2, plateau=1e-2), order=2)
    assert found.self_order == pytest.approx(2.0, abs=1e-6)
    assert found.levels[-1].largest > 5e-3
    assert found.verdict is Verdict.MODEL


@pytest.mark.parametrize(
    ("turns", "verdict"), [([0.1096, 0.1073, 0.1026], Verdict.UNRESOLVED), ([0.1026] * 3, Verdict.MODEL)]
)
def test_only_turns_that_the_levels_have_settled_blame_a_model(turns, verdict):
    """Beside displacements of order one: turns that fall faster with each halving, and such that stand."""
    assert judge(powers(3.0, 1), order=1, turns=turns).verdict is verdict


@pytest.mark.parametrize("plateau", [1e-6, 1e-4, 1e-2, 1.0])
def test_a_plateau_is_never_called_discretisation_once_it_stands_out(plateau):
    found = judge(powers(0.01 * plateau / 0.005**2, 2, plateau), order=2)
    assert found.verdict in (Verdict.MODEL, Verdict.UNRESOLVED)


def test_without_an_order_a_difference_is_one_of_the_model():
    found = judge([1e-3, 1e-5, 1e-6], order=None)
    assert found.verdict is Verdict.MODEL
    assert "no order to read" in found.why
    assert judge([1e-3, 1e-5, 1e-9], order=None).verdict is Verdict.AGREES


def test_a_motion_that_blew_up_is_judged_and_warns_of_nothing():
    found = judge([1e200, 1e170, 1e160])
    assert (found.verdict, found.rule) == (Verdict.UNRESOLVED, "not asymptotic")
    assert found.levels[-1].largest == np.inf  # the square of the error overflows


def test_a_single_level_has_no_order_and_no_limit():
    found = judge([1e-3], order=2)
    assert found.verdict is Verdict.MODEL
    assert (found.order, found.self_order, found.band, found.limit_digits) == (None, None, None, None)


def test_a_ladder_cut_short_blames_no_model_and_names_the_step_it_needs():
    """Levels that take 2.5 s and more are followed by none: 5 s is the limit of a further one."""
    for errors, words in (([1e-3], "a single level"), (powers(0.1, 1), "not asymptotic")):
        found = judge(errors, order=2, cpu=2.5)
        assert (found.verdict, found.rule) == (Verdict.UNRESOLVED, "not asymptotic")
        assert words in found.why
        assert f"the next level, at {STEPS[len(errors) - 1] / 2:.2g} s, would take" in found.why


@pytest.mark.parametrize(("cpu", "verdict"), [(0.1, Verdict.MODEL), (2.5, Verdict.UNRESOLVED)])
def test_a_ladder_cut_short_blames_no_model_just_beyond_its_band(cpu, verdict):
    """A plateau of 1.6 bands: the band of order one is 5/4 of the last change."""
    assert judge(powers(1.0, 1, plateau=-1.6 * 1.25 * 0.005), order=1, cpu=cpu).verdict is verdict


def test_levels_keep_their_step_cost_and_curve():
    found = judge(powers(1.0, 2))
    assert [level.step for level in found.levels] == list(STEPS)
    assert [level.cpu for level in found.levels] == [1.0, 2.0, 3.0]
    assert len(found.times) == len(found.levels[0].difference) == len(found.levels[0].energy) == 41
    curve = np.array(found.levels[0].difference)
    np.testing.assert_allclose(curve, STEPS[0] ** 2 * np.abs(SHAPE), rtol=0, atol=1e-15)
    assert found.levels[0].rms == pytest.approx(np.sqrt(np.mean(curve**2)))


def test_energy_is_recomputed_from_the_motion():
    """A displacement d along z adds ``-m g_z d``; energy errors are relative to the largest exact kinetic energy."""
    size, body, g = size_of_motion(MECHANISM, REFERENCE), MECHANISM.bodies[0], MECHANISM.gravity
    change = np.array(judge([0.05]).levels[0].energy) - np.array(judge([0.0]).levels[0].energy)
    quats = REFERENCE.quat_WB[:, 0]
    kinetic = []
    for q, v in zip(quats, REFERENCE.v_WB_W[:, 0], strict=True):
        R = rotation_from_quaternion(q)
        v_com = v + np.cross([0, 0, 1.0], R @ body.com)
        kinetic.append(0.5 * body.mass * v_com @ v_com + 0.5 * (R @ body.inertia @ R.T)[2, 2])
    np.testing.assert_allclose(change, -body.mass * g[2] * 0.05 * size * SHAPE / np.max(kinetic), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("count", "kept"), [(1, [0]), (5, [0, 1, 2, 3, 4]), (1001, list(range(0, 1001, 10)))])
def test_kept_samples_are_spread_from_end_to_end(count, kept):
    assert kept_samples(count) == kept


def test_spread_of_the_reference_is_the_largest_difference_to_its_first_answer():
    size = size_of_motion(MECHANISM, REFERENCE)
    found = reference_spread(MECHANISM, [REFERENCE, motion(1e-9 * size), motion(0.0, 3e-9)])
    assert found == pytest.approx(3e-9 * np.max(np.abs(SHAPE)), rel=1e-5)
    assert reference_spread(MECHANISM, [REFERENCE]) == 0.0


# ---------------------------------------------------------------- instant

PLAIN = Method("m", Route.NATIVE)
RNG = np.random.default_rng(3)
ANSWER = InstantAnswer(
    *(RNG.normal(size=(2, 2, 3)) for _ in range(4)), kinetic=np.array([2.0, 5.0]), potential=np.array([-3.0, 4.0])
)
KNOWN = np.ones((2, 2, 6), dtype=bool)
INSTANTS = Instants(
    np.array([1.0, 1.0]),
    KNOWN,
    mass=2.0,
    gravity=9.81,
    characteristic_length=1.0,
    spin=0.0,
    speed=0.0,
    driven=0.0,
    weights=0.0,
    swings=0.0,
    bodies=2,
)


def shifted(name, by, index=(1, 0, 2)):
    """Return the answer with one value shifted by a multiple of the largest component of its own scale."""
    value = getattr(ANSWER, name).copy()
    partner = {"a_WB_W": "alpha_WB_W", "alpha_WB_W": "a_WB_W", "force_F": "torque_F", "torque_F": "force_F"}.get(name)
    if partner is None:
        value[index[0]] += by * np.max(np.abs(value))
    else:
        value[index] += by * max(np.max(np.abs(x[index[0]])) for x in (value, getattr(ANSWER, partner)))
    return replace(ANSWER, **{name: value})


def instant(answer, instants=INSTANTS, method=PLAIN, reference=ANSWER):
    return compare_instant("c", "e", method, answer, reference, instants)


QUANTITIES = {
    "a_WB_W": ("accelerations", 1e-11),
    "alpha_WB_W": ("accelerations", 1e-11),
    "force_F": ("reactions", 1e-10),
    "torque_F": ("reactions", 1e-10),
    "kinetic": ("kinetic energy", 1e-12),
    "potential": ("potential energy", 1e-12),
}


@pytest.mark.parametrize(("name", "most"), [("a_WB_W", 1e-6), ("torque_F", 1e-5)])
@pytest.mark.parametrize("touching", [True, False])
@pytest.mark.parametrize("route", [Route.NATIVE, Route.HARNESS_SOLVE])
def test_where_something_touches_an_engine_s_solver_may_be_off_but_does_not_pass(name, most, touching, route):
    """Bars are those of smooth mechanisms; what is missed by no more than bars of pushing contacts blames no model."""
    own, method = touching and route is Route.NATIVE, replace(PLAIN, route=route)
    for by, unresolved in ((0.9 * most, own), (1.2 * most, False)):
        found = instant(shifted(name, by), replace(INSTANTS, touching=touching), method)
        assert found.verdict is (Verdict.UNRESOLVED if unresolved else Verdict.MODEL)
        assert found.rule == ("contact solver" if unresolved else "")
    found = instant(shifted("kinetic", 1e-9), replace(INSTANTS, touching=touching), method)
    assert found.verdict is Verdict.MODEL


def test_equal_answers_agree_to_all_digits():
    found = instant(ANSWER)
    assert (found.verdict, found.digits) == (Verdict.AGREES, 16.0)


@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize(("factor", "verdict"), [(0.9, Verdict.AGREES), (1.2, Verdict.MODEL), (-1.2, Verdict.MODEL)])
def test_each_quantity_is_held_to_its_bar(name, factor, verdict):
    quantity, bar = QUANTITIES[name]
    found = instant(shifted(name, factor * bar))
    assert found.verdict is verdict
    assert found.why.startswith(f"{quantity}: difference ")
    (one,) = [q for q in found.quantities if q.name == quantity]
    assert one.difference == pytest.approx(abs(factor) * bar, rel=1e-2)
    assert found.digits == pytest.approx(-np.log10(abs(factor) * bar), abs=1e-2)


@pytest.mark.parametrize("name", QUANTITIES)
def test_a_value_that_is_no_number_never_meets_a_bar(name):
    found = instant(shifted(name, np.nan))
    assert found.verdict is Verdict.MODEL
    assert found.why.startswith(QUANTITIES[name][0])


def test_the_bar_of_accelerations_grows_with_the_condition_of_the_mass_matrix():
    ill = replace(INSTANTS, condition=np.array([1.0, 1e5]))
    bar = 1e-11 + 4 * EPS * 1e5
    assert instant(shifted("a_WB_W", 0.9 * bar), ill).verdict is Verdict.AGREES
    assert instant(shifted("a_WB_W", 1.2 * bar), ill).verdict is Verdict.MODEL
    # the condition number of the same state counts, not that of another
    assert instant(shifted("a_WB_W", 0.9 * bar, index=(0, 0, 2)), ill).verdict is Verdict.MODEL


@pytest.mark.parametrize(("name", "bar"), [("a_WB_W", 1e-8), ("force_F", 1e-7), ("kinetic", 1e-12)])
def test_extrapolated_answers_have_bars_of_their_own(name, bar):
    method = Method("m", Route.EXTRAPOLATED)
    assert instant(shifted(name, 0.9 * bar), method=method).verdict is Verdict.AGREES
    assert instant(shifted(name, 1.2 * bar), method=method).verdict is Verdict.MODEL


def test_reactions_that_are_not_determined_are_not_compared():
    known = KNOWN.copy()
    known[1, 0, 2] = known[0, 1, 4] = False
    instants = replace(INSTANTS, determined=known)
    found = instant(shifted("force_F", 100.0), instants)
    assert found.verdict is Verdict.AGREES
    (reactions,) = [q for q in found.quantities if q.name == "reactions"]
    assert reactions.count == 22
    assert reactions.remark.startswith("2 ")
    assert instant(shifted("force_F", 100.0, index=(1, 1, 2)), instants).verdict is Verdict.MODEL


def test_a_method_without_reactions_is_judged_by_the_rest_and_says_so():
    found = instant(replace(ANSWER, force_F=None, torque_F=None))
    assert found.verdict is Verdict.AGREES
    (reactions,) = [q for q in found.quantities if q.name == "reactions"]
    assert (reactions.count, reactions.remark) == (0, "this method gives none")
    worse = replace(shifted("a_WB_W", 1e-3), force_F=None, torque_F=None)
    assert instant(worse).verdict is Verdict.MODEL


def test_a_state_without_load_is_measured_by_the_others():
    """Reactions at one state vanish up to rounding: differences of rounding size agree, larger ones do not."""
    quiet = ANSWER.force_F.copy(), ANSWER.torque_F.copy()
    for x in quiet:
        x[1] = 1e-16
    reference = replace(ANSWER, force_F=quiet[0], torque_F=quiet[1])
    noisy = replace(reference, force_F=reference.force_F + 1e-15)
    assert instant(noisy, reference=reference).verdict is Verdict.AGREES
    wrong = replace(reference, force_F=reference.force_F + np.array([0.0, 1e-3])[:, None, None])
    assert instant(wrong, reference=reference).verdict is Verdict.MODEL


@pytest.mark.parametrize(
    ("found", "expected", "floor", "difference"),
    [
        ([1.0, 2.0], [1.0, 2.5], 0.0, 0.2),
        ([0.0, 0.0], [0.0, 0.0], 0.0, 0.0),
        ([0.0, 1e-300], [0.0, 0.0], 0.0, np.inf),
        ([0.0, 1e-3], [0.0, 0.0], 10.0, 1e-4),
        ([], [], 0.0, 0.0),
    ],
)
def test_relative_difference_is_over_the_largest_component(found, expected, floor, difference):
    assert relative_difference(found, expected, floor) == pytest.approx(difference, rel=1e-12)


@pytest.mark.parametrize(("difference", "digits"), [(0.0, 16.0), (1e-20, 16.0), (1e-5, 5.0), (1.0, 0.0), (50.0, 0.0)])
def test_digits_are_minus_the_logarithm_from_none_to_sixteen(difference, digits):
    assert digits_of(difference) == pytest.approx(digits, abs=1e-12)


@pytest.mark.parametrize(("difference", "met"), [(1.0, True), (1.1, False), (np.nan, False), (np.inf, False)])
def test_a_bar_is_met_up_to_and_with_its_value_and_never_by_nan(difference, met):
    assert Quantity("q", difference, 1.0, 1).met is met


# ---------------------------------------------------------------- model

MODEL = ModelAnswer(4.0, np.array([0.1, -0.2, 0.3]), np.diag([1.0, 2.0, 2.5]), 3)


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"mass": 4.0 * (1 + 2e-12)}, "total mass"),
        ({"com": MODEL.com + np.array([0, 0, 4e-12])}, "centre of mass"),
        ({"inertia": MODEL.inertia + 4e-12 * np.eye(3)[[1, 0, 2]]}, "inertia of the whole"),
        ({"freedom": 4}, "degrees of freedom"),
        ({"freedom": 2}, "degrees of freedom"),
        ({"mass": np.nan}, "total mass"),
    ],
)
def test_each_part_of_the_model_is_held_to_its_bar(changes, quantity):
    found = compare_model("c", "e", PLAIN, replace(MODEL, **changes), MODEL, 2.0)
    assert found.verdict is Verdict.MODEL
    assert found.why.startswith(quantity)


def test_a_centre_of_mass_at_the_origin_is_measured_by_the_mechanism():
    reference = replace(MODEL, com=np.zeros(3))
    near = replace(MODEL, com=np.array([0, 1e-12, 0]))
    assert compare_model("c", "e", PLAIN, near, reference, 2.0).verdict is Verdict.AGREES
    assert compare_model("c", "e", PLAIN, near, reference, 0.5).verdict is Verdict.MODEL
    assert compare_model("c", "e", PLAIN, MODEL, MODEL, 2.0).verdict is Verdict.AGREES


def test_verdicts_stand_from_best_to_worst():
    assert [str(v) for v in Verdict] == [
        "agrees",
        "differs: discretisation",
        "differs: regularisation",
        "unsupported",
        "unresolved",
        "differs: model",
        "failed",
    ]


VANISHING = {  # quantity -> scale of its rounding where the quantity vanishes
    ("a_WB_W", "alpha_WB_W"): lambda: INSTANTS.gravity,
    ("force_F", "torque_F"): lambda: INSTANTS.mass * np.max(np.abs(ANSWER.a_WB_W)),
    ("potential",): lambda: np.max(ANSWER.kinetic),
    ("kinetic",): lambda: np.max(np.abs(ANSWER.potential)),
}


@pytest.mark.parametrize("names", VANISHING, ids=lambda names: names[0])
def test_rounding_of_a_quantity_that_vanishes_is_no_difference_and_more_is(names):
    size = VANISHING[names]()
    nothing = replace(ANSWER, **{name: 0.0 * getattr(ANSWER, name) for name in names})
    noise = replace(nothing, **{name: getattr(nothing, name) + 1e-17 * size for name in names})
    wrong = replace(nothing, **{name: getattr(nothing, name) + 1e-8 * size for name in names})
    assert instant(noise, reference=nothing).verdict is Verdict.AGREES
    assert instant(wrong, reference=nothing).verdict is Verdict.MODEL


def test_at_a_state_without_load_the_other_states_give_the_scale():
    """A rod carries no load at the instant of release: rounding is compared with other states, or with weights."""
    released = ANSWER.force_F.copy(), ANSWER.torque_F.copy()
    for array in released:
        array[0] = 0.0
    reference = replace(ANSWER, force_F=released[0], torque_F=released[1])
    size = max(*(np.max(np.abs(x[1])) for x in released), INSTANTS.inertial(ANSWER))
    for shift, verdict in ((1e-16, Verdict.AGREES), (0.9e-12, Verdict.AGREES), (1.1e-12, Verdict.MODEL)):
        force = released[0].copy()
        force[0, 0, 0] = shift * size
        assert instant(replace(reference, force_F=force), reference=reference).verdict is verdict


@pytest.mark.parametrize(
    ("events", "since"),
    [
        ([("opens", 0)], 1.5),
        ([("slips", 0)], 1.5),
        ([("slips", 1)], 0.0),
        ([("slips", 2)], 0.0),
        ([("sticks", 0), ("slips", 0)], 0.0),
        ([("slips", 1), ("slips", 1)], 1.5),
    ],
    ids=["opens", "reverses", "begins to slip", "dry friction", "stops before it slips", "begins, then reverses"],
)
def test_what_opens_or_reverses_is_off_from_then_on(events, since):
    """One contact slides from the start, another sticks; the third is dry friction. Events are at 0.5 s of 2 s."""
    kinds, places = zip(*events, strict=True)
    answer = replace(
        REFERENCE,
        contact_mode=np.tile([CONTACT_MODES.index(mode) for mode in ("sliding", "sticking")], (len(TIMES), 1)),
        event_time=np.full(len(events), 0.5),
        event_contact=np.array(places),
        event_kind=np.array([EVENT_KINDS.index(kind) for kind in kinds]),
    )
    motion = ReferenceMotion(answer, np.zeros(len(TIMES)), 8)
    assert motion.since_departures(2.0) == since


# ---------------------------------------------------------------- softness at an instant


def softened(by, scales, reference=ANSWER):
    """Return the answers at softness 1, and at `scales`, with accelerations wrong by the function `by` of softness."""
    off = [replace(reference, a_WB_W=reference.a_WB_W + by(s) * INSTANTS.gravity) for s in (1.0, *scales)]
    return off[0], off[1:]


@pytest.mark.parametrize("profile", Profile)
@pytest.mark.parametrize(
    ("by", "verdict"),
    [
        (lambda s: 1e-14 * s, Verdict.AGREES),
        (lambda s: 1e-3 * s, Verdict.REGULARISATION),
        (lambda s: 1e-3 * s**2, Verdict.REGULARISATION),
        (lambda s: 1e-3 + 1e-6 * s, Verdict.MODEL),
        (lambda s: 1e-3 + 1e-3 * s, Verdict.UNRESOLVED),
    ],
)
def test_softness_at_an_instant(by, verdict, profile):
    answer, others = softened(by, SCALES[profile])
    found = compare_instant("c", "e", replace(PLAIN, profile=profile), answer, ANSWER, INSTANTS, others)
    assert found.verdict is verdict, found.why
    assert found.softness is not None


def pulled(answers, by):
    """Return answers at softness 1, 2 and 4 with reactions off by the function `by` of softness."""
    return [replace(a, force_F=a.force_F * (1.0 + by(s))) for a, s in zip(answers, (1.0, 2.0, 4.0), strict=True)]


@pytest.mark.parametrize("accelerations", [lambda s: 1e-3 * s, lambda s: 1e-14 * s], ids=["missed", "met"])
@pytest.mark.parametrize(
    ("by", "verdict"),
    [
        (lambda s: 1e-3 * s, Verdict.REGULARISATION),
        (lambda s: 1e-3, Verdict.MODEL),
        (lambda s: 1e-3 + 1e-3 * s, Verdict.UNRESOLVED),
    ],
)
def test_softness_explains_each_quantity_that_misses_its_bar(accelerations, by, verdict):
    """Forces of a joint about another axis differ where accelerations do not: soft constraints are no excuse."""
    answer, others = softened(accelerations, SCALES[Profile.MATCHED])
    found, *softer = pulled([answer, *others], by)
    judged = compare_instant("c", "e", PLAIN, found, ANSWER, INSTANTS, softer)
    assert judged.verdict is verdict, judged.why


def test_softness_explains_no_energy():
    answer, others = softened(lambda s: 1e-3 * s, SCALES[Profile.MATCHED])
    wrong = replace(answer, kinetic=answer.kinetic * 1.1)
    assert compare_instant("c", "e", PLAIN, wrong, ANSWER, INSTANTS, others).verdict is Verdict.MODEL


def test_accelerations_that_vanish_are_compared_with_the_speed():
    """A slide without forces keeps its velocity: of a = 0, rounding is no difference, and v^2 / L / 1e9 is one."""
    draw = cs.Drawing("sled", gravity=(0, 0, 0))
    draw.body("a", cs.block((0.3, 0.2, 0.1)), mass=2.0)
    draw.joint("slide", "prismatic", "ground", "a", at=(0, 0, 0), axis=(1, 2, 2))
    mechanism = draw.mechanism()
    state = cs.initial_state(mechanism, cs.Initial(rates={"slide": {"distance": 0.05}}))
    instants, answer = Instants.of(mechanism, [state]), cs.accelerations(mechanism, [state])
    for size, verdict in ((1e-18, Verdict.AGREES), (0.05**2 / instants.characteristic_length / 1e9, Verdict.MODEL)):
        off = replace(answer, a_WB_W=answer.a_WB_W + size)
        assert compare_instant("c", "e", PLAIN, off, answer, instants).verdict is verdict


def test_velocities_of_joints_that_cancel_widen_the_bar_of_the_kinetic_energy():
    """Of a rod about a pin, m v w r / 2 is the energy of translation; of a rod that turns against it, far more."""
    draw = cs.Drawing("rods", gravity=(0, 0, 0))
    draw.body("a", cs.bar((0, 0, 0), (2, 0, 0), radius=0.01), mass=1.0)
    draw.body("b", cs.bar((2, 0, 0), (1.9, 0, 0), radius=0.01), mass=3.0)
    draw.joint("pin", "revolute", "ground", "a", at=(0, 0, 0), axis=(0, 1, 0))
    draw.joint("elbow", "revolute", "a", "b", at=(2, 0, 0), axis=(0, 1, 0))
    mechanism = draw.mechanism()
    # the elbow moves with 2 m/s, the centre of b with 2 - 0.05 w_b
    for turning, ratio in ((1.0, 1.0), (38.0, 30.0)):
        start = cs.Initial(rates={"pin": {"angle": 1.0}, "elbow": {"angle": turning - 1.0}})
        state = cs.initial_state(mechanism, start)
        swings = Instants.of(mechanism, [state]).swings
        v = np.linalg.norm(state.v_WB_W + np.cross(state.w_WB_W, [[1.0, 0, 0], [1.95, 0, 0]]), axis=1)
        w = np.max(np.linalg.norm(state.w_WB_W, axis=1))
        assert swings == pytest.approx(0.5 * (1.0 * v[0] * w * 1.0 + 3.0 * v[1] * w * 1.95), rel=1e-12)
        assert swings >= 0.9 * ratio * 0.5 * (v[0] ** 2 + 3.0 * v[1] ** 2)


@pytest.mark.parametrize(("case", "together"), [("balls_touching", 0.1), ("balls_apart", np.inf)])
def test_an_impact_of_several_contacts_is_noticed(case, together):
    """The first ball, 0.1 m away at 1 m/s, hits two that touch; apart they are hit one after the other."""
    answer = cs.simulate(cs.load_case(case))
    assert ReferenceMotion(answer, np.zeros(len(answer.time)), 8).joint_impact == pytest.approx(together, abs=1e-11)


def first_joint_impact(found):
    return ReferenceMotion(found, np.zeros(len(found.time)), 8).joint_impact


@pytest.mark.parametrize("last", [1.0, 0.0])
def test_contacts_that_stay_closed_take_part_in_an_impact(last):
    """A ball strikes two that touch, e = 1: it leaves with -1/3 of its speed, they stay together, pressed, with 2/3."""
    draw = cs.Drawing("line", gravity=(0, 0, 0))
    places = {"a": -0.3, "b": 0.0, "c": 0.2}
    for name, x in places.items():
        draw.body(name, mass=2.0, inertia=(0.01, 0.01, 0.01), at=(x, 0, 0))
        draw.joint(f"track_{name}", "prismatic", "ground", name, at=(x, 0, 0), axis=(1, 0, 0))
    for one, other, e in (("a", "b", 1.0), ("b", "c", last)):
        balls = {"at": (places[other], 0, 0), "partner_at": (places[one], 0, 0), "radius": 0.1, "partner_radius": 0.1}
        draw.add("contact", f"{one}{other}", body=other, partner=one, restitution=e, **balls)
    draw.add("force", "pressed", body="c", vector=(-1e-6, 0, 0), frame="world", at=(0.2, 0, 0))
    found = cs.simulate(draw.case(rates={"track_a": 1.0}, duration=0.2, sample=0.04))
    assert found.v_WB_W[-1, :, 0] == pytest.approx([-1 / 3, 2 / 3, 2 / 3], abs=1e-6)
    assert len(found.event_time) == 1
    assert first_joint_impact(found) == pytest.approx(0.1, abs=1e-6)


def test_a_floor_that_bears_a_weight_takes_no_part_in_an_impact_on_a_wall():
    draw = cs.Drawing("alley", gravity=(0, 0, -9.81))
    draw.body("ball", mass=2.0, inertia=(0.01, 0.01, 0.01), at=(0, 0, 0.1))
    draw.joint("flight", "free", "ground", "ball", at=(0, 0, 0.1))
    ball = {"body": "ball", "at": (0, 0, 0.1), "radius": 0.1, "restitution": 0.5}
    draw.add("contact", "floor", point=(0, 0, 0), normal=(0, 0, 1), **ball)
    draw.add("contact", "wall", point=(0.2, 0, 0), normal=(-1, 0, 0), **ball)
    found = cs.simulate(draw.case(rates={"flight": {"position": [1.0, 0.0, 0.0]}}, duration=0.2, sample=0.04))
    assert found.v_WB_W[-1, 0] == pytest.approx([-0.5, 0.0, 0.0], abs=1e-12)
    assert first_joint_impact(found) == np.inf


@pytest.mark.parametrize("name", ["impacts that scatter", "impacts, another restitution"])
def test_a_verdict_behind_an_impact_of_several_contacts_says_that_any_gap_changes_it(name):
    (situation,) = (each for each in SITUATIONS if each.name == name)
    one, two = situation.judge(), replace(situation, contacts=2).judge()
    assert one.rule == two.rule
    assert (
        two.why
        == f"{one.why} (several contacts take part in the impact at 0.5 s: after any gap another motion follows)"
    )
