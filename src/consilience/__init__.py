"""Consilience: cross-validation of multibody dynamics engines.

Conclusions of independent engines that agree are strong. The names below are the library; each is imported when first
used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from itertools import count
from time import monotonic
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the names once more for type checkers, which do not see those of `__getattr__`
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike

    from consilience.case import Case as Case
    from consilience.case import Drawing as Drawing
    from consilience.case import case_names as case_names
    from consilience.case import frame as frame
    from consilience.case import load_case as load_case
    from consilience.case import save_case as save_case
    from consilience.engine import InstantAnswer
    from consilience.engine import Question as Question
    from consilience.engine import Route as Route
    from consilience.engine import load_engine as load_engine
    from consilience.errors import CannotAssemble as CannotAssemble
    from consilience.errors import ConsilienceError as ConsilienceError
    from consilience.errors import InvalidInput as InvalidInput
    from consilience.errors import NumericalFailure as NumericalFailure
    from consilience.mechanism import Array
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
    from consilience.mechanism import constant as constant
    from consilience.mechanism import linear as linear
    from consilience.mechanism import random_states as random_states
    from consilience.mechanism import sine as sine
    from consilience.mechanism import through as through
    from consilience.reference import initial_state as initial_state
    from consilience.reference.formulations.body_velocities import AppliedForces
    from consilience.report.agreement import Agreement as Agreement
    from consilience.report.simulation import Simulation as Simulation
    from consilience.report.study import Study as Study
    from consilience.suite import run_suite as run_suite

_NAMES = {
    "case": "Case Drawing case_names frame load_case save_case",
    "engine": "Question Route load_engine",
    "errors": "CannotAssemble ConsilienceError InvalidInput NumericalFailure",
    "mechanism": "Body Control Coupling Drive Frame Friction Function Initial Joint JointSpring Load Mechanism "
    "Rolling Skate Solid Spring State ball bar block constant linear random_states sine through",
    "reference": "initial_state",
    "report.agreement": "Agreement",
    "report.simulation": "Simulation",
    "report.study": "Study",
    "suite": "run_suite",
}
"""Names of the library by module."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_MODULES)
__all__ += ["accelerations", "compare", "simulate", "simulate_many", "study"]


_PATIENCE = 1.0
"""Time, s, after which progress is shown."""


def __getattr__(name: str) -> Any:
    if name == "compare":
        return import_module("consilience.compare")
    if name not in _MODULES:
        raise AttributeError(f"module 'consilience' has no attribute '{name}'")
    return getattr(import_module(f"consilience.{_MODULES[name]}"), name)


def _drawn(mechanism: Mechanism, state: State | None) -> str:
    """Return the drawing of a mechanism, for notebooks."""
    from consilience.mechanism import drawing_state  # noqa: PLC0415 - drawn in notebooks alone
    from consilience.report.picture import picture  # noqa: PLC0415

    return picture(mechanism, state or drawing_state(mechanism), mechanism.name)


