"""Exudyn: the force of a driven constraint under TrapezoidalIndex2 alternates between zero and twice its value.

A mass of 2 kg whose coordinate is driven by a user function, x = 3 t^2 / 2: a = 3 m/s^2, force -6 N. The initial
acceleration leaves the drive out and is 0; the undamped rule carries this error on for ever, at every step size, while
the position is right. Second route: the mean of neighbouring samples is -6, and GeneralizedAlpha, which damps, forgets.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False
MASS, ACCELERATION = 2.0, 3.0


def samples(solver, steps):
    """Force of the constraint and position of the mass, at every step of 0.1 s."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(ii.NodePoint(referenceCoordinates=[0, 0, 0]))
    mbs.AddObject(ii.ObjectMassPoint(mass=MASS, nodeNumber=node))
    nodes = [mbs.AddNode(ii.NodePointGround()), node]
    drive = ii.ObjectConnectorCoordinate(
        markerNumbers=[mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=n, coordinate=0)) for n in nodes],
        offsetUserFunction=lambda _mbs, t, _item, _offset: ACCELERATION * t * t / 2.0,
        offsetUserFunction_t=lambda _mbs, t, _item, _offset: ACCELERATION * t,
    )
    joint = mbs.AddObject(drive)
    store = {"storeInternal": True, "writeToFile": False}
    force = ii.SensorObject(objectNumber=joint, outputVariableType=exu.OutputVariableType.Force, **store)
    place = ii.SensorNode(nodeNumber=node, outputVariableType=exu.OutputVariableType.Position, **store)
    sensors = [mbs.AddSensor(force), mbs.AddSensor(place)]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = 0.1
    settings.solution.sensors.writePeriod = 0.1 / steps
    mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
    return [mbs.GetSensorStoredData(sensor)[:, 1] for sensor in sensors]


expected = -MASS * ACCELERATION
print(f"exudyn {exu.__version__}: expected force {expected} N, position 0.015 m at the end")
checks = []
for steps in (10, 100, 1000):
    force, x = samples("TrapezoidalIndex2", steps)
    damped, _ = samples("GeneralizedAlpha", steps)
    means = (force[1:] + force[:-1]) / 2.0
    print(f"{steps:5d} steps: trapezoidal {np.round(force[:4], 6)} ... {force[-1]:.6f}, position {x[-1]:.9f}")
    print(f"             mean of neighbours {means[0]:.6f}, generalised alpha at the end {damped[-1]:.6f}")
    checks += [abs(force[0]) < 1e-9, abs(abs(force[-1] - expected) - abs(expected)) < 1e-6, abs(x[-1] - 0.015) < 1e-9]
    checks.append(np.max(np.abs(means - expected)) < 1e-6)
checks.append(abs(damped[-1] - expected) < 1e-6)
print("off by the whole force, at every step size" if all(checks) else "it converges")
sys.exit(0 if all(checks) else 1)
