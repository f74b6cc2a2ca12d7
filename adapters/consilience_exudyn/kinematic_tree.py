"""Trees of one-axis joints as an ObjectKinematicTree, in minimal coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.engine import axis_link
from consilience.mechanism import GROUND, Array, Mechanism, State, Tree, coordinates, to_elementary_tree
from consilience_exudyn.constraints import Mark
from consilience_exudyn.efforts import Coordinate, Integrals, efforts_of, opposed
from consilience_exudyn.forces import add_springs_and_loads
from consilience_exudyn.library import add_coordinates, exu, items

_JOINT_TYPES = {"R": exu.JointType.RevoluteZ, "P": exu.JointType.PrismaticZ}
HELD = {"screw joint", "drive", "coupling", "rolling", "skate"}
"""Features that would be constraints, which Exudyn's explicit integrators do not accept."""

MOTION = ("Position", "RotationMatrix", "Velocity", "AngularVelocity")
ACCELERATIONS = ("Acceleration", "AngularAcceleration")


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Assembled Exudyn system of one kinematic tree.

    Attributes
    ----------
    mechanism : Mechanism
    tree : Tree
    container, system : exudyn.SystemContainer, exudyn.MainSystem
    sensors : tuple of tuple of exudyn.SensorIndex
        Sensors of each body; sensors of rotation matrices give axes of the link.
    R_LB : ndarray, shape (n_b, 3, 3)
        Axes of each body in its link.
    integrals : int
        Number of coordinates behind those of the tree: integrals of controllers.
    """

    mechanism: Mechanism
    tree: Tree
    container: Any
    system: Any
    sensors: tuple[tuple[Any, ...], ...]
    R_LB: Array
    integrals: int


def is_one_axis_tree(mechanism: Mechanism) -> bool:
    """Whether the mechanism has no loop and only joints made of revolute and prismatic axes."""
    if HELD & mechanism.features.keys():
        return False
    tree = to_elementary_tree(mechanism)
    return not tree.welds and all(link.elementary in _JOINT_TYPES for link in tree.links)


def set_initial(model: KinematicTree, state: State) -> None:
    """Set the initial values of Exudyn's solvers to the joint coordinates of a state."""
    at, data = coordinates(model.mechanism, model.tree, state), model.system.systemData
    zero = [0.0] * model.integrals
    data.SetODE2Coordinates([*(c.q for c in at), *zero], configuration=exu.ConfigurationType.Initial)
    data.SetODE2Coordinates_t([*(c.rate for c in at), *zero], configuration=exu.ConfigurationType.Initial)


Coordinates = Callable[[str, str], tuple[tuple[Any, Any], float]]
"""Markers of a joint coordinate, at rest and of the joint, and the sign of the coordinate."""

Touching = Callable[[Any, Mark, Coordinates], None]
"""Adds contacts, stops and dry friction to a system, with functions for rigid markers and markers of coordinates."""


def build_tree(
    mechanism: Mechanism, state: State, outputs: Sequence[str] = MOTION, touching: Touching | None = None
) -> KinematicTree:
    """Translate a tree of one-axis joints, with the joint coordinates of a state as initial values.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    outputs : sequence of str
        Exudyn's output variables that sensors read at the origin of each body.
    touching : callable, optional
        Adds contacts, stops and dry friction.
    """
    tree = to_elementary_tree(mechanism)
    container = exu.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    node = add_coordinates(system, len(tree.links))
    index = system.AddObject(_tree_object(mechanism, tree, node))
    integrals = _add_efforts(system, mechanism, tree, node)

    def mark(name: str, p: Array, R: Array) -> Any:
        """Add a marker at a frame of a body or of the ground."""
        if name == GROUND:
            return system.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localHT=exu.HT(rotation=R, translation=p)))
        carrier = tree.carrier(mechanism.body_index[name])
        B = tree.links[carrier].body_frame
        place = exu.HT(rotation=B.R @ R, translation=B.p + B.R @ p)
        return system.AddMarker(items.MarkerKinematicTreeRigid(objectNumber=index, linkNumber=carrier, localHT=place))

    add_springs_and_loads(system, mechanism, mark)
    if touching is not None:
        touching(system, mark, _coordinate_markers(system, mechanism, tree, node))
    carriers = [tree.carrier(b) for b in range(len(mechanism.bodies))]
    sensors = tuple(_add_sensors(system, index, n, tree.links[n].body_frame.p, outputs) for n in carriers)
    system.Assemble()
    axes = np.array([tree.links[n].body_frame.R for n in carriers])
    model = KinematicTree(mechanism, tree, container, system, sensors, axes, integrals)
    set_initial(model, state)
    return model


