"""What a worker can be asked, and how an engine is asked it. The same functions serve an engine in this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

import numpy as np

from consilience.engine.answers import Manifest, Method, Question, Unsupported
from consilience.engine.protocol import Engine
from consilience.mechanism import Array, Mechanism, State

_P = ParamSpec("_P")
_T = TypeVar("_T")


@dataclass(frozen=True)
class Raised:
    """What an engine raised in place of an answer."""

    error: Exception


def attempt(action: Callable[_P, _T], *given: _P.args, **named: _P.kwargs) -> _T | Raised:
    """Let an engine act; what it raises is evidence about it. What judges its answers is to stay outside."""
    try:
        return action(*given, **named)
    except Exception as error:  # noqa: BLE001 - an engine, and its adapter, may raise anything
        return Raised(error)


@dataclass(frozen=True, eq=False)
class Request:
    """One job of a worker. Without a question: describe yourself and, given a mechanism, plan.

    With several `survey` questions instead of one, say all there is to say to each of them.
    """

    mechanism: Mechanism | None = None
    question: Question | None = None
    method: Method | None = None
    states: Sequence[State] = ()
    times: Array | None = None
    step: float = 0.0
    survey: tuple[Question, ...] = ()


_WIDTHS = {"p_WB": 3, "quat_WB": 4, "v_WB_W": 3, "w_WB_W": 3}
"""Fields of a state, in the order of a row, and what each has for one body."""

_WIDTH = sum(_WIDTHS.values())

_FLOAT = np.dtype(float)


def stacked(states: Sequence[State]) -> tuple[bytes, tuple[int, int]]:
    """States of one mechanism as an array, its bytes and shape.

    One state in a row: positions of all bodies, then quaternions, and so on.
    """
    parts = list[bytes]()
    for state in states:
        parts += state.p_WB.tobytes(), state.quat_WB.tobytes(), state.v_WB_W.tobytes(), state.w_WB_W.tobytes()
    return b"".join(parts), (len(states), _WIDTH * len(states[0].p_WB))


def states_of(table: Array) -> tuple[State, ...]:
    """States of such an array, contiguous as what has come in a frame is; they share its memory.

    Raises
    ------
    ValueError
        If it is none.
    """
    if table.dtype != _FLOAT or table.ndim != 2 or table.shape[1] % _WIDTH:
        raise ValueError(f"an array of {table.dtype} and shape {table.shape} holds no states")
    count, width = table.shape
    return tuple([_state(table, row * width * _FLOAT.itemsize, width // _WIDTH) for row in range(count)])


def _state(table: Array, at: int, bodies: int) -> State:
    """Of a row that begins at a byte, without the checks of a state: it must be the runner's to the last bit."""
    state = object.__new__(State)
    content = state.__dict__
    for name, width in _WIDTHS.items():
        content[name] = np.ndarray((bodies, width), _FLOAT, table, at)
        at += bodies * width * _FLOAT.itemsize
    return state


@dataclass(frozen=True)
class Plan:
    """What an engine says about a mechanism before it is asked anything."""

    unsupported: dict[Question, tuple[Unsupported, ...]]
    methods: dict[Question, tuple[Method, ...]]
    manifest: Manifest


@dataclass(frozen=True, eq=False)
class MethodAnswer:
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
class AnswerSet:
    """All an engine said to some questions about one mechanism, and what it cannot represent of each."""

    said: tuple[MethodAnswer, ...]
    unsupported: dict[Question, tuple[Unsupported, ...]]


def perform(engine: Engine, request: Request) -> object:
    """Let an engine do a job: an EngineInfo, a Plan, a Survey or an Answer from a sound engine; anything from another.

    Raises
    ------
    Exception
        Whatever the engine raises.
    """
    if request.mechanism is None:
        return engine.info()
    if request.survey:
        return _survey(engine, request.mechanism, request.states, request.survey)
    if request.question is None or request.method is None:
        return _plan(engine, request.mechanism)
    return _ask(engine, request.mechanism, request)


def _plan(engine: Engine, mechanism: Mechanism) -> Plan:
    unsupported = {q: engine.unsupported(mechanism, q) for q in Question}
    can = [q for q in Question if not unsupported[q]]
    return Plan(
        unsupported,
        {q: engine.methods(mechanism, q) for q in can},
        engine.manifest(mechanism) if can else Manifest(),
    )


def _ask(engine: Engine, mechanism: Mechanism, request: Request) -> object:
    assert request.method is not None
    if request.question is Question.MODEL:
        return engine.model(mechanism, request.states[0], request.method)
    if request.question is Question.INSTANT:
        return engine.instant(mechanism, request.states, request.method)
    assert request.times is not None
    return engine.trajectory(mechanism, request.states[0], request.times, request.method, request.step)


def offer(
    engine: Engine, mechanism: Mechanism, question: Question
) -> tuple[tuple[Unsupported, ...], tuple[Method, ...]]:
    """What an engine cannot represent of a mechanism, and its methods if that is nothing."""
    unsupported = engine.unsupported(mechanism, question)
    return unsupported, () if unsupported else engine.methods(mechanism, question)


def _survey(engine: Engine, mechanism: Mechanism, states: Sequence[State], questions: Sequence[Question]) -> AnswerSet:
    """Ask for what this is about alone: a whole plan would have the engine look into trajectories, too."""
    said, refusals = list[MethodAnswer](), dict[Question, tuple[Unsupported, ...]]()
    for question in questions:
        offered = attempt(offer, engine, mechanism, question)
        if isinstance(offered, Raised):
            said.append(MethodAnswer(question, None, None, raised(offered.error)))
            continue
        refusals[question], methods = offered
        if not methods and not refusals[question]:
            said.append(MethodAnswer(question, None, None, "the adapter supports the question and offers no method"))
        for method in methods:
            answer = attempt(_ask, engine, mechanism, Request(mechanism, question, method, states))
            if isinstance(answer, Raised):
                said.append(MethodAnswer(question, method, None, raised(answer.error)))
            else:
                said.append(MethodAnswer(question, method, answer))
    return AnswerSet(tuple(said), refusals)


_MOST_WORDS = 2000


def raised(error: BaseException) -> str:
    """An exception in words."""
    try:
        words = str(error)
    except Exception as worse:  # noqa: BLE001 - an exception of an adapter whose own message fails
        words = f"its message cannot be read: {type(worse).__name__}"
    return f"{type(error).__name__}: {words}"[:_MOST_WORDS]
