"""The Exudyn library, imported once in the way the adapter needs: no user settings, nothing on the console."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import reduce
from typing import Any

# read at import: a user's ~/.exudyn/config.json may change solver settings behind the script
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
"""What has to be set for a run at Exudyn's defaults: it would write into the working directory."""

SETTINGS: dict[str, Any] = {
    **QUIET,
    "timeIntegration.adaptiveStep": False,
    "timeIntegration.newton.relativeTolerance": NEWTON_TOLERANCE,
    "timeIntegration.newton.absoluteTolerance": NEWTON_TOLERANCE,
}
"""A fixed step, and Newton's equations solved nearly to rounding."""

POINTWISE: dict[str, Any] = {**SETTINGS, "timeIntegration.generalizedAlpha.computeInitialAccelerations": False}
"""For terms at a state: with dependent rows initial accelerations are singular, and else right to 1e-8 at best."""


def simulation_settings(changed: Mapping[str, Any]) -> Any:
    """Build an exudyn.SimulationSettings with these knobs, by their own names, and all else at its default."""
    settings = exu.SimulationSettings()
    for name, value in changed.items():
        *groups, knob = name.split(".")
        # choices are named
        chosen = getattr(exu.LinearSolverType, value) if knob == "solverType" else value
        setattr(reduce(getattr, groups, settings), knob, chosen)
    return settings
