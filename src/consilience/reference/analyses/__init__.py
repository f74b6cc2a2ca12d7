"""Analyses on the reference solver: degrees of freedom, static equilibrium, linear vibrations, inverse dynamics."""

from __future__ import annotations

from consilience.reference.analyses.freedom import Freedom, count_freedom
from consilience.reference.analyses.inverse import InverseDynamics, inverse_dynamics
from consilience.reference.analyses.linearisation import Linearisation, linearise
from consilience.reference.analyses.statics import NoEquilibrium, static_equilibrium

__all__ = [
    "Freedom",
    "InverseDynamics",
    "Linearisation",
    "NoEquilibrium",
    "count_freedom",
    "inverse_dynamics",
    "linearise",
    "static_equilibrium",
]
