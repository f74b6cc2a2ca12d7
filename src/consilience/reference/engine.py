"""The reference solver as an engine of the harness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from consilience.engine import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Question,
    Route,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.mechanism import (
    ASSOCIATED_ALONE,
    Array,
    Mechanism,
    State,
    free_directions,
    kept_in_units,
    mass_properties,
    motion_units,
    own_units,
    rough_dampers,
    telling_si,
)
from consilience.reference.formulations import registry
from consilience.reference.solver import accelerations_at, refuse_steep_friction, simulate

_INSTANTS = ("descriptor", "null_space")
"""Formulations for accelerations and reactions when none is named."""

_MOTIONS = {"relative": (1e-10, 1e-12, 1e-13), "null_space": (1e-12,)}
"""Formulations for motions and their tolerances: the first is the reference, the second bounds its uncertainty."""

_LONG = {"relative": (1e-10, 1e-12, 1e-13), "articulated_body": (1e-11,)}
"""As `_MOTIONS`, for more than `_MANY` bodies, where dense equations of all bodies are too expensive."""

_MANY = 24

_OTHER = {"relative, Gauss": ("relative", "gauss", (1e-12,))}
"""Further motions that bound the uncertainty, by another integrator: formulation, integrator, tolerances."""

_ROUGH = {"relative, Radau": ("relative", "radau13", (1e-12,))}
"""The same of accelerations that are not smooth: Gauss collocation estimates its errors by the square of a difference,
which is right for smooth ones."""

_CONTACTS = "descriptor, contacts"
"""Method for mechanisms with contacts, stops or dry friction; for motions with the tolerances of `relative`."""

TIME_STEPPING = Method("time stepping at velocity level", Route.REFERENCE, order=1)
"""Second formulation of motions with contacts, of audits alone: its errors are far above those of `_CONTACTS`."""

_LADDER = (1e-9, 1e-10, 1e-11)
"""Tolerances of a formulation that is named."""

_SUBSTEPS = (4, 8, 16)
"""Steps per sample interval of a formulation with constant steps."""


class ReferenceEngine:
    """Reference engine: relative joint coordinates for motions, descriptor form at instants, and a check of each.

    Mechanisms are computed in their own units of length and mass (`own_units`), and motions in units of their duration,
    so that tolerances and ranks do not depend on the units of a case.

    Parameters
    ----------
    formulation : str, optional
        Use this formulation alone (``reference:NAME``), to be judged like any other engine.
    """

    def __init__(self, formulation: str | None = None) -> None:
        self._own = formulation

    @staticmethod
    def variants() -> tuple[str, ...]:
        """Return the names of all formulations."""
        return (*registry.FORMULATIONS, *registry.SYSTEMS)

    def info(self) -> EngineInfo:
        """Return name, version and methods."""
        own = version("consilience")
        titles = (
            registry.SYSTEMS[name].title
            if name in registry.SYSTEMS
            else f"{registry.FORMULATIONS[name].title}; {'Taylor or TP 8(6)' if name == 'relative' else 'DOP853'}"
            for name in ([self._own] if self._own else dict.fromkeys((*_MOTIONS, *_INSTANTS)))
        )
        return EngineInfo("reference", own, own, "; ".join(titles))

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """List the features of a mechanism that the formulation cannot represent; by default some of contact."""
        if question is Question.MODEL or (self._own is None and not _touches(mechanism)):
            return ()
        if self._own is None:
            from consilience.reference.contact.layout import not_covered  # noqa: PLC0415 - slow to import

            return tuple(Unsupported(f"contact '{name}'", ASSOCIATED_ALONE) for name in not_covered(mechanism))
        return registry.unsupported(self._own, mechanism)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """List the methods that answer a question, the reference first."""
        if question is Question.MODEL:
            return (Method("mass properties and constraint rank", Route.REFERENCE),)
        if self._own is None and _touches(mechanism):
            tolerances = () if question is Question.INSTANT else _MOTIONS["relative"]
            return (Method(_CONTACTS, Route.REFERENCE, tolerances=tolerances),)
        if question is Question.INSTANT:
            return tuple(Method(name, Route.REFERENCE) for name in ([self._own] if self._own else _INSTANTS))
        if self._own is not None:
            return (_motion(self._own, _LADDER),)
        if len(mechanism.bodies) > _MANY:
            return tuple(_motion(name, tolerances) for name, tolerances in _LONG.items())
        return (
            *(_motion(name, tolerances) for name, tolerances in _MOTIONS.items()),
            *(_motion(name, ways[-1]) for name, ways in (_ROUGH if rough_dampers(mechanism) else _OTHER).items()),
        )

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Declare every joint and element exact."""
        return Manifest(exact=("all joints by their basic constraints", "all force elements"))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return mass properties and the number of degrees of freedom, ``6 p - rank Q``."""
        mass, com, inertia = mass_properties(mechanism, state)
        freedom = free_directions(mechanism, state).shape[1]
        return ModelAnswer(mass, com, inertia, freedom)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return accelerations, reactions (if the formulation has them), contact forces and energies."""
        if self._own is None and _touches(mechanism):
            from consilience.reference.contact import contact_instant  # noqa: PLC0415 - slow to import

            return contact_instant(mechanism, states)
        units = own_units(mechanism)
        own = kept_in_units(mechanism, units)
        with telling_si(units):
            return units.inverse.convert(accelerations_at(own, [units.convert(state) for state in states], method.name))

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate the motion.

        Parameters
        ----------
        mechanism : Mechanism
        state : State
            Consistent state at ``times[0]``.
        times : ndarray, shape (n_t,), s
        method : Method
            One of `methods`, or `TIME_STEPPING`; contacts are regularised as its law has it.
        step : float
            Tolerance, or for a formulation with constant steps the step, s.
        """
        if self._own is None and _touches(mechanism):
            from consilience.reference.contact import simulate_regularised, simulate_with_contacts  # noqa: PLC0415 - slow to import

            if method.name == TIME_STEPPING.name:
                from consilience.reference.contact.time_stepping import step_with_contacts  # noqa: PLC0415 - as above

                count = round(float(times[1] - times[0]) / step)
                stepped = step_with_contacts(mechanism, state, np.asarray(times), count)
                return TrajectoryAnswer(times, stepped.p_WB, stepped.quat_WB, stepped.v_WB_W, stepped.w_WB_W)
            if method.law is not None and method.law.regularisation is not None:
                return simulate_regularised(mechanism, method.law.regularisation, state, np.asarray(times), step)
            return simulate_with_contacts(mechanism, state, np.asarray(times), step)[0]
        refuse_steep_friction(mechanism)  # here, because the message names a speed
        units = motion_units(mechanism, times)
        own, start, grid = kept_in_units(mechanism, units), units.convert(state), np.asarray(times) * units.time
        formulation, integrator, _ = (_OTHER | _ROUGH).get(method.name, (method.name, None, ()))
        step = step * units.time if method.substeps else step
        with telling_si(units):
            found = simulate(own, start, grid, step, formulation, integrator)
        return replace(units.inverse.convert(found), time=np.asarray(times))


def _touches(mechanism: Mechanism) -> bool:
    """Return whether a mechanism has contacts, stops or dry friction."""
    return bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)


def _motion(name: str, tolerances: tuple[float, ...]) -> Method:
    """Describe the method of a motion in one formulation."""
    if name not in registry.SYSTEMS:
        settings = {"projection": "positions and velocities, after every step"}
        return Method(name, Route.REFERENCE, tolerances=tolerances, settings=settings)
    order = registry.SYSTEMS[name].order
    if order is None:
        return Method(name, Route.REFERENCE, tolerances=tolerances)
    return Method(name, Route.REFERENCE, order, _SUBSTEPS)
