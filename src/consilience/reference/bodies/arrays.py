"""Arrays of a mechanism, of its state, and of the work space of the compiled kernels.

Mechanisms differ in the sizes of the arrays alone, so that one compilation serves all. Vectors fixed to a body start at
its **centre of mass** and are given in body axes; body -1 is the ground, whose vectors start at the world origin.

The packed state y has shape (n_b + n_e, 13). A row of a body: r and v, position and velocity of the centre of mass in
world axes; Euler parameters p; angular velocity w' in body axes. The last n_e rows hold the integrals of controllers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import (
    BASIC_CONSTRAINTS,
    Array,
    Coupling,
    Function,
    Joint,
    Mechanism,
    State,
    plane_axes,
    rotation_from_quaternion,
)
from consilience.reference.kernel.functions import Functions, flatten_functions
from consilience.reference.kernel.mechanism_record import record_of

R, P, V, W = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
"""Columns of y: position, Euler parameters, velocity, angular velocity."""

ROWS = (*BASIC_CONSTRAINTS, "H")
"""Kinds of joint rows; kernels use their index."""

ANGLE, DISTANCE = 0, 1
_COORDINATES = {"angle": ANGLE, "distance": DISTANCE}


class Model(NamedTuple):
    """Arrays of a mechanism: n_b bodies, n_j joints, q joint rows, n_c joint coordinates that elements read."""

    gravity: Array  # (3,)
    mass: Array  # (n_b,)
    inertia: Array  # (n_b, 3, 3) about the centre of mass, body axes
    inertia_factor: Array  # (n_b, 3, 3) lower Cholesky factor of the inertia
    length: float  # characteristic length that scales tolerances, m
    body_i: Array  # (n_j,) predecessor
    body_j: Array  # (n_j,) successor
    arm_i: Array  # (n_j, 3) s_i'
    arm_j: Array  # (n_j, 3) s_j'
    axes_i: Array  # (n_j, 3, 3) A_Ji
    axes_j: Array  # (n_j, 3, 3) A_Jj
    pitch: Array  # (n_j,) of a screw
    first_row: Array  # (n_j + 1,)
    row_kind: Array  # (q,) index into ROWS
    row_target: Array  # (q,)
    coordinate: Array  # (n_c, 2) joint, ANGLE or DISTANCE
    counted: Array  # (n_c,) true for an angle whose full turns are counted
    functions: Functions
    spring_body: Array  # (n, 2)
    spring_arm: Array  # (n, 2, 3)
    spring_law: Array  # (n, 3) k, c, L0
    spring_function: Array  # (n,) actuator, -1 for none
    joint_spring: Array  # (n, 2) coordinate; actuator, -1 for none
    joint_spring_law: Array  # (n, 3) k, c, rest
    friction: Array  # (n,) coordinate
    friction_law: Array  # (n, 3) viscous, Coulomb, speed
    control: Array  # (n, 2) coordinate, target
    control_law: Array  # (n, 3) P, I, D
    load_body: Array  # (n,)
    load_kind: Array  # (n, 2) 0 force or 1 torque; 0 world or 1 body
    load_vector: Array  # (n, 3)
    load_arm: Array  # (n, 3)
    load_function: Array  # (n,) history, -1 for none
    drive: Array  # (n, 2) coordinate, function
    coupling: Array  # (n, 3) coordinate, that of the driver, function
    rolling_body: Array  # (n,)
    rolling_arm: Array  # (n, 3) centre
    rolling_axis: Array  # (n, 3)
    rolling_plane: Array  # (n, 3, 3) normal and two directions in the plane, as rows
    rolling_point: Array  # (n, 3)
    rolling_radii: Array  # (n, 2) R, r
    skate_body: Array  # (n,)
    skate_arm: Array  # (n, 3)
    skate_lateral: Array  # (n, 3)


def holonomic_rows(model: Model) -> int:
    """Count the rows at position level."""
    return len(model.row_kind) + len(model.drive) + len(model.coupling) + len(model.rolling_body)


def all_rows(model: Model) -> int:
    """Count all rows, the non-holonomic ones included."""
    return holonomic_rows(model) + 2 * len(model.rolling_body) + len(model.skate_body)


def _table(rows: list[list[float]], width: int) -> Array:
    return np.array(rows, dtype=float).reshape(-1, width)


def _vectors(rows: list[Array] | list[list[Array]], *shape: int) -> Array:
    """Return vectors as an array of shape (n, *shape, 3)."""
    return np.array(rows, dtype=float).reshape(-1, *shape, 3)


def _indices(rows: list[int] | list[list[int]], *width: int) -> Array:
    return np.array(rows, dtype=np.int64).reshape(-1, *width)


class _Numbers:
    """Indices of the joint coordinates and functions that elements refer to."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.joints = mechanism.joint_index
        self.coordinates: dict[tuple[int, int], int] = {}
        self.functions: list[Function] = []

    def coordinate(self, joint: str, name: str) -> int:
        key = (self.joints[joint], _COORDINATES[name])
        return self.coordinates.setdefault(key, len(self.coordinates))

    def pair(self, element: Any, function: Function | None) -> list[int]:
        """Return the indices of the joint coordinate of an element and of its function."""
        return [self.coordinate(element.joint, element.coordinate), self.function(function)]

    def triple(self, coupling: Coupling) -> list[int]:
        """Return the indices of both coordinates of a coupling and of its law."""
        first = self.coordinate(coupling.joint, coupling.coordinate)
        return [first, self.coordinate(coupling.driver_joint, coupling.driver_coordinate), self.function(coupling.law)]

    def function(self, function: Function | None) -> int:
        if function is None:
            return -1
        self.functions.append(function)
        return len(self.functions) - 1


