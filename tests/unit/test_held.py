"""What is held reads in a kernel as the tuple does, and lives as long as it is read."""

import gc
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.held import Held, hold, opened, words_of
from consilience.reference.kernel.linking import InnerLibrary

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
    """A tuple of fields of every sort, no two numbers alike; one array is a part of another."""
    whole = np.arange(40.0).reshape(5, 8) + 100.0
    inside = Inner(np.arange(6, dtype=np.int64).reshape(2, 3) - 7, -12, 0.3, True)
    return Outer(np.array([0.1, -0.2]), inside, None, np.arange(24.0).reshape(2, 3, 4) * 1.7, whole[1::2, 2:7:2], False)


@inner
def read(held, nothing, out):
    """All numbers of the fields, one after the other; None is told from what is there."""
    n = 0
    for i in range(held.first.shape[0]):
        out[n] = held.first[i]
        n += 1
    for i in range(held.inner.table.shape[0]):
        for j in range(held.inner.table.shape[1]):
            out[n] = held.inner.table[i, j]
            n += 1
    out[n], out[n + 1], out[n + 2], out[n + 3] = held.inner.count, held.inner.factor, held.inner.yes, held.no
    n += 4
    if nothing is not None:
        out[n] = nothing.first[0]  # would not compile
    for i in range(held.cube.shape[0]):
        for j in range(held.cube.shape[1]):
            for k in range(held.cube.shape[2]):
                out[n] = held.cube[i, j, k]
                n += 1
    for i in range(held.part.shape[0]):
        for j in range(held.part.shape[1]):
            out[n] = held.part[i, j]
            n += 1
    return n


@kernel
def read_held(held, out):
    return read(held, held.nothing, out)


@kernel
def read_words(words, out):
    held = opened(words)
    return read(held, held.nothing, out)


@kernel
def double(held):
    """Arrays are those of Python: what is written is seen there."""
    for i in range(held.first.shape[0]):
        held.first[i] *= 2.0


def numbers(fields):
    """What `read` is to find."""
    inside = fields.inner
    parts = [fields.first, inside.table, [inside.count, inside.factor, inside.yes, fields.no], fields.cube, fields.part]
    return np.concatenate([np.ravel(part) for part in parts]).astype(float)


@pytest.mark.parametrize(("make", "call"), [(hold, read_held), (words_of, read_words)])
def test_every_field_reads_as_that_of_the_tuple(make, call):
    wanted = numbers(example())
    out = np.full(len(wanted) + 1, np.nan)
    held = make(example())  # nothing else keeps the arrays
    gc.collect()
    rubbish = [np.full(40, 9.9) for _ in range(50)]
    assert call(held, out) == len(wanted)
    np.testing.assert_array_equal(out[:-1], wanted)
    assert np.isnan(out[-1])
    assert rubbish


def test_fields_within_fields_may_be_held_already():
    fields = example()
    out = np.empty(len(numbers(fields)))
    read_held(hold(fields._replace(inner=hold(fields.inner))), out)
    np.testing.assert_array_equal(out, numbers(fields))


def test_a_kernel_writes_into_the_arrays_themselves():
    fields = example()
    double(hold(fields))
    np.testing.assert_array_equal(fields.first, [0.2, -0.4])


def test_python_reads_the_fields_too():
    fields = example()
    held = hold(fields)
    assert held.inner is fields.inner
    assert all(one is other for one, other in zip(held, fields, strict=True))
    assert held._replace(no=True).no


def test_one_compilation_serves_all_tuples_of_the_same_fields():
    one, other = hold(example()), hold(example()._replace(first=np.zeros(7), no=True))
    assert one.numba_type is other.numba_type
    flat = hold(example()._replace(cube=np.zeros((2, 2))))
    there = hold(example()._replace(nothing=np.zeros(1)))
    assert len({str(held.numba_type) for held in (one, flat, there)}) == 3


def test_nothing_is_held_as_nothing():
    assert hold(None) is None


@pytest.mark.parametrize("field", ["text", [1.0], {1: 2}, object()])
def test_what_no_kernel_could_read_is_refused(field):
    with pytest.raises((TypeError, ValueError)):
        hold(example()._replace(first=field))


def test_only_what_python_calls_becomes_machine_code():
    """Instructions of the inner kernel are in its caller, which gives the numbers above."""
    read_held(hold(example()), np.empty(64))
    (of_kernel, *_), (of_inner, *_) = read_held.overloads.values(), read.overloads.values()
    assert isinstance(of_inner.library, InnerLibrary)
    assert not isinstance(of_kernel.library, InnerLibrary)
    assert isinstance(hold(example()), Held)
