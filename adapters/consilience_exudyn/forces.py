"""Springs, joint springs and loads as Exudyn's connectors and loads, in rigid bodies and kinematic trees.

Functions of time and laws that are not linear are user functions of the connectors and loads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from consilience.mechanism import Array, Load, Mechanism, Spring
from consilience_exudyn.constraints import Mark
from consilience_exudyn.efforts import Coordinate, Integrals, efforts_of, opposed
from consilience_exudyn.library import exu, items

_LOADS = {"force": items.LoadForceVector, "torque": items.LoadTorqueVector}
_ONE = np.eye(3)


def add_springs_and_loads(system: Any, mechanism: Mechanism, mark: Mark) -> None:
    """Add the springs between points and the loads of a mechanism.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled.
    mechanism : Mechanism
    mark : callable
        Adds a rigid marker (`constraints.Mark`).
    """
    for spring in mechanism.springs:
        markers = [
            mark(spring.predecessor, spring.point_predecessor, _ONE),
            mark(spring.successor, spring.point_successor, _ONE),
        ]
        system.AddObject(_spring_damper(spring, markers))
        if spring.actuator is not None:
            system.AddObject(_actuator(spring, markers))
    for load in mechanism.loads:
        system.AddLoad(_load(load, mark))


def _spring_damper(spring: Spring, markers: list[Any]) -> Any:
    return items.ObjectConnectorSpringDamper(
        markerNumbers=markers, referenceLength=spring.free_length, stiffness=spring.stiffness, damping=spring.damping
    )


def _actuator(spring: Spring, markers: list[Any]) -> Any:
    """Connector for the actuator of a spring, so that the connector of the spring keeps its potential energy."""
    assert spring.actuator is not None
    push = spring.actuator.jet

    def pull(_system: Any, t: float, _item: int, *_: float) -> float:
        return -push(t)[0]

    return items.ObjectConnectorSpringDamper(
        markerNumbers=markers, referenceLength=spring.free_length, springForceUserFunction=pull
    )


def _load(load: Load, mark: Mark) -> Any:
    common = {
        "markerNumber": mark(load.body, load.point, _ONE),
        "loadVector": list(load.vector),
        "bodyFixed": load.frame == "body",
    }
    if load.history is None:
        return _LOADS[load.kind](**common)
    factor, vector = load.history.jet, load.vector

    def at(_system: Any, t: float, _vector: Array) -> Array:
        return np.asarray(factor(t)[0] * vector)

    return _LOADS[load.kind](**common, loadVectorUserFunction=at)


def add_joint_forces(system: Any, mechanism: Mechanism, mark: Mark) -> tuple[tuple[str, ...], int]:
    """Add joint springs and efforts as connectors between the frames F and M, about and along the joint axes.

    A torsional connector gets a data node, with which Exudyn counts full turns; without it the angle jumps at half a
    turn.

    Returns
    -------
    turning : tuple of str
        Joint of each data node.
    integrals : int
        Coordinates of integrals of controllers, behind those of the bodies.
    """
    turning: list[str] = []
    meters: dict[Coordinate, Any] = {}
    integrals = Integrals(system, mechanism, lambda where: _measured(system, meters[where], where[1]))

    def connect(joint_name: str, coordinate: str, **law: Any) -> Any:
        """Add a linear or torsional connector along z of a joint, and return its object number."""
        joint = mechanism.joints[mechanism.joint_index[joint_name]]
        markers = [mark(joint.predecessor, joint.F.p, joint.F.R), mark(joint.successor, joint.M.p, joint.M.R)]
        if coordinate == "distance":
            axis = [0.0, 0.0, 1.0]
            return system.AddObject(
                items.ObjectConnectorLinearSpringDamper(markerNumbers=markers, axisMarker0=axis, **law)
            )
        turning.append(joint_name)
        node = system.AddNode(items.NodeGenericData(initialCoordinates=[0.0], numberOfDataCoordinates=1))
        return system.AddObject(
            items.ObjectConnectorTorsionalSpringDamper(markerNumbers=markers, nodeNumber=node, **law)
        )

    for s in mechanism.joint_springs:
        connect(s.joint, s.coordinate, stiffness=s.stiffness, damping=s.damping, offset=s.rest)
    for (joint, coordinate), laws in efforts_of(mechanism).items():
        meters[joint, coordinate] = connect(joint, coordinate, **{_USER[coordinate]: opposed(laws, integrals)})
    return tuple(turning), integrals.count


def _measured(system: Any, connector: Any, coordinate: str) -> float:
    return float(system.GetObjectOutput(connector, _MEASURED[coordinate]))


_USER = {"angle": "springTorqueUserFunction", "distance": "springForceUserFunction"}
_MEASURED = {"angle": exu.OutputVariableType.Rotation, "distance": exu.OutputVariableType.DisplacementLocal}
