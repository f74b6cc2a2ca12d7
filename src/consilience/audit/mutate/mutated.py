"""An engine with one error at its public seam: the mechanism, the states or the method it gets, or its answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from consilience.engine import (
    Engine,
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Question,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.mechanism import Array, Mechanism, State


class SeamError(Exception):
    """A mutant does not fit its adapter: a name is gone, or has another meaning."""


MechanismChange = Callable[[Mechanism, float], Mechanism]
"""Map the mechanism of a request and a magnitude to the mechanism that the host gets."""

StatesChange = Callable[[Mechanism, Sequence[State], float], list[State]]
"""Map the mechanism and states of a request and a magnitude to the states that the host gets."""

MethodChange = Callable[[Method, float], Method]
"""Map a method of the host and a magnitude to another description of the method."""


@dataclass(frozen=True, eq=False)
class InstantRequest:
    """The request of an answer to `instant`, for changes of the answer that ask the engine again."""

    engine: Engine
    mechanism: Mechanism
    states: Sequence[State]
    method: Method


ModelChange = Callable[[ModelAnswer, float], ModelAnswer]
InstantChange = Callable[[InstantRequest, InstantAnswer, float], InstantAnswer]
MotionChange = Callable[[TrajectoryAnswer, float], TrajectoryAnswer]


@dataclass(eq=False)
class Mutated:
    """An engine with changed requests or answers.

    Attributes
    ----------
    host : Engine
        The correct engine.
    magnitude : float
    change_mechanism, change_states : callable, optional
        Change the mechanism, and the states, of a request.
    change_method : callable, optional
        Change the methods that the engine offers; the host still answers by its own.
    change_own_method : callable, optional
        Change the method by which the host answers; the engine offers the methods of the host.
    change_model, change_instant, change_motion : callable, optional
        Change the answer to a question.
    """

    host: Engine
    magnitude: float
    change_mechanism: MechanismChange | None = None
    change_states: StatesChange | None = None
    change_method: MethodChange | None = None
    change_own_method: MethodChange | None = None
    change_model: ModelChange | None = None
    change_instant: InstantChange | None = None
    change_motion: MotionChange | None = None
    _last: tuple[Mechanism, Mechanism] | None = None
    _methods: dict[str, Method] = field(default_factory=dict)

    def _given(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism for the host: one object for one mechanism, whose translation hosts keep."""
        if self.change_mechanism is None:
            return mechanism
        if self._last is None or self._last[0] is not mechanism:
            self._last = (mechanism, self.change_mechanism(mechanism, self.magnitude))
        return self._last[1]

    def _at(self, mechanism: Mechanism, states: Sequence[State]) -> list[State]:
        return list(states) if self.change_states is None else self.change_states(mechanism, states, self.magnitude)

    def info(self) -> EngineInfo:
        """Return the description of the host."""
        return self.host.info()

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Return what the host cannot represent of the changed mechanism."""
        return self.host.unsupported(self._given(mechanism), question)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods of the host, with changed descriptions."""
        own = self.host.methods(self._given(mechanism), question)
        self._methods = {method.name: method for method in own}
        if self.change_method is None:
            return own
        return tuple(self.change_method(method, self.magnitude) for method in own)

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Return the manifest of the host for the changed mechanism."""
        return self.host.manifest(self._given(mechanism))

    def _own(self, method: Method) -> Method:
        own = replace(self._methods.get(method.name, method), softness=method.softness)
        return own if self.change_own_method is None else self.change_own_method(own, self.magnitude)

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return the changed answer of the host to the changed request."""
        answer = self.host.model(self._given(mechanism), self._at(mechanism, [state])[0], self._own(method))
        return answer if self.change_model is None else self.change_model(answer, self.magnitude)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return the changed answer of the host to the changed request."""
        given, own = self._given(mechanism), self._own(method)
        answer = self.host.instant(given, self._at(mechanism, states), own)
        if self.change_instant is None:
            return answer
        return self.change_instant(InstantRequest(self.host, given, states, own), answer, self.magnitude)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Return the changed motion of the host from the changed state.

        Parameters
        ----------
        mechanism : Mechanism
        state : State
            At the first time.
        times : ndarray, shape (n_t,), s
        method : Method
        step : float
            Step size in s, or tolerance.
        """
        start = self._at(mechanism, [state])[0]
        answer = self.host.trajectory(self._given(mechanism), start, times, self._own(method), step)
        return answer if self.change_motion is None else self.change_motion(answer, self.magnitude)


Planting = Callable[[Engine, float], Any]
"""Context manager that plants an error of a magnitude in an engine, yields the engine to ask, and removes the error."""


def changed(**changes: Any) -> Planting:
    """Plant changes at the public seam, named as the fields of `Mutated` without ``change_``."""

    @contextmanager
    def plant(engine: Engine, magnitude: float) -> Iterator[Engine]:
        yield Mutated(engine, magnitude, **{f"change_{name}": change for name, change in changes.items()})

    return plant
