"""Records of named tuples of arrays, which kernels read through one address.

Numba unboxes every array of a tuple at each call from Python, and passes it between kernels as seven or more values; a
mechanism has about 150 arrays. A record stores the fields once, as words of eight bytes that never change: an array as
its address, shape and strides, a number as itself, a nested tuple as its words in place, None as nothing. Kernels pass
the address of the words and load a field where it is used; the loads are marked invariant for LLVM.

In a kernel a field of a record reads like a field of the tuple, ``closure.qr.W``: to Numba a record is a named tuple
with another representation.

Numba asks Python for the type of an unknown object, which takes microseconds. For frequent calls `record_array` wraps
the words in a NumPy array, whose type Numba knows; the kernel then calls `fields_of`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from ctypes import c_int64
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, typeof, types
from numba.extending import (
    NativeValue,
    intrinsic,
    lower_getattr_generic,
    models,
    overload,
    register_model,
    typeof_impl,
    unbox,
)

_WORD = 8
"""Bytes of a word."""

T = TypeVar("T")

_RECORD_TYPES: dict[str, RecordType] = {}
"""Types of the records given as arrays, by name."""

_ARRAY_TYPES: dict[tuple[Any, ...], types.Type] = {}
"""Types of arrays by class, dtype, rank and layout."""

_KINDS: dict[tuple[Any, ...], RecordType] = {}
"""Types of records by class and identities of the types of the fields: each exists once, and Numba's hash is slow."""

_FORM = 0x1 | 0x2 | 0x100 | 0x400
"""Flags of an array that its type depends on, as in NumPy's C interface: order (C, Fortran), aligned, writeable."""

_NUMBERS = (types.int64, types.float64, types.boolean)


class RecordType(types.NamedTuple):  # type: ignore[misc]
    """Numba type of a record: a named tuple, of whose fields this class knows the words.

    The name is a short digest, because symbols of kernels contain the names of all argument types.
    """

    def __init__(self, kind: type, fields: tuple[types.Type, ...]) -> None:
        self.types, self.count, self.fields, self.instance_class = fields, len(fields), kind._fields, kind  # type: ignore[attr-defined]
        self.begins, self.words = {}, 0
        for name, field in zip(self.fields, fields, strict=True):
            self.begins[name] = self.words
            self.words += _word_count(field)
        digest = hashlib.sha256(repr((self.fields, fields)).encode()).hexdigest()[:12]
        types.Type.__init__(self, name=f"{kind.__name__}.{digest}")

    @property
    def key(self) -> str:
        """Return the name, by which types are compared."""
        return str(self.name)


def _word_count(kind: types.Type) -> int:
    if isinstance(kind, types.Array):
        return 1 + 2 * kind.ndim
    return kind.words if isinstance(kind, RecordType) else int(kind in _NUMBERS)


def _walk(value: Any, words: list[int]) -> types.Type:
    """Append the words of a value, as integers; return its Numba type."""
    if isinstance(value, np.ndarray):
        # each way takes a third of the other for its arrays: `__array_interface__` describes the fields of a record
        words.append(value.ctypes.data if value.dtype.names else value.__array_interface__["data"][0])
        words += value.shape
        words += value.strides
        form = type(value), value.dtype, value.ndim, value.flags.num & _FORM
        if form not in _ARRAY_TYPES:
            _ARRAY_TYPES[form] = typeof(value)
        return _ARRAY_TYPES[form]
    if isinstance(value, MechanismRecord):
        words += value.words
        return value.numba_type
    if isinstance(value, tuple):
        fields = [_walk(one, words) for one in value]
        key = type(value), *map(id, fields)
        if key not in _KINDS:
            _KINDS[key] = RecordType(type(value), tuple(fields))
        return _KINDS[key]
    kind = typeof(value)
    if not (kind in _NUMBERS or isinstance(kind, types.NoneType)):
        raise TypeError(f"{kind} cannot be held: give arrays, int, float, bool, None, or named tuples of them")
    if value is not None:
        words.append(int(np.float64(value).view(np.int64)) if isinstance(value, float) else int(value))
    return kind


def type_of(value: Any) -> types.Type:
    """Return the Numba type of a record, of a named tuple as a record, or of a field."""
    return _walk(value, [])


