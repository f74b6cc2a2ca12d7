"""Springs, joint springs and loads as Exudyn's own connectors and loads, for either model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from consilience.mechanism import JointSpring, Load, Mechanism, Spring
from consilience.spatial import Array
from consilience_exudyn.library import exu, items

Mark = Callable[[str, Array, Array], Any]
"""Adds a rigid marker: name of the body, origin and axes of the marker in the body's frame; returns its index."""

_LOADS = {"force": items.LoadForceVector, "torque": items.LoadTorqueVector}
_ONE = np.eye(3)


def add_springs_and_loads(system: Any, mechanism: Mechanism, mark: Mark) -> None:
    """Add the springs between points and the constant loads of a mechanism.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled.
    mark : callable
    """
    for spring in mechanism.springs:
        system.AddObject(_spring_damper(spring, mark))
    for load in mechanism.loads:
        system.AddLoad(_load(load, mark))


def _spring_damper(spring: Spring, mark: Mark) -> Any:
    markers = [
        mark(spring.predecessor, spring.point_predecessor, _ONE),
        mark(spring.successor, spring.point_successor, _ONE),
    ]
    return items.ObjectConnectorSpringDamper(
        markerNumbers=markers,
        referenceLength=spring.free_length,
        stiffness=spring.stiffness,
        damping=spring.damping,
    )


def _load(load: Load, mark: Mark) -> Any:
    return _LOADS[load.kind](
        markerNumber=mark(load.body, load.point, _ONE),
        loadVector=list(load.vector),
        bodyFixed=load.frame == "body",
    )


def add_joint_springs(system: Any, mechanism: Mechanism, mark: Mark) -> None:
    """Add the springs about and along joint axes as connectors between the frames F and M.

    A torsional spring gets a data node: Exudyn counts full turns only with one, else the angle jumps at half a turn.
    """
    for spring in mechanism.joint_springs:
        joint = mechanism.joints[mechanism.joint_index[spring.joint]]
        markers = [mark(joint.predecessor, joint.F.p, joint.F.R), mark(joint.successor, joint.M.p, joint.M.R)]
        system.AddObject(_JOINT_SPRINGS[spring.coordinate](system, spring, markers))


def _torsional(system: Any, spring: JointSpring, markers: list[Any]) -> Any:
    turns = system.AddNode(items.NodeGenericData(initialCoordinates=[0.0], numberOfDataCoordinates=1))
    return items.ObjectConnectorTorsionalSpringDamper(
        markerNumbers=markers,
        nodeNumber=turns,
        stiffness=spring.stiffness,
        damping=spring.damping,
        offset=spring.rest,
    )


def _linear(system: Any, spring: JointSpring, markers: list[Any]) -> Any:
    return items.ObjectConnectorLinearSpringDamper(
        markerNumbers=markers,
        stiffness=spring.stiffness,
        damping=spring.damping,
        axisMarker0=[0.0, 0.0, 1.0],
        offset=spring.rest,
    )


_JOINT_SPRINGS = {"angle": _torsional, "distance": _linear}


def transformation(p: Array, R: Array) -> Any:
    """Homogeneous transformation of Exudyn from an origin, shape (3,), and axes, shape (3, 3)."""
    return exu.HT(rotation=R, translation=p)
