"""Values known from elsewhere: they reach the case, and a reference that contradicts them may not fail an engine."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Published
from consilience.casefile import load_file
from consilience.compare import Verdict
from consilience.compare.motion import Scales
from consilience.compare.published import against_published, dispute
from consilience.errors import InvalidInput
from consilience.library import load_case
from consilience.run import Question
from consilience.suite import run_suite
from situations import MECHANISM, TIMES, TRUE

BODY = MECHANISM.bodies[0].name
SPREAD = np.full(len(TIMES), 1e-9)


def known(value, uncertainty=1e-10, observable="p_WB", component=0, time=1.0):
    return Published(observable, BODY, component, time, value, uncertainty, "a closed form")


def test_the_bar_is_the_sum_of_both_uncertainties():
    """The body runs on the unit circle: x = cos t."""
    (found,) = against_published(MECHANISM, [known(np.cos(1.0) + 5e-10)], TRUE, SPREAD)
    assert found.difference == pytest.approx(5e-10, rel=1e-5)
    assert found.bar == pytest.approx(1e-10 + 1e-9 * Scales.of(MECHANISM, TRUE).size, rel=1e-9)
    assert found.met
    assert dispute([found]) == ""


@pytest.mark.parametrize(
    ("observable", "component", "value"), [("p_WB", 1, np.sin(1.0)), ("v_WB_W", 0, -np.sin(1.0)), ("w_WB_W", 2, 1.0)]
)
def test_every_observable_is_read_at_its_time_and_component(observable, component, value):
    right, wrong = (known(value + d, 1e-10, observable, component) for d in (0.0, 1e-6))
    found = against_published(MECHANISM, [right, wrong], TRUE, SPREAD)
    assert [q.met for q in found] == [True, False]
    assert f"{observable} of {BODY}" in dispute(found)


def test_a_disputed_reference_fails_no_engine():
    case = replace(load_case("simple_pendulum-small"), duration=0.5)
    wrong = Published("p_WB", "bob", 0, 0.5, 1.0, 1e-3, "a misprint")
    for published, verdict in (((), Verdict.AGREES), ((wrong,), Verdict.UNRESOLVED)):
        results = run_suite([replace(case, published=published)], [], [Question.TRAJECTORY])
        assert {c.verdict for c in results.comparisons} == {verdict}
    assert "the reference is disputed: p_WB of bob, x at 0.5 s differs by" in results.comparisons[0].why


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("body", '"bab"', r"published\[0\].body: there is no body 'bab'"),
        ("time", "0.07", r"published\[0\].time: 0.07 s is no sample"),
        ("time", "11.0", r"published\[0\].time: 11 s is no sample"),
        ("uncertainty", "0.0", r"uncertainty"),
        ("observable", '"energy"', r"observable"),
    ],
)
def test_a_value_that_cannot_be_compared_is_refused(tmp_path, field, value, message):
    entry = {
        "body": '"bob"',
        "observable": '"p_WB"',
        "time": "0.5",
        "value": "[0.0, 0.0, 0.0]",
        "uncertainty": "1e-9",
        "source": '"mine"',
    } | {field: value}
    text = (
        'title = "t"\nsources = ["s"]\ngravity = [0.0, 0.0, -9.81]\n[trajectory]\nduration = 1.0\n'
        '[[body]]\nname = "bob"\nmass = 1.0\nat = [0.0, 0.0, 0.0]\ninertia = { xx = 1.0, yy = 1.0, zz = 1.0 }\n'
        '[[joint]]\nname = "j"\nkind = "free"\npredecessor = "ground"\nsuccessor = "bob"\nat = [0.0, 0.0, 0.0]\n'
        "axis = [0.0, 0.0, 1.0]\n[[published]]\n" + "\n".join(f"{k} = {v}" for k, v in entry.items())
    )
    path = tmp_path / "c.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInput, match=message):
        load_file(path)
