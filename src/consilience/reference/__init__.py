"""The neutral reference solver, importable for itself.

`simulate` integrates a mechanism, `accelerations` answers at single states. The first call in a fresh installation
compiles the kernels (about a minute); later processes load them from the cache.
"""

from __future__ import annotations

from consilience.reference.solver import NumericalFailure, accelerations, simulate

__all__ = ["NumericalFailure", "accelerations", "simulate"]
