"""Questions to one engine about many mechanisms: sound answers, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from consilience.audit.identities.result import NotApplicableError, UnansweredError
from consilience.engine import InstantAnswer, Method, Question, TrajectoryAnswer, Unsupported, defects
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan, Request
from consilience.mechanism import Array, Mechanism, State

Ask = Callable[[Request], Reply]
"""Request to reply: `Worker.ask`."""


@dataclass(frozen=True, eq=False)
class Asker:
    """One engine: sound answers, or an exception with the reason why there is none.

    Attributes
    ----------
    ask : callable
        Request to reply.
    """

    ask: Ask

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods for a question.

        Raises
        ------
        NotApplicableError
            The engine cannot represent the mechanism.
        UnansweredError
            The engine has no plan, or supports the question and offers no method.
        """
        reply = self.ask(Request(mechanism))
        plan = reply.value
        if not isinstance(plan, Plan):
            raise UnansweredError(reply.reason or f"the plan is a {type(plan).__name__}")
        if plan.unsupported[question]:
            raise NotApplicableError("; ".join(map(str, plan.unsupported[question])))
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
        NotApplicableError
            The engine cannot represent a state.
        UnansweredError
        """
        answer = self._sound(Request(mechanism, Question.INSTANT, method, states), len(states))
        assert isinstance(answer, InstantAnswer)
        return answer

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Return a sound motion.

        Parameters
        ----------
        mechanism : Mechanism
        state : State
            At the first time.
        times : ndarray, shape (n_t,), s
        method : Method
        step : float
            Step size in s, or tolerance.

        Raises
        ------
        NotApplicableError
            The engine cannot represent the course of the motion.
        UnansweredError
        """
        answer = self._sound(Request(mechanism, Question.TRAJECTORY, method, [state], times, step), len(times))
        assert isinstance(answer, TrajectoryAnswer)
        return answer

    def _sound(self, request: Request, count: int) -> object:
        """Return the answer to a request, with `count` states or samples."""
        assert request.mechanism is not None
        assert request.question is not None
        reply = self.ask(request)
        if isinstance(reply.value, Unsupported):
            raise NotApplicableError(str(reply.value))
        wrong = defects(reply.value, request.question, request.mechanism, count) if reply.returned else [reply.reason]
        if wrong:
            raise UnansweredError("; ".join(wrong))
        return reply.value
