"""Kernels that only other kernels call."""

from __future__ import annotations

from numba import njit

inner = njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Decorator of a kernel that Python never calls: the code that takes tuples of many arrays out of Python objects is
left out, which is most of what compiling such a kernel takes."""
