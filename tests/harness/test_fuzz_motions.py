"""Motions of a fuzz with contacts: two formulations of the reference, then the engines."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.audit.fuzz.judging import alarms
from consilience.audit.fuzz.motions import judge_motions
from consilience.audit.fuzz.population import specimen
from consilience.compare import Verdict
from consilience.engine.worker.client import InProcessEngine, Reply
from consilience.reference.engine import TIME_STEPPING, ReferenceEngine
from contact_problems import FEET, LEVEL, G, Lab


class OfOtherSteps(InProcessEngine):
    """The reference, whose motion by time stepping is another one."""

    def __init__(self, alter):
        super().__init__("reference", ReferenceEngine())
        self._alter = alter

    def ask(self, request):
        return super().ask(
            self._alter(request) if request.method and request.method.name == TIME_STEPPING.name else request
        )


def _slippery(request):
    contacts = tuple(replace(c, friction=0.5 * c.friction) for c in request.mechanism.contacts)
    return replace(request, mechanism=replace(request.mechanism, contacts=contacts))


def test_a_motion_on_which_the_formulations_of_the_reference_differ_judges_nobody():
    """Half of the friction in one of them is beyond its band; the same in both is not."""
    sliding = specimen(3, contacts=True).case
    for alter, verdict in ((lambda request: request, Verdict.AGREES), (_slippery, Verdict.MODEL)):
        engines = {"reference": OfOtherSteps(alter), "x": InProcessEngine("x", ReferenceEngine())}
        (found,) = judge_motions([sliding], engines)
        assert (found[0].method, found[0].verdict) == (TIME_STEPPING.name, verdict)
        assert [e.verdict for e in found if e.engine == "x"] == [
            Verdict.AGREES if verdict is Verdict.AGREES else Verdict.UNRESOLVED
        ]
    assert [e.engine for e in alarms(found)] == ["reference"]


@pytest.mark.parametrize(
    ("reason", "verdict", "quantity"),
    [
        ("NumericalFailure: no forces satisfy the laws of contact 'c' (Painleve)", Verdict.UNRESOLVED, "painleve"),
        ("NumericalFailure: events at t = 0.1 s do not settle", Verdict.FAILED, "unsettled"),
        ("no answer within 3 s; the worker was stopped", Verdict.FAILED, "timed out"),
        ("the worker died: signal SIGSEGV", Verdict.FAILED, "failed"),
    ],
)
def test_what_the_laws_leave_open_is_no_failure_of_a_motion(reason, verdict, quantity):
    class Refuses:
        engine = "reference"

        def ask(self, request):
            return Reply(None, False, reason)

    (found,) = judge_motions([specimen(4, contacts=True).case], {"reference": Refuses(), "x": Refuses()})
    assert [(e.engine, e.verdict) for e in found] == [("reference", verdict), ("x", Verdict.UNRESOLVED)]
    assert found[0].quantity == quantity
    assert len(alarms(found)) == (verdict is Verdict.FAILED)


def test_the_reference_steps_a_block_to_where_friction_has_used_its_energy():
    """``x = v^2 / (2 mu g)``, off by ``mu g h^2 / 2`` at most: one step of Moreau's scheme, in which it stops."""
    lab, mu, v, h = Lab(), 0.35, np.array([1.2, 0.9, 0.0]), 0.01
    block = lab.free_body(2.0, (0.02, 0.03, 0.04), LEVEL, lab.points(FEET, friction=mu))
    start = lab.state([0, 0, 0.1], v)
    motion = ReferenceEngine().trajectory(block, start, np.array([0.0, 0.3, 0.6]), TIME_STEPPING, h)
    off = motion.p_WB[-1, 0] - start.p_WB[0] - lab.axes @ (v * np.linalg.norm(v) / (2 * mu * G))
    assert 1e-9 < np.linalg.norm(off) < 0.5 * mu * G * h**2
