"""Kernels that other kernels call by address, all with one signature: ``f(record, request, t, z, out) -> float``.

A kernel that names another one contains its machine code, for each type of its arguments. An integrator that named the
kernels of a mechanism would be compiled with them for each type of mechanism; it is given their addresses instead, and
is compiled once. A call by address takes tens of nanoseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic, overload

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import compile_operation, kernel
from consilience.reference.kernel.mechanism_record import RecordType, record_of, type_of

_VECTOR = types.Array(types.float64, 1, "C")

_OTHERS = types.int64, types.float64, _VECTOR, _VECTOR
"""Types of the arguments behind the record."""


class Operation:
    """A kernel called by address.

    Parameters
    ----------
    function : callable
        ``f(record, request, t, z, out)`` with a record of `mechanism_record`, the number of what is asked, a time in
        s, and arrays of one dimension, which are read or overwritten; returns a float.
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
            self._compiled[kind] = compile_operation(self.function, signature, self.allocating)
        return self._compiled[kind].address


allocating_operation = partial(Operation, allocating=True)
"""Decorator of a kernel called by address that makes arrays."""


def address_of(record: Any) -> Any:
    """Return the address of a record of `record_of`; the tuple itself where Numba is disabled."""
    return record if config.DISABLE_JIT else record.address


def call(operation: Any, record: Any, request: int, t: float, z: Array, out: Array) -> float:
    """Call, in a kernel, an operation with a record, both given by their addresses."""
    return float(operation(record, request, t, z, out))


@intrinsic
def _call(context: Any, operation: Any, record: Any, request: Any, t: Any, z: Any, out: Any) -> tuple[Any, Any]:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function, record, *others = values
        address = context.get_value_type(types.voidptr)
        kinds = [address, *map(context.get_value_type, signature.args[2:])]
        pointer = ir.FunctionType(context.get_value_type(signature.return_type), kinds).as_pointer()
        return builder.call(builder.inttoptr(function, pointer), [builder.inttoptr(record, address), *others])

    return types.float64(operation, record, *_OTHERS), generate


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