def _joint_arrays(mechanism: Mechanism) -> dict[str, Array]:
    joints, index = mechanism.joints, mechanism.body_index
    return {
        "body_i": _indices([index[j.predecessor] for j in joints]),
        "body_j": _indices([index[j.successor] for j in joints]),
        "arm_i": _vectors([_arm(mechanism, j.predecessor, j.F.p) for j in joints]),
        "arm_j": _vectors([_arm(mechanism, j.successor, j.M.p) for j in joints]),
        "axes_i": _vectors([j.F.R for j in joints], 3),
        "axes_j": _vectors([j.M.R for j in joints], 3),
        "pitch": np.array([j.pitch for j in joints]),
        "first_row": np.concatenate([[0], np.cumsum([len(j.rows) for j in joints])]).astype(np.int64),
        "row_kind": _indices([ROWS.index(row) for j in joints for row in j.rows]),
        "row_target": np.array([j.length if row == "L" else 0.0 for j in joints for row in j.rows]),
    }


def _arm(mechanism: Mechanism, body: str, point: Array) -> Array:
    """Return a point of a body relative to its centre of mass."""
    i = mechanism.body_index[body]
    return point if i < 0 else point - mechanism.bodies[i].com


def _force_arrays(mechanism: Mechanism, number: _Numbers) -> dict[str, Array]:
    index, springs, loads = mechanism.body_index, mechanism.springs, mechanism.loads
    arm_i = [_arm(mechanism, s.predecessor, s.point_predecessor) for s in springs]
    arm_j = [_arm(mechanism, s.successor, s.point_successor) for s in springs]
    return {
        "spring_body": _indices([[index[s.predecessor], index[s.successor]] for s in springs], 2),
        "spring_arm": _vectors([list(ends) for ends in zip(arm_i, arm_j, strict=True)], 2),
        "spring_law": _table([[s.stiffness, s.damping, s.free_length] for s in springs], 3),
        "spring_function": _indices([number.function(s.actuator) for s in springs]),
        "joint_spring": _indices([number.pair(s, s.actuator) for s in mechanism.joint_springs], 2),
        "joint_spring_law": _table([[s.stiffness, s.damping, s.rest] for s in mechanism.joint_springs], 3),
        "friction": _indices([number.coordinate(f.joint, f.coordinate) for f in mechanism.frictions]),
        "friction_law": _table([[f.viscous, f.coulomb, f.speed] for f in mechanism.frictions], 3),
        "control": _indices([number.pair(c, c.target) for c in mechanism.controls], 2),
        "control_law": _table([[c.proportional, c.integral, c.derivative] for c in mechanism.controls], 3),
        "load_body": _indices([index[load.body] for load in loads]),
        "load_kind": _indices([[int(load.kind == "torque"), int(load.frame == "body")] for load in loads], 2),
        "load_vector": _vectors([load.vector for load in loads]),
        "load_arm": _vectors([_arm(mechanism, load.body, load.point) for load in loads]),
        "load_function": _indices([number.function(load.history) for load in loads]),
    }


def _constraint_arrays(mechanism: Mechanism, number: _Numbers) -> dict[str, Array]:
    index, rollings, skates = mechanism.body_index, mechanism.rollings, mechanism.skates
    return {
        "drive": _indices([number.pair(d, d.motion) for d in mechanism.drives], 2),
        "coupling": _indices([number.triple(c) for c in mechanism.couplings], 3),
        "rolling_body": _indices([index[r.body] for r in rollings]),
        "rolling_arm": _vectors([_arm(mechanism, r.body, r.center) for r in rollings]),
        "rolling_axis": _vectors([r.axis for r in rollings]),
        "rolling_plane": _vectors([plane_axes(r) for r in rollings], 3),
        "rolling_point": _vectors([r.point for r in rollings]),
        "rolling_radii": _table([[r.radius, r.rounding] for r in rollings], 2),
        "skate_body": _indices([index[s.body] for s in skates]),
        "skate_arm": _vectors([_arm(mechanism, s.body, s.point) for s in skates]),
        "skate_lateral": _vectors([s.lateral for s in skates]),
    }


