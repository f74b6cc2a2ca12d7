"""Frames of the protocol: a prefix of fixed size, a header of two lines of JSON, the buffers of the arrays.

::

    magic "CNSL"   version   (2 zero bytes)   size of header   size of body   header   body
    4 bytes        uint16                     uint32           uint64         JSON     buffers

Numbers of the prefix are little-endian. The first line of the header is an object of what differs from frame to frame.
The second, the form, is an object of what often does not, so that it need not be read again: ``value``, and ``arrays``,
which lists type (as NumPy writes it) and shape of every buffer. Each buffer begins at a multiple of 16 bytes. Whatever
does not fit raises `ProtocolError`: frames come from processes that may be broken.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np

from consilience.spatial import Array

MAGIC = b"CNSL"
VERSION = 2
PREFIX = struct.Struct("<4sHxxIQ")

MOST_HEADER = 8 * 2**20
MOST_BODY = 2**30
"""Sizes in bytes beyond which a frame is refused before any memory is given to it."""

_ALIGNMENT = 16
_MOST_ARRAYS = 100_000
_MOST_AXES = 8
_DTYPE = re.compile(r"[<>|=]?[biufcUS][0-9]{1,6}")

_MOST_REMEMBERED = 8192
"""Size in bytes of a form beyond which it is not kept for the next frame."""

_ENCODER = json.JSONEncoder(separators=(",", ":"))

Header = dict[str, Any]
_Place = tuple[np.dtype[Any], tuple[int, ...], int, int]
"""Of an array: type, shape, number of elements, where it begins in the body."""


class ProtocolError(Exception):
    """What came is not what the protocol allows."""


def pack(header: Header, arrays: Sequence[Array] = ()) -> bytes:
    """One frame.

    Parameters
    ----------
    header : dict
        What JSON can hold. Its entry ``value``, if it has one, is the part that refers to the arrays.
    arrays : sequence of ndarray
        Of numbers, booleans or text; any order in memory.

    Raises
    ------
    ProtocolError
        If the frame is larger than the protocol allows.
    """
    listed, parts, size = list[str](), list[bytes](), 0
    for array in arrays:
        data = array.tobytes()
        listed.append(_listed(array.dtype, array.shape))
        parts.append(data.ljust(_padded(len(data)), b"\0"))
        size += len(parts[-1])
    first = header.copy()
    value = f',"value":{_ENCODER.encode(first.pop("value"))}' if "value" in header else ""
    text = f'{_ENCODER.encode(first)}\n{{"arrays":[{",".join(listed)}]{value}}}'.encode("ascii")
    _check_sizes(len(text), size)
    return b"".join([PREFIX.pack(MAGIC, VERSION, len(text), size), text, *parts])


@lru_cache(1000)
def _listed(dtype: np.dtype[Any], shape: tuple[int, ...]) -> str:
    """Entry of an array in the header."""
    return _ENCODER.encode([dtype.str, list(shape)])


def sizes(prefix: bytes) -> tuple[int, int]:
    """Sizes of header and body that a prefix announces.

    Raises
    ------
    ProtocolError
        If it is no prefix, of another version, or announces too much.
    """
    magic, version, header, body = PREFIX.unpack(prefix)
    if magic != MAGIC:
        raise ProtocolError(f"garbage on the wire: {bytes(prefix)!r} is no start of a frame")
    if version != VERSION:
        raise ProtocolError(f"it speaks version {version} of the protocol, not {VERSION}")
    _check_sizes(header, body)
    return header, body


def unpack(text: bytes | bytearray, body: bytearray) -> tuple[Header, list[Array]]:
    """Header and arrays of a frame; the arrays share the memory of `body`.

    Its entry ``value`` may be shared with that of other frames: it is to be read, not changed.

    Raises
    ------
    ProtocolError
        If a line of the header is no object of JSON, or its arrays do not fill the body.
    """
    try:
        first, _, second = text.decode("ascii").partition("\n")
    except UnicodeDecodeError:
        raise ProtocolError("the header is not in ASCII") from None
    header = _object(first)
    if "value" in header or "arrays" in header:
        raise ProtocolError("the value or the arrays are in the first line of the header")
    rest, places, size = (_form if len(second) <= _MOST_REMEMBERED else _form.__wrapped__)(second)
    if size != len(body):
        raise ProtocolError(f"the arrays fill {size} of the {len(body)} bytes of the body")
    found = [
        np.frombuffer(body, dtype, count, at).reshape(shape) if count else np.empty(shape, dtype)
        for dtype, shape, count, at in places
    ]
    return header | rest, found


class Incoming:
    """What has come of a stream of frames."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._sizes: tuple[int, int] | None = None

    def __len__(self) -> int:
        return len(self._data)

    @property
    def announced(self) -> int:
        """Size of the frame that is coming; 0 while that is unknown."""
        return PREFIX.size + sum(self._sizes) if self._sizes else 0

    def add(self, chunk: bytes) -> bool:
        """Take what has come; whether there is a complete frame.

        Raises
        ------
        ProtocolError
            If this is no frame.
        """
        self._data += chunk
        if self._sizes is None and len(self._data) >= PREFIX.size:
            self._sizes = sizes(bytes(self._data[: PREFIX.size]))
        return self._sizes is not None and len(self._data) >= self.announced

    def take(self) -> tuple[Header, list[Array]]:
        """The complete frame; what has come after it remains.

        Raises
        ------
        ProtocolError
        """
        assert self._sizes is not None
        start, end = PREFIX.size + self._sizes[0], self.announced
        text, body = self._data[PREFIX.size : start], self._data[start:end]
        del self._data[:end]
        self._sizes = None
        return unpack(text, body)


def _object(text: str) -> Header:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"the header is no JSON: {error}") from None
    if not isinstance(found, dict):
        raise ProtocolError("the header is no object")
    return found


@lru_cache(256)
def _form(text: str) -> tuple[Header, list[_Place], int]:
    """The value, if there is one; places of the arrays; size of the body that they fill."""
    form = _object(text)
    listed = form.pop("arrays", None)
    if not form.keys() <= {"value"}:
        raise ProtocolError("the second line of the header holds more than a value and its arrays")
    if not isinstance(listed, list) or len(listed) > _MOST_ARRAYS:
        raise ProtocolError("the header lists no arrays, or too many")
    places, at = list[_Place](), 0
    for one in listed:
        match one:
            case [str(name), list(shape)] if all(type(n) is int for n in shape):
                dtype = _type(name, shape)
            case _:
                raise ProtocolError(f"{str(one)[:80]} is no type and shape of an array")
        count = math.prod(shape)
        if dtype.itemsize == 0:
            count = 0
        places.append((dtype, tuple(shape), count, at))
        at += _padded(count * dtype.itemsize)
        if at > MOST_BODY:
            raise ProtocolError(f"the arrays need more than {MOST_BODY} bytes")
    return form, places, at


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


def _padded(size: int) -> int:
    return -(-size // _ALIGNMENT) * _ALIGNMENT


def _check_sizes(header: int, body: int) -> None:
    if header > MOST_HEADER or body > MOST_BODY:
        raise ProtocolError(
            f"a frame of {header} + {body} bytes; at most {MOST_HEADER} of header and {MOST_BODY} of arrays are allowed"
        )
