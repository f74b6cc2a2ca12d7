"""What a worker is sent: mechanisms and methods to keep, engines to load, jobs."""

from __future__ import annotations

import hashlib
import weakref
from collections import OrderedDict
from functools import lru_cache
from typing import Any

import numpy as np

from consilience.engine.answers import Method, Question
from consilience.engine.worker import codec, wire
from consilience.engine.worker.environments import local_name
from consilience.engine.worker.requests import Request, stacked
from consilience.mechanism import Mechanism

REMEMBERED = 32
"""Mechanisms that a worker holds at a time, and methods."""

_packed: dict[int, tuple[weakref.ref[Mechanism | Method], str, bytes]] = {}
"""By identity: a method holds a table of settings and has no hash."""


def frame_of(value: Mechanism | Method) -> tuple[str, bytes]:
    """Key of a mechanism or method, by its content, and the frame that has a worker keep it."""
    name = id(value)
    if name not in _packed:
        tree, arrays = codec.encode(value)
        key = hashlib.sha256(wire.pack({"value": tree}, arrays)).hexdigest()
        frame = wire.pack({"kind": "keep", "key": key, "value": tree}, arrays)
        _packed[name] = weakref.ref(value, lambda _: _packed.pop(name, None)), key, frame
    return _packed[name][1:]


class Held:
    """What a worker has been sent to keep: the last used of one kind."""

    def __init__(self) -> None:
        self._keys: OrderedDict[str, None] = OrderedDict()

    def need(self, value: Mechanism | Method | None) -> tuple[str | None, bytes]:
        """Key under which the worker holds a value, and the frames to send before a job that needs it."""
        if value is None:
            return None, b""
        key, frame = frame_of(value)
        if key in self._keys:
            self._keys.move_to_end(key)
            return key, b""
        self._keys[key] = None
        if len(self._keys) > REMEMBERED:
            oldest, _ = self._keys.popitem(last=False)
            frame += wire.pack({"kind": "forget", "key": oldest})
        return key, frame


def replayable_job(engine: str, request: Request) -> bytes:
    """All frames that an empty worker needs for a job: ``python -m consilience.engine.worker FILE`` does it."""
    mechanism, first = Held().need(request.mechanism)
    method, second = Held().need(request.method)
    return loading(engine, 1) + first + second + job(request, mechanism, method, 2)


def loading(engine: str, number: int) -> bytes:
    """Frame that has an engine imported and constructed."""
    return wire.pack({"kind": "load", "engine": local_name(engine)}, job=number)


_FLOAT = np.dtype(float)

_Listed = tuple[np.dtype[Any], tuple[int, ...]]


def job(request: Request, mechanism: str | None, method: str | None, number: int) -> bytes:
    """Frame of a job about the mechanism and by the method of these keys."""
    buffers, states, times = list[bytes](), None, None
    if request.states:
        buffer, shape = stacked(request.states)
        buffers, states = [buffer], (_FLOAT, shape)
    if request.times is not None:
        grid = np.asarray(request.times)
        buffers, times = [*buffers, grid.tobytes()], (grid.dtype, grid.shape)
    form = _form(mechanism, method, request.question, request.survey, float(request.step), states, times)
    return wire.framed(form, buffers, number)


@lru_cache(256)
def _form(
    mechanism: str | None,
    method: str | None,
    question: Question | None,
    survey: tuple[Question, ...],
    step: float,
    states: _Listed | None,
    times: _Listed | None,
) -> bytes:
    """Header of a job: the same whenever the same is asked at as many states and times."""
    listed = [one for one in (states, times) if one is not None]
    told = {
        "kind": "job",
        "mechanism": mechanism,
        "method": method,
        "question": question,
        "survey": survey,
        "step": step,
        "states": int(states is not None),
        "times": int(times is not None),
    }
    return wire.written(told, listed)
