"""Frames of the protocol: a prefix of fixed size, a header in JSON, the buffers of the arrays.

::

    magic "CNSL"   version   (2 zero bytes)   size of header   size of body   job      CPU time   header   body
    4 bytes        uint16                     uint32           uint64         uint64   float64    JSON     buffers

Numbers of the prefix are little-endian: what differs from frame to frame. The header, the form, is an object of what
often does not, so that it need be neither written nor read again: all that the frame says, and ``arrays``, which lists
type (as NumPy writes it) and shape of every buffer. Each buffer begins at a multiple of 16 bytes. Whatever does not fit
raises `ProtocolError`: frames come from processes that may be broken.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array

MAGIC = b"CNSL"
VERSION = 3
PREFIX = struct.Struct("<4sHxxIQQd")

MOST_HEADER = 8 * 2**20
MOST_BODY = 2**30
"""Sizes in bytes beyond which a frame is refused before any memory is given to it."""

_SHOWN = 20
"""Bytes of garbage that are shown."""

_ALIGNMENT = 16
_MOST_ARRAYS = 100_000
_MOST_AXES = 8
_DTYPE = re.compile(r"[<>|=]?[biufcUS][0-9]{1,6}")

_MOST_REMEMBERED = 8192
"""Size in bytes of a form beyond which it is not kept for the next frame."""

_ENCODER = json.JSONEncoder(separators=(",", ":"))

_FILLING = bytes(_ALIGNMENT)

Header = dict[str, Any]
_Place = tuple[np.dtype[Any], tuple[int, ...], int | None]
"""Of an array: type, shape, where it begins in the body; None if it has no bytes there."""


class ProtocolError(Exception):
    """What came is not what the protocol allows."""


@dataclass(eq=False, slots=True)
class Form:
    """What a frame has in common with others of its kind; remembered, so it is to be read and not changed.

    Attributes
    ----------
    told : dict
        The header without its list of arrays.
    reader : callable or None
        What `codec.value_of` has made to read the value.
    """

    told: Header
    places: Sequence[_Place] = ()
    size: int = 0
    reader: Callable[[Sequence[Array]], Any] | None = None


class Frame(NamedTuple):
    """One frame that has come: its form, its arrays, number of the job, CPU time in s."""

    form: Form
    arrays: list[Array]
    job: int = 0
    cpu: float = 0.0


def pack(told: Header, arrays: Sequence[Array] = (), job: int = 0, cpu: float = 0.0) -> bytes:
    """One frame.

    Parameters
    ----------
    told : dict
        What JSON can hold.
    arrays : sequence of ndarray
        Of numbers, booleans or text; any order in memory.
    job : int
        Number of the job; 0 where there is none.
    cpu : float, s

    Raises
    ------
    ProtocolError
        If the frame is larger than the protocol allows.
    """
    listed = [(array.dtype, array.shape) for array in arrays]
    return framed(written(told, listed), [array.tobytes() for array in arrays], job, cpu)


def written(told: Header, listed: Iterable[tuple[np.dtype[Any], tuple[int, ...]]]) -> bytes:
    """Header of a frame with arrays of these types and shapes."""
    entries = ",".join(_listed(dtype, shape) for dtype, shape in listed)
    rest = _ENCODER.encode(told)[1:]
    return f'{{"arrays":[{entries}]{"," if told else ""}{rest}'.encode("ascii")


def framed(header: bytes, buffers: Sequence[bytes], job: int = 0, cpu: float = 0.0) -> bytes:
    """Frame of a header that has been written, and of the bytes of its arrays.

    Raises
    ------
    ProtocolError
        If it is larger than the protocol allows.
    """
    parts, size = [b"", header], 0
    for buffer in buffers:
        parts.append(buffer)
        size += len(buffer)
        if over := size % _ALIGNMENT:
            parts.append(_FILLING[over:])
            size += _ALIGNMENT - over
    _check_sizes(len(header), size)
    parts[0] = PREFIX.pack(MAGIC, VERSION, len(header), size, job, cpu)
    return b"".join(parts)


@lru_cache(1000)
def _listed(dtype: np.dtype[Any], shape: tuple[int, ...]) -> str:
    """Entry of an array in the header."""
    return _ENCODER.encode([dtype.str, list(shape)])


def opened(data: bytes | bytearray) -> tuple[int, int, int, float]:
    """Sizes of header and body, number of the job and CPU time, from the prefix that data begin with.

    Raises
    ------
    ProtocolError
        If it is no prefix, of another version, or announces too much.
    """
    magic, version, header, body, job, cpu = PREFIX.unpack_from(data)
    if magic != MAGIC:
        raise ProtocolError(f"garbage on the wire: {bytes(data[:_SHOWN])!r} is no start of a frame")
    if version != VERSION:
        raise ProtocolError(f"it speaks version {version} of the protocol, not {VERSION}")
    _check_sizes(header, body)
    return header, body, job, cpu


def unpack(header: bytes, body: bytearray) -> tuple[Form, list[Array]]:
    """Form and arrays of a frame; the arrays share the memory of `body`.

    Raises
    ------
    ProtocolError
        If the header is no object of JSON, or its arrays do not fill the body.
    """
    form = (_form if len(header) <= _MOST_REMEMBERED else _form.__wrapped__)(header)
    if form.size != len(body):
        raise ProtocolError(f"the arrays fill {form.size} of the {len(body)} bytes of the body")
    return form, [
        np.empty(shape, dtype) if at is None else np.ndarray(shape, dtype, body, at) for dtype, shape, at in form.places
    ]


class Incoming:
    """What has come of a stream of frames.

    Attributes
    ----------
    announced : int
        Size of the frame that is coming; 0 while that is unknown.
    """

    def __init__(self) -> None:
        self._data: bytes | bytearray = b""
        self._prefix: tuple[int, int, int, float] | None = None
        self.announced = 0

    def __len__(self) -> int:
        return len(self._data)

    def add(self, chunk: bytes) -> bool:
        """Take what has come; whether there is a complete frame.

        Raises
        ------
        ProtocolError
            If this is no frame.
        """
        if not self._data:
            self._data = chunk  # most frames come in one
        elif chunk:
            if isinstance(self._data, bytes):
                self._data = bytearray(self._data)
            self._data += chunk
        if self._prefix is None and len(self._data) >= PREFIX.size:
            self._prefix = opened(self._data)
            self.announced = PREFIX.size + self._prefix[0] + self._prefix[1]
        return self._prefix is not None and len(self._data) >= self.announced

    def take(self) -> Frame:
        """The complete frame; what has come after it remains.

        Raises
        ------
        ProtocolError
        """
        assert self._prefix is not None
        header, _, job, cpu = self._prefix
        start, end, data = PREFIX.size + header, self.announced, self._data
        text, body = bytes(data[PREFIX.size : start]), bytearray(memoryview(data)[start:end])
        self._data = b"" if len(data) == end else data[end:]
        self._prefix, self.announced = None, 0
        return Frame(*unpack(text, body), job, cpu)


@lru_cache(256)
def _form(header: bytes) -> Form:
    """Read a header."""
    try:
        told = json.loads(header.decode("ascii"))
    except UnicodeDecodeError:
        raise ProtocolError("the header is not in ASCII") from None
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"the header is no JSON: {error}") from None
    if not isinstance(told, dict):
        raise ProtocolError("the header is no object")
    listed = told.pop("arrays", None)
    if not isinstance(listed, list) or len(listed) > _MOST_ARRAYS:
        raise ProtocolError("the header lists no arrays, or too many")
    places, at = list[_Place](), 0
    for one in listed:
        match one:
            case [str(name), list(shape)] if all(type(n) is int for n in shape):
                dtype = _type(name, shape)
            case _:
                raise ProtocolError(f"{str(one)[:80]} is no type and shape of an array")
        size = math.prod(shape) * dtype.itemsize
        places.append((dtype, tuple(shape), at if size else None))
        at += -(-size // _ALIGNMENT) * _ALIGNMENT
        if at > MOST_BODY:
            raise ProtocolError(f"the arrays need more than {MOST_BODY} bytes")
    return Form(told, places, at)


def _type(name: str, shape: list[int]) -> np.dtype[Any]:
    """Type of an array."""
    sound = _DTYPE.fullmatch(name) and len(shape) <= _MOST_AXES and all(0 <= n <= MOST_BODY for n in shape)
    if sound and _nonzero(shape) <= MOST_BODY:
        with suppress(TypeError):
            return np.dtype(name)
    raise ProtocolError(f"{name[:40]}, {str(shape)[:80]} is no type and shape of an array")


def _nonzero(shape: Iterable[int]) -> int:
    """Product of the lengths that are not zero: what an empty array may pretend to hold."""
    return math.prod(n for n in shape if n)


def _check_sizes(header: int, body: int) -> None:
    if header > MOST_HEADER or body > MOST_BODY:
        raise ProtocolError(
            f"a frame of {header} + {body} bytes; at most {MOST_HEADER} of header and {MOST_BODY} of arrays are allowed"
        )
