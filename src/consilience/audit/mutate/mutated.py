"""An engine with one error at its public seam: what goes into it, or what comes out, is changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
    """A mutant does not fit the adapter it is planted in: a name is gone, or no longer means what it did."""


MechanismChange = Callable[[Mechanism, float], Mechanism]
"""Mechanism and magnitude in, what the engine is given out."""

StatesChange = Callable[[Mechanism, Sequence[State], float], list[State]]
"""The same of the states of a mechanism."""

MethodChange = Callable[[Method, float], Method]
"""What the engine says of its method; it still answers by the one it has."""


@dataclass(frozen=True, eq=False)
class InstantRequest:
    """What an engine was asked at `instant`, for changes of its answer that need the engine again."""

    engine: Engine
    mechanism: Mechanism
    states: Sequence[State]
    method: Method


ModelChange = Callable[[ModelAnswer, float], ModelAnswer]
InstantChange = Callable[[InstantRequest, InstantAnswer, float], InstantAnswer]
MotionChange = Callable[[Mechanism, TrajectoryAnswer, float], TrajectoryAnswer]


@dataclass(eq=False)
class Mutated:
    """An engine whose questions or answers are changed; everything else is the host's."""

    host: Engine
    magnitude: float
    change_mechanism: MechanismChange | None = None
    change_states: StatesChange | None = None
    change_method: MethodChange | None = None
    change_model: ModelChange | None = None
    change_instant: InstantChange | None = None
    change_motion: MotionChange | None = None
    _last: tuple[Mechanism, Mechanism] | None = None
    _methods: dict[str, Method] | None = None

    def _given(self, mechanism: Mechanism) -> Mechanism:
        """What the host is given: the same object each time, for hosts keep the translation of the last one."""
        if self.change_mechanism is None:
            return mechanism
        if self._last is None or self._last[0] is not mechanism:
            self._last = (mechanism, self.change_mechanism(mechanism, self.magnitude))
        return self._last[1]

    def _at(self, mechanism: Mechanism, states: Sequence[State]) -> list[State]:
        return list(states) if self.change_states is None else self.change_states(mechanism, states, self.magnitude)

    def info(self) -> EngineInfo:
        """Those of the host."""
        return self.host.info()

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Those of the host for what it is given."""
        return self.host.unsupported(self._given(mechanism), question)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Those of the host, perhaps described otherwise."""
        own = self.host.methods(self._given(mechanism), question)
        self._methods = {method.name: method for method in own}
        if self.change_method is None:
            return own
        return tuple(self.change_method(method, self.magnitude) for method in own)

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """That of the host."""
        return self.host.manifest(self._given(mechanism))

    def _own(self, method: Method) -> Method:
        return replace((self._methods or {}).get(method.name, method), softness=method.softness)

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """The host's answer to the changed question, changed."""
        answer = self.host.model(self._given(mechanism), self._at(mechanism, [state])[0], self._own(method))
        return answer if self.change_model is None else self.change_model(answer, self.magnitude)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """As above."""
        given, own = self._given(mechanism), self._own(method)
        answer = self.host.instant(given, self._at(mechanism, states), own)
        if self.change_instant is None:
            return answer
        return self.change_instant(InstantRequest(self.host, given, states, own), answer, self.magnitude)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """As above."""
        start = self._at(mechanism, [state])[0]
        answer = self.host.trajectory(self._given(mechanism), start, times, self._own(method), step)
        return answer if self.change_motion is None else self.change_motion(mechanism, answer, self.magnitude)


Planting = Callable[[Engine, float], Any]
"""Context manager that plants an error of a magnitude in an engine, gives the engine to ask, and takes it out again."""


def changed(**changes: Any) -> Planting:
    """Plant a change at the public seam; `changes` are fields of `Mutated` without their ``change_``."""

    @contextmanager
    def plant(engine: Engine, magnitude: float) -> Iterator[Engine]:
        yield Mutated(engine, magnitude, **{f"change_{name}": change for name, change in changes.items()})

    return plant
