"""Questions to one engine about many mechanisms: sound answers, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from consilience.audit.identities.result import NotApplicableError, UnansweredError
from consilience.engine import InstantAnswer, Method, Question, TrajectoryAnswer, defects
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan, Request
from consilience.mechanism import Array, Mechanism, State

Ask = Callable[[Request], Reply]
"""Request to reply: `Worker.ask`."""


@dataclass(frozen=True, eq=False)
class Asker:
    """One engine; returns sound answers, raises the reason otherwise."""

    ask: Ask

    def plan(self, mechanism: Mechanism) -> Plan:
        """Return the engine's plan for a mechanism.

        Raises
        ------
        NoAnswerError
        """
        reply = self.ask(Request(mechanism))
        if not isinstance(reply.value, Plan):
            raise UnansweredError(reply.reason or f"the plan is a {type(reply.value).__name__}")
        return reply.value

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods for a question.

        Raises
        ------
        NotApplicableError
            The engine cannot represent the mechanism.
        NoAnswerError
            The engine supports the question and offers no method.
        """
        plan = self.plan(mechanism)
        if plan.unsupported[question]:
            raise NotApplicableError("; ".join(f"{u.feature}: {u.reason}" for u in plan.unsupported[question]))
        if not plan.methods[question]:
            raise UnansweredError("the adapter supports the question and offers no method")
        return plan.methods[question]

    def method(self, mechanism: Mechanism, question: Question, name: str) -> Method:
        """Return the method of a name.

        Raises
        ------
        NotApplicableError
            There is no such method for this mechanism.
        """
        for method in self.methods(mechanism, question):
            if method.name == name:
                return method
        raise NotApplicableError(f"the engine does not offer {name} for the mechanism so changed")

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return a sound answer about states.

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
        """Return a sound motion.

        Parameters
        ----------
        state : State
            At the first time.
        times : ndarray, shape (n_t,), s
        step : float, s
            Step of the method, or its tolerance.

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
