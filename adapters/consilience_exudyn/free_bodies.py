"""Free bodies as nodes with rotation vectors, for explicit integrators of motions on the Lie group.

Exudyn takes the angle of a rotation vector from the cosine of its half: near a rotation vector of zero, turns below
2e-8 rad in a step are lost. At the start the axes of every node are therefore half a turn away from the world's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Array, Mechanism, State
from consilience_exudyn.forces import add_springs_and_loads
from consilience_exudyn.library import exu, items
from consilience_exudyn.maximal import inertia_vector

KEEP = {"storeInternal": True, "writeToFile": False}
"""Settings of a sensor."""

_TURN = np.pi * np.full(3, 3.0**-0.5)
_R_WN = np.full((3, 3), 2.0 / 3.0) - np.eye(3)
"""Rotation vector and axes of a node at the start: bodies that turn about an axis of the world stay away from zero."""


def add_free_bodies(
    system: Any, mechanism: Mechanism, state: State, touching: Callable[..., None]
) -> tuple[list[list[Any]], Array]:
    """Assemble bodies on nodes at their centres of mass, with springs, loads and gravity.

    Parameters
    ----------
    system : exudyn.MainSystem
        Empty.
    mechanism : Mechanism
    state : State
        At the start.
    touching : callable
        Adds what touches, by a function that adds a marker (`constraints.Mark`).

    Returns
    -------
    sensors : list of list of exudyn.SensorIndex
        Position, rotation, velocity and angular velocity of each body's origin, the rotation that of the node.
    R_NB : ndarray, shape (n_b, 3, 3)
        Axes of the bodies in those of their nodes.
    """
    R_NB = np.asarray(_R_WN.T @ state.R_WB)
    ground = system.AddObject(items.ObjectGround())
    indices = [_add_body(system, mechanism, state, n, R_NB[n]) for n in range(len(mechanism.bodies))]

    def mark(name: str, p: Array, R: Array) -> Any:
        """Add a marker at a frame of a body or of the ground."""
        index = ground
        if name != GROUND:
            n = mechanism.body_index[name]
            index, p, R = indices[n], R_NB[n] @ (p - mechanism.bodies[n].com), R_NB[n] @ R
        return system.AddMarker(items.MarkerBodyRigid(bodyNumber=index, localHT=exu.HT(rotation=R, translation=p)))

    add_springs_and_loads(system, mechanism, mark)
    touching(system, mark, None)
    sensors = [
        [
            system.AddSensor(
                items.SensorBody(
                    bodyNumber=index,
                    localPosition=list(-R @ body.com),
                    outputVariableType=getattr(exu.OutputVariableType, name),
                    **KEEP,
                )
            )
            for name in ("Position", "RotationMatrix", "Velocity", "AngularVelocity")
        ]
        for index, body, R in zip(indices, mechanism.bodies, R_NB, strict=True)
    ]
    system.Assemble()
    return sensors, R_NB


def _add_body(system: Any, mechanism: Mechanism, state: State, n: int, R_NB: Array) -> Any:
    """Add a body at its pose, with gravity."""
    body = mechanism.bodies[n]
    arm, w = state.R_WB[n] @ body.com, state.w_WB_W[n]
    node = system.AddNode(
        items.NodeRigidBodyRotVecLG(
            referenceCoordinates=[*(state.p_WB[n] + arm), *_TURN],
            initialVelocities=[*(state.v_WB_W[n] + np.cross(w, arm)), *(_R_WN.T @ w)],
        )
    )
    index = system.AddObject(
        items.ObjectRigidBody(mass=body.mass, inertia=inertia_vector(R_NB @ body.inertia @ R_NB.T), nodeNumber=node)
    )
    marker = system.AddMarker(items.MarkerBodyMass(bodyNumber=index))
    system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=list(mechanism.gravity)))
    return index
