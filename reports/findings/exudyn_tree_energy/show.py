"""Exudyn: with a forceUserFunction a kinematic tree has no potential energy, also not that of gravity.

A pendulum of 2 kg as an ObjectKinematicTree, let go at rest. SystemEnergy(mbs) adds up kinetic and potential energies.
With a user function of zero forces the motion is the same, and the sum, which should stay, gains what gravity gives:
the tree's own potential energy is refused, and SystemEnergy leaves it out. Second route: m g z of the centre of mass,
by SensorKinematicTree's output of its position, and the same tree without the function.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np
from exudyn.advancedUtilities import SystemEnergy

exu.config.printToConsole = False
MASS, G, COM = 2.0, 9.81, [0.5, 0.0, 0.0]


def nothing(mbs, t, item, q, q_t):
    """Generalised force zero."""
    return [0.0]


def swing(function):
    """Energies at the start and after half a second, each with m g z, and what SystemEnergy names as left out."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(
        ii.NodeGenericODE2(
            referenceCoordinates=[0.0], initialCoordinates=[0.4], initialCoordinates_t=[0.0], numberOfODE2Coordinates=1
        )
    )
    one, zero = exu.Matrix3DList([np.eye(3)]), exu.Vector3DList([[0.0, 0.0, 0.0]])
    tree = mbs.AddObject(
        ii.ObjectKinematicTree(
            nodeNumber=node,
            gravity=[0.0, 0.0, -G],
            jointTypes=[exu.JointType.RevoluteY],
            linkParents=[-1],
            jointTransformations=one,
            jointOffsets=zero,
            linkInertiasCOM=one,
            linkCOMs=exu.Vector3DList([COM]),
            linkMasses=[MASS],
            forceUserFunction=function,
        )
    )
    sensor = mbs.AddSensor(
        ii.SensorKinematicTree(
            objectNumber=tree, linkNumber=0, localPosition=COM, outputVariableType=exu.OutputVariableType.Position
        )
    )
    mbs.Assemble()
    energy = SystemEnergy(mbs)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.endTime = 0.5
    settings.timeIntegration.numberOfSteps = 200
    found = []
    for _ in range(2):
        kinetic, potential = energy.ComputeSystemEnergies()[:2]
        found.append((kinetic, potential, MASS * G * mbs.GetSensorValues(sensor)[2]))
        if len(found) == 1:
            mbs.SolveDynamic(settings)
    return np.array(found), energy.unavailable


print(f"exudyn {exu.__version__}: kinetic and potential energy, m g z, at the start and after half a second, J")
totals, wrong, named = {}, {}, {}
for name, function in (("without", 0), ("with", nothing)):
    found, named[name] = swing(function)
    totals[name] = found[:, 0] + found[:, 1]
    wrong[name] = np.max(np.abs(found[:, 1] - found[:, 2]))
    for kinetic, potential, expected in found:
        print(f"{name:7s} a function: {kinetic:8.4f} {potential:8.4f} {expected:8.4f}   sum {kinetic + potential:8.4f}")
print("named as unavailable:", [item[3].splitlines()[0].split(" [")[0] for item in named["with"]])
shown = wrong["without"] < 1e-9 and wrong["with"] > 1.0 and abs(np.ptp(totals["with"])) > 1.0
shown = shown and np.ptp(totals["without"]) < 1e-3 and len(named["with"]) == 1
print("the potential energy is gone" if shown else "the potential energy is there")
sys.exit(0 if shown else 1)
