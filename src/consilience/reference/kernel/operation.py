"""Kernels that other kernels call by address, all with one signature: ``f(record, request, t, z, out) -> float``.

A kernel that names another one contains its machine code, for each type of its arguments. An integrator that named the
kernels of a mechanism would be compiled with them for each type of mechanism; it is given their addresses instead, and
is compiled once. A call by address takes some nanoseconds, as long as its arguments fit into registers: an array is
passed as its address and length, from which the kernel called makes the array again (`array_of`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic, models, overload, register_model

from consilience.mechanism import Array
from consilience.reference.kernel.cache import one_process
from consilience.reference.kernel.compiled import compile_operation, kernel
from consilience.reference.kernel.mechanism_record import RecordType, array_from_words, record_of, type_of

_ARRAY = types.Array(types.float64, 1, "C")


class _VectorType(types.Type):  # type: ignore[misc]
    """Numba type of a contiguous array of floats, passed as its address and length."""


@register_model(_VectorType)
class _Vector(models.StructModel):  # type: ignore[misc]
    """Numba's data model of a vector."""

    def __init__(self, manager: Any, kind: _VectorType) -> None:
        super().__init__(manager, kind, [("data", types.CPointer(types.float64)), ("size", types.intp)])


_VECTOR = _VectorType("Vector")

_OTHERS = types.int64, types.float64, _VECTOR, _VECTOR
"""Types of the arguments behind the record."""


class Operation:
    """A kernel called by address.

    Parameters
    ----------
    function : callable
        ``f(record, request, t, z, out)`` with a record of `mechanism_record`, the number of what is asked, a time in
        s, and two arguments of which `array_of` makes arrays of one dimension, which are read or overwritten; returns
        a float.
    allocating : bool
        Whether it makes arrays.
    """

    def __init__(self, function: Callable[[Any, int, float, Array, Array], float], allocating: bool = False) -> None:
        self.function, self.allocating, self.__doc__ = function, allocating, function.__doc__
        self._compiled: dict[RecordType, Any] = {}

    def address(self, record: Any) -> Any:
        """Return the address of the kernel for the type of a record; the function itself where Numba is disabled."""
        if config.DISABLE_JIT:
            return self.function
        kind = type_of(record)
        if kind not in self._compiled:
            signature = types.float64(kind, *_OTHERS)
            with one_process(f"{self.function.__module__}.{kind.name}"):
                self._compiled[kind] = compile_operation(self.function, signature, self.allocating)
        return self._compiled[kind].address


allocating_operation = partial(Operation, allocating=True)
"""Decorator of a kernel called by address that makes arrays."""


def _array_itself(vector: Array) -> Array:
    return vector


@intrinsic
def _array(context: Any, vector: Any) -> tuple[Any, Any]:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        item = context.get_constant(types.intp, 8)
        words = builder.extract_value(arguments[0], 0), builder.extract_value(arguments[0], 1), item
        return array_from_words(context, builder, _ARRAY, lambda n, _: words[n])

    return _ARRAY(vector), generate


# without reference counting no function returns an array that it is not given: hence no overload
array_of = _array_itself if config.DISABLE_JIT else _array
"""Return, in a kernel called by address, the array of an argument."""


def address_of(record: Any) -> Any:
    """Return the address of a record of `record_of`; the tuple itself where Numba is disabled."""
    return record if config.DISABLE_JIT else record.address


def call(operation: Any, record: Any, request: int, t: float, z: Array, out: Array) -> float:
    """Call, in a kernel, an operation with a record.

    Parameters
    ----------
    operation, record : int
        Addresses.
    request, t, z, out : see `Operation`
    """
    return float(operation(record, request, t, z, out))


@intrinsic
def _call(context: Any, operation: Any, record: Any, request: Any, t: Any, z: Any, out: Any) -> tuple[Any, Any]:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function, record, request, t, *arrays = values
        address = context.get_value_type(types.voidptr)
        kinds = [address, *map(context.get_value_type, _OTHERS)]
        pointer = ir.FunctionType(context.get_value_type(signature.return_type), kinds).as_pointer()
        vectors = []
        for given in arrays:
            array = context.make_array(_ARRAY)(context, builder, given)
            vector = builder.insert_value(ir.Constant(kinds[-1], ir.Undefined), array.data, 0)
            vectors.append(builder.insert_value(vector, array.nitems, 1))
        record = builder.inttoptr(record, address)
        return builder.call(builder.inttoptr(function, pointer), [record, request, t, *vectors])

    return types.float64(operation, record, types.int64, types.float64, _ARRAY, _ARRAY), generate


@overload(call, jit_options={"forceinline": True})  # inlined by LLVM: see `mechanism_record.fields_of`
def _call_by_address(operation, record, request, t, z, out):  # type: ignore[no-untyped-def] # Numba compares this line
    return lambda operation, record, request, t, z, out: _call(operation, record, request, t, z, out)  # noqa: PLW0108


@kernel
def _call_from_python(operation: Any, record: Any, request: int, t: float, z: Array, out: Array) -> float:
    return call(operation, record, request, t, z, out)


class BoundOperation:
    """An operation with its record, for calls from Python.

    Parameters
    ----------
    operation : Operation
    record : named tuple
        As `mechanism_record.record_of` takes it.

    Attributes
    ----------
    addresses : tuple
        Of the operation and of the record.
    """

    def __init__(self, operation: Operation, record: Any) -> None:
        self._record = record_of(record)
        self.addresses = operation.address(self._record), address_of(self._record)

    def __call__(self, request: int, t: float, z: Array, out: Array) -> float:
        """Call the operation; z and out are arrays of floats of one dimension, contiguous."""
        return float(_call_from_python(*self.addresses, request, t, z, out))
