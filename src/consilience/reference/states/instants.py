"""Accelerations, reactions and energies at states of a known mechanism, compiled: the descriptor form as one kernel.

The equations are those of `formulations.descriptor`: Newton-Euler for every body with all constraint rows,
accelerations by a rank-revealing QR of ``B = L^-1 Q^T``, multipliers of least norm with ``Q^T lam = M a - f``. A state
where anything is in doubt is left to that formulation, which words the refusal: accelerations that are not finite or
violate rows, a least pivot near the limit of the rank.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from consilience.engine import InstantAnswer
from consilience.mechanism import Array, Mechanism, State, characteristic_length
from consilience.reference.bodies.arrays import Model, Workspace, flatten, workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.joint_rows import coordinate, joint_motion
from consilience.reference.bodies.mass_metric import solve_factor
from consilience.reference.bodies.motion import arm, rotations
from consilience.reference.bodies.residual import SOLVABLE, row_size
from consilience.reference.formulations.descriptor import accelerations
from consilience.reference.kernel.compiled import inner, threaded
from consilience.reference.kernel.least_squares import LeastSquares, least_squares, solve_factored
from consilience.reference.kernel.mechanism_record import fields_of, record_array
from consilience.reference.kernel.vectors import add, column, cross, dot, load, rotate, rotate_back, scale, store, sub

_CLEAR_RANK = 1e-5
"""Least pivot over the first one above which the rank is beyond doubt."""

_STRICTER = 0.1
"""Part of the allowed residual that the compiled form passes itself."""


class InstantArrays(NamedTuple):
    """Arrays for accelerations of n_b bodies with q rows."""

    model: Model
    ws: Workspace
    com: Array  # (n_b, 3) centres of mass, m
    gravity_rate: float  # gravity over the characteristic length, 1/s^2
    length: float  # characteristic length, m
    turns: Array  # (n_c,)
    y: Array  # (n_b + n_e, 13)
    a: Array  # (6 n_b,)
    residual: Array  # (6 n_b,) M a - f, whitened
    lam: Array  # (q,) multipliers
    by: LeastSquares


class InstantValues(NamedTuple):
    """What n_s states have, and their answers."""

    p: Array  # (n_s, n_b, 3)
    quat: Array  # (n_s, n_b, 4)
    v: Array  # (n_s, n_b, 3)
    w: Array  # (n_s, n_b, 3)
    a: Array  # (n_s, n_b, 3)
    alpha: Array  # (n_s, n_b, 3)
    force: Array  # (n_s, n_j, 3)
    torque: Array  # (n_s, n_j, 3)
    energy: Array  # (n_s, 2) kinetic, potential
    sound: Array  # (n_s,) 1 where nothing is in doubt


@inner
def _pack(by: InstantArrays, values: InstantValues, n: int) -> None:
    """Place the bodies at state n, and count turns from zero."""
    y, A = by.y, by.ws.A
    for b in range(by.com.shape[0]):
        for k in range(4):
            y[b, 3 + k] = values.quat[n, b, k]
    rotations(y, A)
    for b in range(by.com.shape[0]):
        c, w = rotate(A[b], load(by.com[b])), load(values.w[n, b])
        store(y[b, 0:3], add(load(values.p[n, b]), c), 1.0)
        store(y[b, 7:10], add(load(values.v[n, b]), cross(w, c)), 1.0)
        store(y[b, 10:13], rotate_back(A[b], w), 1.0)
    by.turns[:] = 0.0
    count_turns(by.model, y, by.ws, by.turns)


@inner
def _at_origins(by: InstantArrays, values: InstantValues, n: int) -> float:
    """Write the accelerations of the origins; return the largest rate of all, 1/s^2."""
    largest = by.gravity_rate
    for b in range(by.com.shape[0]):
        A = by.ws.A[b]
        alpha, w, c = rotate(A, load(by.a[6 * b + 3 : 6 * b + 6])), load(values.w[n, b]), rotate(A, load(by.com[b]))
        a = sub(load(by.a[6 * b : 6 * b + 3]), add(cross(alpha, c), cross(w, cross(w, c))))
        store(values.a[n, b], a, 1.0)
        store(values.alpha[n, b], alpha, 1.0)
        largest = max(largest, dot(w, w))
        for k in range(3):
            largest = max(largest, abs(a[k]) / by.length, abs(alpha[k]))
    return largest


@inner
def _solved(by: InstantArrays, largest: float) -> bool:
    """Whether the accelerations are finite and satisfy all rows."""
    total = 0.0
    for c in range(by.a.shape[0]):
        total += by.a[c]
    if not np.isfinite(total):
        return False
    for row in range(by.ws.Q.shape[0]):
        left = by.ws.gamma[row]
        for c in range(by.a.shape[0]):
            left -= by.ws.Q[row, c] * by.a[c]
        if not abs(left) <= _STRICTER * SOLVABLE * largest * row_size(by.model, row):
            return False
    return True


@inner
def _multipliers(by: InstantArrays, rank: int) -> bool:
    """Compute the multipliers of least norm; return whether their rank is beyond doubt."""
    model, ws, r = by.model, by.ws, by.residual
    for b in range(model.mass.shape[0]):
        o = 6 * b
        for k in range(3):
            r[o + k] = model.mass[b] * by.a[o + k] - ws.f[o + k]
            r[o + 3 + k] = -ws.f[o + 3 + k]
            for j in range(3):
                r[o + 3 + k] += model.inertia[b, k, j] * by.a[o + 3 + j]
    solve_factor(model, r)
    if rank == 0:
        by.lam[:] = 0.0
        return by.lam.shape[0] == 0
    solve_factored(ws.B, ws.tau, ws.pivot, rank, r, by.by, by.lam)
    return abs(ws.B[rank - 1, rank - 1]) > _CLEAR_RANK * abs(ws.B[0, 0])


@inner
def _reactions(by: InstantArrays, values: InstantValues, n: int) -> None:
    """Write force and torque of each joint on its successor, at the origin of M, axes of F."""
    model, A, zero = by.model, by.ws.A, (0.0, 0.0, 0.0)
    for k in range(model.body_i.shape[0]):
        i, j = model.body_i[k], model.body_j[k]
        m = joint_motion(model, by.y, A, k)
        # on the body whose columns exist, about its centre of mass; M from there
        b, sign = (j, 1.0) if j >= 0 else (i, -1.0)
        s = m.s_j if j >= 0 else add(m.s_i, m.d)
        force, torque = zero, zero
        for row in range(model.first_row[k], model.first_row[k + 1]):
            Q = by.ws.Q[row, 6 * b : 6 * b + 6]
            force = add(force, scale(sign * by.lam[row], load(Q)))
            torque = add(torque, scale(sign * by.lam[row], rotate(A[b], load(Q[3:]))))
        torque = sub(torque, cross(s, force))
        for axis in range(3):
            u = arm(A, i, column(model.axes_i[k], axis))
            values.force[n, k, axis], values.torque[n, k, axis] = dot(u, force), dot(u, torque)


@inner
def _energies(by: InstantArrays, values: InstantValues, n: int) -> None:
    """Write kinetic and potential energy, of gravity and springs, J."""
    model, y, A = by.model, by.y, by.ws.A
    kinetic = potential = 0.0
    for b in range(model.mass.shape[0]):
        r, v, w = load(y[b, 0:3]), load(y[b, 7:10]), load(y[b, 10:13])
        kinetic += 0.5 * (model.mass[b] * dot(v, v) + dot(w, rotate(model.inertia[b], w)))
        potential -= model.mass[b] * dot(load(model.gravity), r)
    for k in range(model.spring.shape[0]):
        spring = model.spring[k]
        end_i, end_j = arm(A, spring.i, load(spring.arm_i)), arm(A, spring.j, load(spring.arm_j))
        r_i = add(load(y[spring.i, 0:3]), end_i) if spring.i >= 0 else end_i
        r_j = add(load(y[spring.j, 0:3]), end_j) if spring.j >= 0 else end_j
        d = sub(r_j, r_i)
        potential += 0.5 * spring.stiffness * (np.sqrt(dot(d, d)) - spring.rest) ** 2
    for k in range(model.joint_spring.shape[0]):
        spring = model.joint_spring[k]
        x = coordinate(model, y, A, spring.coordinate, 0.0).value - spring.rest
        potential += (0.5 * spring.stiffness + (spring.higher[0] / 3.0 + 0.25 * spring.higher[1] * x) * x) * x**2
    values.energy[n, 0], values.energy[n, 1] = kinetic, potential


@threaded
def _instants(by_array: InstantArrays, values_array: InstantValues, t: float) -> None:
    """Compute the answers at all states at the time t; both records are given as arrays."""
    by, values = fields_of(by_array), fields_of(values_array)
    for n in range(values.sound.shape[0]):
        values.sound[n] = 0
        _pack(by, values, n)
        by.ws.limit[0], by.ws.best[0].rank = by.ws.Q.shape[0], 0
        rank = accelerations(by.model, t, by.y, by.turns, by.ws, by.a)
        if not _solved(by, _at_origins(by, values, n)) or not _multipliers(by, rank):
            continue
        _reactions(by, values, n)
        _energies(by, values, n)
        values.sound[n] = 1


@lru_cache(maxsize=8)
def _idle(mechanism: Mechanism) -> list[InstantArrays]:
    """Return the arrays of a mechanism that no thread uses, as record arrays; the last mechanisms are kept."""
    return []


def _arrays(mechanism: Mechanism) -> InstantArrays:
    model, n, length = flatten(mechanism), len(mechanism.bodies), characteristic_length(mechanism)
    ws = workspace(model)
    q = len(ws.Q)
    return record_array(
        InstantArrays(
            model=model,
            ws=ws,
            com=np.array([body.com for body in mechanism.bodies]),
            gravity_rate=float(np.linalg.norm(mechanism.gravity)) / length,
            length=length,
            turns=np.zeros(len(model.coordinate)),
            y=np.zeros((n + -(-len(mechanism.controls) // 13), 13)),
            a=np.zeros(6 * n),
            residual=np.zeros(6 * n),
            lam=np.zeros(q),
            by=least_squares(6 * n, q),
        )
    )


def instants(mechanism: Mechanism, states: list[State], t: float) -> tuple[InstantAnswer, Array]:
    """Return accelerations, reactions and energies at states, and for each whether nothing is in doubt.

    Parameters
    ----------
    mechanism : Mechanism
    states : list of State
        Consistent states of this mechanism.
    t : float, s
    """
    idle, n_s, n_b, n_j = _idle(mechanism), len(states), len(mechanism.bodies), len(mechanism.joints)
    try:  # another thread may take the last ones
        by = idle.pop()
    except IndexError:
        by = _arrays(mechanism)
    p, quat, v, w = (np.array([getattr(s, name) for s in states]) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"))
    a, alpha, force, torque = (np.zeros((n_s, n, 3)) for n in (n_b, n_b, n_j, n_j))
    energy, sound = np.zeros((n_s, 2)), np.zeros(n_s, dtype=np.int64)
    _instants(by, record_array(InstantValues(p, quat, v, w, a, alpha, force, torque, energy, sound)), t)
    idle.append(by)
    return InstantAnswer(a, alpha, force, torque, energy[:, 0], energy[:, 1]), sound.astype(bool)
