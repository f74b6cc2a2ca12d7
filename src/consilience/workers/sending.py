"""What a worker is sent: mechanisms, engines to load, jobs."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from weakref import WeakKeyDictionary

from consilience.mechanism import Mechanism
from consilience.workers import codec, frames
from consilience.workers.environments import local_name
from consilience.workers.jobs import Request

_packed: WeakKeyDictionary[Mechanism, tuple[str, bytes]] = WeakKeyDictionary()


def frame_of(mechanism: Mechanism) -> tuple[str, bytes]:
    """Key of a mechanism, by its content, and the frame that sends it."""
    known = _packed.get(mechanism)
    if known is None:
        tree, arrays = codec.encode(mechanism)
        key = hashlib.sha256(frames.pack({"value": tree}, arrays)).hexdigest()
        known = _packed[mechanism] = key, frames.pack({"kind": "mechanism", "key": key, "value": tree}, arrays)
    return known


def alone(engine: str, request: Request) -> bytes:
    """All frames that an empty worker needs for a job: ``python -m consilience.workers FILE`` does it."""
    key, mechanism = (None, b"") if request.mechanism is None else frame_of(request.mechanism)
    return loading(engine, 1) + mechanism + job(request, key, 2)


def loading(engine: str, number: int) -> bytes:
    """Frame that has an engine imported and constructed."""
    return frames.pack({"kind": "load", "job": number, "engine": local_name(engine)})


def job(request: Request, key: str | None, number: int) -> bytes:
    """Frame of a job about the mechanism of a key."""
    tree, arrays = codec.encode(replace(request, mechanism=None))
    return frames.pack({"kind": "job", "job": number, "mechanism": key, "value": tree}, arrays)
