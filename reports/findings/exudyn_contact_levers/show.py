"""Exudyn: a contact of a sphere takes the slip at one lever, and applies the friction at another one.

A sphere of 0.1 m overlaps a plane by 2 mm; only friction acts beside the normal force. Lever of the slip: the sphere
turns in place, friction is in its proportional zone, and the lever is slip over angular velocity. Lever of the force:
the moment about the centre over the friction. Second route: the power of the friction on the body is not minus the
force times the slip, which it is for a force at the point that slips on a plane at rest.
"""

import sys

import exudyn
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

RADIUS, OVERLAP, STIFFNESS, MU, ZONE, SPIN = 0.1, 2e-3, 1e5, 0.5, 1e3, 7.0

exudyn.config.printToConsole = False
container = exudyn.SystemContainer()
system = container.AddSystem()
ground = system.AddMarker(ii.MarkerBodyRigid(bodyNumber=system.AddObject(ii.ObjectGround())))
node = system.AddNode(ii.NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0]))
ball = system.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=[0.004] * 3 + [0] * 3, nodeNumber=node))
data = system.AddNode(ii.NodeGenericData(numberOfDataCoordinates=4, initialCoordinates=[1.0, 0.0, 0.0, 0.0]))
system.AddObject(
    ii.ObjectContactSphereTriangle(
        markerNumbers=[system.AddMarker(ii.MarkerBodyRigid(bodyNumber=ball)), ground],
        nodeNumber=data,
        sphereRadius=RADIUS,
        includeEdges=0,
        trianglePoints=exudyn.Vector3DList([[-9, -9, 0], [9, -9, 0], [0, 9, 0]]),
        dynamicFriction=MU,
        frictionProportionalZone=ZONE,
        contactStiffness=STIFFNESS,
    )
)
system.Assemble()
settings = exudyn.SimulationSettings()
settings.solution.file.write = False
settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
solver = exudyn.MainSolverImplicitSecondOrder()
solver.InitializeSolver(system, settings)

now = exudyn.ConfigurationType.Current
system.systemData.SetODE2Coordinates([0, 0, RADIUS - OVERLAP, 0, 0, 0, 0], configuration=now)
system.systemData.SetODE2Coordinates_t([0, 0, 0, 0, 0, 0.5 * SPIN, 0], configuration=now)  # about y
system.systemData.SetDataCoordinates([-OVERLAP, SPIN * RADIUS, 0.0, 0.0], configuration=now)
solver.ComputeODE2RHS(system)
force = np.array(solver.GetSystemResidual())
friction, normal, moment = force[0], force[2], 0.5 * force[5]  # along Euler parameters: twice the moment

slip_lever = friction * ZONE / (MU * normal * SPIN)
force_lever = -moment / friction
power, by_slip = moment * SPIN, -friction * slip_lever * SPIN
print(f"exudyn {exudyn.__version__}")
print(f"normal force {normal:.6f} N for {STIFFNESS * OVERLAP:.6f}")
print(f"lever of the slip   {slip_lever:.6f} m: radius less the overlap is {RADIUS - OVERLAP:.6f}")
print(f"lever of the force  {force_lever:.6f} m: radius less half of the overlap is {RADIUS - 0.5 * OVERLAP:.6f}")
print(f"power of the friction on the body {power:.6e} W, by force and slip {by_slip:.6e} W")
shown = abs(slip_lever - RADIUS + OVERLAP) < 1e-9 and abs(force_lever - RADIUS + 0.5 * OVERLAP) < 1e-9
print("the levers differ" if shown else "the levers are the same, or others")
sys.exit(0 if shown else 1)
