"""Frames of the protocol between runner and worker: a prefix of fixed size, a JSON header, the buffers of the arrays.

::

    magic "CNSL"   version   (2 zero bytes)   size of header   size of body   job      CPU time   header   body
    4 bytes        uint16                     uint32           uint64         uint64   float64    JSON     buffers

Numbers of the prefix are little-endian; they differ from frame to frame. The header is a JSON object that is often the
same in many frames, so that it need neither be written nor parsed again: the entries of the message, and ``arrays``,
which lists type (as NumPy writes it) and shape of each buffer. Each buffer begins at a multiple of 16 bytes. Frames
come from processes that may be broken: a frame that breaks these rules raises `ProtocolError`.
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
"""Largest sizes in bytes; a larger frame is refused before memory is allocated."""

_SHOWN = 20
"""Number of bytes of garbage that a message shows."""

_ALIGNMENT = 16
_MOST_ARRAYS = 100_000
_MOST_AXES = 8
_DTYPE = re.compile(r"[<>|=]?[biufcUS][0-9]{1,6}")

_MOST_REMEMBERED = 8192
"""Size in bytes beyond which a parsed header is not kept for the next frame."""

_ENCODER = json.JSONEncoder(separators=(",", ":"))

_FILLING = bytes(_ALIGNMENT)

_Place = tuple[np.dtype[Any], tuple[int, ...], int | None]
"""Type and shape of an array, and the byte of the body at which it begins; None for an array without elements."""


class ProtocolError(Exception):
    """A frame or a value that the protocol does not allow."""


@dataclass(eq=False, slots=True)
class MessageHeader:
    """Parsed header of a frame; many messages share one, so that it must not be changed.

    Attributes
    ----------
    entries : dict
        The header without its list of arrays.
    places : sequence
        Type, shape and place in the body of each array.
    size : int
        Size of the body in bytes.
    reader : callable or None
        Function that `codec.value_of` has made to build the value from the arrays.
    """

    entries: dict[str, Any]
    places: Sequence[_Place] = ()
    size: int = 0
    reader: Callable[[Sequence[Array]], Any] | None = None


class Message(NamedTuple):
    """A frame that was read: its header, its arrays, number of the job, CPU time in s."""

    header: MessageHeader
    arrays: list[Array]
    job: int = 0
    cpu: float = 0.0


def pack(entries: dict[str, Any], arrays: Sequence[Array] = (), job: int = 0, cpu: float = 0.0) -> bytes:
    """Return the bytes of a frame.

    Parameters
    ----------
    entries : dict
        Values that JSON can hold.
    arrays : sequence of ndarray
        Arrays of numbers, booleans or text, in any memory order.
    job : int
        Number of the job; 0 for none.
    cpu : float, s

    Raises
    ------
    ProtocolError
        If the frame is larger than the protocol allows.
    """
    listed = [(array.dtype, array.shape) for array in arrays]
    return pack_frame(pack_header(entries, listed), [array.tobytes() for array in arrays], job, cpu)


def pack_header(entries: dict[str, Any], listed: Iterable[tuple[np.dtype[Any], tuple[int, ...]]]) -> bytes:
    """Return the header of a frame with arrays of these types and shapes."""
    arrays = ",".join(_array_entry(dtype, shape) for dtype, shape in listed)
    rest = _ENCODER.encode(entries)[1:]
    return f'{{"arrays":[{arrays}]{"," if entries else ""}{rest}'.encode("ascii")


def pack_frame(header: bytes, buffers: Sequence[bytes], job: int = 0, cpu: float = 0.0) -> bytes:
    """Return the frame of a header as from `pack_header` and of the bytes of its arrays.

    Raises
    ------
    ProtocolError
        If the frame is larger than the protocol allows.
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
def _array_entry(dtype: np.dtype[Any], shape: tuple[int, ...]) -> str:
    """Return the entry of an array in the header."""
    return _ENCODER.encode([dtype.str, list(shape)])


