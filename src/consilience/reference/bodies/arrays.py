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
    Function,
    Joint,
    Mechanism,
    State,
    crosses,
    plane_axes,
    rotation_from_quaternion,
)
from consilience.reference.bodies import records
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
    coordinate: Array  # (n_c,) of COORDINATE
    counted: Array  # (n_c,) true for an angle whose full turns are counted
    functions: Functions
    spring: Array  # the rest are records of `bodies.records`: (n,) of SPRING
    joint_spring: Array
    friction: Array
    control: Array
    load: Array
    drive: Array
    coupling: Array
    rolling: Array
    skate: Array


def holonomic_rows(model: Model) -> int:
    """Count the rows at position level."""
    return len(model.row_kind) + len(model.drive) + len(model.coupling) + len(model.rolling)


def all_rows(model: Model) -> int:
    """Count all rows, the non-holonomic ones included."""
    return holonomic_rows(model) + 2 * len(model.rolling) + len(model.skate)


def _vectors(rows: list[Array], *shape: int) -> Array:
    """Return vectors as an array of shape (n, *shape, 3)."""
    return np.array(rows, dtype=float).reshape(-1, *shape, 3)


def _indices(rows: list[int]) -> Array:
    return np.array(rows, dtype=np.int64)


class _Numbers:
    """Indices of the joint coordinates and functions that elements refer to."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.joints = mechanism.joint_index
        self.coordinates: dict[tuple[int, int], int] = {}
        self.functions: list[Function] = []

    def coordinate(self, joint: str, name: str) -> int:
        key = (self.joints[joint], _COORDINATES[name])
        return self.coordinates.setdefault(key, len(self.coordinates))

    def of(self, element: Any) -> int:
        """Return the index of the joint coordinate of an element."""
        return self.coordinate(element.joint, element.coordinate)

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
    index, of, function = mechanism.body_index, number.of, number.function
    springs = [
        (
            *(index[s.predecessor], index[s.successor]),
            *(_arm(mechanism, s.predecessor, s.point_predecessor), _arm(mechanism, s.successor, s.point_successor)),
            *(s.stiffness, s.damping, s.free_length, function(s.actuator)),
        )
        for s in mechanism.springs
    ]
    joint_springs = [
        (of(s), function(s.actuator), s.stiffness, s.damping, s.rest, s.higher) for s in mechanism.joint_springs
    ]
    frictions = [(of(f), f.viscous, f.coulomb, f.speed) for f in mechanism.frictions]
    controls = [(of(c), function(c.target), c.proportional, c.integral, c.derivative) for c in mechanism.controls]
    loads = [
        (
            *(index[a.body], a.kind == "torque", a.frame == "body"),
            *(a.vector, _arm(mechanism, a.body, a.point), function(a.history)),
        )
        for a in mechanism.loads
    ]
    return {
        "spring": np.array(springs, records.SPRING),
        "joint_spring": np.array(joint_springs, records.JOINT_SPRING),
        "friction": np.array(frictions, records.FRICTION),
        "control": np.array(controls, records.CONTROL),
        "load": np.array(loads, records.LOAD),
    }


def _constraint_arrays(mechanism: Mechanism, number: _Numbers) -> dict[str, Array]:
    index, of, function = mechanism.body_index, number.of, number.function
    couplings = [
        (of(c), number.coordinate(c.driver_joint, c.driver_coordinate), function(c.law)) for c in mechanism.couplings
    ]
    rollings = [
        (*(index[r.body], _arm(mechanism, r.body, r.center), r.axis), *(plane_axes(r), r.point, r.radius, r.rounding))
        for r in mechanism.rollings
    ]
    skates = [(index[s.body], _arm(mechanism, s.body, s.point), s.lateral) for s in mechanism.skates]
    return {
        "drive": np.array([(of(d), function(d.motion)) for d in mechanism.drives], records.DRIVE),
        "coupling": np.array(couplings, records.COUPLING),
        "rolling": np.array(rollings, records.ROLLING),
        "skate": np.array(skates, records.SKATE),
    }


_SHORTEST_ARM = 1e-14  # m; what is shorter is rounding


def _length(joints: tuple[Joint, ...], arrays: dict[str, Array]) -> float:
    arms = [float(np.linalg.norm(a)) for a in (*arrays["arm_i"], *arrays["arm_j"])]
    longest = max(*arms, *(j.length for j in joints))
    return longest if longest > _SHORTEST_ARM else 1.0


def _counted(coordinate: Array, elements: dict[str, Array]) -> Array:
    """Mark the angles whose value is read; actuators and friction read rates alone."""
    springs, couplings = elements["joint_spring"], elements["coupling"]
    stiff = (springs["stiffness"] != 0.0) | np.any(springs["higher"][:, :2] != 0.0, axis=1)
    readers = springs[stiff], elements["control"], elements["drive"], couplings
    read = np.concatenate([*(reader["coordinate"] for reader in readers), couplings["driver"]])
    return np.isin(np.arange(len(coordinate)), read) & (coordinate["kind"] == ANGLE)


def flatten(mechanism: Mechanism) -> Model:
    """Convert a mechanism to arrays, as a record."""
    return record_of(model_arrays(mechanism))


def model_arrays(mechanism: Mechanism) -> Model:
    """Convert a mechanism to arrays."""
    number = _Numbers(mechanism)
    joints = _joint_arrays(mechanism)
    elements = {**_force_arrays(mechanism, number), **_constraint_arrays(mechanism, number)}
    inertia = np.array([b.inertia for b in mechanism.bodies])
    coordinate = np.array(list(number.coordinates), records.COORDINATE)
    return Model(
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


def pack(mechanism: Mechanism, state: State) -> Array:
    """Pack a canonical state into y, shape (n_b + n_e, 13); integrals of controllers are zero."""
    A = state.R_WB
    c = np.einsum("bij,bj->bi", A, np.array([b.com for b in mechanism.bodies]))
    w = state.w_WB_W
    w_body = np.einsum("bji,bj->bi", A, w)
    bodies = np.hstack([state.p_WB + c, state.quat_WB, state.v_WB_W + crosses(w, c), w_body])
    return np.vstack([bodies, np.zeros((-(-len(mechanism.controls) // 13), 13))])


def unpack(mechanism: Mechanism, y: Array) -> tuple[Array, Array, Array, Array]:
    """Unpack states y, shape (..., n_b + n_e, 13), into p_WB, quat_WB, v_WB_W, w_WB_W."""
    y = y[..., : len(mechanism.bodies), :]
    A = rotation_from_quaternion(y[..., P])
    c = np.einsum("...bij,bj->...bi", A, np.array([b.com for b in mechanism.bodies]))
    w = np.einsum("...bij,...bj->...bi", A, y[..., W])
    return y[..., R] - c, y[..., P].copy(), y[..., V] - crosses(w, c), w


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
    best: Array  # (1,) of LARGEST
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
            best=np.zeros(1, records.LARGEST),
            norms=np.zeros(q),
            z=np.zeros(n),
        )
    )
