"""Store of answers by the content of their requests: a database beside the report.

The key of an answer is a digest of everything on which the answer depends: engine and version, mechanism, states,
times, question, parameters, method with its settings, step, and the sources of the harness and of the adapter. After
any change of these the engine is asked again.

SQLite stores each answer in a transaction of its own: a process that is killed loses only its running jobs.
"""

from __future__ import annotations

import hashlib
import io
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from consilience.engine import Answer, EngineInfo, installed, split_name
from consilience.engine.questions import ANSWERS
from consilience.engine.worker.client import Request, replayable_job
from consilience.errors import ConsilienceError

FILE = "answers.sqlite"

FAILED = "failed"
"""Folder of failed jobs, beside the database."""

_LAYOUT = "CREATE TABLE IF NOT EXISTS answers (key TEXT PRIMARY KEY, about TEXT NOT NULL, arrays BLOB NOT NULL)"


class StoreError(ConsilienceError):
    """The store cannot be read or written."""


@dataclass(frozen=True, eq=False)
class StoredAnswer:
    """An answer with its CPU time and the output of the engine."""

    answer: Answer
    cpu: float
    log: str


def _pieces(value: Any) -> Iterator[bytes]:
    """Yield bytes that stand for the content of a value: equal for equal values, different for different values."""
    if is_dataclass(value) and not isinstance(value, type):
        yield type(value).__name__.encode()
        for item in fields(value):
            yield item.name.encode()
            yield from _pieces(getattr(value, item.name))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        yield f"{{{len(value)}".encode()
        for key in sorted(value, key=repr):
            yield repr(key).encode()
            yield from _pieces(value[key])
    elif isinstance(value, str | bytes | bool | int | float | None):
        yield f"{type(value).__name__}:{value!r};".encode()
    elif isinstance(value, Sequence):
        yield f"[{len(value)}".encode()
        for item in value:
            yield from _pieces(item)
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


def _digest(*values: Any) -> str:
    digest = hashlib.sha256()
    for value in values:
        for piece in _pieces(value):
            digest.update(len(piece).to_bytes(8, "little"))
            digest.update(piece)
    return digest.hexdigest()


@cache
def _sources(package: str) -> str:
    """Return a digest of the Python sources of an installed package, without importing it; empty if it has none."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        return ""
    origin = Path(spec.origin)
    files = sorted(origin.parent.rglob("*.py")) if spec.submodule_search_locations else [origin]
    return _digest([(str(f.relative_to(origin.parent)), f.read_bytes()) for f in files])


def _code(engine: str) -> tuple[str, str]:
    """Return digests of the sources of the harness and of an adapter; an engine may write its name in capitals."""
    named = {name.casefold(): entry for name, entry in installed().items()}
    entry = named.get(engine.partition(":")[0].casefold())
    return _sources("consilience"), _sources(entry.module.partition(".")[0]) if entry else ""


def code_of(engines: Sequence[str]) -> str:
    """Return a digest of the sources of the harness and of the adapters of these engines."""
    return _digest(*(_code(split_name(engine)[0]) for engine in ("", *engines)))


def _item(value: Any) -> Any:
    """Return a NumPy scalar as a Python number."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"no place for a {type(value).__name__} in the store")


class Store:
    """Store of answers in a folder.

    Parameters
    ----------
    folder : Path
        Created if missing.
    fresh : bool
        Delete all answers.

    Raises
    ------
    StoreError
        If the file is no database, or cannot be written.
    """

    def __init__(self, folder: Path, fresh: bool = False) -> None:
        self._file = folder / FILE
        self._lock = Lock()
        self._mechanism: tuple[object, str] = (None, "")
        self._codes: dict[str, tuple[str, str]] = {}
        folder.mkdir(parents=True, exist_ok=True)
        try:
            self._connection = sqlite3.connect(self._file, check_same_thread=False, isolation_level=None)
        except sqlite3.Error as error:
            raise StoreError(f"{self._file}: {error}") from None
        self._do("PRAGMA journal_mode=WAL")
        self._do("PRAGMA synchronous=NORMAL")
        self._do(_LAYOUT)
        if fresh:
            self._do("DELETE FROM answers")

    def _do(self, statement: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        with self._lock:
            try:
                return self._connection.execute(statement, values).fetchall()
            except sqlite3.Error as error:
                remedy = "Free some room, or remove it to begin anew."
                raise StoreError(f"{self._file}: {error}. {remedy}") from None

    def key(self, info: EngineInfo, request: Request) -> str:
        """Return the key of a job."""
        known, digest = self._mechanism
        if known is not request.mechanism:
            digest = _digest(request.mechanism)
            self._mechanism = (request.mechanism, digest)
        asked = (request.question, request.method, request.states, request.times, request.step, request.parameters)
        if info.name not in self._codes:  # reading the sources takes longer than many jobs
            self._codes[info.name] = _code(info.name)
        return _digest(asdict(info), self._codes[info.name], digest, asked)

    def find(self, key: str) -> StoredAnswer | None:
        """Return the answer of a key; None if there is none."""
        rows = self._do("SELECT about, arrays FROM answers WHERE key = ?", (key,))
        if not rows:
            return None
        about, arrays = json.loads(rows[0][0]), np.load(io.BytesIO(rows[0][1]), allow_pickle=False)
        values = dict(about["values"]) | {name: arrays[name] for name in arrays.files}
        return StoredAnswer(ANSWERS[about["kind"]](**values), about["cpu"], about["log"])

    def keep(self, key: str, stored: StoredAnswer) -> None:
        """Store an answer."""
        values = vars(stored.answer)
        arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
        others = {name: value for name, value in values.items() if name not in arrays}
        about = {"kind": type(stored.answer).__name__, "values": others, "cpu": stored.cpu, "log": stored.log}
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        row = (key, json.dumps(about, default=_item), buffer.getvalue())
        self._do("INSERT OR REPLACE INTO answers VALUES (?, ?, ?)", row)

    def keep_job(self, key: str, job: bytes) -> str:
        """Write the frames of a failed job to a file; return its name relative to the folder."""
        file = self._file.parent / FAILED / f"{key[:20]}.frames"
        try:
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(job)
        except OSError as error:
            raise StoreError(f"{file}: {error.strerror}") from None
        return f"{FAILED}/{file.name}"

    def close(self) -> None:
        """Close the database."""
        with self._lock:
            self._connection.close()


def with_job(log: str, store: Store, key: str, engine: str, request: Request) -> str:
    """Write a failed job to the store; return the output of the engine, and how to repeat the job.

    Parameters
    ----------
    log : str
        Output of the engine.
    store : Store
    key : str
        Key of the job in the store.
    engine : str
    request : Request
    """
    job = store.keep_job(key, replayable_job(engine, request))
    lines = [log.rstrip("\n")] if log.strip() else []
    return "\n".join([*lines, f"to do it again: python -m consilience.engine.worker {job}"])
