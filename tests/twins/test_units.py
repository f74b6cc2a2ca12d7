"""Cases in other units: the same verdicts, and the same digits as far as they are not rounding.

Long version, over the library: ``python tests/twins/test_units.py [-e ENGINE] [--turns] [name ...]``; without -e all
installed engines are asked. --turns takes two units far off for each case, of length, mass and time by turns, and short
motions of each engine's first method. What differs in units by powers of ten and not in units by powers of two is
rounding of the data, to which the case is sensitive: a parallelogram of rounded lengths is none at its change point.
So is what differs as much in units that are those of the case but for their last places.
What differs between worlds in the same units, too, is no dependence on units: an engine that sorts contacts by their
addresses, for instance. Both are listed, and counted by themselves.
"""

import argparse
import sys
from collections import Counter
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from consilience.case import case_files, load_case, load_cases
from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.engine import Profile, Question, installed, load_engine
from consilience.engine.worker.client import InProcessEngine
from consilience.errors import NumericalFailure
from consilience.mechanism import Frame, Initial, Units, in_units, telling_si
from consilience.suite import QUICK, Thoroughness, ask_ladder, run_suite
from consilience.suite.engine_runs import EngineCase, levels_of, open_plan


def units_by(*factors):
    """Other units of length, of mass and of time."""
    return tuple(Units(*(factor if k == n else 1.0 for n in range(3))) for k in range(3) for factor in factors)


UNITS, BINARY = units_by(1e-6, 1e-3, 1e3, 1e6), units_by(2.0**-20, 2.0**-10, 2.0**10, 2.0**20)
TURNS = ((0, 7), (3, 8), (4, 11), (7, 0), (8, 3), (11, 4))
"""Pairs of `UNITS` that are far off, one in length, mass or time and one in another of these."""

SHORT = Thoroughness(states=4, samples=10, closer=False)
TOGETHER = 8
"""Cases of one suite, whose engines are loaded once."""

REPEATED = [Units()] * 12
"""Twins in the same units."""

NEAR = [Units(*(1.0 + n * 2.0**-50 if k == m else 1.0 for m in range(3))) for k in range(3) for n in (1, 2, 3)]
"""Units that differ from those of the case in their last places."""

SENSITIVE, UNLIKE_ITSELF = "sensitive to the rounding of their data", "unlike themselves in the same units"

ROUNDING = 11.0
"""Digits beyond which differences are rounding."""

_LENGTHS = ("distance", "x", "y", "position")


def scaled(case, units):
    """The case in other units; expected values are left out."""

    def held(values, time):
        return {
            joint: {n: np.asarray(v) * (units.length if n in _LENGTHS else 1.0) / time for n, v in own.items()}
            for joint, own in values.items()
        }

    old = case.initial
    new = Initial(
        held(old.coordinates, 1.0),
        held(old.rates, units.time),
        {n: Frame(units.length * pose.p, pose.R) for n, pose in old.poses.items()},
        {
            n: (np.asarray(v) * units.length / units.time, np.asarray(w) / units.time)
            for n, (v, w) in old.velocities.items()
        },
    )
    return replace(
        case,
        name=f"{case.name} in {units.length:g} {units.mass:g} {units.time:g}",
        mechanism=in_units(case.mechanism, *units),
        initial=new,
        duration=case.duration * units.time,
        sample=case.sample * units.time,
        published=(),
    )


def numbered(n, case):
    """The case with a name of its own."""
    return replace(case, name=f"{case.name}, {n}")


def moved(cases, units, runs):
    """Where the reference's motion in other units is another one than in those of the first case."""
    asked = [run for run in runs if run.engine == REFERENCE and run.question is Question.TRAJECTORY]
    motions = {run.case: run.answer for run in asked if run.answer is not None}
    first, mechanism = motions.get(cases[0].name), cases[0].mechanism
    for case, one in zip(cases[1:], units, strict=True) if first is not None else ():
        if case.name not in motions:
            yield f"{case.name}: the reference ends no motion"
            continue
        back = one.inverse.convert(motions[case.name])
        off = float(np.max(difference_over_time(back, first, size_of_motion(mechanism, first))))
        if not off <= 10.0 ** -cases[0].digits:
            yield f"{case.name}: the motion differs by {off:.2g}"


def digits_of(found):
    """Return the digits of a comparison that are not rounding."""
    return min(ROUNDING, np.inf if found.digits is None else found.digits)


