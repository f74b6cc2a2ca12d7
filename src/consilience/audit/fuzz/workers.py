"""Engines in worker processes that answer about many mechanisms, one after the other.

A mechanism that kills its worker, or exceeds the time limit, fails with the evidence; the other mechanisms do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from consilience.case import Case
from consilience.engine import Question, Unsupported
from consilience.engine.worker.client import Reply, Request, Worker
from consilience.engine.worker.requests import AnswerSet, MethodAnswer

QUESTIONS = (Question.MODEL, Question.INSTANT)


@dataclass(frozen=True, eq=False)
class AnswerBatch:
    """All answers of an engine about one mechanism.

    Attributes
    ----------
    answers : tuple of MethodAnswer
    unsupported : tuple of Unsupported
        Features for which the engine refuses the question `instant`.
    cpu : float, s
        CPU time of the worker.
    log : str
        Output of the engine.
    """

    answers: tuple[MethodAnswer, ...]
    unsupported: tuple[Unsupported, ...] = ()
    cpu: float = 0.0
    log: str = ""


class EngineStream(Worker):
    """A worker of an engine, with a queue of mechanisms, and the CPU time of all its answers, s."""

    spent: float = 0.0

    def _answer(self, request: Request) -> Reply:
        reply = super()._answer(request)
        self.spent += reply.cpu
        return reply

    def submit_cases(self, cases: Sequence[Case]) -> list[Future[Reply]]:
        """Queue a request for the mechanism and the states of each case."""
        return [self.submit(Request(case.mechanism, states=case.states, survey=QUESTIONS)) for case in cases]

    def collect(self, futures: Sequence[Future[Reply]]) -> list[AnswerBatch]:
        """Wait for the replies, and return the answers about each mechanism in the order of the requests."""
        return [batch_of(self.reply(future)) for future in futures]


def batch_of(reply: Reply) -> AnswerBatch:
    """Return the answers of a reply; of a worker that failed, one answer with the reason."""
    if not isinstance(reply.value, AnswerSet):
        return AnswerBatch((MethodAnswer(Question.INSTANT, None, None, reply.reason),), log=reply.log)
    unsupported = reply.value.unsupported.get(Question.INSTANT, ())
    return AnswerBatch(reply.value.said, unsupported, reply.cpu, reply.log)
