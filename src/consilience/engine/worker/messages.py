"""Frames from the runner to a worker: mechanisms and methods to keep, engines to load, jobs."""

from __future__ import annotations

import hashlib
import weakref
from collections import OrderedDict
from functools import lru_cache
from typing import Any

import numpy as np

from consilience.engine.answers import Method
from consilience.engine.worker import codec, wire
from consilience.engine.worker.environments import local_name
from consilience.engine.worker.requests import Request, pack_states
from consilience.mechanism import Mechanism

REMEMBERED = 32
"""Number of mechanisms that a worker keeps, and of methods."""

_packed: dict[int, tuple[weakref.ref[Mechanism | Method], str, bytes]] = {}
"""Key and frame of each mechanism and method by identity: a method holds a dict of settings and has no hash."""


def frame_of(value: Mechanism | Method) -> tuple[str, bytes]:
    """Return the key of a mechanism or method, a digest of its content, and the frame by which a worker keeps it."""
    name = id(value)
    if name not in _packed:
        tree, arrays = codec.encode(value)
        key = hashlib.sha256(wire.pack({"value": tree}, arrays)).hexdigest()
        frame = wire.pack({"kind": "keep", "key": key, "value": tree}, arrays)
        _packed[name] = weakref.ref(value, lambda _: _packed.pop(name, None)), key, frame
    return _packed[name][1:]


class RecentlySent:
    """Keys of the mechanisms, or methods, that a worker keeps, in the order of their last use."""

    def __init__(self) -> None:
        self._keys: OrderedDict[str, None] = OrderedDict()

    def need(self, value: Mechanism | Method | None) -> tuple[str | None, bytes]:
        """Return the key under which the worker keeps a value, and the frames to send before a job that needs it."""
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
    """Return all frames of a job for a new worker: ``python -m consilience.engine.worker FILE`` repeats the job."""
    mechanism, first = RecentlySent().need(request.mechanism)
    method, second = RecentlySent().need(request.method)
    return loading(engine, 1) + first + second + job(request, mechanism, method, 2)


def loading(engine: str, number: int) -> bytes:
    """Return the frame by which a worker imports and constructs an engine."""
    return wire.pack({"kind": "load", "engine": local_name(engine)}, job=number)


_FLOAT = np.dtype(float)

_ArrayType = tuple[np.dtype[Any], tuple[int, ...]]


def job(request: Request, mechanism: str | None, method: str | None, number: int) -> bytes:
    """Return the frame of a job about the mechanism and by the method of these keys."""
    buffers, states, times = list[bytes](), None, None
    if request.states:
        buffer, shape = pack_states(request.states)
        buffers, states = [buffer], (_FLOAT, shape)
    if request.times is not None:
        grid = np.asarray(request.times)
        buffers, times = [*buffers, grid.tobytes()], (grid.dtype, grid.shape)
    listed = tuple(one for one in (states, times) if one is not None)
    entries = {
        "kind": "job",
        "mechanism": mechanism,
        "method": method,
        "question": request.question,
        "survey": request.survey,
        "step": float(request.step),
        "states": int(states is not None),
        "times": int(times is not None),
    }
    if not request.parameters:
        return wire.pack_frame(_header(tuple(entries.items()), listed), buffers, number)
    entries["parameters"], arrays = codec.encode(dict(request.parameters))
    listed += tuple((array.dtype, array.shape) for array in arrays)
    return wire.pack_frame(wire.pack_header(entries, listed), [*buffers, *(a.tobytes() for a in arrays)], number)


@lru_cache(256)
def _header(entries: tuple[tuple[str, Any], ...], listed: tuple[_ArrayType, ...]) -> bytes:
    """Return the header of a job: equal for equal requests at as many states and times."""
    return wire.pack_header(dict(entries), listed)