def record_array(value: T) -> T:
    """Return the words of a named tuple as an array, for kernels that call `fields_of`.

    The array keeps the tuple alive.
    """
    if config.DISABLE_JIT:
        return value
    words = list[int]()
    kind = cast(RecordType, _walk(value, words))
    memory: Any = (c_int64 * kind.words)(*words)
    memory.kept = value
    _RECORD_TYPES[kind.name] = kind
    return cast(T, np.frombuffer(memory, dtype=np.dtype([(kind.name, np.int64, (kind.words,))], align=True)))


def fields_of(words: T) -> T:
    """Return, in a kernel, the record whose words an array holds."""
    return words


@intrinsic
def _open(context: Any, words: types.Array) -> tuple[Any, Any]:
    (name,) = words.dtype.fields

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(words)(context, builder, arguments[0])
        return builder.bitcast(array.data, context.get_value_type(types.voidptr))

    return _RECORD_TYPES[name](words), generate


# inlined by LLVM: after Numba has inlined an overload it removes assignments to arrays that are not arguments
@overload(fields_of, jit_options={"forceinline": True})
def _fields_of(words):  # type: ignore[no-untyped-def] # Numba compares this line with the next
    return lambda words: _open(words)  # noqa: PLW0108


class MechanismRecord:
    """A named tuple that kernels read through one address; keeps its arrays alive. Made by `record_of`.

    Python reads the fields like those of the tuple.

    Attributes
    ----------
    address : int
        Address of the words.
    numba_type : RecordType
    words : list of int
    """

    def __init__(self, fields: Any) -> None:
        self.__dict__.update(fields._asdict())  # `__getattr__` alone would take longer than what is read
        self._tuple, self.words = fields, list[int]()
        self.numba_type = _walk(fields, self.words)
        self._memory = np.array(self.words, dtype=np.int64)
        self.address = self._memory.ctypes.data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._tuple, name)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._tuple)


def record_of(value: T) -> T:
    """Return the record of a named tuple of arrays and numbers.

    None and a record are returned as they are, and where Numba is disabled, any tuple.

    Raises
    ------
    TypeError, ValueError
        A field is neither an array, an int, float or bool, None, nor a named tuple of these.
    """
    if value is None or config.DISABLE_JIT or isinstance(value, MechanismRecord):
        return value
    return cast(T, MechanismRecord(cast(tuple[Any, ...], value)))


@typeof_impl.register(MechanismRecord)
def _typeof_record(value: MechanismRecord, context: object) -> RecordType:
    return value.numba_type


@register_model(RecordType)
class _Address(models.OpaqueModel):  # type: ignore[misc]
    """Numba's data model of a record: an address."""


@unbox(RecordType)
def _unbox(kind: RecordType, value: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(address, is_error=c.pyapi.c_api_error())


@lower_getattr_generic(RecordType)
def _field(context: Any, builder: Any, kind: RecordType, address: Any, field: str) -> Any:
    """Generate the instructions that load a field."""
    wanted, first = kind.types[kind.fields.index(field)], kind.begins[field]

    def place(n: int) -> Any:
        return builder.gep(address, [context.get_constant(types.int64, _WORD * (first + n))])

    def load(n: int, as_type: Any) -> Any:
        word = builder.load(builder.bitcast(place(n), as_type.as_pointer()), align=_WORD)
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    if isinstance(wanted, RecordType):
        return place(0)
    if isinstance(wanted, types.NoneType):
        return context.get_dummy_value()
    if isinstance(wanted, types.Array):
        return array_from_words(context, builder, wanted, load)
    if wanted == types.boolean:
        return builder.trunc(load(0, context.get_value_type(types.int64)), context.get_value_type(types.boolean))
    return load(0, context.get_value_type(wanted))


def array_from_words(context: Any, builder: Any, kind: types.Array, load: Any) -> Any:
    """Generate an array without ownership from the words that ``load(n, type)`` returns."""
    array, size = context.make_array(kind)(context, builder), context.get_value_type(types.intp)
    item, lengths = context.get_data_type(kind.dtype), types.UniTuple(types.intp, kind.ndim)
    shape = [load(1 + n, size) for n in range(kind.ndim)]
    strides = [load(1 + kind.ndim + n, size) for n in range(kind.ndim)]
    array.meminfo, array.parent = array.meminfo.type(None), array.parent.type(None)
    array.nitems = shape[0]
    for length in shape[1:]:
        array.nitems = builder.mul(array.nitems, length)
    array.itemsize = context.get_constant(types.intp, context.get_abi_sizeof(item))
    array.data = load(0, item.as_pointer())
    array.shape, array.strides = (
        context.make_tuple(builder, lengths, shape),
        context.make_tuple(builder, lengths, strides),
    )
    return array._getvalue()
