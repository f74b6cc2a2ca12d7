"""Exudyn: TrapezoidalIndex2 locks a Bricard mechanism, loses all its energy in 0.05 s and reports success.

Five unit rods along the edges of a cube, and the ground, joined by six revolutes: one degree of freedom although
36 - 30 - 6 = 0, because one of the constraint equations depends on the others. It starts with the velocities that the
null vector of its six screws allows. Expected: kinetic and potential energy keep their sum. Second route: the same
mechanism with the dependent equation left out (a generic joint of four equations), same solver and steps, keeps it.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False
G = 9.81
EDGES = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0], [0, 0, -1]], dtype=float)
POINTS = np.vstack([np.zeros(3), np.cumsum(EDGES, axis=0)])
AXES = np.array([np.cross(EDGES[i - 1], EDGES[i]) for i in range(6)])
SCREWS = np.array([np.concatenate([a, np.cross(p, a)]) for a, p in zip(AXES, POINTS, strict=False)]).T
INERTIAS = [0.02 * np.eye(3) + (np.eye(3) - np.outer(e, e)) / 12.0 for e in EDGES]  # about the middle of a rod of 1 kg
_, SINGULAR, V = np.linalg.svd(SCREWS)
RATES = 3.0 * V[-1]


def build(last_axes):
    """System of five rods; the last joint is Exudyn's revolute, or a generic joint with `last_axes`."""
    mbs = CONTAINER.AddSystem()
    chain, twist = [mbs.AddObject(ii.ObjectGround())], np.zeros(6)
    for i, (p, e) in enumerate(zip(POINTS, EDGES[:5], strict=False)):
        twist = twist + RATES[i] * SCREWS[:, i]
        w = twist[:3]
        rates = [*(twist[3:] + np.cross(w, p)), 0.0, *(w / 2.0)]
        node = mbs.AddNode(ii.NodeRigidBodyEP(referenceCoordinates=[*p, 1, 0, 0, 0], initialVelocities=rates))
        c = e / 2.0
        I = INERTIAS[i] + c @ c * np.eye(3) - np.outer(c, c)
        six = [I[0, 0], I[1, 1], I[2, 2], I[1, 2], I[0, 2], I[0, 1]]
        chain.append(mbs.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=six, centerOfMass=c, nodeNumber=node)))
        at_mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=chain[-1]))
        mbs.AddLoad(ii.LoadMassProportional(markerNumber=at_mass, loadVector=[0, 0, -G]))
    for i, z in enumerate(AXES):
        x = np.roll(np.abs(z), 1)
        F = np.column_stack([x, np.cross(z, x), z])
        ends = [
            (chain[i], EDGES[i - 1] if i else np.zeros(3)),
            (chain[(i + 1) % 6], np.zeros(3) if i < 5 else POINTS[5]),
        ]
        frames = [(body, exu.HT(rotation=F, translation=p)) for body, p in ends]
        markers = [mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=body, localHT=frame)) for body, frame in frames]
        if i == 5 and last_axes:
            mbs.AddObject(ii.ObjectJointGeneric(markerNumbers=markers, constrainedAxes=last_axes))
        else:
            mbs.AddObject(ii.ObjectJointRevoluteZ(markerNumbers=markers))
    mbs.Assemble()
    return mbs, chain[1:]


def energy(mbs, bodies, configuration):
    """Kinetic energy, and its sum with the potential energy, in J."""
    kinetic = potential = 0.0
    for body, e, I in zip(bodies, EDGES, INERTIAS, strict=False):

        def output(name, body=body, e=e):
            kind = getattr(exu.OutputVariableType, name)
            return np.array(mbs.GetObjectOutputBody(body, kind, e / 2.0, configuration))

        v, w = output("Velocity"), output("AngularVelocityLocal")
        kinetic += 0.5 * (v @ v + w @ I @ w)
        potential += G * output("Position")[2]
    return kinetic, kinetic + potential


CONTAINER = exu.SystemContainer()
print(f"exudyn {exu.__version__}; singular values of the six screws {np.round(SINGULAR, 3)}: one degree of freedom")
lost = {}
for name, axes in (("six revolutes", None), ("dependent equation left out", [1, 1, 1, 1, 0, 0])):
    system, rods = build(axes)
    before = energy(system, rods, exu.ConfigurationType.Initial)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.endTime = 0.05
    settings.timeIntegration.numberOfSteps = 50
    success = system.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
    after = energy(system, rods, exu.ConfigurationType.Current)
    largest = np.max(np.abs(system.systemData.GetAECoordinates()))
    lost[name] = (before[1] - after[1], after[0], success)
    print(
        f"{name:28s} success {success}, energy lost {lost[name][0]:8.1e} J of {before[0]:.3f} J kinetic at the start,"
    )
    print(f"{'':28s} kinetic energy left {after[0]:.1e} J, largest multiplier {largest:.1e} N")
full, reduced = lost["six revolutes"], lost["dependent equation left out"]
shown = bool(full[2]) and full[0] > 3.0 and full[1] < 1e-6 and abs(reduced[0]) < 1e-4
print("locked, and reported as a success" if shown else "it moves, or it says that it failed")
sys.exit(0 if shown else 1)