def differences(
    cases, units, engines=(), questions=(Question.INSTANT, Question.TRAJECTORY), thoroughness=SHORT, compared=None
):
    """What differs, by case, between its comparisons and those in its other units; what is unsupported does not.

    `compared`, a Counter, counts the pairs of comparisons by their engines.
    """
    compared = Counter() if compared is None else compared
    twins = [
        [numbered(n, scaled(case, one)) for n, one in enumerate([Units(), *own])]
        for case, own in zip(cases, units, strict=True)
    ]
    found = run_suite([one for own in twins for one in own], list(engines), questions, thoroughness=thoroughness)
    matched = [c for c in found.comparisons if c.profile is Profile.MATCHED]  # defaults have units of their own
    return {
        case.name: [
            *moved(own, others, found.runs),
            *unlike([[c for c in matched if c.case == one.name] for one in own], compared),
        ]
        for case, own, others in zip(cases, twins, units, strict=True)
    }


def unlike(answers, compared):
    """What differs between the comparisons of a case and those in each of the other units."""
    for others in answers[1:]:
        same = {(c.engine, c.question, c.method): c for c in others}
        for a, b in [(a, same.get((a.engine, a.question, a.method))) for a in answers[0]]:
            if b is None or Verdict.UNSUPPORTED in (a.verdict, b.verdict):  # an engine's own bounds, in kg and m
                if a.engine == REFERENCE:
                    yield f"{a.case}: {a.engine} {a.question} {a.method}: {a.verdict}, {b and b.verdict} in other units"
                continue
            compared[a.engine] += 1
            if a.verdict is not b.verdict or abs(digits_of(a) - digits_of(b)) > 0.3:
                what = f"{b.case}: {a.engine} {a.question} {a.method}"
                yield f"{what}: {a.verdict} {a.digits}, {b.verdict} {b.digits} {b.why}"


@pytest.mark.slow
def test_a_force_that_is_not_converted_fails_the_campaign(monkeypatch, capsys):
    convert = in_units

    def forgetful(mechanism, *units):
        return replace(convert(mechanism, *units), gravity=mechanism.gravity)

    monkeypatch.setitem(globals(), "in_units", forgetful)
    monkeypatch.setitem(globals(), "UNITS", UNITS[:1])
    monkeypatch.setitem(globals(), "BINARY", BINARY[:1])
    assert main(["single_revolute", "-e", REFERENCE]) == 1
    assert "the motion differs by" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rssr_four_bar", "stiff_spring", "rolling_disc"])
def test_a_case_in_other_units_has_the_same_verdicts_and_digits(name):
    assert not differences([load_case(name)], [[*UNITS[::3], Units(time=1e-6)]])[name]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "engines"),
    [
        ("double_pendulum", ["pinocchio", "dart", "exudyn"]),
        ("four_bar", ["pinocchio", "exudyn", "mujoco"]),  # engines solve loops with absolute constants
        ("ball_rolls", ["pinocchio", "exudyn"]),  # and contacts
    ],
)
def test_instants_on_engines_do_not_depend_on_units(name, engines):
    """One suite of several engines for each case."""
    case = replace(load_case(name), instants=3)
    assert not differences([case], [units_by(1e-6, 1e6)], engines, [Question.INSTANT])[name]


@pytest.mark.parametrize("units", [Units(1e-6), Units(1e6), Units(mass=1e-6), Units(time=1e6)])
def test_the_parameter_of_each_kind_for_which_power_is_stated_does_not_depend_on_units(units):
    """Six legs and as many springs, dampers and actuators, of which velocities choose."""
    chosen = []
    for case in (load_case("stewart_platform"), scaled(load_case("stewart_platform"), units)):
        reference = InProcessEngine(REFERENCE)
        chosen.append([p.of for p in EngineCase(reference, case, open_plan(reference, case)).sensitive_parameters])
    assert chosen[0] == chosen[1]


@pytest.mark.parametrize("units", [Units(), Units(1e-6), Units(1e6)])
def test_declared_orders_do_not_depend_on_units(units):
    """Positions of DART are of order two where drives leave no freedom."""
    case = scaled(load_case("scissor_lift"), units)
    methods = load_engine("dart").methods(case.mechanism, Question.TRAJECTORY)
    assert {m.order for m in methods if m.name.startswith("World.step")} == {2}


@pytest.mark.parametrize("time", [2.0**-10, 2.0**-6, 2.0**5])
def test_a_ring_of_fifty_bodies_moves_in_mujoco_in_any_unit_of_time(time):
    """MuJoCo's solver stops early where the ring is fast in the units that the engine has."""
    motions = []
    for case in (load_case("ring_of_50"), scaled(load_case("ring_of_50"), Units(time=time))):
        engine = InProcessEngine("mujoco", load_engine("mujoco"))
        plan = open_plan(engine, case)
        method = next(m for m in plan.methods[Question.TRAJECTORY] if m.profile is Profile.MATCHED)
        (run,) = ask_ladder(engine, case, plan, method, levels_of(case, Question.TRAJECTORY, method)[:1])
        motions.append(run.answer.p_WB)
    np.testing.assert_allclose(motions[1], motions[0], rtol=0, atol=1e-8)


