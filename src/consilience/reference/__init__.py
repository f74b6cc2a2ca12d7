"""Reference solver: equations of motion in many formulations, integration, analyses, contact.

`simulate` integrates a mechanism and `accelerations` evaluates single states, in any of `FORMULATIONS` and `SYSTEMS`;
`initial_state` assembles a mechanism and `formulation` returns the equations of motion. See the packages `analyses` and
`contact` for the rest. The first call in a fresh installation compiles the kernels (a minute or two); later processes
load them from the cache.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from consilience.errors import NumericalFailure
from consilience.reference.kernel.cache import announce_compilation

if TYPE_CHECKING:
    from consilience.reference.bodies.canonical import sample_times
    from consilience.reference.formulations.registry import FORMULATIONS, SYSTEMS, formulation, unsupported
    from consilience.reference.solver import accelerations, simulate
    from consilience.reference.states.assembly import initial_state
    from consilience.reference.tree.forward_dynamics import ForwardDynamics

__all__ = [
    "FORMULATIONS",
    "SYSTEMS",
    "ForwardDynamics",
    "NumericalFailure",
    "accelerations",
    "formulation",
    "initial_state",
    "sample_times",
    "simulate",
    "unsupported",
]

_MODULES = {
    **dict.fromkeys(("FORMULATIONS", "SYSTEMS", "formulation", "unsupported"), "formulations.registry"),
    **dict.fromkeys(("accelerations", "simulate"), "solver"),
    "initial_state": "states.assembly",
    "sample_times": "bodies.canonical",
    "ForwardDynamics": "tree.forward_dynamics",
}
"""Modules of the names that import Numba, which takes longer than many commands need."""


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'consilience.reference' has no attribute '{name}'")
    announce_compilation()
    globals()[name] = found = getattr(import_module(f"consilience.reference.{_MODULES[name]}"), name)
    return found
