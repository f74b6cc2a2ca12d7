"""Decorators of kernels: what Numba is to leave out.

Numba counts the users of every array of every tuple that a function is given, at each call, by instructions that lock
the bus: of an evaluation that hands fifty arrays down ten calls this is most. A kernel that makes no array has nothing
to free and need not count. It must not call one that answers with a new array either: nobody would free that
(``tests/unit/test_compiled.py``). A kernel that is not marked inherits what its first caller is.
"""

from __future__ import annotations

from typing import Any

from numba import njit

_ALL: dict[str, Any] = {"cache": True, "error_model": "numpy"}
_INNER: dict[str, Any] = {**_ALL, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

kernel = njit(**_ALL, _nrt=False)
"""Decorator of a kernel that makes no array."""

inlined = njit(**_ALL, _nrt=False, inline="always")
"""Decorator of a kernel that makes no array and is written out where it is called."""

fused = njit(**_ALL, _nrt=False, forceinline=True)
"""Decorator of a small kernel whose machine code is to be part of that of its callers."""

threaded = njit(**_ALL, _nrt=False, nogil=True)
"""Decorator of a kernel that makes no array and lets other threads run."""

inner = njit(**_INNER, _nrt=False)
"""Decorator of a kernel that makes no array and that Python never calls: the code that takes tuples of many arrays out
of Python objects is left out, which is most of what compiling such a kernel takes."""

allocating = njit(**_ALL, _nrt=True)
"""Decorator of a kernel that makes arrays, or that calls one which answers with a new array."""