def _saved(mechanism: Mechanism, path: str | Path) -> Path:
    """Write a mechanism as a case file."""
    from consilience.case import save_case  # noqa: PLC0415 - Pydantic is needed by files alone

    return save_case(mechanism, path)


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def simulate(
    mechanism: Mechanism | Case | Drawing,
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
    mechanism : Mechanism, Case or Drawing
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
    # names of the library are imported at their first use, and here where they are used: each costs a microsecond
    from consilience.errors import InvalidInput  # noqa: PLC0415
    from consilience.mechanism import Mechanism  # noqa: PLC0415
    from consilience.reference import simulate as integrate  # noqa: PLC0415
    from consilience.report.simulation import Simulation  # noqa: PLC0415

    if not isinstance(mechanism, Mechanism):
        case = _case(mechanism)
        mechanism = case.mechanism
        state = case.initial_state if state is None else state
        times = case.times if times is None else times
    if times is None:
        raise InvalidInput("times", "they are missing", "Give sample times in s, for example numpy.linspace(0, 2, 41).")
    if state is None:
        from consilience.reference import initial_state  # noqa: PLC0415

        state = initial_state(mechanism)
    form = formulation or ("relative" if forces is None else "descriptor")
    if _touches(mechanism) and formulation is None and forces is None and integrator is None:
        from consilience.mechanism import assembled  # noqa: PLC0415
        from consilience.reference import sample_times  # noqa: PLC0415
        from consilience.reference.contact import simulate_with_contacts  # noqa: PLC0415

        grid = sample_times(times)
        state = assembled(mechanism, state, float(grid[0])) if assemble else state
        answer = simulate_with_contacts(mechanism, state, grid, tolerance)[0]
    else:
        answer = integrate(mechanism, state, times, tolerance, form, integrator, forces, assemble)
    return Simulation.of(mechanism, answer)


def accelerations(
    mechanism: Mechanism | Case | Drawing,
    states: State | Sequence[State] | None = None,
    formulation: str | None = None,
    t: float = 0.0,
) -> InstantAnswer:
    """Compute accelerations, reactions, contact forces and energies at consistent states, drives and loads at time t.

    Parameters
    ----------
    mechanism : Mechanism, Case or Drawing
    states : State or sequence of State, optional
        Default: that of the case at its start, or the drawing at rest, assembled.
    formulation : str, optional
        Default: ``descriptor``; with contacts, stops or dry friction `consilience.reference.contact.contact_instant`.
    t : float, s
        As in `consilience.reference.accelerations`, whose answers and errors these are.
    """
    from consilience.mechanism import Mechanism, State  # noqa: PLC0415 - names are imported at their first use
    from consilience.reference import accelerations as compute  # noqa: PLC0415

    if not isinstance(mechanism, Mechanism) or states is None:
        case = _case(mechanism)
        mechanism, states = case.mechanism, case.initial_state if states is None else states
    if formulation is None and _touches(mechanism):
        from consilience.errors import in_range  # noqa: PLC0415
        from consilience.reference.contact import contact_instant  # noqa: PLC0415

        in_range("t", t, -1e300, 1e300, "Give a time in s.")
        return contact_instant(mechanism, [states] if isinstance(states, State) else states, t)
    return compute(mechanism, states, formulation or "descriptor", t)


def _touches(mechanism: Mechanism) -> bool:
    """Return whether a mechanism has contacts, stops or dry friction."""
    return bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)


def study(
    case: Case | Mechanism | Drawing,
    parameters: Mapping[str, ArrayLike],
    duration: float | None = None,
    sample: float | None = None,
    tolerance: float = 1e-9,
    paired: bool = False,
) -> Study:
    """Integrate the motions of a mechanism with many values of its parameters, by one compiled model on all cores.

    Parameters
    ----------
    case : Case, Mechanism or Drawing
        What starts at given joint coordinates is a case; others start in the drawing, at rest.
    parameters : mapping of str to array_like, shape (n,)
        Values by name, SI units: ``upper.mass``, ``upper.com[2]``, ``elbow.place[2]`` (of the joint, in the drawing),
        ``spring.stiffness``, ``gravity[2]``, ``initial.coordinates.elbow.angle``, ...; all names are
        `consilience.reference.analyses.parameter_paths`.
    duration, sample : float, s, optional
        Span and sampling interval; default: those of the case.
    tolerance : float
        As in `simulate`, scaled by the characteristic length of the mechanism as it is given.
    paired : bool
        Whether the values are taken row by row; else all combinations are.

    Raises
    ------
    InvalidInput
        An unknown parameter, with the nearest names, or an impossible value. A set that cannot be assembled or
        integrated is in ``failures`` of the study.
    """
    # names of the library are imported at their first use
    from consilience.reference.analyses.many_motions import changed_cases, columns_of  # noqa: PLC0415

    given, columns = _case(case).with_span(duration, sample), columns_of(parameters)
    cases = changed_cases(given, columns, not paired)
    return _motions(given, columns, not paired, [c.mechanism for c in cases], [c.initial for c in cases], tolerance)


def simulate_many(
    case: Case | Mechanism | Drawing,
    states: State | Sequence[State],
    duration: float | None = None,
    sample: float | None = None,
    tolerance: float = 1e-9,
) -> Study:
    """Integrate the motions of a mechanism from many states, by one compiled model on all cores.

    Parameters
    ----------
    case : Case, Mechanism or Drawing
    states : State or sequence of State
        Consistent states at the time zero, for example of `random_states`.
    duration, sample, tolerance
        As in `study`.

    Raises
    ------
    InvalidInput
        There are no states, or one is not of this mechanism. A state that is not consistent is in ``failures``.
    """
    from consilience.mechanism import State, require_states  # noqa: PLC0415 - names are imported at their first use
    from consilience.reference.analyses.many_motions import starts_of  # noqa: PLC0415

    given = _case(case).with_span(duration, sample)
    starts = starts_of([states] if isinstance(states, State) else states)
    require_states(given.mechanism, starts)
    return _motions(given, {}, False, [given.mechanism] * len(starts), starts, tolerance)