def _length(joints: tuple[Joint, ...], arrays: dict[str, Array]) -> float:
    arms = [float(np.linalg.norm(a)) for a in (*arrays["arm_i"], *arrays["arm_j"])]
    return max(*arms, *(j.length for j in joints)) or 1.0


def _counted(coordinate: Array, elements: dict[str, Array]) -> Array:
    """Mark the angles whose value is read; actuators and friction read rates alone."""
    springs = elements["joint_spring"][elements["joint_spring_law"][:, 0] != 0.0]
    readers = springs[:, :1], elements["control"][:, :1], elements["drive"][:, :1], elements["coupling"][:, :2]
    read = np.concatenate([coordinates.ravel() for coordinates in readers])
    return np.isin(np.arange(len(coordinate)), read) & (coordinate[:, 1] == ANGLE)


def flatten(mechanism: Mechanism) -> Model:
    """Convert a mechanism to arrays."""
    number = _Numbers(mechanism)
    joints = _joint_arrays(mechanism)
    elements = {**_force_arrays(mechanism, number), **_constraint_arrays(mechanism, number)}
    inertia = np.array([b.inertia for b in mechanism.bodies])
    coordinate = _indices([list(key) for key in number.coordinates], 2)
    return record_of(
        Model(
            gravity=np.array(mechanism.gravity),
            mass=np.array([b.mass for b in mechanism.bodies]),
            inertia=inertia,
            inertia_factor=np.linalg.cholesky(inertia),
            length=_length(mechanism.joints, joints),
            coordinate=coordinate,
            counted=_counted(coordinate, elements),
            functions=flatten_functions(number.functions),
            **joints,
            **elements,
        )
    )


def pack(mechanism: Mechanism, state: State) -> Array:
    """Pack a canonical state into y, shape (n_b + n_e, 13); integrals of controllers are zero."""
    A = state.R_WB
    c = np.einsum("bij,bj->bi", A, np.array([b.com for b in mechanism.bodies]))
    w = state.w_WB_W
    w_body = np.einsum("bji,bj->bi", A, w)
    bodies = np.hstack([state.p_WB + c, state.quat_WB, state.v_WB_W + np.cross(w, c), w_body])
    return np.vstack([bodies, np.zeros((-(-len(mechanism.controls) // 13), 13))])


def unpack(mechanism: Mechanism, y: Array) -> tuple[Array, Array, Array, Array]:
    """Unpack states y, shape (..., n_b + n_e, 13), into p_WB, quat_WB, v_WB_W, w_WB_W."""
    y = y[..., : len(mechanism.bodies), :]
    A = rotation_from_quaternion(y[..., P])
    c = np.einsum("...bij,bj->...bi", A, np.array([b.com for b in mechanism.bodies]))
    w = np.einsum("...bij,...bj->...bi", A, y[..., W])
    return y[..., R] - c, y[..., P].copy(), y[..., V] - np.cross(w, c), w


class Workspace(NamedTuple):
    """Work arrays for n_b bodies and q constraint rows; `external` alone is input."""

    A: Array  # (n_b, 3, 3) rotation matrices
    f: Array  # (6 n_b,) generalised forces
    external: Array  # (6 n_b,) forces of the caller, added to f
    value: Array  # (q,) violation g; overwritten by solutions
    rate: Array  # (q,) nu of Q v = nu
    Q: Array  # (q, 6 n_b)
    gamma: Array  # (q,)
    B: Array  # (6 n_b, q) L^-1 Q^T and its factors
    tau: Array  # (min(6 n_b, q),)
    pivot: Array  # (q,)
    limit: Array  # (1,) upper limit of the rank: the rank of the last projection, or q
    best: Array  # (2,) largest rank of any projection, and the largest value of its smallest pivot
    norms: Array  # (q,)
    z: Array  # (6 n_b,)


def workspace(model: Model) -> Workspace:
    """Allocate the work arrays of a model."""
    n, q = 6 * len(model.mass), all_rows(model)
    return record_of(
        Workspace(
            A=np.zeros((len(model.mass), 3, 3)),
            f=np.zeros(n),
            external=np.zeros(n),
            value=np.zeros(q),
            rate=np.zeros(q),
            Q=np.zeros((q, n)),
            gamma=np.zeros(q),
            B=np.zeros((n, q)),
            tau=np.zeros(min(n, q)),
            pivot=np.zeros(q, dtype=np.int64),
            limit=np.array([q], dtype=np.int64),
            best=np.zeros(2),
            norms=np.zeros(q),
            z=np.zeros(n),
        )
    )
