"""Records of arrays: kernels read the same fields as from the tuple, and arrays live as long as the record."""

import gc
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of, record_array, record_of
from consilience.reference.kernel.operation import Operation, address_of, array_of, call

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


class Inner(NamedTuple):
    table: Any
    count: int
    factor: float
    yes: bool


class Outer(NamedTuple):
    first: Any
    inner: Inner
    nothing: Any
    cube: Any
    part: Any
    no: bool


def example():
    """Return a tuple with fields of every type and all numbers different; one array is a view of another."""
    whole = np.arange(40.0).reshape(5, 8) + 100.0
    inside = Inner(np.arange(6, dtype=np.int64).reshape(2, 3) - 7, -12, 0.3, True)
    return Outer(np.array([0.1, -0.2]), inside, None, np.arange(24.0).reshape(2, 3, 4) * 1.7, whole[1::2, 2:7:2], False)


@inner
def read(record, nothing, out):
    """Copy the numbers of all fields to `out` in order; a field that is None is pruned at compilation."""
    n = 0
    for i in range(record.first.shape[0]):
        out[n] = record.first[i]
        n += 1
    for i in range(record.inner.table.shape[0]):
        for j in range(record.inner.table.shape[1]):
            out[n] = record.inner.table[i, j]
            n += 1
    out[n], out[n + 1], out[n + 2], out[n + 3] = record.inner.count, record.inner.factor, record.inner.yes, record.no
    n += 4
    if nothing is not None:
        out[n] = nothing.first[0]  # would not compile if this branch were kept
    for i in range(record.cube.shape[0]):
        for j in range(record.cube.shape[1]):
            for k in range(record.cube.shape[2]):
                out[n] = record.cube[i, j, k]
                n += 1
    for i in range(record.part.shape[0]):
        for j in range(record.part.shape[1]):
            out[n] = record.part[i, j]
            n += 1
    return n


@kernel
def read_record(record, out):
    return read(record, record.nothing, out)


@kernel
def read_array(words, out):
    record = fields_of(words)
    return read(record, record.nothing, out)


@kernel
def double(record):
    """Write into an array of the record: the change shows in Python."""
    for i in range(record.first.shape[0]):
        record.first[i] *= 2.0


@kernel
def double_array(words):
    """Write into an array of a record that this kernel opens."""
    record = fields_of(words)
    for i in range(record.first.shape[0]):
        record.first[i] *= 2.0


def numbers(fields):
    """Return the numbers of all fields in the order of `read`."""
    inside = fields.inner
    parts = [fields.first, inside.table, [inside.count, inside.factor, inside.yes, fields.no], fields.cube, fields.part]
    return np.concatenate([np.ravel(part) for part in parts]).astype(float)


@pytest.mark.parametrize(("make", "call"), [(record_of, read_record), (record_array, read_array)])
def test_every_field_reads_as_that_of_the_tuple(make, call):
    wanted = numbers(example())
    out = np.full(len(wanted) + 1, np.nan)
    record = make(example())  # the record alone keeps the arrays alive
    gc.collect()
    rubbish = [np.full(40, 9.9) for _ in range(50)]
    assert call(record, out) == len(wanted)
    np.testing.assert_array_equal(out[:-1], wanted)
    assert np.isnan(out[-1])
    assert rubbish


def test_a_field_may_be_a_record_already():
    fields = example()
    out = np.empty(len(numbers(fields)))
    read_record(record_of(fields._replace(inner=record_of(fields.inner))), out)
    np.testing.assert_array_equal(out, numbers(fields))


@pytest.mark.parametrize(("make", "call"), [(record_of, double), (record_array, double_array)])
def test_a_kernel_writes_into_the_arrays_themselves(make, call):
    fields = example()
    call(make(fields))
    np.testing.assert_array_equal(fields.first, [0.2, -0.4])


def test_python_reads_the_fields_too():
    fields = example()
    record = record_of(fields)
    assert record.inner is fields.inner
    assert all(one is other for one, other in zip(record, fields, strict=True))
    assert record._replace(no=True).no


def test_one_compilation_serves_all_tuples_of_the_same_fields():
    one, other = record_of(example()), record_of(example()._replace(first=np.zeros(7), no=True))
    assert one.numba_type is other.numba_type
    flat = record_of(example()._replace(cube=np.zeros((2, 2))))
    there = record_of(example()._replace(nothing=np.zeros(1)))
    assert len({str(record.numba_type) for record in (one, flat, there)}) == 3


def test_the_record_of_none_is_none():
    assert record_of(None) is None


@pytest.mark.parametrize("field", ["text", [1.0], {1: 2}, object()])
def test_fields_that_no_kernel_can_read_are_refused(field):
    with pytest.raises((TypeError, ValueError)):
        record_of(example()._replace(first=field))


def linear(record, request, t, z, out):
    """Compute ``out = request factor z + t``; return the sum of a field."""
    given, found = array_of(z), array_of(out)
    for n in range(given.shape[0]):
        found[n] = request * record.inner.factor * given[n] + t
    return record.first[0] + record.first[1]


@kernel
def ask_twice(words, z, out):
    """Call a kernel by its address, and again with what it returned."""
    record = fields_of(words)
    found = call(record.count, record.record, 2, 0.5, z, out)
    return call(record.count, record.record, -1, found, out, z)


class Addresses(NamedTuple):
    count: Any
    record: Any


def test_a_kernel_called_by_address_reads_its_record_and_writes_its_arrays():
    operation, held = Operation(linear), record_of(example())
    z, out = np.array([1.0, -2.0, 4.0]), np.empty(3)
    found = ask_twice(record_array(Addresses(operation.address(held), address_of(held))), z, out)
    assert found == pytest.approx(-0.1)
    np.testing.assert_allclose(out, [1.1, -0.7, 2.9], rtol=1e-15)
    np.testing.assert_allclose(z, -0.3 * out - 0.1, rtol=1e-15)


def test_an_operation_is_compiled_once_for_each_type_of_record():
    operation = Operation(linear)
    one, same = record_of(example()), record_of(example()._replace(no=True))
    other = record_of(example()._replace(nothing=np.zeros(1)))
    assert operation.address(one) == operation.address(same) != operation.address(other)