def _case(given: Case | Mechanism | Drawing) -> Case:
    from consilience.case import Case, Drawing  # noqa: PLC0415
    from consilience.mechanism import require_states  # noqa: PLC0415

    if isinstance(given, Drawing):
        return given.case()
    if not isinstance(given, Case):
        require_states(given, ())
        return Case.of(given)
    return given


def _motions(
    case: Case,
    parameters: Mapping[str, Array],
    grid: bool,
    mechanisms: Sequence[Mechanism],
    starts: Sequence[State | Initial],
    tolerance: float,
) -> Study:
    """Integrate many motions, and show the progress."""
    from consilience.reference.analyses.many_motions import simulate_many as integrate  # noqa: PLC0415
    from consilience.report.study import Study  # noqa: PLC0415

    show = _progress(f"{len(mechanisms)} motions")
    found = integrate(case.mechanism, mechanisms, starts, case.times, tolerance, progress=show)
    arrays = {name: getattr(found, name) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")}
    failures, rebuilt = dict(sorted(found.failures.items())), tuple(sorted(found.rebuilt))
    return Study(case, parameters, grid, mechanisms, found.time, arrays, failures, rebuilt)


def _progress(total: str) -> Callable[[int], None] | None:
    """Return the function that shows on a terminal, or in a notebook, how many of all are done; None elsewhere."""
    begun = monotonic()
    if not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        return None

    def show(done: int) -> None:
        if monotonic() - begun > _PATIENCE:
            sys.stderr.write(f"\r{done} of {total}" + "\n" * total.startswith(f"{done} "))
            sys.stderr.flush()

    return show


def _compare(
    cases: Case | Mechanism | Drawing | Sequence[Case | Mechanism | Drawing],
    engines: Sequence[str] = (),
    questions: Sequence[Question] = (),
) -> Agreement:
    """Ask engines about cases and judge their answers by the reference.

    Parameters
    ----------
    cases : Case, Mechanism, Drawing, or a sequence of them
        What is no case starts in its drawing, at rest.
    engines : sequence of str, optional
        Default: all that are installed.
    questions : sequence of Question, optional
        Default: all.

    Raises
    ------
    InvalidInput
        An engine is not installed, there are no cases, or two of them have one name.
    CannotAssemble
    """
    # names of the library are imported at their first use
    from collections.abc import Sequence  # noqa: PLC0415

    from consilience.engine import Question, installed, require_installed  # noqa: PLC0415
    from consilience.errors import InvalidInput  # noqa: PLC0415
    from consilience.report.agreement import Agreement  # noqa: PLC0415
    from consilience.suite import run_suite  # noqa: PLC0415

    begun = monotonic()
    chosen = [_case(case) for case in (cases if isinstance(cases, Sequence) else [cases])]
    if not chosen:
        raise InvalidInput("cases", "there are none", "Give a case, or a list of cases.")
    asked = engines or tuple(installed())
    for name in () if isinstance(asked, str) else asked:
        require_installed(name)
    show, done = _progress(f"{len(chosen) * len({'reference', *asked})} answers of engines"), count(1)
    results = run_suite(chosen, asked, questions or tuple(Question), progress=show and (lambda *_: show(next(done))))
    return Agreement.of(results, monotonic() - begun)


if TYPE_CHECKING:
    compare = _compare
else:

    class _Compare(ModuleType):
        """The room `compare`, which is also the function of that name: ``cs.compare(case, engines)``."""

        __call__ = staticmethod(_compare)

    class _Library(ModuleType):
        """The library; a room that is imported becomes an attribute.

        `compare` can then be called, and a mechanism can be drawn and saved.
        """

        def __setattr__(self, name: str, value: Any) -> None:
            if name == "compare":
                value.__class__ = _Compare
            elif name == "mechanism":
                value.Mechanism.html, value.Mechanism.writer = _drawn, _saved
            super().__setattr__(name, value)

    sys.modules[__name__].__class__ = _Library
