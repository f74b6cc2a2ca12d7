"""Consilience: conclusions from independent multibody engines that agree are strong.

The names below are the library; each is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from consilience.case import Case, case_names, load_case
    from consilience.engine import Question, Route, load_engine
    from consilience.errors import CannotAssemble, ConsilienceError, InvalidInput
    from consilience.mechanism import (
        Body,
        Control,
        Coupling,
        Drive,
        Frame,
        Friction,
        Function,
        Initial,
        Joint,
        JointSpring,
        Load,
        Mechanism,
        Rolling,
        Skate,
        Spring,
        State,
        initial_state,
        random_states,
    )
    from consilience.reference import accelerations, simulate
    from consilience.suite import run_suite

_HOME = {
    "mechanism": "Body Control Coupling Drive Frame Friction Function Initial Joint "
    "JointSpring Load Mechanism Rolling Skate Spring State initial_state random_states",
    "case": "Case case_names load_case",
    "engine": "Question Route load_engine",
    "errors": "CannotAssemble ConsilienceError InvalidInput",
    "reference": "accelerations simulate",
    "suite": "run_suite",
}
"""Names of the library by the module they come from."""

_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

__all__ = [
    "Body",
    "CannotAssemble",
    "Case",
    "ConsilienceError",
    "Control",
    "Coupling",
    "Drive",
    "Frame",
    "Friction",
    "Function",
    "Initial",
    "InvalidInput",
    "Joint",
    "JointSpring",
    "Load",
    "Mechanism",
    "Question",
    "Rolling",
    "Route",
    "Skate",
    "Spring",
    "State",
    "accelerations",
    "case_names",
    "initial_state",
    "load_case",
    "load_engine",
    "random_states",
    "run_suite",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'consilience' has no attribute '{name}'")
    return getattr(import_module(f"consilience.{_MODULE_OF[name]}"), name)
