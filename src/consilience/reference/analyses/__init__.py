"""Analyses with the reference: freedom, equilibrium, vibrations, driven motion, inverse problems, sensitivity."""

from consilience.reference.analyses.assembly_history import Assembly, Iteration, assemble_with_history
from consilience.reference.analyses.freedom import Freedom, count_freedom
from consilience.reference.analyses.inverse import InverseDynamics, inverse_dynamics
from consilience.reference.analyses.inverse_kinematics import Unreachable, inverse_kinematics
from consilience.reference.analyses.kinematic import (
    DrivenDynamics,
    KinematicMotion,
    SingularDrive,
    driven_dynamics,
    kinematic_motion,
)
from consilience.reference.analyses.linearisation import Linearisation, linearise
from consilience.reference.analyses.parameters import parameter, parameter_paths, with_parameter
from consilience.reference.analyses.sensitivity import Sensitivity, sensitivity
from consilience.reference.analyses.statics import NoEquilibrium, static_equilibrium
from consilience.reference.analyses.steady_motion import NotSteady, SteadyMotion, linearise_steady_motion
from consilience.reference.analyses.trajectory_sensitivity import TrajectorySensitivity, trajectory_sensitivity

__all__ = [
    "Assembly",
    "DrivenDynamics",
    "Freedom",
    "InverseDynamics",
    "Iteration",
    "KinematicMotion",
    "Linearisation",
    "NoEquilibrium",
    "NotSteady",
    "Sensitivity",
    "SingularDrive",
    "SteadyMotion",
    "TrajectorySensitivity",
    "Unreachable",
    "assemble_with_history",
    "count_freedom",
    "driven_dynamics",
    "inverse_dynamics",
    "inverse_kinematics",
    "kinematic_motion",
    "linearise",
    "linearise_steady_motion",
    "parameter",
    "parameter_paths",
    "sensitivity",
    "static_equilibrium",
    "trajectory_sensitivity",
    "with_parameter",
]
