"""State z of a canonical state, compiled: in Python the conversion would take longer than a short motion.

Joint coordinates are those of M relative to F [docs/formulations.md, `relative`]: displacements ``F^T (r_M - r_F)``,
angles from the columns of ``F^T M``, Euler parameters by Shepperd's method; speeds from the relative motion in F.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array, State
from consilience.reference.bodies.arrays import Model, P, R, V, W
from consilience.reference.bodies.joint_rows import joint_motion
from consilience.reference.bodies.motion import arm, rotations
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of, record_array
from consilience.reference.kernel.vectors import Vector, add, column, cross, dot, load, rotate, rotate_back, store, sub
from consilience.reference.tree.arrays import TreeLinks
from consilience.reference.tree.inertia import Columns
from consilience.reference.tree.kinematics import euler_parameters


class StatePacking(NamedTuple):
    """Arrays from which `pack_state` reads the joints."""

    links: TreeLinks
    spanning: TreeModel
    model: Model


def pack_relative(links: TreeLinks, spanning: TreeModel, model: Model, state: State) -> Array:
    """Return the state z of a canonical state; integrals of controllers are zero."""
    return pack_state(links, record_array(StatePacking(links, spanning, model)), state)


def pack_state(links: TreeLinks, packing: StatePacking, state: State) -> Array:
    """Return the state z of a canonical state, with a record of `StatePacking` that serves many states."""
    z, y, A = np.zeros(len(links.kind)), np.empty((len(links.com), 13)), np.empty((len(links.com), 3, 3))
    y[:, R], y[:, P], y[:, V], y[:, W] = state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W
    _pack(packing, y, A, z)
    return z


@inner
def _to_centres(com: Array, y: Array, A: Array) -> None:
    """Convert canonical rows of bodies, in place, to rows of the kernels (centres of mass, body axes); fill A."""
    rotations(y, A)
    for b in range(com.shape[0]):
        c, w = rotate(A[b], load(com[b])), load(y[b, 10:13])
        store(y[b, 0:3], add(load(y[b, 0:3]), c), 1.0)
        store(y[b, 7:10], add(load(y[b, 7:10]), cross(w, c)), 1.0)
        store(y[b, 10:13], rotate_back(A[b], w), 1.0)


@inner
def _frame(axes: Array, A: Array, body: int) -> Columns:
    """Return the axes of a frame on a body, in the world."""
    return arm(A, body, column(axes, 0)), arm(A, body, column(axes, 1)), arm(A, body, column(axes, 2))


@inner
def _components(F: Columns, a: Vector) -> Vector:
    """Return the components of a world vector in axes of F."""
    return dot(F[0], a), dot(F[1], a), dot(F[2], a)


@kernel
def _pack(packing: StatePacking, y: Array, A: Array, z: Array) -> None:
    """Fill z from y, whose canonical rows become rows of the kernels."""
    by = fields_of(packing)
    links, spanning, model = by.links, by.spanning, by.model
    layout, direction, first_speed = links.layout, links.direction, links.first_speed
    _to_centres(links.com, y, A)
    for k in range(layout.shape[0]):
        n = spanning.joint[k]
        m = joint_motion(model, y, A, n)
        F, M = _frame(model.axes_i[n], A, m.i), _frame(model.axes_j[n], A, m.j)
        X = _components(F, M[0]), _components(F, M[1]), _components(F, M[2])
        p, v = _components(F, m.d), _components(F, sub(m.d_dot, cross(m.w_i, m.d)))
        w = _components(F, sub(m.w_j, m.w_i))
        at, free, about = layout[k].coordinate, layout[k].free, layout[k].rotations
        for r in range(layout[k].translations):
            axis = direction[free + r, 1]
            z[at + r], z[first_speed + free + r] = p[axis], v[axis]
        at, free = at + layout[k].translations, first_speed + free + layout[k].translations
        if about == 3:
            e = euler_parameters(X)
            z[at], z[at + 1], z[at + 2], z[at + 3] = e
            z[free], z[free + 1], z[free + 2] = w
        elif about:
            z[at], z[free] = np.arctan2(X[0][1], X[0][0]), w[2]
        if about == 2:
            z[at + 1], z[free + 1] = np.arctan2(X[1][2], X[2][2]), dot(X[0], w)