def _coordinate_markers(system: Any, mechanism: Mechanism, tree: Tree, node: Any) -> Coordinates:
    """Return the function that adds the markers of a joint coordinate."""

    def markers(joint: str, coordinate: str) -> tuple[tuple[Any, Any], float]:
        n, sign = axis_link(mechanism, tree, joint, coordinate)
        at_rest = items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
        moved = items.MarkerNodeCoordinate(nodeNumber=node, coordinate=n)
        return (system.AddMarker(at_rest), system.AddMarker(moved)), sign

    return markers


def _tree_object(mechanism: Mechanism, tree: Tree, node: Any) -> Any:
    links = tree.links
    force, stiffness, damping = _joint_controls(mechanism, tree)
    return items.ObjectKinematicTree(
        nodeNumber=node,
        gravity=list(mechanism.gravity),
        jointTypes=[_JOINT_TYPES[link.elementary] for link in links],
        linkParents=[link.parent for link in links],
        jointTransformations=exu.Matrix3DList([link.placement.R for link in links]),
        jointOffsets=exu.Vector3DList([link.placement.p for link in links]),
        linkInertiasCOM=exu.Matrix3DList([link.inertia for link in links]),
        linkCOMs=exu.Vector3DList([link.com for link in links]),
        linkMasses=[link.mass for link in links],
        jointForceVector=list(force),
        jointPositionOffsetVector=[0.0] * len(links),
        jointVelocityOffsetVector=[0.0] * len(links),
        jointPControlVector=list(stiffness),
        jointDControlVector=list(damping),
    )


def _joint_controls(mechanism: Mechanism, tree: Tree) -> tuple[Array, Array, Array]:
    """Joint springs as joint control of the tree: constant force, stiffness and damping of each coordinate.

    A joint passed backwards has the negative coordinate, so that the constant force ``k q0`` changes sign.
    """
    force, stiffness, damping = np.zeros((3, len(tree.links)))
    for spring in mechanism.joint_springs:
        n, sign = axis_link(mechanism, tree, spring.joint, spring.coordinate)
        force[n] += sign * spring.stiffness * spring.rest
        stiffness[n] += spring.stiffness
        damping[n] += spring.damping
    return force, stiffness, damping


def _add_efforts(system: Any, mechanism: Mechanism, tree: Tree, node: Any) -> int:
    """Add all efforts but linear springs; return the number of integrals of controllers.

    Efforts are connectors on the coordinates: a kinematic tree with a user function of its own has no potential energy.
    """
    at_rest = items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
    ground = system.AddMarker(at_rest)

    def measure(where: Coordinate) -> float:
        n, sign = axis_link(mechanism, tree, *where)
        return sign * float(np.atleast_1d(system.GetNodeOutput(node, exu.OutputVariableType.Coordinates))[n])

    integrals = Integrals(system, mechanism, measure)
    for where, laws in efforts_of(mechanism).items():
        n, sign = axis_link(mechanism, tree, *where)
        moved = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=n))
        force = opposed(laws, integrals, sign)
        law = {"markerNumbers": [ground, moved], "springForceUserFunction": force}
        system.AddObject(items.ObjectConnectorCoordinateSpringDamper(**law))
    return integrals.count


def _add_sensors(system: Any, tree: Any, link: int, p_LB: Array, outputs: Sequence[str]) -> tuple[Any, ...]:
    """Add sensors at the origin of a body, and return their indices.

    Parameters
    ----------
    system : exudyn.MainSystem
    tree : exudyn.ObjectIndex
        The kinematic tree.
    link : int
    p_LB : ndarray, shape (3,), m
        Origin of the body in its link.
    outputs : sequence of str
        Exudyn's output variables.
    """
    return tuple(
        system.AddSensor(
            items.SensorKinematicTree(
                objectNumber=tree,
                linkNumber=link,
                localPosition=list(p_LB),
                outputVariableType=getattr(exu.OutputVariableType, name),
                storeInternal=True,
                writeToFile=False,
            )
        )
        for name in outputs
    )
