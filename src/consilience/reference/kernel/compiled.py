"""Decorators of kernels.

Reference counting. Numba counts references to every array of every argument at each call, by atomic instructions. A
kernel that makes no array frees nothing and need not count (``_nrt=False``). Such a kernel must not call a kernel that
returns a new array, which would never be freed (``tests/unit/test_compiled.py``). Unmarked kernels inherit the
reference-counting mode of their first caller.

Floating point. Of the fast modes only ``contract`` is on: a product and a sum may become one instruction, rounded once.
Results may therefore differ in the last bits on a machine without fused multiply-add.

Compilation time grows with the code that is copied and with wrappers. `inlined` copies a kernel into each kernel on the
way to the compiled one, including branches pruned there: it is for a few lines. `inner` and `fused` compile a kernel
once for its types, for its callers. Where a kernel is not marked, Numba lets it inherit the inlining of its first
caller, so that its speed depends on what is compiled first: what every evaluation calls is `fused`. Only `kernel` has
the wrapper that unboxes arguments from Python. A kernel that is called by address (`operation`) is compiled once,
whatever calls it.

The arrays of a mechanism are passed as one address: see `mechanism_record`. Compiled kernels are kept in the folder of
`cache`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import cfunc, config, njit

from consilience.reference.kernel.cache import kernels_folder

_ALL: dict[str, Any] = {"cache": True, "fastmath": {"contract"}, "error_model": "numpy", "no_cfunc_wrapper": True}
_INNER: dict[str, Any] = {**_ALL, "no_cpython_wrapper": True}


def _cached(decorate: Callable[..., Any], function: Callable[..., Any]) -> Any:
    """Return a function decorated by Numba, its machine code cached in the folder of the kernels."""
    given, config.CACHE_DIR = config.CACHE_DIR, str(kernels_folder())  # other users of Numba keep their folder
    try:
        return decorate(function)
    finally:
        config.CACHE_DIR = given


def _decorator(**options: Any) -> Any:
    """Return a decorator that compiles with some options."""
    return partial(_cached, njit(**options))


def compile_operation(function: Callable[..., Any], signature: Any, makes_arrays: bool) -> Any:
    """Compile a kernel for a signature; return the C function of Numba, which has an address."""
    options = {name: _ALL[name] for name in ("cache", "fastmath", "error_model")}
    return _cached(cfunc(signature, _nrt=makes_arrays, **options), function)


kernel = _decorator(**_ALL, _nrt=False)
"""Decorator of a kernel that makes no array and that Python calls."""

inner = _decorator(**_INNER, _nrt=False)
"""Decorator of a kernel that makes no array and that only kernels call; a call from Python would crash."""

fused = _decorator(**_INNER, _nrt=False, forceinline=True)
"""`inner`, with the code inlined into the callers by LLVM."""

inlined = _decorator(**{**_ALL, "cache": False}, _nrt=False, inline="always")
"""Decorator of a kernel of a few lines that makes no array and is copied where it is called: it has no code to keep."""

threaded = _decorator(**_ALL, _nrt=False, nogil=True)
"""`kernel` that releases the global interpreter lock."""

allocating = _decorator(**_ALL, _nrt=True)
"""Decorator of a kernel that makes arrays, or that calls a kernel which returns a new array."""
