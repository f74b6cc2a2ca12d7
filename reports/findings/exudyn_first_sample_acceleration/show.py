"""Exudyn: with explicit Runge-Kutta solvers the first sample of an acceleration sensor is zero.

A free mass point in gravity: its acceleration is g at all times, the first included. Second route: the implicit solver
GeneralizedAlpha, and VelocityVerlet, write g into the first sample of the same sensor.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name

exu.config.printToConsole = False
G = -9.81
container = exu.SystemContainer()
mbs = container.AddSystem()
node = mbs.AddNode(ii.NodePoint(referenceCoordinates=[0, 0, 0]))
body = mbs.AddObject(ii.ObjectMassPoint(mass=2.0, nodeNumber=node))
at_mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=body))
mbs.AddLoad(ii.LoadMassProportional(markerNumber=at_mass, loadVector=[0, 0, G]))
acceleration = exu.OutputVariableType.Acceleration
sensor = mbs.AddSensor(
    ii.SensorNode(nodeNumber=node, outputVariableType=acceleration, storeInternal=True, writeToFile=False)
)
mbs.Assemble()
settings = exu.SimulationSettings()
settings.solution.file.write = False
settings.timeIntegration.numberOfSteps = 10
settings.timeIntegration.endTime = 0.1
settings.solution.sensors.writePeriod = 0.01

print(f"exudyn {exu.__version__}: expected {G} in every sample")
first, later = {}, {}
for name in ("ExplicitEuler", "RK44", "RK67", "DOPRI5", "VelocityVerlet", "GeneralizedAlpha"):
    mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, name))
    samples = mbs.GetSensorStoredData(sensor)[:, 3]
    first[name], later[name] = samples[0], samples[1]
    print(f"{name:18s} first {samples[0]:6.2f}, second {samples[1]:6.2f}")
shown = all(first[name] == 0.0 for name in ("ExplicitEuler", "RK44", "RK67", "DOPRI5"))
shown = shown and all(abs(first[name] - G) < 1e-9 for name in ("VelocityVerlet", "GeneralizedAlpha"))
sys.exit(0 if shown and all(abs(a - G) < 1e-9 for a in later.values()) else 1)
