"""Engines that are asked about one mechanism after the other, each in a process of its own that stays alive.

A mechanism that kills its worker, or keeps it beyond the time limit, fails with the evidence, and the others do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from consilience.engine import Question, Unsupported
from consilience.engine.worker.client import Reply, Request, Worker
from consilience.engine.worker.requests import AnswerSet, MethodAnswer
from consilience.mechanism import Mechanism, State

__all__ = ["MethodAnswer", "Panelist", "Sheet", "Task"]

QUESTIONS = (Question.MODEL, Question.INSTANT)


@dataclass(frozen=True, eq=False)
class Task:
    """A mechanism and the states at which to ask about it."""

    mechanism: Mechanism
    states: Sequence[State]


@dataclass(frozen=True, eq=False)
class Sheet:
    """All an engine said about one mechanism.

    Attributes
    ----------
    said : tuple of Said
    unsupported : tuple of Unsupported
        Why it was not asked for the instant.
    cpu : float, s
        CPU time of the worker.
    log : str
        What it printed.
    """

    said: tuple[MethodAnswer, ...]
    unsupported: tuple[Unsupported, ...] = ()
    cpu: float = 0.0
    log: str = ""


class Panelist(Worker):
    """An engine that is asked about many mechanisms."""

    def submit_many(self, tasks: Sequence[Task]) -> list[Future[Reply]]:
        """Queue a message for each; give the futures to `sheets`."""
        return [self.submit(Request(t.mechanism, states=t.states, survey=QUESTIONS)) for t in tasks]

    def sheets(self, futures: Sequence[Future[Reply]]) -> list[Sheet]:
        """Wait for the answers: one sheet a task, in their order."""
        return [_sheet(self.reply(future)) for future in futures]


def _sheet(reply: Reply) -> Sheet:
    if not isinstance(reply.value, AnswerSet):
        return Sheet((MethodAnswer(Question.INSTANT, None, None, reply.reason),), log=reply.log)
    unsupported = reply.value.unsupported.get(Question.INSTANT, ())
    return Sheet(reply.value.said, unsupported, reply.cpu, reply.log)
