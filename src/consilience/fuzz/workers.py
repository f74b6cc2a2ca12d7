"""Engines that answer about many mechanisms in one message, each in a process of its own that stays alive.

A message that kills its worker, or keeps it beyond the time limit, is asked again one mechanism at a time: the
mechanism that did it fails, with the evidence, and the others do not.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from consilience.engine import Engine, load_engine
from consilience.mechanism import Mechanism, State
from consilience.run import Method, Question, Unsupported
from consilience.worker import Worker

QUESTIONS = (Question.MODEL, Question.INSTANT)


@dataclass(frozen=True, eq=False)
class Task:
    """A mechanism and the states at which to ask about it."""

    mechanism: Mechanism
    states: Sequence[State]


@dataclass(frozen=True, eq=False)
class Said:
    """What an engine said to one question by one method.

    Attributes
    ----------
    question : Question
    method : Method or None
        None where the engine could not even be asked.
    answer : object
        None if there is none.
    reason : str
        Why there is none.
    """

    question: Question
    method: Method | None
    answer: object
    reason: str = ""


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
        What it printed about the mechanisms of the message.
    """

    said: tuple[Said, ...]
    unsupported: tuple[Unsupported, ...] = ()
    cpu: float = 0.0
    log: str = ""


Raw = tuple[Question, Method | None, bytes | None, str]

_engines: dict[str, Engine] = {}
"""Of this process, when it is a worker."""


def _serve_many(name: str, tasks: Sequence[Task]) -> tuple[bytes, str, float]:
    """Work through a message in the worker; each answer is pickled on its own, so that one can fail alone."""
    if name not in _engines:
        _engines[name] = load_engine(name)
    start = time.process_time()
    sheets = []
    for task in tasks:
        begun = time.process_time()
        sheets.append((*_about(_engines[name], task), time.process_time() - begun))
    return pickle.dumps(sheets), "", time.process_time() - start


def _about(engine: Engine, task: Task) -> tuple[list[Raw], tuple[Unsupported, ...]]:
    """Ask for what this is about alone: a whole plan would have the engine look into trajectories, too."""
    mechanism, said, refusals = task.mechanism, list[Raw](), list[Unsupported]()
    for question in QUESTIONS:
        try:
            unsupported = engine.unsupported(mechanism, question)
            methods = () if unsupported else engine.methods(mechanism, question)
        except Exception as error:  # noqa: BLE001 - whatever an engine raises is evidence about that engine
            said.append((question, None, None, f"{type(error).__name__}: {error}"))
            continue
        refusals += [u for u in unsupported if question is Question.INSTANT]
        if not methods and not unsupported:
            said.append((question, None, None, "the adapter supports the question and offers no method"))
        said += [_answer(engine, task, question, method) for method in methods]
    return said, tuple(refusals)


def _answer(engine: Engine, task: Task, question: Question, method: Method) -> Raw:
    try:
        value: object
        if question is Question.MODEL:
            value = engine.model(task.mechanism, task.states[0], method)
        else:
            value = engine.instant(task.mechanism, task.states, method)
        return question, method, pickle.dumps(value), ""
    except Exception as error:  # noqa: BLE001 - whatever an engine raises is evidence about that engine
        return question, method, None, f"{type(error).__name__}: {error}"


def _unpickled(raw: Raw) -> Said:
    question, method, pickled, reason = raw
    if pickled is None:
        return Said(question, method, None, reason)
    try:
        return Said(question, method, pickle.loads(pickled))
    except Exception as error:  # noqa: BLE001 - what an answer does while it is read is evidence about its engine
        return Said(question, method, None, f"the answer cannot be read: {type(error).__name__}: {error}")


class Panelist(Worker):
    """An engine that is asked about many mechanisms at a time."""

    def submit_many(self, tasks: Sequence[Task]) -> Future[Any]:
        """Queue a message; give the future to `sheets`."""
        future: Future[Any] = self._pool.schedule(_serve_many, args=(self.engine, tasks), timeout=self.limit)
        self._pending = future
        if self._cancelled:
            future.cancel()
        return future

    def sheets(self, tasks: Sequence[Task], future: Future[Any]) -> list[Sheet]:
        """Wait for a message: one sheet a task, in their order."""
        reply = self.reply(future)
        if isinstance(reply.value, list):
            return [
                Sheet(tuple(_unpickled(raw) for raw in said), unsupported, cpu, reply.log)
                for said, unsupported, cpu in reply.value
            ]
        if len(tasks) == 1:
            return [Sheet((Said(Question.INSTANT, None, None, reply.reason),), log=reply.log)]
        alone = [self.sheets([task], self.submit_many([task]))[0] for task in tasks]
        if any(said.reason == reply.reason for sheet in alone for said in sheet.said):
            return alone
        # none does it alone: what they did together must not vanish from the record
        together = Said(Question.INSTANT, None, None, f"{reply.reason}, in a message of {len(tasks)} mechanisms")
        return [Sheet((*alone[0].said, together), alone[0].unsupported, alone[0].cpu, reply.log), *alone[1:]]
