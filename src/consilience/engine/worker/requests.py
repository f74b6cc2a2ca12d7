"""Requests to an engine and their answers; the same functions serve an engine in a worker and one in this process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ParamSpec, TypeVar

import numpy as np

from consilience.engine.answers import CannotRepresent, Manifest, Method, Unsupported
from consilience.engine.protocol import Engine
from consilience.engine.questions import Question
from consilience.engine.worker.own_units import units_of, with_units, without_units
from consilience.mechanism import Array, Mechanism, State, Units, in_units, telling_si

_P = ParamSpec("_P")
_T = TypeVar("_T")


@dataclass(frozen=True)
class Raised:
    """Exception that an engine raised in place of an answer."""

    error: Exception


def attempt(action: Callable[_P, _T], *given: _P.args, **named: _P.kwargs) -> _T | Raised:
    """Call an engine and return its value or its exception; the judgement of answers must not be called so."""
    try:
        return action(*given, **named)
    except Exception as error:  # noqa: BLE001 - an engine, and its adapter, may raise anything
        return Raised(error)


@dataclass(frozen=True, eq=False)
class Request:
    """Job of a worker: one question, or several by all their methods, or a description of the engine or of its plan.

    Attributes
    ----------
    mechanism : Mechanism or None
        None asks for the `EngineInfo`; a mechanism without questions for the `Plan`.
    question : Question or None
    method : Method or None
    states : sequence of State
    times : ndarray, shape (n_t,), s, or None
        Samples of a motion.
    step : float
        Step size in s or tolerance.
    survey : tuple of Question
        Questions to be answered by all methods, in an `AnswerSet`.
    parameters : dict
        Further arguments of the question by name: arrays, numbers, text, and tuples and dicts of them.
    """

    mechanism: Mechanism | None = None
    question: Question | None = None
    method: Method | None = None
    states: Sequence[State] = ()
    times: Array | None = None
    step: float = 0.0
    survey: tuple[Question, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def state(self) -> State:
        """The first state."""
        return self.states[0]

    def argument(self, name: str) -> object:
        """Return an argument of the engine's method, as a row of the table names it."""
        return self.parameters[name] if name in self.parameters else getattr(self, name)


_WIDTHS = {"p_WB": 3, "quat_WB": 4, "v_WB_W": 3, "w_WB_W": 3}
"""Fields of a state in the order of a row, and their numbers of components for one body."""

_WIDTH = sum(_WIDTHS.values())

_FLOAT = np.dtype(float)


def pack_states(states: Sequence[State]) -> tuple[bytes, tuple[int, int]]:
    """Return states of one mechanism as the bytes of an array, and its shape.

    Each row holds one state: positions of all bodies, then quaternions, velocities and angular velocities.
    """
    parts = list[bytes]()
    for state in states:
        parts += state.p_WB.tobytes(), state.quat_WB.tobytes(), state.v_WB_W.tobytes(), state.w_WB_W.tobytes()
    return b"".join(parts), (len(states), _WIDTH * len(states[0].p_WB))


