"""Import of the Exudyn library without user settings and console output, and settings of simulations."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import reduce
from typing import Any

# Exudyn reads this at import: a user's ~/.exudyn/config.json could change settings of solvers
os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as _exudyn
from exudyn import advancedUtilities, itemInterface

exu: Any = _exudyn
items: Any = itemInterface
SystemEnergy: Any = advancedUtilities.SystemEnergy
LoadPotentialEnergy: Any = advancedUtilities.LoadPotentialEnergy

exu.config.printToConsole = False


NEWTON_TOLERANCE = 1e-12

QUIET: dict[str, Any] = {"solution.file.write": False}
"""Settings of a run at Exudyn's defaults: no files in the working directory."""

SETTINGS: dict[str, Any] = {
    **QUIET,
    "timeIntegration.adaptiveStep": False,
    "timeIntegration.newton.relativeTolerance": NEWTON_TOLERANCE,
    "timeIntegration.newton.absoluteTolerance": NEWTON_TOLERANCE,
}
"""Settings for a fixed step, with Newton's equations solved nearly to rounding."""

CONTACT_SETTINGS: dict[str, Any] = {**SETTINGS, "timeIntegration.discontinuous.useRecommendedStepSize": False}
"""Settings of a motion with contacts: otherwise a fixed step fails at the first one that closes."""

POINTWISE: dict[str, Any] = {**SETTINGS, "timeIntegration.generalizedAlpha.computeInitialAccelerations": False}
"""Settings for terms at a state, without initial accelerations: these are singular for dependent rows, and otherwise
right to 1e-8 at best."""


def simulation_settings(changed: Mapping[str, Any]) -> Any:
    """Return an exudyn.SimulationSettings with the given knobs by their names, all others at their defaults."""
    settings = exu.SimulationSettings()
    for name, value in changed.items():
        *groups, knob = name.split(".")
        chosen = getattr(exu.LinearSolverType, value) if knob == "solverType" else value
        setattr(reduce(getattr, groups, settings), knob, chosen)
    return settings


def add_coordinates(system: Any, count: int) -> Any:
    """Add a node of `count` coordinates of second order, zero in the reference and initially; return the node."""
    zero = [0.0] * count
    node = items.NodeGenericODE2(
        referenceCoordinates=zero, initialCoordinates=zero, initialCoordinates_t=zero, numberOfODE2Coordinates=count
    )
    return system.AddNode(node)
