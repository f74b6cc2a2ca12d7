"""The neutral reference solver, importable for itself.

`simulate` integrates a mechanism, `accelerations` answers at single states, in any of `FORMULATIONS` and `SYSTEMS`;
`formulation` gives the equations of motion themselves. The packages `analyses` and `impacts` have the rest. The first
call in a fresh installation compiles the kernels (a minute or two); later processes load them from the cache.
"""

from __future__ import annotations

from consilience.errors import NumericalFailure
from consilience.reference.formulations.registry import FORMULATIONS, SYSTEMS, formulation, unsupported
from consilience.reference.solver import accelerations, simulate
from consilience.reference.tree.forward_dynamics import ForwardDynamics

__all__ = [
    "FORMULATIONS",
    "SYSTEMS",
    "ForwardDynamics",
    "NumericalFailure",
    "accelerations",
    "formulation",
    "simulate",
    "unsupported",
]
