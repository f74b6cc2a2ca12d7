"""Rules of verdicts: every situation of known cause gets its verdict by its rule, and the docs list the same rules."""

from pathlib import Path

import numpy as np
import pytest

from consilience.compare import Verdict
from consilience.compare.rules import RULES
from situations import SITUATIONS

DOCS = Path(__file__).parents[2] / "docs" / "verdicts.md"


@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda s: s.name)
def test_the_cause_is_found(situation):
    found = situation.judge()
    assert (found.verdict, found.rule) == (situation.verdict, situation.rule), found.why


def test_the_set_is_large_and_triggers_every_rule():
    assert len(SITUATIONS) >= 40
    assert len({s.name for s in SITUATIONS}) == len(SITUATIONS)
    assert {s.rule for s in SITUATIONS} == {r.name for r in RULES}
    assert {s.verdict for s in SITUATIONS} == set(Verdict) - {Verdict.UNSUPPORTED, Verdict.FAILED}


def test_the_horizon_lies_where_one_rounding_error_reaches_the_digits():
    situation = next(s for s in SITUATIONS if s.name == "wrong only past the horizon")
    found = situation.judge()
    reached = np.log(1e-8 / np.finfo(float).eps) / 10.0
    assert found.horizon == pytest.approx(np.floor(reached / 0.05) * 0.05, abs=1e-12)
    assert "up to the horizon" in found.why


def test_the_rules_stand_in_the_docs_in_their_order():
    text = DOCS.read_text(encoding="utf-8")
    rows = [f"| {rule.name} | {rule.when} | {rule.verdict} |" for rule in RULES]
    places = [text.find(row) for row in rows]
    assert -1 not in places, rows[places.index(-1)]
    assert places == sorted(places)
