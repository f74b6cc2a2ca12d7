"""Constraint rows of a mechanism at a state y, compiled: violation g, Jacobian Q, gamma and nu.

    g(x, t) = 0,    Q v = nu,    Q a = gamma                                        [MASS (13)-(29), C4 (4.85)-(4.89)]

Order: joints, drives, couplings, contacts of rolling bodies; then the non-holonomic rows, which have no g: slip of
rolling bodies, skates. The columns of a body belong to its velocity v (centre of mass, world axes) and its angular
velocity w' (**body** axes): with these velocities the mass matrix ``diag(m 1, I')`` is constant.

`consilience.mechanism` has the same rows about body origins in NumPy. Neither is derived from the other: the two check
each other.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.joint_rows import Row, coordinate, joint_motion, joint_row, place
from consilience.reference.bodies.motion import add_coefficients, arm, motion
from consilience.reference.kernel import functions
from consilience.reference.kernel.compiled import inlined, kernel
from consilience.reference.kernel.vectors import Vector, add, cross, dot, load, scale, sub


@inlined
def _joints(model: Model, y: Array, ws: Workspace) -> int:
    """Write the rows of all joints; return the index of the next row."""
    A, Q = ws.A, ws.Q
    for k in range(model.body_i.shape[0]):
        if model.first_row[k] == model.first_row[k + 1]:
            continue
        m = joint_motion(model, y, A, k)
        for n in range(model.first_row[k], model.first_row[k + 1]):
            row: Row = joint_row(model, A, m, k, model.row_kind[n])
            ws.value[n] = row.value - model.row_target[n]
            ws.gamma[n] = row.gamma
            place(Q, n, A, m.i, m.j, 1.0, row)
    return model.row_kind.shape[0]


@inlined
def _drives(model: Model, t: float, y: Array, ws: Workspace, first: int) -> int:
    """Write the rows of drives, ``q - f(t) = 0``.

    Parameters
    ----------
    model, t, y, ws
        As in `evaluate`.
    first : int
        Index of the first row.
    """
    for n in range(model.drive.shape[0]):
        f, f_dot, f_ddot = functions.evaluate(model.functions, model.drive[n].motion, t)
        q = coordinate(model, y, ws.A, model.drive[n].coordinate, f)
        ws.value[first + n] = q.value - f
        ws.rate[first + n] = f_dot
        ws.gamma[first + n] = q.row.gamma + f_ddot
        place(ws.Q, first + n, ws.A, q.i, q.j, 1.0, q.row)
    return first + model.drive.shape[0]


@inlined
def _couplings(model: Model, y: Array, turns: Array, ws: Workspace, first: int) -> int:
    """Write the rows of couplings, ``q - f(q_driver) = 0``.

    Parameters
    ----------
    model, y, turns, ws
        As in `evaluate`.
    first : int
        Index of the first row.
    """
    for n in range(model.coupling.shape[0]):
        coupling = model.coupling[n]
        driver = coordinate(model, y, ws.A, coupling.driver, turns[coupling.driver])
        f, slope, bend = functions.evaluate(model.functions, coupling.law, driver.value)
        q = coordinate(model, y, ws.A, coupling.coordinate, f)
        ws.value[first + n] = q.value - f
        ws.gamma[first + n] = q.row.gamma - slope * driver.row.gamma + bend * driver.rate**2
        place(ws.Q, first + n, ws.A, q.i, q.j, 1.0, q.row)
        place(ws.Q, first + n, ws.A, driver.i, driver.j, -slope, driver.row)
    return first + model.coupling.shape[0]


@inlined
def rolling_contact(model: Model, y: Array, A: Array, k: int) -> tuple[float, Vector, Vector]:
    """Return height, arm and bias acceleration of the contact point of rolling body k, world axes.

    With the body's axis a, the plane's normal n, the circle of radius R about a, rounded by r [EXU]:

        m = n - (n . a) a,    mu = |m| (1 of a ball),    rho = -R m / mu - r n,
        height = n . (p + s - point) - R mu - r,    arm = s + rho,    bias = w x (w x s) + w x rho'.
    """
    rolling = model.rolling[k]
    b, R, r = rolling.body, rolling.radius, rolling.rounding
    p, _, w = motion(y, A, b)
    s, a = arm(A, b, load(rolling.arm)), arm(A, b, load(rolling.axis))
    n = load(rolling.plane[0])
    a_dot = cross(w, a)
    m = sub(n, scale(dot(n, a), a))
    m_dot = scale(-1.0, add(scale(dot(n, a_dot), a), scale(dot(n, a), a_dot)))
    mu = np.sqrt(dot(m, m)) if R > 0.0 else 1.0
    mu_dot = dot(m, m_dot) / mu
    rho = sub(scale(-R / mu, m), scale(r, n))
    rho_dot = scale(-R / mu, sub(m_dot, scale(mu_dot / mu, m)))
    height = dot(n, sub(add(p, s), load(rolling.point))) - R * mu - r
    return height, add(s, rho), add(cross(w, cross(w, s)), cross(w, rho_dot))


@inlined
def _rollings(model: Model, y: Array, ws: Workspace, first: int) -> int:
    """Write the contact rows, then two slip rows, of all rolling bodies: n and two directions in the plane."""
    count = model.rolling.shape[0]
    for k in range(count):
        height, s, bias = rolling_contact(model, y, ws.A, k)
        for axis in range(3):
            row = first + k if axis == 0 else first + count + 2 * k + axis - 1
            direction = load(model.rolling[k].plane[axis])
            ws.value[row] = height if axis == 0 else 0.0
            ws.gamma[row] = -dot(direction, bias)
            add_coefficients(ws.Q, row, ws.A, model.rolling[k].body, 1.0, direction, cross(s, direction))
    return first + 3 * count


@inlined
def _skates(model: Model, y: Array, ws: Workspace, first: int) -> None:
    """Write the rows of skates, ``l . (v + w x s) = 0``."""
    for n in range(model.skate.shape[0]):
        skate = model.skate[n]
        b = skate.body
        _, v, w = motion(y, ws.A, b)
        s, lateral = arm(ws.A, b, load(skate.arm)), arm(ws.A, b, load(skate.lateral))
        ws.value[first + n] = 0.0
        sideways = dot(cross(w, lateral), add(v, cross(w, s)))
        ws.gamma[first + n] = -(sideways + dot(lateral, cross(w, cross(w, s))))
        add_coefficients(ws.Q, first + n, ws.A, b, 1.0, lateral, cross(s, lateral))


@kernel
def evaluate(model: Model, t: float, y: Array, turns: Array, ws: Workspace) -> None:
    """Evaluate all constraint rows: g into ``ws.value``, Q, gamma, and nu into ``ws.rate``.

    Parameters
    ----------
    model : Model
    t : float, s
    y : ndarray, shape (n_b + n_e, 13)
        Packed state.
    turns : ndarray, shape (n_c,)
        Joint coordinates that elements read, at an earlier time (m, rad): full turns are counted from them.
    ws : Workspace
        ``ws.A`` holds the rotation matrices of y (`motion.rotations`).
    """
    ws.Q[:, :] = 0.0
    ws.rate[:] = 0.0
    row = _joints(model, y, ws)
    if row < ws.rate.shape[0]:
        row = _drives(model, t, y, ws, row)
        row = _couplings(model, y, turns, ws, row)
        row = _rollings(model, y, ws, row)
        _skates(model, y, ws, row)
