"""Decorators of kernels: what Numba is to leave out.

Numba counts the users of every array of every tuple that a function is given, at each call, by instructions that lock
the bus: of an evaluation that hands fifty arrays down ten calls this is most. A kernel that makes no array has nothing
to free and need not count. It must not call one that answers with a new array either: nobody would free that
(``tests/unit/test_compiled.py``). A kernel that is not marked inherits what its first caller is.

A product and a sum may become one instruction, rounded once (``contract``): a twentieth of the time. Numba leaves that
out by itself, and so it is asked for; what else it calls fast (sums in another order, no NaN) is not. A machine without
that instruction gives other last bits.

What compiling takes grows with what is written out and with what is wrapped. `inlined` copies a kernel's instructions
once for each kernel between it and the one that is compiled, with branches that None will rule out there: it is for a
few lines. `inner` and `fused` compile a kernel to instructions once for its types and leave the rest to LLVM, where
they end up (`linking`): only what Python calls becomes machine code, and needs code that takes its arguments out of
their objects. That is `kernel`, and nothing else.

What a mechanism is made of goes from kernel to kernel as one address (`held`), and not as some hundred arrays.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from consilience.reference.kernel.linking import InnerCompiler

_ALL: dict[str, Any] = {"cache": True, "fastmath": {"contract"}, "error_model": "numpy", "no_cfunc_wrapper": True}
_INNER: dict[str, Any] = {**_ALL, "no_cpython_wrapper": True, "pipeline_class": InnerCompiler}

kernel = njit(**_ALL, _nrt=False)
"""Decorator of a kernel that makes no array and that Python calls."""

inner = njit(**_INNER, _nrt=False)
"""Decorator of a kernel that makes no array and that Python never calls: the process would end there."""

fused = njit(**_INNER, _nrt=False, forceinline=True)
"""`inner`, and its machine code is to be part of that of its callers."""

inlined = njit(**_ALL, _nrt=False, inline="always")
"""Decorator of a kernel of a few lines that makes no array and is written out where it is called."""

threaded = njit(**_ALL, _nrt=False, nogil=True)
"""`kernel` that lets other threads run."""

allocating = njit(**_ALL, _nrt=True)
"""Decorator of a kernel that makes arrays, or that calls one which answers with a new array."""