@lru_cache
def reference_motion(name, units):
    """Motion of a case in other units; that in its own is the same for all tests."""
    case, engine = load_case(name), load_engine(REFERENCE)
    times = case.times[:: len(case.times) // 5]
    method = engine.methods(case.mechanism, Question.TRAJECTORY)[-1]
    there = in_units(case.mechanism, *units), units.convert(case.initial_state)
    return engine.trajectory(*there, units.time * times, method, 1e-8)


@pytest.mark.parametrize("name", ["rssr_four_bar", "ring_of_50", "box_tips"])
@pytest.mark.parametrize("units", [Units(2.0**-10), Units(mass=2.0**10), Units(time=2.0**-10), Units(time=2.0**10)])
def test_a_reference_motion_in_units_by_powers_of_two_is_the_same_to_the_last_bit(name, units):
    """No conversion rounds; a tolerance counts in units of the motion."""
    own, back = reference_motion(name, Units()), units.inverse.convert(reference_motion(name, units))
    np.testing.assert_array_equal(back.p_WB, own.p_WB)
    np.testing.assert_array_equal(back.v_WB_W, own.v_WB_W)


def test_a_failure_tells_its_amounts_in_si_units_and_leaves_names_and_other_numbers():
    """In units of 1/4 m, 2 kg and 1/8 s: a step of 2.4e-7 of them is 3e-8 s, a speed of 2 is 4 m/s."""
    told = "steps of 2.4e-07 s: at t = 12.8000000016 s joint '3 s' stays wrong by 4e-05 of its size"
    told += "; closes at 2 m/s, A = -0.852112535298 1/kg, B = -8 m/s^2, 4 N m, 4 N, 3 rad/s, 3 feet"
    right = "steps of 3e-08 s: at t = 1.6000000002 s joint '3 s' stays wrong by 4e-05 of its size"
    right += "; closes at 4 m/s, A = -0.426056267649 1/kg, B = -128 m/s^2, 32 N m, 128 N, 24 rad/s, 3 feet"
    with pytest.raises(NumericalFailure) as found, telling_si(Units(4.0, 0.5, 8.0)):
        raise NumericalFailure(told)
    assert str(found.value) == right


def excuse(case, lines, binary, engines, how):
    """Why a case may differ in other units, if it may: in the same or all but the same ones by the same methods."""
    if not differences([case], [binary], engines, thoroughness=how)[case.name]:
        return SENSITIVE
    for why, twins in ((UNLIKE_ITSELF, REPEATED), (SENSITIVE, NEAR)):
        alike = differences([case], [twins], engines, thoroughness=how)[case.name]
        if {line.split(": ")[1] for line in lines} <= {line.split(": ")[1] for line in alike}:
            return why
    return ""


def main(arguments=None):
    """Compare the named cases, by default all, in all units; return the exit code, 1 after a difference."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("-e", "--engine", action="append", default=[])
    parser.add_argument("--turns", action="store_true", help="two units and short motions for each case")
    asked = parser.parse_args(arguments)
    names, how = asked.names or [path.stem for path in case_files()], QUICK if asked.turns else SHORT
    engines, compared = asked.engine or list(installed()), Counter()
    cases = [case for name in names for case in load_cases(name)]
    problems, excused = 0, Counter()
    for first in range(0, len(cases), TOGETHER):
        chunk = cases[first : first + TOGETHER]
        turns = [TURNS[n % len(TURNS)] if asked.turns else range(len(UNITS)) for n in range(len(chunk))]
        decimal, binary = ([[units[n] for n in own] for own in turns] for units in (UNITS, BINARY))
        found = differences(chunk, decimal, engines, thoroughness=how, compared=compared)
        for case, own in zip(chunk, binary, strict=True):
            if lines := found[case.name]:
                why = excuse(case, lines, own, engines, how)
                excused[why] += 1
                problems += 0 if why else len(lines)
                print(f"{case.name}: {why}" if why else case.name, *lines, sep="\n  ", flush=True)
        cases_that = ", ".join(f"{excused[why]} {why}" for why in (SENSITIVE, UNLIKE_ITSELF))
        counts = f"{problems} differences; {cases_that}"
        print(f"{first + len(chunk)} cases, {dict(compared)} compared: {counts}", flush=True)
    return int(problems > 0)


if __name__ == "__main__":
    sys.exit(main())
