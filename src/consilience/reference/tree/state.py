"""State z of a canonical state, compiled: in Python the conversion would take longer than a short motion.

Joint coordinates are those of M relative to F [docs/formulations.md, `relative`]: displacements ``F^T (r_M - r_F)``,
angles from the columns of ``F^T M``, Euler parameters by Shepperd's method; speeds from the relative motion in F.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array, State
from consilience.reference.bodies.arrays import Model, P, R, V, W
from consilience.reference.bodies.joint_rows import frame_motion
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.residual import compare_rows, other_rows, set_slowest
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of, record_array
from consilience.reference.kernel.vectors import add, cross, dot, load, rotate, rotate_back, store
from consilience.reference.tree.arrays import TreeLinks
from consilience.reference.tree.kinematics import euler_parameters


class StatePacking(NamedTuple):
    """Arrays from which `pack_state` reads the joints."""

    links: TreeLinks
    spanning: TreeModel
    model: Model
    others: Array | None  # see `bodies.residual.CheckedRows`


def state_packing(links: TreeLinks, spanning: TreeModel, model: Model) -> StatePacking:
    """Return the record array for `pack_state`."""
    packing: StatePacking = record_array(StatePacking(links, spanning, model, other_rows(model)))
    return packing


def pack_relative(links: TreeLinks, spanning: TreeModel, model: Model, state: State) -> Array:
    """Return the state z of a canonical state; integrals of controllers are zero."""
    return pack_state(links, state_packing(links, spanning, model), state)


def pack_state(links: TreeLinks, packing: StatePacking, state: State) -> Array:
    """Return the state z of a canonical state, with a record of `StatePacking` that serves many states."""
    return pack_compared(links, packing, state, np.zeros(1), np.zeros(links.residuals))


def pack_compared(links: TreeLinks, packing: StatePacking, state: State, times: Array, found: Array) -> Array:
    """Return the state z of a canonical state, whose residuals are compared with their sizes.

    Parameters
    ----------
    links : TreeLinks
    packing : StatePacking
    state : State
    times : ndarray, shape (n_t,), s
        The first is that of the state.
    found : ndarray, shape (TURNS + 2 couplings,)
        Overwritten by the largest residual: see `bodies.residual`.
    """
    count = len(links.com)
    z, y, A = np.zeros(len(links.kind)), np.empty((count, 13)), np.empty((count, 3, 3))
    y[:, R], y[:, P], y[:, V], y[:, W] = state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W
    _pack(packing, y, A, z, times, found)
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


@kernel
def _pack(packing: StatePacking, y: Array, A: Array, z: Array, times: Array, found: Array) -> None:
    """Fill z from y, whose canonical rows become rows of the kernels, and compare its residuals."""
    by = fields_of(packing)
    links, spanning, model = by.links, by.spanning, by.model
    layout, direction, first_speed = links.layout, links.direction, links.first_speed
    _to_centres(links.com, y, A)
    set_slowest(model, times, found)
    compare_rows(model, by.others, times[0], 0.0, y, A, found)
    for k in range(layout.shape[0]):
        p, X, v, w = frame_motion(model, y, A, spanning.joint[k])
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
