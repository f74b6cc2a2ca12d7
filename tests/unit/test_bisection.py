"""Bisection over versions of an engine, without engines: which are asked, which is named, what is said."""

import pytest

from consilience.report.history.bisection import bisect, bisection_statement
from consilience.report.statement import WRITERS
from records import comparison, record_of

VERSIONS = [f"1.{n}" for n in range(16)]


def asking(bad_from, absent=(), digits=None):
    """Return a function that gives records, and the versions it was asked for; `digits` are those of bad ones."""
    asked = []

    def ask(engine):
        version = engine.partition("@")[2]
        asked.append(version)
        if version in absent:
            return f"no wheel of {version}"
        bad = VERSIONS.index(version) >= bad_from
        more = (
            {} if not bad else {"digits": digits} if digits else {"verdict": "differs: model", "why": "mass is twice"}
        )
        return record_of([comparison("arm", engine, "model", **more)], engines=(engine,))

    return ask, asked


@pytest.mark.parametrize("bad_from", range(1, 16))
def test_every_place_is_found_in_a_logarithmic_number_of_versions(bad_from):
    ask, asked = asking(bad_from)
    found = bisect("toy", VERSIONS, ask, 0.5)
    assert (found.last_good.version, found.first_bad.version) == (f"1.{bad_from - 1}", f"1.{bad_from}")
    assert len(asked) == len(set(asked)) <= 2 + 4  # both ends, and log2 of 15 between


def test_versions_that_cannot_be_asked_are_passed_over_and_named():
    absent = ("1.0", "1.7", "1.8", "1.9", "1.15")
    ask, _ = asking(9, absent)
    found = bisect("toy", VERSIONS, ask, 0.5)
    assert (found.last_good.version, found.first_bad.version) == ("1.6", "1.10")
    said = WRITERS["markdown"](bisection_statement(found))
    assert "first bad version 1.10, last good version 1.6; 1.7, 1.8, 1.9 between them could not be asked." in said
    assert "mass is twice" in said
    assert "no wheel of 1.8" in said


def test_a_loss_of_digits_counts_from_a_threshold_on():
    ask, asked = asking(5, digits=11.9)  # 12.5 before
    assert bisect("toy", VERSIONS, ask, 0.5).first_bad.version == "1.5"
    ask, asked = asking(5, digits=11.9)
    found = bisect("toy", VERSIONS, ask, 0.7)
    assert found.first_bad is None
    assert asked == ["1.0", "1.15"]
    assert "nothing is worse in 1.15 than in 1.0." in bisection_statement(found).sentences[0]


def test_a_first_version_that_does_not_agree_is_said():
    ask, _ = asking(0)
    found = bisect("toy", VERSIONS[:2], ask, 0.5)
    assert bisection_statement(found).sentences == [
        "toy: nothing is worse in 1.1 than in 1.0.",
        "1.0, with which the others are compared, does not agree itself: differs: model.",
    ]


def test_without_a_version_nothing_is_named():
    ask, _ = asking(5, VERSIONS)
    found = bisect("toy", VERSIONS, ask, 0.5)
    assert (found.last_good, found.first_bad) == (None, None)
    assert bisection_statement(found).sentences == ["toy: no version could be asked."]
