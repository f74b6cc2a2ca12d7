"""Power of comparisons: errors of parameters, the smallest that would have been noticed, cells that notice nothing."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case, load_case
from consilience.compare.evidence import Evidence
from consilience.compare.judge import judge_case
from consilience.compare.motion import size_of_motion
from consilience.compare.power_of_bars import with_power
from consilience.compare.result import Quantity, Verdict, compare_by_bars
from consilience.compare.rules import NO_POWER, decide
from consilience.engine import Method, Question, Route, Run, Status
from consilience.engine.worker.client import InProcessEngine
from consilience.mechanism import (
    Initial,
    Perturbation,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    initial_state,
    physical_parameters,
)
from consilience.mechanism.perturbation import AXIS, COEFFICIENT, PLACE
from consilience.report.exports import spreadsheet
from consilience.report.recordschema import checked
from consilience.report.view import page
from consilience.suite.engine_runs import ask_case
from mechanisms import chain, coupled, driven, four_bar, powered, rolling
from records import comparison, record_of

REFERENCE = InProcessEngine("reference")
SIZE = 1e-4


def asked(mechanism, initial):
    case = Case("c", "c.toml", "t", mechanism, initial, 0.8, 0.1, 8, 3, seed=5)
    return case, list(ask_case(REFERENCE, case, tuple(Question)))


def judged(mechanism, initial):
    """Comparisons of an engine that answers as the reference does, one for each question."""
    case, runs = asked(mechanism, initial)
    engine = [replace(r, engine="e") for r in runs if r.perturbation is None and "displaced" not in r.method.settings]
    found = {c.question: c for c in reversed(judge_case(case, [*runs, *engine])) if c.engine == "e"}
    return [found[question] for question in (Question.MODEL, Question.INSTANT, Question.TRAJECTORY)]


def motion_size(mechanism, initial):
    _, runs = asked(mechanism, initial)
    return size_of_motion(mechanism, next(r.answer for r in runs if r.question is Question.TRAJECTORY))


@pytest.mark.parametrize(
    "kind", ["revolute", "prismatic", "cylindrical", "universal", "spherical", "planar", "screw", "point_on_line"]
)
def test_a_joint_is_moved_where_it_is(kind):
    """Moved in both bodies at once, a joint holds the pose of the start, and no longer any other."""
    mechanism = chain(kind, kind, seed=3)
    start = initial_state(mechanism)
    for parameter in physical_parameters(mechanism, start):
        if parameter.kind in (PLACE, AXIS):
            changed = parameter.change(mechanism, 0.1)
            assert np.max(np.abs(constraint_residual(changed, start))) < 1e-12
            frames = [
                np.ptp([a.F.p - b.F.p, a.F.R[0] - b.F.R[0]])
                for a, b in zip(changed.joints, mechanism.joints, strict=True)
            ]
            assert sorted(f > 1e-3 for f in frames) == [False, True]


@pytest.mark.parametrize("mechanism", [powered(), driven(), coupled(), rolling()], ids=lambda m: m.name)
def test_coefficients_are_parameters_and_their_states_are_assembled(mechanism):
    start = initial_state(mechanism)
    found = [p for p in physical_parameters(mechanism, start) if p.kind == COEFFICIENT]
    assert found
    for parameter in found:
        changed, (state,) = parameter.perturbed(mechanism, [start], SIZE)
        assert np.max(np.abs(constraint_residual(changed, state))) < 1e-12
        v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
        assert np.max(np.abs(constraint_jacobian(changed, state) @ v - constraint_rates(changed))) < 1e-12


def test_an_axis_that_would_lock_a_loop_is_no_parameter():
    mechanism = four_bar()
    start = initial_state(mechanism)
    kinds = {p.kind: p.perturbed(mechanism, [start], SIZE) for p in physical_parameters(mechanism, start)}
    assert kinds[AXIS] is None
    assert kinds[PLACE] is not None


def test_a_fall_depends_on_gravity_alone():
    """Mass does not act on a fall from rest, nor inertia [Galilei].

    The fall is g t^2 / 2: its change over its length is the relative error of gravity. Potential energy and
    accelerations are in proportion to gravity, energies and the total mass to the mass.
    """
    mechanism = chain("free", seed=6)
    model, instant, motion = judged(mechanism, Initial())
    assert {p.kind: p.limit for p in model.power}["mass"] == pytest.approx(1e-12, rel=1e-3)
    limits = {p.kind: p.limit for p in instant.power}
    assert (limits["gravity"], limits["mass"]) == pytest.approx((1e-12, 1e-12), rel=1e-3)
    (power,) = motion.power
    length = 0.5 * np.linalg.norm(mechanism.gravity) * 0.8**2
    assert (power.kind, power.of) == ("gravity", "gravity")
    assert power.limit == pytest.approx(1e-8 * motion_size(mechanism, Initial()) / length, rel=1e-3)


def test_a_tumbling_body_shows_one_moment_and_not_all():
    """A common factor of the moments cancels in Euler's equations; the largest alone does not."""
    mechanism = chain("free", seed=6)
    spin = {mechanism.bodies[0].name: (np.zeros(3), np.array([0.3, -2.0, 1.1]))}
    (*_, motion) = judged(mechanism, Initial(velocities=spin))
    assert [p.of for p in motion.power] == ["gravity", "largest moment of inertia of body 'b0'"]


@pytest.mark.parametrize("seed", range(3))
def test_the_largest_moment_is_off_by_the_size_and_the_body_remains_one(seed):
    mechanism = chain("free", seed=seed)
    (largest,) = (p for p in physical_parameters(mechanism, initial_state(mechanism)) if "largest" in p.of)
    before, after = mechanism.bodies[0].inertia, largest.change(mechanism, 0.3).bodies[0].inertia
    moments, axes = np.linalg.eigh(before)
    change = np.diag(axes.T @ (before - after) @ axes) / moments[2]
    np.testing.assert_allclose(change, [0.0, 0.3, 0.3], atol=1e-12)


