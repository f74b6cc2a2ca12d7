"""Reference solver: equations of motion in many formulations, integration, analyses, impacts.

`simulate` integrates a mechanism and `accelerations` evaluates single states, in any of `FORMULATIONS` and `SYSTEMS`;
`formulation` returns the equations of motion. See the packages `analyses` and `impacts` for the rest. The first call in
a fresh installation compiles the kernels (a minute or two); later processes load them from the cache.
"""

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
