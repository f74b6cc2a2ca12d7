"""Consilience: cross-validation of multibody dynamics engines.

Conclusions of independent engines that agree are strong. The names below are the library; each is imported when first
used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the names once more for type checkers, which do not see those of `__getattr__`
    from consilience.case import Case as Case
    from consilience.case import case_names as case_names
    from consilience.case import load_case as load_case
    from consilience.engine import Question as Question
    from consilience.engine import Route as Route
    from consilience.engine import load_engine as load_engine
    from consilience.errors import CannotAssemble as CannotAssemble
    from consilience.errors import ConsilienceError as ConsilienceError
    from consilience.errors import InvalidInput as InvalidInput
    from consilience.mechanism import Body as Body
    from consilience.mechanism import Control as Control
    from consilience.mechanism import Coupling as Coupling
    from consilience.mechanism import Drive as Drive
    from consilience.mechanism import Frame as Frame
    from consilience.mechanism import Friction as Friction
    from consilience.mechanism import Function as Function
    from consilience.mechanism import Initial as Initial
    from consilience.mechanism import Joint as Joint
    from consilience.mechanism import JointSpring as JointSpring
    from consilience.mechanism import Load as Load
    from consilience.mechanism import Mechanism as Mechanism
    from consilience.mechanism import Rolling as Rolling
    from consilience.mechanism import Skate as Skate
    from consilience.mechanism import Spring as Spring
    from consilience.mechanism import State as State
    from consilience.mechanism import initial_state as initial_state
    from consilience.mechanism import random_states as random_states
    from consilience.reference import accelerations as accelerations
    from consilience.reference import simulate as simulate
    from consilience.suite import run_suite as run_suite

_NAMES = {
    "case": "Case case_names load_case",
    "engine": "Question Route load_engine",
    "errors": "CannotAssemble ConsilienceError InvalidInput",
    "mechanism": "Body Control Coupling Drive Frame Friction Function Initial Joint JointSpring Load Mechanism "
    "Rolling Skate Spring State initial_state random_states",
    "reference": "accelerations simulate",
    "suite": "run_suite",
}
"""Names of the library by module."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'consilience' has no attribute '{name}'")
    return getattr(import_module(f"consilience.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
