"""Frames of the protocol: a prefix of fixed size, a header in JSON, the buffers of the arrays.

::

    magic "CNSL"   version   (2 zero bytes)   size of header   size of body   header   body
    4 bytes        uint16                     uint32           uint64         JSON     buffers

Numbers of the prefix are little-endian. The header is an object; its entry ``arrays`` lists type (as NumPy writes it)
and shape of every buffer; each begins at a multiple of 16 bytes. Whatever does not fit raises `ProtocolError`: frames
come from processes that may be broken.
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
VERSION = 1
PREFIX = struct.Struct("<4sHxxIQ")

MOST_HEADER = 8 * 2**20
MOST_BODY = 2**30
"""Sizes in bytes beyond which a frame is refused before any memory is given to it."""

_ALIGNMENT = 16
_MOST_ARRAYS = 100_000
_MOST_AXES = 8
_DTYPE = re.compile(r"[<>|=]?[biufcUS][0-9]{1,6}")

Header = dict[str, Any]


class ProtocolError(Exception):
    """What came is not what the protocol allows."""


def pack(header: Header, arrays: Sequence[Array] = ()) -> bytes:
    """One frame.

    Parameters
    ----------
    header : dict
        What JSON can hold.
    arrays : sequence of ndarray
        Of numbers, booleans or text; any order in memory.

    Raises
    ------
    ProtocolError
        If the frame is larger than the protocol allows.
    """
    plain = [np.asarray(a, order="C") for a in arrays]
    listed = [[a.dtype.str, list(a.shape)] for a in plain]
    text = json.dumps({**header, "arrays": listed}, separators=(",", ":")).encode("ascii")
    parts, size = [], 0
    for a in plain:
        parts += [a.tobytes(), bytes(_padded(a.nbytes) - a.nbytes)]
        size += _padded(a.nbytes)
    _check_sizes(len(text), size)
    return b"".join([PREFIX.pack(MAGIC, VERSION, len(text), size), text, *parts])


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

    Raises
    ------
    ProtocolError
        If the header is no object of JSON, or its arrays do not fill the body.
    """
    try:
        header = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"the header is no JSON: {error}") from None
    if not isinstance(header, dict):
        raise ProtocolError("the header is no object")
    return header, _arrays(header.pop("arrays", None), body)


def _arrays(listed: object, body: bytearray) -> list[Array]:
    if not isinstance(listed, list) or len(listed) > _MOST_ARRAYS:
        raise ProtocolError("the header lists no arrays, or too many")
    found, at = [], 0
    for one in listed:
        match one:
            case [str(name), list(shape)] if all(type(n) is int for n in shape):
                dtype, count, size = _form(name, tuple(shape))
            case _:
                raise ProtocolError(f"{str(one)[:80]} is no type and shape of an array")
        if at + size > len(body):
            raise ProtocolError(f"the arrays need more than the {len(body)} bytes of the body")
        found.append(np.frombuffer(body, dtype, count, at).reshape(shape) if size else np.empty(shape, dtype))
        at += _padded(size)
    if at != len(body):
        raise ProtocolError(f"the arrays fill {at} of the {len(body)} bytes of the body")
    return found


@lru_cache(1000)
def _form(name: str, shape: tuple[int, ...]) -> tuple[np.dtype[Any], int, int]:
    """Type of an array, number of its elements and of its bytes."""
    sound = _DTYPE.fullmatch(name) and len(shape) <= _MOST_AXES and all(0 <= n <= MOST_BODY for n in shape)
    if sound and _nonzero(shape) <= MOST_BODY:
        with suppress(TypeError):
            dtype = np.dtype(name)
            return dtype, math.prod(shape), math.prod(shape) * dtype.itemsize
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
