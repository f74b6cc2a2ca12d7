"""The Exudyn library, imported once in the way the adapter needs: no user settings, nothing on the console."""

from __future__ import annotations

import os
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


def plain_settings() -> Any:
    """Build settings that write no file, keep the step fixed and solve Newton's equations nearly to rounding.

    Returns
    -------
    exudyn.SimulationSettings
        With the knobs of `SETTINGS` and everything else at its default.
    """
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    integration = settings.timeIntegration
    integration.adaptiveStep = False
    integration.newton.relativeTolerance = NEWTON_TOLERANCE
    integration.newton.absoluteTolerance = NEWTON_TOLERANCE
    return settings


NEWTON_TOLERANCE = 1e-12
SETTINGS: dict[str, Any] = {
    "solution.file.write": False,
    "timeIntegration.adaptiveStep": False,
    "timeIntegration.newton.relativeTolerance": NEWTON_TOLERANCE,
    "timeIntegration.newton.absoluteTolerance": NEWTON_TOLERANCE,
}
"""What `plain_settings` changes, by Exudyn's own names."""
