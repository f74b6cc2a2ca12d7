"""Consilience: cross-validation of multibody dynamics engines.

Conclusions of independent engines that agree are strong. The names below are the library; each is imported when first
used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from time import monotonic
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the names once more for type checkers, which do not see those of `__getattr__`
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from consilience.case import Case as Case
    from consilience.case import Drawing as Drawing
    from consilience.case import case_names as case_names
    from consilience.case import frame as frame
    from consilience.case import load_case as load_case
    from consilience.case import save_case as save_case
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
    from consilience.mechanism import Solid as Solid
    from consilience.mechanism import Spring as Spring
    from consilience.mechanism import State as State
    from consilience.mechanism import ball as ball
    from consilience.mechanism import bar as bar
    from consilience.mechanism import block as block
    from consilience.mechanism import random_states as random_states
    from consilience.reference import accelerations as accelerations
    from consilience.reference import initial_state as initial_state
    from consilience.reference.formulations.body_velocities import AppliedForces
    from consilience.report.agreement import Agreement as Agreement
    from consilience.report.simulation import Simulation as Simulation
    from consilience.suite import run_suite as run_suite

_NAMES = {
    "case": "Case Drawing case_names frame load_case save_case",
    "engine": "Question Route load_engine",
    "errors": "CannotAssemble ConsilienceError InvalidInput",
    "mechanism": "Body Control Coupling Drive Frame Friction Function Initial Joint JointSpring Load Mechanism "
    "Rolling Skate Solid Spring State ball bar block random_states",
    "reference": "accelerations initial_state",
    "report.agreement": "Agreement",
    "report.simulation": "Simulation",
    "suite": "run_suite",
}
"""Names of the library by module."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_MODULES)
__all__ += ["compare", "simulate"]


def __getattr__(name: str) -> Any:
    if name == "compare":
        return import_module("consilience.compare")
    if name not in _MODULES:
        raise AttributeError(f"module 'consilience' has no attribute '{name}'")
    found = getattr(import_module(f"consilience.{_MODULES[name]}"), name)
    import_module("consilience.mechanism").Mechanism.html = _drawn
    return found


def _drawn(mechanism: Mechanism) -> str:
    """Return the drawing of a mechanism, for notebooks."""
    from consilience.mechanism import drawing_state  # noqa: PLC0415 - drawn in notebooks alone
    from consilience.report.picture import picture  # noqa: PLC0415

    return picture(mechanism, drawing_state(mechanism), mechanism.name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def simulate(
    mechanism: Mechanism | Case,
    state: State | None = None,
    times: ArrayLike | None = None,
    tolerance: float = 1e-12,
    formulation: str | None = None,
    integrator: str | None = None,
    forces: AppliedForces | None = None,
    assemble: bool = False,
) -> Simulation:
    """Integrate the motion of a mechanism by the reference solver.

    Parameters
    ----------
    mechanism : Mechanism or Case
    state : State, optional
        Consistent state at the first time; default: that of the case, or the drawing at rest, assembled.
    times : array_like, shape (n_t,), s, optional
        Increasing sample times; default: those of the case.
    tolerance, integrator, forces, assemble
        As in `consilience.reference.simulate`.
    formulation : str, optional
        Default: ``relative``, compiled as a whole; ``descriptor`` where forces are given; with contacts, stops or dry
        friction `consilience.reference.contact.simulate_with_contacts`.

    Raises
    ------
    InvalidInput, CannotAssemble, NumericalFailure
    """
    import numpy as np  # noqa: PLC0415 - names of the library are imported at their first use

    from consilience.case import Case  # noqa: PLC0415
    from consilience.errors import InvalidInput  # noqa: PLC0415
    from consilience.mechanism import initial_state  # noqa: PLC0415
    from consilience.reference import simulate as integrate  # noqa: PLC0415
    from consilience.reference.contact import simulate_with_contacts  # noqa: PLC0415
    from consilience.report.simulation import Simulation  # noqa: PLC0415

    if isinstance(mechanism, Case):
        case, mechanism = mechanism, mechanism.mechanism
        state = case.initial_state if state is None else state
        times = case.times if times is None else times
    if times is None:
        raise InvalidInput("times", "they are missing", "Give sample times in s, for example numpy.linspace(0, 2, 41).")
    start = initial_state(mechanism) if state is None else state
    form = formulation or ("relative" if forces is None else "descriptor")
    grid = np.asarray(times, dtype=float)
    touches = mechanism.contacts or mechanism.stops or mechanism.dry_frictions
    if touches and formulation is None and forces is None:
        answer = simulate_with_contacts(mechanism, start, grid, tolerance)[0]
    else:
        answer = integrate(mechanism, start, grid, tolerance, form, integrator, forces, assemble)
    return Simulation.of(mechanism, answer)


def _compare(
    cases: Case | Sequence[Case], engines: Sequence[str] = (), questions: Sequence[Question] = ()
) -> Agreement:
    """Ask engines about cases and judge their answers by the reference.

    Parameters
    ----------
    cases : Case or sequence of Case
    engines : sequence of str, optional
        Default: all that are installed.
    questions : sequence of Question, optional
        Default: all.

    Raises
    ------
    InvalidInput, CannotAssemble
    """
    from consilience.case import Case  # noqa: PLC0415 - names of the library are imported at their first use
    from consilience.engine import Question, installed  # noqa: PLC0415
    from consilience.report.agreement import Agreement  # noqa: PLC0415
    from consilience.suite import run_suite  # noqa: PLC0415

    begun = monotonic()
    chosen = [cases] if isinstance(cases, Case) else cases
    results = run_suite(chosen, engines or tuple(installed()), questions or tuple(Question))
    return Agreement.of(results, monotonic() - begun)


if TYPE_CHECKING:
    compare = _compare
else:

    class _Compare(ModuleType):
        """The room `compare`, which is also the function of that name: ``cs.compare(case, engines)``."""

        __call__ = staticmethod(_compare)

    class _Library(ModuleType):
        """The library; a room that is imported becomes an attribute, and `compare` can then be called."""

        def __setattr__(self, name: str, value: Any) -> None:
            if name == "compare":
                value.__class__ = _Compare
            super().__setattr__(name, value)

    sys.modules[__name__].__class__ = _Library
