"""The reference formulations as an engine of the harness."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from consilience.kinematics import free_directions
from consilience.mechanism import Mechanism, State
from consilience.observe import mass_properties
from consilience.reference.dynamics import FORMULATIONS
from consilience.reference.solver import accelerations, simulate
from consilience.run import (
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
from consilience.spatial import Array

_TOLERANCES = {"descriptor": (1e-10, 1e-12, 1e-13), "null_space": (1e-12,)}


class ReferenceEngine:
    """In-house reference: descriptor form with Euler parameters, and its check, the null-space form."""

    def info(self) -> EngineInfo:
        """Name and version."""
        own = version("consilience")
        return EngineInfo("reference", own, own, "Euler-parameter descriptor form and null-space form, DOP853")

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Nothing: the neutral model is what the reference solves."""
        return ()

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Every formulation, the descriptor form first."""
        if question is Question.MODEL:
            return (Method("mass properties and constraint rank", Route.REFERENCE),)
        settings = {"projection": "positions and velocities, after every step"}
        return tuple(
            Method(
                name,
                Route.REFERENCE,
                tolerances=_TOLERANCES[name] if question is Question.TRAJECTORY else (),
                settings=settings if question is Question.TRAJECTORY else {},
            )
            for name in FORMULATIONS
        )

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Everything is exact."""
        return Manifest(exact=("all joints by their basic constraints", "all force elements"))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Mass properties of the neutral model and its true number of degrees of freedom, ``6 p - rank Q``."""
        mass, com, inertia = mass_properties(mechanism, state)
        freedom = free_directions(mechanism, state).shape[1]
        return ModelAnswer(mass, com, inertia, freedom)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Accelerations, reactions (descriptor form) and energies."""
        return accelerations(mechanism, states, method.name)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Motion to the tolerance `step`."""
        return simulate(mechanism, state, np.asarray(times), step, method.name)
