"""Random mechanisms with states at which a setting of an adapter is critical: a poor setting raises a false alarm."""

from __future__ import annotations

import pytest

from consilience.audit.mutate.judge import verdicts
from consilience.audit.mutate.subjects import random_subject
from consilience.audit.mutate.synthetic import host
from consilience.compare import Verdict
from consilience.engine import Question


@pytest.mark.parametrize(
    ("engine", "seed"),
    [
        pytest.param("dart", 72, id="dart: rod near the singular pose of its angles, link at 74 rad/s"),
        pytest.param("mujoco", 313, id="mujoco: slider-crank locked by a coupling, CG creeps"),
    ],
)
def test_every_method_agrees_with_the_reference(engine: str, seed: int) -> None:
    subject = random_subject(seed)
    assert subject is not None
    found = verdicts(host(engine), subject, Question.INSTANT)
    assert len(found) >= 2
    assert {c.method: c.verdict for c in found} == dict.fromkeys((c.method for c in found), Verdict.AGREES)
