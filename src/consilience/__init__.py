"""Consilience: conclusions from independent multibody engines that agree are strong.

The names below are the library; each is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from consilience.assembly import Initial, initial_state, random_states
    from consilience.case import Case
    from consilience.engine import load_engine
    from consilience.errors import CannotAssemble, ConsilienceError, InvalidInput
    from consilience.functions import Function
    from consilience.library import case_names, load_case
    from consilience.mechanism import (
        Body,
        Control,
        Coupling,
        Drive,
        Frame,
        Friction,
        Joint,
        JointSpring,
        Load,
        Mechanism,
        Rolling,
        Skate,
        Spring,
        State,
    )
    from consilience.reference import accelerations, simulate
    from consilience.run import Question, Route
    from consilience.suite import run_suite

_HOME = {
    "assembly": ("Initial", "initial_state", "random_states"),
    "case": ("Case",),
    "engine": ("load_engine",),
    "errors": ("CannotAssemble", "ConsilienceError", "InvalidInput"),
    "library": ("case_names", "load_case"),
    "functions": ("Function",),
    "mechanism": (
        "Body",
        "Control",
        "Coupling",
        "Drive",
        "Frame",
        "Friction",
        "Joint",
        "JointSpring",
        "Load",
        "Mechanism",
        "Rolling",
        "Skate",
        "Spring",
        "State",
    ),
    "reference": ("accelerations", "simulate"),
    "run": ("Question", "Route"),
    "suite": ("run_suite",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

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