def read_prefix(data: bytes | bytearray) -> tuple[int, int, int, float]:
    """Return the sizes of header and body, the number of the job and the CPU time from the prefix of a frame.

    Raises
    ------
    ProtocolError
        If the data begin with no prefix, or with one of another version or of too large a frame.
    """
    magic, version, header, body, job, cpu = PREFIX.unpack_from(data)
    if magic != MAGIC:
        raise ProtocolError(f"garbage on the wire: {bytes(data[:_SHOWN])!r} is no start of a frame")
    if version != VERSION:
        raise ProtocolError(f"it speaks version {version} of the protocol, not {VERSION}")
    _check_sizes(header, body)
    return header, body, job, cpu


def unpack(header: bytes, body: bytearray) -> tuple[MessageHeader, list[Array]]:
    """Parse header and arrays of a frame; the arrays share the memory of `body`.

    Raises
    ------
    ProtocolError
        If the header is no JSON object, or its arrays do not fill the body.
    """
    parsed = (_parsed if len(header) <= _MOST_REMEMBERED else _parsed.__wrapped__)(header)
    if parsed.size != len(body):
        raise ProtocolError(f"the arrays fill {parsed.size} of the {len(body)} bytes of the body")
    return parsed, [
        np.empty(shape, dtype) if at is None else np.ndarray(shape, dtype, body, at)
        for dtype, shape, at in parsed.places
    ]


class Incoming:
    """Received part of a stream of frames.

    Attributes
    ----------
    announced : int
        Size in bytes of the incomplete frame; 0 while its prefix is incomplete.
    """

    def __init__(self) -> None:
        self._data: bytes | bytearray = b""
        self._prefix: tuple[int, int, int, float] | None = None
        self.announced = 0

    def __len__(self) -> int:
        return len(self._data)

    def add(self, chunk: bytes) -> bool:
        """Add received bytes; return whether a frame is complete.

        Raises
        ------
        ProtocolError
            If the bytes begin no frame.
        """
        if not self._data:
            self._data = chunk  # most frames arrive in one chunk
        elif chunk:
            if isinstance(self._data, bytes):
                self._data = bytearray(self._data)
            self._data += chunk
        if self._prefix is None and len(self._data) >= PREFIX.size:
            self._prefix = read_prefix(self._data)
            self.announced = PREFIX.size + self._prefix[0] + self._prefix[1]
        return self._prefix is not None and len(self._data) >= self.announced

    def take(self) -> Message:
        """Remove the complete frame and return it as a message.

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
        return Message(*unpack(text, body), job, cpu)


@lru_cache(256)
def _parsed(header: bytes) -> MessageHeader:
    """Parse a header."""
    try:
        entries = json.loads(header.decode("ascii"))
    except UnicodeDecodeError:
        raise ProtocolError("the header is not in ASCII") from None
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"the header is no JSON: {error}") from None
    if not isinstance(entries, dict):
        raise ProtocolError("the header is no object")
    listed = entries.pop("arrays", None)
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
    return MessageHeader(entries, places, at)


def _type(name: str, shape: list[int]) -> np.dtype[Any]:
    """Return the type that an entry names, if type and shape are allowed."""
    sound = _DTYPE.fullmatch(name) and len(shape) <= _MOST_AXES and all(0 <= n <= MOST_BODY for n in shape)
    if sound and _nonzero(shape) <= MOST_BODY:
        with suppress(TypeError):
            return np.dtype(name)
    raise ProtocolError(f"{name[:40]}, {str(shape)[:80]} is no type and shape of an array")


def _nonzero(shape: Iterable[int]) -> int:
    """Return the product of the lengths that are not zero, which bounds an empty array, too."""
    return math.prod(n for n in shape if n)


def _check_sizes(header: int, body: int) -> None:
    if header > MOST_HEADER or body > MOST_BODY:
        raise ProtocolError(
            f"a frame of {header} + {body} bytes; at most {MOST_HEADER} of header and {MOST_BODY} of arrays are allowed"
        )
