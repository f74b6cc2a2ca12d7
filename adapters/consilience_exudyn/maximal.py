"""Mechanisms in Exudyn's redundant coordinates: rigid bodies with Euler parameters, joints as constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    Body,
    Joint,
    Mechanism,
    State,
    euler_parameter_matrix,
    rotation_from_quaternion,
)
from consilience_exudyn.constraints import Added, Mark, add_rows
from consilience_exudyn.contacts import AT_INSTANT, add_contact, parts_of
from consilience_exudyn.forces import add_joint_forces, add_springs_and_loads
from consilience_exudyn.library import exu, items
from consilience_exudyn.rows import displacement_turns, rows_of

Axes = tuple[int, ...]
"""Axes that an ObjectJointGeneric holds (1) or leaves free (0): three translations, three rotations, in turned frame F.

A rod has one entry, its distance; a row of `rows_of` has one entry for each equation.
"""

_UNIT_QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])
_ONE = np.eye(3)
_Z_TO_X = np.array(
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
)  # columns z, x, y: the new x is the old z, the new y the old x


@dataclass(frozen=True)
class JointItem:
    """One row of the table of joints.

    Attributes
    ----------
    axes : tuple of int
        Axes of the joint as an ObjectJointGeneric; for a rod one entry, its distance.
    native : callable or None
        Exudyn's object for the joint; None where there is only the generic joint.
    turn : ndarray, shape (3, 3)
        Axes of Exudyn's joint frames in F and in M.
    """

    axes: Axes
    native: Callable[..., Any] | None = None
    turn: Array = field(default_factory=lambda: _ONE)


JOINT_ITEMS: dict[str, JointItem] = {
    "revolute": JointItem((1, 1, 1, 1, 1, 0), items.ObjectJointRevoluteZ),
    "prismatic": JointItem((0, 1, 1, 1, 1, 1), items.ObjectJointPrismaticX, _Z_TO_X),
    "cylindrical": JointItem((1, 1, 0, 1, 1, 0)),
    "universal": JointItem((1, 1, 1, 0, 0, 1), turn=_Z_TO_X),  # the third rotation alone: x of marker 0 across y of 1
    "spherical": JointItem((1, 1, 1, 0, 0, 0), items.ObjectJointSpherical),
    "planar": JointItem((0, 0, 1, 1, 1, 0)),
    "point_on_line": JointItem((1, 1, 0, 0, 0, 0)),
    "point_in_plane": JointItem((0, 0, 1, 0, 0, 0)),
    "parallel_axes": JointItem((0, 0, 0, 1, 1, 0)),
    "rigid": JointItem((1, 1, 1, 1, 1, 1)),
    "rod": JointItem((1,), items.ObjectConnectorDistance),
    "free": JointItem(()),
    "screw": JointItem((1, 1, 0, 1, 1, 0)),  # and a row of its own
}


@dataclass(frozen=True, eq=False)
class Maximal:
    """Assembled Exudyn system of rigid bodies.

    Attributes
    ----------
    mechanism : Mechanism
    container, system : exudyn.SystemContainer, exudyn.MainSystem
    bodies : tuple of exudyn.ObjectIndex
        In the mechanism's order; seven coordinates each.
    joints : tuple of tuple of exudyn.ObjectIndex
        In the mechanism's order: the objects that hold the constraints of the joint.
    rows : tuple of Added
        Constraints beside those of Exudyn's joints, including those of screws.
    turning : tuple of str
        Joints whose angles are data coordinates, so that turns are counted.
    integrals : int
        Number of coordinates behind those of the bodies: integrals of controllers.
    contacts : tuple of exudyn.ObjectIndex
        Elementary contacts, of which those that slide are given a stiffness (`contact_instant`).
    gravity : tuple of exudyn.LoadIndex
    sensors : tuple of tuple of exudyn.SensorIndex
        Coordinates, velocity and angular velocity of each body.
    """

    mechanism: Mechanism
    container: Any
    system: Any
    bodies: tuple[Any, ...]
    joints: tuple[tuple[Any, ...], ...]
    rows: tuple[Added, ...]
    turning: tuple[str, ...]
    integrals: int
    contacts: tuple[Any, ...]
    gravity: tuple[Any, ...]
    sensors: tuple[tuple[Any, Any, Any], ...]


def full_axes(mechanism: Mechanism) -> tuple[Axes, ...]:
    """Return all constrained axes of every joint, then of every row of `rows_of`."""
    joints = (JOINT_ITEMS[joint.kind].axes for joint in mechanism.joints)
    return (*joints, *((1,) * len(row.axes) for row in rows_of(mechanism)))


def inertia_about_origin(body: Body) -> Array:
    """Return the inertia about the body's origin in body axes, ``I + m (c.c 1 - c c^T)``, shape (3, 3)."""
    c = body.com
    return np.asarray(body.inertia + body.mass * ((c @ c) * _ONE - np.outer(c, c)))


def inertia_vector(I: Array) -> list[float]:
    """Return the six entries of an inertia tensor in Exudyn's order, xx yy zz yz xz xy."""
    return [I[0, 0], I[1, 1], I[2, 2], I[1, 2], I[0, 2], I[0, 1]]


def coordinates(state: State) -> Array:
    """Return the coordinates of a state, shape (7 n_b,): displacement and Euler parameters from the world's frame."""
    return np.hstack([state.p_WB, state.quat_WB - _UNIT_QUATERNION]).ravel()


