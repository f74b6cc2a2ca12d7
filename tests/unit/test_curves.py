"""Curves of a motion: drawn extremes are those of the motion, or say how far they may be off."""

import json
from dataclasses import replace

import numpy as np
import pytest

import consilience as cs
from consilience.case import load_case, load_cases
from consilience.engine import Question, TrajectoryAnswer
from consilience.errors import InvalidInput
from consilience.report.curves import KEPT, KINDS, CurveKind, CurveSet, curve_sets, thinned
from consilience.report.figure import GREY
from consilience.report.plots_replay import motion_figure
from consilience.report.replay import replays
from consilience.suite import QUICK, densely_sampled, run_suite, simulate_case
from mechanisms import chain
from peaks import errors


def passing(count, width):
    """Return a body that never turns, with a bell of `width` s in its velocity along x and a constant along z."""
    time = np.linspace(0.0, 1.0, count)
    v = np.zeros((count, 1, 3))
    v[:, 0, 0] = 3918.0 * np.exp(-(((time - 0.3701) / width) ** 2)) + 100.0
    v[:, 0, 2] = 7.0
    quats = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1, 1))
    return TrajectoryAnswer(time, np.zeros_like(v), quats, v, np.zeros_like(v))


def velocities(answer):
    return next(curve_sets(chain("revolute"), answer, ["velocities"]))


def test_a_narrow_peak_is_drawn_at_its_height():
    """A bell of 12 ms, between samples of 8 ms at the first stride: its height is 4018."""
    found = velocities(passing(1025, 0.012))
    assert np.max(found.values[:, 0]) == pytest.approx(4018.0, rel=0.01)
    assert not found.marks
    assert len(found.time) < 200


def test_a_peak_between_the_first_samples_is_found_where_velocities_change_most():
    """A bell of 1 ms between samples of 8 ms, on samples of 1 ms: the largest of them is drawn, and marked as open."""
    answer = passing(1025, 0.001)
    found = velocities(answer)
    assert np.max(found.values[:, 0]) == np.max(answer.v_WB_W[:, 0, 0]) > 2000.0
    assert found.marks


def test_a_peak_that_the_samples_do_not_settle_is_marked():
    """Samples of 25 ms, a bell of 20 ms: the largest sample is below the height by no more than is said."""
    answer = passing(41, 0.02)
    found = velocities(answer)
    (mark,) = found.marks.values()
    assert found.open[0] >= 1.0 - np.max(answer.v_WB_W[:, 0, 0]) / 4018.0 > 0.01
    assert mark.startswith("peak may be off by")
    assert list(found.open[1:]) == [0.0, 0.0]
    assert mark in motion_figure(found, None, [])["layout"]["annotations"][0]["text"]


@pytest.mark.parametrize(("hit", "marked"), [(0.508, True), (0.503, False)])
def test_a_speed_before_an_impact_between_samples_is_marked(hit, marked):
    """A fall of ``g t`` that ends at `hit`; the last sample before it is at 0.5 s, at every fourth as at every one."""
    time, g = np.linspace(0.0, 1.0, 33), 9.81
    answer = passing(33, 1.0)
    answer.v_WB_W[:, 0] = np.where(time < hit, -g * time, 0.0)[:, None] * [0.0, 0.0, 1.0]
    answer = replace(answer, event_time=np.array([hit]), event_contact=np.array([0]), event_kind=np.array([0]))
    found = velocities(answer)
    assert np.min(found.values[:, 2]) == pytest.approx(-g * 0.5)
    assert bool(found.marks) is marked
    assert found.open[2] == (pytest.approx((hit - 0.5) / 0.5) if marked else 0.0)


def test_a_torque_that_is_the_rounding_of_a_force_is_zero():
    """A double pendulum in a plane, pins across it: in its joints no torque acts."""
    case = load_case("chrono_double_pendulum").with_span(0.1, None)
    answer, _ = simulate_case(case, "reference", 60.0)
    found = next(curve_sets(case.mechanism, answer, ["reactions"]))
    torques = [name.unit == "N m" for name in found.names]
    assert sum(torques) == 2
    assert not found.values[:, torques].any()


def test_rounding_costs_no_samples():
    """Velocities of one turn: along x and y a circle, settled at the first samples; along z noise of 1e-15."""
    phase = np.linspace(0.0, 2.0 * np.pi, 4097)
    answer = passing(len(phase), 1.0)
    noise = 1e-15 * np.random.default_rng(1).standard_normal(len(phase))
    answer.v_WB_W[:, 0] = np.column_stack([np.cos(phase), np.sin(phase), noise])
    evaluated = []
    kind = KINDS["velocities"]
    counted = CurveKind(kind.names, lambda m, a, samples: evaluated.append(len(samples)) or kind.values(m, a, samples))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(KINDS, "velocities", counted)
        velocities(answer)
    assert sum(evaluated) < len(phase) / 8


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider_crank", "flat_box_drop"])
def test_drawn_extremes_are_those_of_a_finer_motion_or_marked(name):
    (case,) = load_cases(name)
    wrong, count, _ = errors(case)
    assert count
    assert not wrong


