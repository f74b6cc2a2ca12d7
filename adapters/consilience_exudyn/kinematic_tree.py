"""A tree of one-axis joints as an ObjectKinematicTree: Exudyn's minimal coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Array, Mechanism, State, Tree, coordinates, to_elementary_tree
from consilience_exudyn.efforts import Coordinate, Integrals, efforts_of, opposed
from consilience_exudyn.forces import add_springs_and_loads, transformation
from consilience_exudyn.library import exu, items

_JOINT_TYPES = {"R": exu.JointType.RevoluteZ, "P": exu.JointType.PrismaticZ}
_BEYOND = {"screw joint", "drive", "coupling", "rolling", "skate"}
"""What would be a constraint: Exudyn's explicit integrators take none."""

_SPRUNG = {"angle": "R", "distance": "P"}
MOTION = ("Position", "RotationMatrix", "Velocity", "AngularVelocity")
ACCELERATIONS = ("Acceleration", "AngularAcceleration")


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """An assembled Exudyn system of one kinematic tree.

    Attributes
    ----------
    mechanism : Mechanism
    tree : Tree
    container, system : exudyn.SystemContainer, exudyn.MainSystem
    sensors : tuple of tuple of exudyn.SensorIndex
        What was asked of each body; rotation matrices are those of the link.
    R_LB : ndarray, shape (n_b, 3, 3)
        Axes of each body in its link.
    integrals : int
        Coordinates behind those of the tree: integrals of controllers.
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
    if _BEYOND & mechanism.features.keys():
        return False
    tree = to_elementary_tree(mechanism)
    return not tree.welds and all(link.elementary in _JOINT_TYPES for link in tree.links)


def set_initial(model: KinematicTree, state: State) -> None:
    """Make the joint coordinates of a state the initial values from which Exudyn's solvers start."""
    at, data = coordinates(model.mechanism, model.tree, state), model.system.systemData
    zero = [0.0] * model.integrals
    data.SetODE2Coordinates([*(c.q for c in at), *zero], configuration=exu.ConfigurationType.Initial)
    data.SetODE2Coordinates_t([*(c.rate for c in at), *zero], configuration=exu.ConfigurationType.Initial)


def build_tree(mechanism: Mechanism, state: State, outputs: Sequence[str] = MOTION) -> KinematicTree:
    """Translate a tree of one-axis joints, with the joint coordinates of a state as initial values.

    Parameters
    ----------
    outputs : sequence of str
        Exudyn's output variables that sensors read at the origin of each body.
    """
    tree = to_elementary_tree(mechanism)
    container = exu.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    zero = [0.0] * len(tree.links)
    node = system.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=zero,
            initialCoordinates=zero,
            initialCoordinates_t=zero,
            numberOfODE2Coordinates=len(zero),
        )
    )
    index = system.AddObject(_tree_object(mechanism, tree, node))
    integrals = _add_efforts(system, mechanism, tree, node)

    def mark(name: str, p: Array, R: Array) -> Any:
        """Marker at a frame of a body or of the ground."""
        if name == GROUND:
            return system.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localHT=transformation(p, R)))
        carrier = tree.carrier(mechanism.body_index[name])
        B = tree.links[carrier].body_frame
        place = transformation(B.p + B.R @ p, B.R @ R)
        return system.AddMarker(items.MarkerKinematicTreeRigid(objectNumber=index, linkNumber=carrier, localHT=place))

    add_springs_and_loads(system, mechanism, mark)
    carriers = [tree.carrier(b) for b in range(len(mechanism.bodies))]
    sensors = tuple(_add_sensors(system, index, n, tree.links[n].body_frame.p, outputs) for n in carriers)
    system.Assemble()
    axes = np.array([tree.links[n].body_frame.R for n in carriers])
    model = KinematicTree(mechanism, tree, container, system, sensors, axes, integrals)
    set_initial(model, state)
    return model


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
    """Joint springs as the tree's joint control: constant force, stiffness and damping of each coordinate.

    A joint passed backwards has the negative coordinate, so the constant part ``k q0`` changes sign.
    """
    force, stiffness, damping = np.zeros((3, len(tree.links)))
    for spring in mechanism.joint_springs:
        n, sign = _place(mechanism, tree, (spring.joint, spring.coordinate))
        force[n] += sign * spring.stiffness * spring.rest
        stiffness[n] += spring.stiffness
        damping[n] += spring.damping
    return force, stiffness, damping


def _place(mechanism: Mechanism, tree: Tree, where: Coordinate) -> tuple[int, float]:
    """Index of the link that has a joint coordinate, and -1 where the tree passes the joint backwards."""
    joint, elementary = mechanism.joint_index[where[0]], _SPRUNG[where[1]]
    n = next(i for i, link in enumerate(tree.links) if link.joint == joint and link.elementary == elementary)
    return n, -1.0 if tree.links[n].reversed else 1.0


def _add_efforts(system: Any, mechanism: Mechanism, tree: Tree, node: Any) -> int:
    """Add the efforts that are no linear springs; returns how many integrals of controllers they need.

    They are connectors on the coordinates: with a user function of its own the tree has no potential energy.
    """
    at_rest = items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
    ground = system.AddMarker(at_rest)

    def measure(where: Coordinate) -> float:
        n, sign = _place(mechanism, tree, where)
        return sign * float(np.atleast_1d(system.GetNodeOutput(node, exu.OutputVariableType.Coordinates))[n])

    integrals = Integrals(system, mechanism, measure)
    for where, effort in efforts_of(mechanism).items():
        n, sign = _place(mechanism, tree, where)
        moved = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=n))
        force = opposed(effort, integrals, sign)
        connector = items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[ground, moved], springForceUserFunction=force
        )
        system.AddObject(connector)
    return integrals.count


def _add_sensors(system: Any, tree: Any, link: int, p_LB: Array, outputs: Sequence[str]) -> tuple[Any, ...]:
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