def test_a_motion_that_nothing_acts_on_has_no_power_and_no_verdict_against_it():
    mechanism = chain("rigid", seed=8)
    (*_, motion) = judged(mechanism, Initial())
    assert (motion.power, motion.verdict) == ((), Verdict.AGREES)


def compared(*quantities, power=()):
    return replace(compare_by_bars("c", "e", Question.INSTANT, Method("m", Route.NATIVE), quantities), power=power)


def test_a_bar_that_the_condition_makes_wide_is_no_agreement():
    wide = with_power(compared(Quantity("accelerations", 1.3e-2, 5e-2, 6)), (), lambda _: ())
    assert (wide.verdict, wide.rule) == (Verdict.UNRESOLVED, NO_POWER)
    near = with_power(compared(Quantity("accelerations", 1e-9, 5e-2, 6)), (), lambda _: ())
    assert near.verdict is Verdict.AGREES
    missed = with_power(compared(Quantity("accelerations", 0.1, 5e-2, 6)), (), lambda _: ())
    assert missed.verdict is Verdict.MODEL


def test_a_difference_beyond_a_bar_without_a_digit_blames_no_model():
    wide, energy = Quantity("accelerations", 2.9, 0.44, 6), Quantity("kinetic energy", 1e-9, 1e-12, 1)
    found = with_power(compared(wide), (), lambda _: ())
    assert (found.verdict, found.rule) == (Verdict.UNRESOLVED, NO_POWER)
    assert with_power(compared(wide, energy), (), lambda _: ()).verdict is Verdict.MODEL


def test_an_answer_by_bars_that_shows_no_error_is_unresolved():
    run = Run("c", "reference", Question.INSTANT, None, 0, None, Status.ANSWERED)
    run = replace(run, perturbation=Perturbation("gravity", "gravity", SIZE))
    own = compared(Quantity("accelerations", 1e-9, 0.2, 6))
    blind = with_power(own, [run], lambda _: (Quantity("accelerations", SIZE, 0.2, 6),))
    assert (blind.verdict, blind.rule) == (Verdict.UNRESOLVED, NO_POWER)
    assert blind.power[0].limit == pytest.approx(0.2)
    assert with_power(own, [run], lambda _: (Quantity("kinetic energy", SIZE, 0.05, 6),)).verdict is Verdict.AGREES
    assert with_power(own, [run], lambda _: (Quantity("accelerations", 0.0, 0.2, 6),)).power == ()


def stating(*powers):
    return comparison("c", "alpha", "trajectory", power=[{"kind": k, "of": o, "limit": x} for k, o, x in powers])


def test_a_cell_says_what_it_would_have_noticed_and_what_not():
    seen = ("gravity", "gravity", 2e-5)
    view = page(
        record_of([stating(seen, ("joint axis", "axis of joint 'pin'", 3e-4), ("mass", "mass of body 'bob'", None))])
    )
    (cell,) = (cell for cell in view.cells if cell.engine == "alpha")
    (answer,) = cell.answers
    assert [(fact.name, fact.value, fact.note) for fact in answer.power] == [
        ("gravity", "off by 0.002 %", ""),
        ("axis of joint 'pin'", "off by 0.0003 rad", ""),
        ("mass of body 'bob'", "off by more than 10 %", "would pass"),
    ]
    assert cell.blind
    (cell,) = (cell for cell in page(record_of([stating(seen)])).cells if cell.engine == "alpha")
    assert not cell.blind


def test_the_export_has_a_column_of_it_and_earlier_records_are_read():
    (row,) = spreadsheet.rows(record_of([stating(("gravity", "gravity", 2e-5), ("mass", "mass of body 'bob'", None))]))
    assert row["power"] == "gravity: 2e-05; mass of body 'bob': inf"
    line = comparison("c", "alpha", "trajectory")
    del line["power"]
    assert checked(line)["power"] == []


def test_contact_forces_have_power_at_the_first_states():
    """Errors are asked about at fewer states than the engine: masks of forces must be those of the same states."""
    case = replace(load_case("rocking_block"), instants=4)
    runs = list(ask_case(REFERENCE, case, (Question.INSTANT,)))
    assert min(len(r.answer.kinetic) for r in runs if r.perturbation is not None) < 4
    engine = [replace(r, engine="e") for r in runs if r.perturbation is None]
    found = next(c for c in judge_case(case, [*runs, *engine]) if c.engine == "e")
    assert found.verdict is Verdict.AGREES
    assert {power.kind for power in found.power} >= {"gravity"}


@pytest.mark.parametrize("steps", [1.5, 2.3, 3.0, 3.9, 5.0, 20.0])
def test_twice_the_stated_error_does_not_pass_where_it_cancels_the_error_of_the_steps(steps):
    """Levels err by E, 4 E, 16 E and another model by d: the finest by E + d, the limit at order two by d."""

    def passed(d):
        levels = {"limit": abs(d), "band": 1.25 * steps, "remains": abs(d), "order": 2.0, "declared": 2}
        evidence = Evidence(1.0, 1.0, 1.0, reference=0.0, finest=abs(steps + d), asymptotic=True, **levels)
        return evidence.passes, decide(evidence)[0].verdict in (Verdict.AGREES, Verdict.DISCRETISATION)

    stated, honest = passed(0.0)
    assert honest
    assert not any(passed(factor * stated)[1] for factor in (-3.0, -2.01, 2.01, 3.0))
    assert all(passed(factor * stated)[1] for factor in (-0.3, 0.3))