def test_lines_between_the_kept_samples_are_the_curve():
    time = np.linspace(0.0, 2.0, 5001)
    smooth = np.column_stack([np.sin(3.0 * time), np.exp(-time), np.full_like(time, 5.0)])
    kept = thinned(time, smooth)
    assert len(kept) < 80
    for curve in smooth.T:
        assert np.interp(time, time[kept], curve[kept]) == pytest.approx(curve, abs=0.0021 * np.ptp(curve) + 1e-12)
    noise = np.random.default_rng(3).normal(size=(5001, 2))
    kept = thinned(time, noise)
    assert len(kept) <= KEPT
    assert np.array_equal(noise[kept].max(axis=0), noise.max(axis=0))


def test_curves_of_a_turning_wheel_count_turns_and_have_its_energies():
    """Closed form: 25 rad/s about a fixed axis through the centre of mass, ``T = I w^2 / 2``."""
    draw = cs.Drawing("wheel", gravity=(0, 0, 0))
    draw.body("w", mass=2.0, com=(0, 0, 0), inertia=(0.1, 0.1, 0.2))
    draw.joint("j", "revolute", "ground", "w", at=(0, 0, 0), axis=(0, 0, 1))
    motion = cs.simulate(draw.case(rates={"j": 25.0}, duration=2.0))
    found = {one.what: CurveSet.of(one.data()) for one in curve_sets(motion.mechanism, motion)}
    assert found["coordinates"].values[-1] == pytest.approx([50.0], abs=1e-3)
    assert found["energies"].values[-1] == pytest.approx([62.5, 0.0, 62.5])
    assert found["rates"].names[0].unit == "rad/s"
    assert motion.plot(what="rates").axes[0].get_ylabel() == "j: angle [rad/s]"
    with pytest.raises(InvalidInput, match="Kinds: coordinates"):
        motion.plot(what="reaction")
    with pytest.raises(InvalidInput, match="Names: w"):
        motion.plot("j", what="positions")


def test_the_reaction_of_a_pendulum_peaks_where_it_is_lowest():
    """Closed form: a point mass that falls from 90 degrees pulls its rod with ``3 m g`` at the lowest point."""
    case = load_case("simple_pendulum-large")
    mass, g = case.mechanism.bodies[0].mass, np.linalg.norm(case.mechanism.gravity)
    answer, _ = simulate_case(densely_sampled(case), "reference", 60.0)
    found = next(curve_sets(case.mechanism, answer, ["reactions"]))
    assert np.max(found.values[:, 0]) == pytest.approx(3.0 * mass * g, rel=1e-3)


def test_a_colour_is_an_engine_and_grey_the_reference():
    case = load_case("simple_pendulum-large")
    answer, _ = simulate_case(densely_sampled(case), "reference", 60.0)
    found = next(curve_sets(case.mechanism, answer, ["reactions"]))
    joint = case.mechanism.joints[0].name
    series = {"force": [[1e-20, 2.0]], "torque": [[0.0, 0.0]], "drift": [0.0, 0.0]}
    along = {"times": [0.0, 1.0], "joints": [joint], "engines": {"reference": series, "one": series, "two": series}}
    figure = motion_figure(found, along, ["reference", "one", "two"])
    colours = {}
    for trace in figure["data"]:
        look = trace["line"] if trace["mode"] == "lines" else trace["marker"]
        colours.setdefault(trace["name"].partition(",")[0], set()).add(look["color"])
    assert colours["reference"] == {GREY}
    assert len({next(iter(c)) for c in colours.values()}) == len(colours) == 3
    assert sum(trace["showlegend"] for trace in figure["data"]) == 3
    assert [t["y"] for t in figure["data"] if t["mode"] == "markers" and t["yaxis"] == "y"] == [[0.0, 2.0]] * 2


def test_a_method_and_a_profile_are_chosen_by_name():
    case = load_case("simple_pendulum-large").with_span(0.1, None)
    _, how = simulate_case(case, "reference", 60.0, method="null_space")
    assert how.startswith("null_space")
    with pytest.raises(InvalidInput, match=r"no method 'nullspace'.*Methods: relative"):
        simulate_case(case, "reference", 60.0, method="nullspace")


def test_a_report_draws_the_dense_motion_of_the_reference():
    """Samples of 0.5 s miss the peak of ``3 m g``; the curve of the report has it."""
    case = load_case("simple_pendulum-large")
    case = case.with_span(0.5 * int(case.duration / 0.5), 0.5)
    results = run_suite([case], [], [Question.TRAJECTORY], thoroughness=QUICK)
    found = json.loads(replays(results.cases, results.runs, results.dense))["cases"][0]["curves"]
    (reactions,) = [CurveSet.of(one) for one in found if one["what"] == "reactions"]
    mass, g = case.mechanism.bodies[0].mass, np.linalg.norm(case.mechanism.gravity)
    assert np.max(reactions.values[:, 0]) == pytest.approx(3.0 * mass * g, rel=0.01)