def unpack_states(table: Array) -> tuple[State, ...]:
    """Return the states of a contiguous array as from `pack_states`; they share its memory.

    Raises
    ------
    ValueError
        If the array has another type or shape.
    """
    if table.dtype != _FLOAT or table.ndim != 2 or table.shape[1] % _WIDTH:
        raise ValueError(f"an array of {table.dtype} and shape {table.shape} holds no states")
    count, width = table.shape
    return tuple([_state(table, row * width * _FLOAT.itemsize, width // _WIDTH) for row in range(count)])


def _state(table: Array, at: int, bodies: int) -> State:
    """Return the state of a row that begins at a byte, without the checks of `State`, which normalise quaternions."""
    state = object.__new__(State)
    content = state.__dict__
    for name, width in _WIDTHS.items():
        content[name] = np.ndarray((bodies, width), _FLOAT, table, at)
        at += bodies * width * _FLOAT.itemsize
    return state


@dataclass(frozen=True)
class Plan:
    """Methods of an engine for a mechanism by question, features it cannot represent, and the manifest."""

    unsupported: dict[Question, tuple[Unsupported, ...]]
    methods: dict[Question, tuple[Method, ...]]
    manifest: Manifest

    def refusals(self, question: Question) -> tuple[Unsupported, ...]:
        """Return why a question is unsupported; empty if the engine answers it."""
        return self.unsupported.get(question, _refusal(question, "the worker of the engine does not know the question"))


@dataclass(frozen=True, eq=False)
class MethodAnswer:
    """Answer to one question by one method.

    Attributes
    ----------
    question : Question
    method : Method or None
        None where the engine gave no methods.
    answer : object
        None if there is no answer; an Unsupported if the engine cannot represent a state.
    reason : str
        Why there is no answer.
    """

    question: Question
    method: Method | None
    answer: object
    reason: str = ""


@dataclass(frozen=True, eq=False)
class AnswerSet:
    """Answers to several questions about one mechanism by all methods, and the unsupported features by question."""

    said: tuple[MethodAnswer, ...]
    unsupported: dict[Question, tuple[Unsupported, ...]]


def perform(engine: Engine, request: Request) -> object:
    """Let an engine do a job.

    Returns
    -------
    object
        An EngineInfo, a Plan, an AnswerSet, an Answer, or an Unsupported in its place; an unsound engine may return
        anything.

    Raises
    ------
    Exception
        Any exception of the engine.
    """
    if request.mechanism is None:
        return engine.info()
    if request.survey:
        return _survey(engine, request.mechanism, request)
    if request.question is None or request.method is None:
        return _plan(engine, request.mechanism, request.states)
    return _ask(engine, request.mechanism, request.question, request)


def _refusal(question: Question, reason: str) -> tuple[Unsupported, ...]:
    return (Unsupported(f"the question '{question}'", reason),)


def _unsupported(engine: Engine, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
    """Return the features an engine cannot represent; without a method of its name, the question itself is one."""
    if not hasattr(engine, question):
        return _refusal(question, "the adapter does not answer it")
    return engine.unsupported(mechanism, question)


def _plan(engine: Engine, mechanism: Mechanism, states: Sequence[State]) -> Plan:
    unsupported = {q: _unsupported(engine, mechanism, q) for q in Question}
    can = [q for q in Question if not unsupported[q]]
    return Plan(
        unsupported,
        {q: _methods(engine, mechanism, q, states) for q in can},
        engine.manifest(mechanism) if can else Manifest(),
    )


_in_units = lru_cache(maxsize=4)(in_units)
"""Converted mechanisms; adapters keep what they have prepared for a mechanism."""


def _converted(request: Request, units: Units) -> Request:
    """Return a request in the units of its method, which its adapter does not know."""
    assert request.method is not None
    return replace(
        request,
        method=without_units(request.method),
        states=[units.convert(state) for state in request.states],
        times=None if request.times is None else units.time * request.times,
        step=request.step * (units.time if request.method.substeps else 1.0),
    )


def _ask(engine: Engine, mechanism: Mechanism, question: Question, request: Request) -> object:
    """Call the engine's method of the question's name with the arguments of the question's row, in its own units."""
    units = units_of(request.method)
    if units != Units():
        mechanism, request = _in_units(mechanism, *units), _converted(request, units)
    try:
        with telling_si(units):
            answer = getattr(engine, question)(mechanism, *map(request.argument, question.arguments))
    except CannotRepresent as found:
        return found.refusal
    return units.inverse.convert(answer) if units != Units() and isinstance(answer, question.answer) else answer


def offer(
    engine: Engine, mechanism: Mechanism, question: Question, states: Sequence[State] = ()
) -> tuple[tuple[Unsupported, ...], tuple[Method, ...]]:
    """Return the features that an engine cannot represent, and its methods if there are none."""
    unsupported = _unsupported(engine, mechanism, question)
    return unsupported, () if unsupported else _methods(engine, mechanism, question, states)


def _methods(engine: Engine, mechanism: Mechanism, question: Question, states: Sequence[State]) -> tuple[Method, ...]:
    """Return the methods of an engine, with the units of the mechanism where they need any.

    A compliance follows from inertias and the adapter's constants: it is asked for in the units of the method.
    """
    methods = engine.methods(mechanism, question)
    found = with_units(mechanism, states, question, methods)
    springs = [one for one in found if one.law is not None and one.law.compliance is not None]
    if not springs or (units := units_of(springs[0])) == Units():
        return found
    own = {one.name: one.law for one in engine.methods(_in_units(mechanism, *units), question)}
    names = {one.name for one in springs}
    given = (replace(one, law=own[one.name]) if one.name in names else one for one in methods)
    return with_units(mechanism, states, question, tuple(given))


def _survey(engine: Engine, mechanism: Mechanism, request: Request) -> AnswerSet:
    """Ask for the methods of the given questions alone: a plan would make the engine examine motions, too."""
    said, refusals = list[MethodAnswer](), dict[Question, tuple[Unsupported, ...]]()
    for question in request.survey:
        offered = attempt(offer, engine, mechanism, question, request.states)
        if isinstance(offered, Raised):
            said.append(MethodAnswer(question, None, None, raised(offered.error)))
            continue
        refusals[question], methods = offered
        if not methods and not refusals[question]:
            said.append(MethodAnswer(question, None, None, NO_METHOD))
        for method in methods:
            answer = attempt(_ask, engine, mechanism, question, replace(request, method=method))
            if isinstance(answer, Raised):
                said.append(MethodAnswer(question, method, None, raised(answer.error)))
            else:
                said.append(MethodAnswer(question, method, answer))
    return AnswerSet(tuple(said), refusals)


NO_METHOD = "the adapter supports the question and offers no method"

_MOST_WORDS = 2000


def raised(error: BaseException) -> str:
    """Return type and message of an exception."""
    try:
        words = str(error)
    except Exception as worse:  # noqa: BLE001 - an exception of an adapter whose own message fails
        words = f"its message cannot be read: {type(worse).__name__}"
    return f"{type(error).__name__}: {words}"[:_MOST_WORDS]