def velocities(state: State) -> Array:
    """Return the rates of the coordinates, shape (7 n_b,): ``dp/dt = 1/2 G^T w_B``."""
    pairs = zip(state.quat_WB, state.w_WB_W, strict=True)
    rates = [0.5 * euler_parameter_matrix(q).T @ (rotation_from_quaternion(q).T @ w) for q, w in pairs]
    return np.hstack([state.v_WB_W, np.array(rates)]).ravel()


def set_initial(model: Maximal, state: State) -> None:
    """Set the initial values of Exudyn's solvers to a state."""
    place(model, coordinates(state), velocities(state), exu.ConfigurationType.Initial)
    count_turns(model, state, exu.ConfigurationType.Initial)


def place(model: Maximal, q: Array, v: Array, configuration: Any) -> None:
    """Set coordinates and rates of the bodies in a configuration, and integrals of controllers to zero."""
    data, zero = model.system.systemData, np.zeros(model.integrals)
    data.SetODE2Coordinates(np.append(q, zero), configuration=configuration)
    data.SetODE2Coordinates_t(np.append(v, zero), configuration=configuration)


_SLIDING = [-1.0, 1.0, 0.0, 0.0]
"""Data of a contact that is closed and slides: gap in m, slip in m/s."""


def count_turns(model: Maximal, state: State, configuration: Any) -> None:
    """Start counting the full turns of angles from a state, in a configuration; contacts slide."""
    for added in model.rows:
        added.row.forget()
    values = [displacement_turns(model.mechanism, state, joint) for joint in model.turning]
    values += _SLIDING * len(model.contacts)
    if values:
        model.system.systemData.SetDataCoordinates(values, configuration=configuration)


def build(mechanism: Mechanism, state: State, held: tuple[Axes, ...] | None = None) -> Maximal:
    """Translate a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Initial values. The reference configuration of every body is the pose at the world's origin.
    held : tuple of Axes, optional
        Constrained axes in the form of `full_axes`, without dependent axes; by default all. A joint with all of its
        axes becomes Exudyn's own object for its kind.
    """
    container = exu.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    nodes, bodies, gravity, sensors = [], [], [], []
    for body in mechanism.bodies:
        node, index = _add_body(system, body)
        nodes.append(node)
        bodies.append(index)
        marker = system.AddMarker(items.MarkerBodyMass(bodyNumber=index))
        load = items.LoadMassProportional(markerNumber=marker, loadVector=list(mechanism.gravity))
        gravity.append(system.AddLoad(load))
        sensors.append(_add_sensors(system, node, index))

    def mark(name: str, p: Array, R: Array) -> Any:
        index = ground if name == GROUND else bodies[mechanism.body_index[name]]
        return system.AddMarker(items.MarkerBodyRigid(bodyNumber=index, localHT=exu.HT(rotation=R, translation=p)))

    held = held or full_axes(mechanism)
    own = [_add_joint(system, joint, axes, mark) for joint, axes in zip(mechanism.joints, held, strict=False)]
    rows = add_rows(system, rows_of(mechanism), held[len(own) :], lambda name: nodes[mechanism.body_index[name]], mark)
    joints = tuple(
        (*objects, *(added.index for added in rows if added.row.joint == joint.name))
        for joint, objects in zip(mechanism.joints, own, strict=True)
    )
    add_springs_and_loads(system, mechanism, mark)
    turning, integrals = add_joint_forces(system, mechanism, mark)
    contacts = tuple(add_contact(system, mechanism, state, part, AT_INSTANT, mark) for _, part in parts_of(mechanism))
    system.Assemble()
    model = Maximal(
        mechanism,
        container,
        system,
        tuple(bodies),
        joints,
        rows,
        turning,
        integrals,
        contacts,
        tuple(gravity),
        tuple(sensors),
    )
    set_initial(model, state)
    return model


def _add_body(system: Any, body: Body) -> tuple[Any, Any]:
    node = system.AddNode(items.NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, *_UNIT_QUATERNION]))
    item = items.ObjectRigidBody(
        mass=body.mass, inertia=inertia_vector(inertia_about_origin(body)), centerOfMass=list(body.com), nodeNumber=node
    )
    return node, system.AddObject(item)


def _add_sensors(system: Any, node: Any, body: Any) -> tuple[Any, Any, Any]:
    kinds = exu.OutputVariableType
    keep = {"storeInternal": True, "writeToFile": False}
    return (
        system.AddSensor(items.SensorNode(nodeNumber=node, outputVariableType=kinds.Coordinates, **keep)),
        system.AddSensor(items.SensorBody(bodyNumber=body, outputVariableType=kinds.Velocity, **keep)),
        system.AddSensor(items.SensorBody(bodyNumber=body, outputVariableType=kinds.AngularVelocity, **keep)),
    )


def _add_joint(system: Any, joint: Joint, axes: Axes, mark: Mark) -> tuple[Any, ...]:
    """Add Exudyn's own object if every axis is held, else the generic joint; nothing if no axis is held."""
    if not any(axes):
        return ()
    item = JOINT_ITEMS[joint.kind]
    native = item.native if axes == item.axes else None
    markers = [
        mark(joint.predecessor, joint.F.p, joint.F.R @ item.turn),
        mark(joint.successor, joint.M.p, joint.M.R @ item.turn),
    ]
    if joint.kind == "rod":
        return (system.AddObject(items.ObjectConnectorDistance(markerNumbers=markers, distance=joint.length)),)
    if native:
        return (system.AddObject(native(markerNumbers=markers)),)
    return (system.AddObject(items.ObjectJointGeneric(markerNumbers=markers, constrainedAxes=list(axes))),)
