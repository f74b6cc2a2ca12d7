"""Cases in other units: the same verdicts, and the same digits as far as they are not rounding.

Long version, over the library: ``python tests/twins/test_units.py [name ...]``.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from consilience.case import case_files, load_case, load_cases
from consilience.engine import Question
from consilience.mechanism import Frame, Initial, Units, in_units
from consilience.suite import Thoroughness, run_suite

UNITS = tuple(
    Units(*(factor if k == n else 1.0 for n in range(3))) for k in range(3) for factor in (1e-6, 1e-3, 1e3, 1e6)
)
SHORT = Thoroughness(states=4, samples=10, closer=False)
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


def differences(case, units):
    """What differs between the comparisons of a case and of the case in other units."""
    cases = [scaled(case, Units()), *(scaled(case, one) for one in units)]
    found = run_suite(cases, [], (Question.INSTANT, Question.TRAJECTORY), thoroughness=SHORT)
    own = {one.name: [c for c in found.comparisons if c.case == one.name] for one in cases}
    first = own[cases[0].name]
    for name, others in own.items():
        assert len(others) == len(first)
        for a, b in zip(first, others, strict=True):
            digits = [min(ROUNDING, np.inf if c.digits is None else c.digits) for c in (a, b)]
            if a.verdict is not b.verdict or abs(digits[0] - digits[1]) > 0.3:
                yield f"{name}: {a.question} {a.method}: {a.verdict} {a.digits}, {b.verdict} {b.digits} {b.why}"


@pytest.mark.parametrize("name", ["rssr_four_bar", "stiff_spring", "rolling_disc"])
def test_a_case_in_other_units_has_the_same_verdicts_and_digits(name):
    assert not list(differences(load_case(name), [*UNITS[::3], Units(time=1e-6)]))


if __name__ == "__main__":
    problems = 0
    for one in [case for name in sys.argv[1:] or [path.stem for path in case_files()] for case in load_cases(name)]:
        for line in differences(one, UNITS):
            problems += 1
            print(line, flush=True)
    print(f"{problems} differences")
    sys.exit(bool(problems))
