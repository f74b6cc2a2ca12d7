"""One engine, asked about many mechanisms: what it can, and sound answers or the reason there are none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from consilience.audit.identities.result import NotApplicableError, UnansweredError
from consilience.engine import InstantAnswer, Method, Question, TrajectoryAnswer, defects
from consilience.engine.worker.client import Plan, Reply, Request
from consilience.mechanism import Array, Mechanism, State

Ask = Callable[[Request], Reply]
"""A job in, what came of it out: `Worker.ask`."""


@dataclass(frozen=True, eq=False)
class Asker:
    """Asks, and tells answers from reasons."""

    ask: Ask

    def plan(self, mechanism: Mechanism) -> Plan:
        """What the engine says about a mechanism.

        Raises
        ------
        NoAnswerError
        """
        reply = self.ask(Request(mechanism))
        if not isinstance(reply.value, Plan):
            raise UnansweredError(reply.reason or f"the plan is a {type(reply.value).__name__}")
        return reply.value

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Ways to answer a question.

        Raises
        ------
        NotApplicableError
            If the engine cannot represent the mechanism, with its reasons.
        NoAnswerError
            If it says it can and offers no way.
        """
        plan = self.plan(mechanism)
        if plan.unsupported[question]:
            raise NotApplicableError("; ".join(f"{u.feature}: {u.reason}" for u in plan.unsupported[question]))
        if not plan.methods[question]:
            raise UnansweredError("the adapter supports the question and offers no method")
        return plan.methods[question]

    def method(self, mechanism: Mechanism, question: Question, name: str) -> Method:
        """The method of a name.

        Raises
        ------
        NotApplicableError
            If there is none of this name for this mechanism.
        """
        for method in self.methods(mechanism, question):
            if method.name == name:
                return method
        raise NotApplicableError(f"the engine does not offer {name} for the mechanism so changed")

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Sound answer about states.

        Raises
        ------
        NoAnswerError
        """
        reply = self.ask(Request(mechanism, Question.INSTANT, method, states))
        _refuse(reply, Question.INSTANT, mechanism, len(states))
        assert isinstance(reply.value, InstantAnswer)
        return reply.value

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Sound motion.

        Raises
        ------
        NoAnswerError
        """
        reply = self.ask(Request(mechanism, Question.TRAJECTORY, method, [state], times, step))
        _refuse(reply, Question.TRAJECTORY, mechanism, len(times))
        assert isinstance(reply.value, TrajectoryAnswer)
        return reply.value


def _refuse(reply: Reply, question: Question, mechanism: Mechanism, count: int) -> None:
    reason = "; ".join(defects(reply.value, question, mechanism, count)) if reply.returned else reply.reason
    if reason:
        raise UnansweredError(reason)
