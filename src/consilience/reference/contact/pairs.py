"""Kinematics of pairs of shapes, compiled: gap, frame, relative velocity, its rows and its bias acceleration.

With the arms ``r`` from the centres of mass of both bodies to one contact point, on the shape of `body` even where
shapes are apart or overlap, so that a force and its reaction have one line of action,

    u = v + w x r - v_p - w_p x r_p,     g' = n . u,     u' = J a + gamma,     gamma = w x r' - w_p x r_p',
    g'' = n . u' + n' . u,     (t . u)' = t . u' + t' . u.

The arms of a pair do not turn with their bodies, and so each pair gives its own r':

==================  ==========================================  =======================================
pair                gap, normal                                 arm of the body
==================  ==========================================  =======================================
sphere on plane     ``n . (c - p) - rho``, n of the plane       ``s - rho n``
sphere on sphere    ``|d| - rho - rho_p``, ``n = d / |d|``      ``s - rho n``
disc on plane       height of the lowest point of the rim       ``s - rho m / |m|``, m the part of n
                                                                across the axis
==================  ==========================================  =======================================

The normal points from `partner` to `body`. A point is a sphere of radius zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array, Mechanism, SphereSphere
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.joint_rows import coordinate, place
from consilience.reference.bodies.motion import ZERO, add_coefficients, arm, motion
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.record_type import INT, record_type
from consilience.reference.kernel.vectors import Vector, add, cross, dot, load, rotate_back, scale, store, sub

PLANE, SPHERE, DISC = 0, 1, 2

PAIR = record_type(
    ("kind", INT),
    ("body", INT),
    ("partner", INT),
    ("arm", float, 3),  # centre of the sphere, corner or disc, from the centre of mass
    ("partner_arm", float, 3),  # point of the plane, or centre of the sphere
    ("normal", float, 3),  # of the plane, axes of the partner
    ("tangent", float, 3),  # its projection onto the plane is t1, axes of the partner
    ("axis", float, 3),  # of the disc, axes of the body
    ("radius", float),
    ("partner_radius", float),
    ("turning", INT),  # first of its three rows of relative rotation; -1: none
    ("carried", INT),  # 1: no law reads the tangent, see `carry_tangents`
)
"""Pair of shapes; vectors in axes of their bodies."""

LIMIT = record_type(("coordinate", INT), ("sign", float), ("target", float))
"""Row of a joint coordinate, ``sign (q - target)``: a side of a stop, or a dry friction."""


class RowMotion(NamedTuple):
    """Motion of n pairs of shapes and of the m rows of contacts, stops and dry friction.

    Rows of pair k are n, t1, t2 at 3 k; then those of relative rotation about n, t1, t2 where a pair has them; then
    joint coordinates.
    """

    gap: Array  # (n + n_l,) of pairs, then of joint coordinates; m, rad
    frame: Array  # (n, 3, 3) rows n, t1, t2, world axes
    velocity: Array  # (n, 3) relative velocity of the contact points, world axes, m/s
    point: Array  # (n, 3) contact point on the body, world, m
    J: Array  # (m, 6 n_b) coefficients of the rates of the rows in the velocities
    u: Array  # (m,) rates of the rows
    bias: Array  # (m,) their derivatives without accelerations: u' = J a + bias, along normals g''


def row_motion(pairs: int, limits: int, rows: int, bodies: int) -> RowMotion:
    """Allocate the motion of rows."""
    return RowMotion(
        gap=np.zeros(pairs + limits),
        frame=np.zeros((pairs, 3, 3)),
        velocity=np.zeros((pairs, 3)),
        point=np.zeros((pairs, 3)),
        J=np.zeros((rows, 6 * bodies)),
        u=np.zeros(rows),
        bias=np.zeros(rows),
    )


def pairs_of(mechanism: Mechanism, contacts: tuple[Any, ...]) -> Array:
    """Return the records of elementary contacts, shape (n,) of PAIR."""
    index, found = mechanism.body_index, np.zeros(len(contacts), PAIR)
    turning = 3 * len(contacts)
    for pair, c in zip(found, contacts, strict=True):
        body, partner = index[c.body], index[c.partner]
        spheres = isinstance(c, SphereSphere)
        pair["kind"] = SPHERE if spheres else DISC if hasattr(c, "axis") else PLANE
        pair["body"], pair["partner"], pair["radius"] = body, partner, c.radius
        pair["arm"] = c.center - (mechanism.bodies[body].com if body >= 0 else 0.0)
        pair["partner_arm"] = (c.partner_center if spheres else c.point) - (
            mechanism.bodies[partner].com if partner >= 0 else 0.0
        )
        pair["partner_radius"] = c.partner_radius if spheres else 0.0
        pair["normal"] = (0.0, 0.0, 0.0) if spheres else c.normal
        pair["axis"] = getattr(c, "axis", (0.0, 0.0, 0.0))
        pair["tangent"], pair["turning"] = _tangent(c, spheres), -1
        pair["carried"] = spheres and c.cone.kind == "circle"
        if c.torsional > 0.0 or c.rolling > 0.0:
            pair["turning"] = turning
            turning += 3
    return found


def _tangent(contact: Any, spheres: bool) -> Array:
    """Return the vector whose projection is t1: that of the cone, or x, or y where the normal is along x."""
    cone = getattr(contact, "cone", None)
    if cone is not None and cone.tangent is not None:
        return np.asarray(cone.tangent, dtype=float)
    along_x = not spheres and abs(float(contact.normal[0])) > 1.0 - 1e-12
    return np.eye(3)[1 if along_x else 0]


@inner
def _directions(tangent: Vector, n: Vector) -> tuple[Vector, Vector]:
    """Return t1, the projection of a vector onto the plane, and ``t2 = n x t1``."""
    t = sub(tangent, scale(dot(tangent, n), n))
    size = np.sqrt(dot(t, t))
    if size < 1e-6:  # two spheres, their line of centres along the vector
        other = (tangent[1], tangent[2], tangent[0])
        t = sub(other, scale(dot(other, n), n))
        size = np.sqrt(dot(t, t))
    t1 = scale(1.0 / size, t)
    return t1, cross(n, t1)


@inner
def _turning(tangent: Vector, w_p: Vector, n: Vector, n_dot: Vector, t1: Vector) -> Vector:
    """Return the angular velocity of the frame n, t1, t2, whose tangent turns with the partner."""
    t2 = cross(n, t1)
    along = dot(tangent, t1)
    if along < 1e-6:  # t1 of another vector
        tangent = (tangent[1], tangent[2], tangent[0])
        along = dot(tangent, t1)
    about = (dot(cross(w_p, tangent), t2) - dot(tangent, n) * dot(n_dot, t2)) / along
    return add(cross(n, n_dot), scale(about, n))


@inner
def _lowest(pair: Any, s: Vector, a: Vector, w: Vector, n: Vector, n_dot: Vector) -> tuple[Vector, Vector]:
    """Return the arm from the centre of mass to the lowest point of a sphere or disc, and its rate.

    Parameters
    ----------
    pair : record of PAIR
    s, a : Vector, m and 1
        Centre of the shape from the centre of mass, and axis of the disc, world axes.
    w : Vector, rad/s
    n, n_dot : Vector
        Normal of the plane, and its rate.
    """
    s_dot = cross(w, s)
    if pair.kind == PLANE:
        return sub(s, scale(pair.radius, n)), sub(s_dot, scale(pair.radius, n_dot))
    a_dot = cross(w, a)
    along, along_dot = dot(n, a), dot(n_dot, a) + dot(n, a_dot)
    m = sub(n, scale(along, a))
    m_dot = sub(n_dot, add(scale(along_dot, a), scale(along, a_dot)))
    size = np.sqrt(dot(m, m))
    e = scale(1.0 / size, m)
    e_dot = scale(1.0 / size, sub(m_dot, scale(dot(e, m_dot), e)))
    return sub(s, scale(pair.radius, e)), sub(s_dot, scale(pair.radius, e_dot))


@inner
def _contact_point(pair: Any, y: Array, A: Array) -> tuple[float, Vector, Vector, Vector, Vector, Vector, Vector]:
    """Return gap, normal and its rate, and the arms of body and partner with their rates, world axes."""
    c, v, w = motion(y, A, pair.body)
    c_p, v_p, w_p = motion(y, A, pair.partner)
    s, s_p = arm(A, pair.body, load(pair.arm)), arm(A, pair.partner, load(pair.partner_arm))
    if pair.kind == SPHERE:
        d = sub(add(c, s), add(c_p, s_p))
        d_dot = sub(add(v, cross(w, s)), add(v_p, cross(w_p, s_p)))
        distance = np.sqrt(dot(d, d))
        n = scale(1.0 / distance, d)
        n_dot = scale(1.0 / distance, sub(d_dot, scale(dot(n, d_dot), n)))
        r, r_dot = sub(s, scale(pair.radius, n)), sub(cross(w, s), scale(pair.radius, n_dot))
        apart = distance - pair.radius  # of the partner's centre and the contact point
        r_p = add(s_p, scale(apart, n))
        r_p_dot = add(cross(w_p, s_p), add(scale(dot(n, d_dot), n), scale(apart, n_dot)))
        return distance - pair.radius - pair.partner_radius, n, n_dot, r, r_dot, r_p, r_p_dot
    n = arm(A, pair.partner, load(pair.normal))
    n_dot = cross(w_p, n)
    r, r_dot = _lowest(pair, s, arm(A, pair.body, load(pair.axis)), w, n, n_dot)
    above = sub(add(c, r), add(c_p, s_p))  # from the point of the plane to the lowest point of the shape
    above_dot = sub(add(v, r_dot), add(v_p, cross(w_p, s_p)))
    return dot(n, above), n, n_dot, r, r_dot, add(s_p, above), add(cross(w_p, s_p), above_dot)


@inner
def _move_pair(pair: Any, k: int, y: Array, A: Array, found: RowMotion) -> None:
    """Write gap, frame, velocity and rows of pair k; parameters as in `move_rows`."""
    b, p = pair.body, pair.partner
    c, v, w = motion(y, A, b)
    _, v_p, w_p = motion(y, A, p)
    gap, n, n_dot, r, r_dot, r_p, r_p_dot = _contact_point(pair, y, A)
    tangent = arm(A, p, load(pair.tangent))
    t1, t2 = _directions(tangent, n)
    turning = _turning(tangent, w_p, n, n_dot, t1)
    u = sub(add(v, cross(w, r)), add(v_p, cross(w_p, r_p)))
    gamma = sub(cross(w, r_dot), cross(w_p, r_p_dot))
    turn = sub(w, w_p)
    found.gap[k] = gap
    store(found.velocity[k], u, 1.0)
    store(found.point[k], add(c, r), 1.0)
    store(found.frame[k, 0], n, 1.0)
    store(found.frame[k, 1], t1, 1.0)
    store(found.frame[k, 2], t2, 1.0)
    for axis in range(3):
        e, row = load(found.frame[k, axis]), 3 * k + axis
        found.u[row], found.bias[row] = dot(e, u), dot(e, gamma) + dot(cross(turning, e), u)
        add_coefficients(found.J, row, A, b, 1.0, e, cross(r, e))
        add_coefficients(found.J, row, A, p, -1.0, e, cross(r_p, e))
        if pair.turning >= 0:
            row = pair.turning + axis
            found.u[row], found.bias[row] = dot(e, turn), dot(n_dot if axis == 0 else cross(w_p, e), turn)
            add_coefficients(found.J, row, A, b, 1.0, ZERO, e)
            add_coefficients(found.J, row, A, p, -1.0, ZERO, e)


@inner
def carry_tangents(pairs: Array, A: Array, found: RowMotion) -> None:
    """Let the tangents of spheres go on from t1 as it is: a fixed one of the partner may come along the normal.

    Parameters as in `move_rows`; `found` has been evaluated there.
    """
    for k in range(pairs.shape[0]):
        if pairs[k].carried:
            t1, p = load(found.frame[k, 1]), pairs[k].partner
            store(pairs[k].tangent, rotate_back(A[p], t1) if p >= 0 else t1, 1.0)


@kernel
def move_rows(model: Model, pairs: Array, limits: Array, y: Array, turns: Array, A: Array, found: RowMotion) -> None:
    """Evaluate all pairs, and the rows of contacts, stops and dry friction.

    Parameters
    ----------
    model : Model
    pairs : ndarray, shape (n,) of PAIR
    limits : ndarray, shape (n_l,) of LIMIT
        Of the last rows.
    y : ndarray, shape (n_b + n_e, 13)
    turns : ndarray, shape (n_c,)
        As in `constraints.evaluate`.
    A : ndarray, shape (n_b, 3, 3)
        Rotation matrices of y.
    found : RowMotion
        Overwritten.
    """
    found.J[:, :] = 0.0
    for k in range(pairs.shape[0]):
        _move_pair(pairs[k], k, y, A, found)
    first = found.J.shape[0] - limits.shape[0]
    for k in range(limits.shape[0]):
        number, sign = limits[k].coordinate, limits[k].sign
        q = coordinate(model, y, A, number, turns[number])
        found.gap[pairs.shape[0] + k] = sign * (q.value - limits[k].target)
        found.u[first + k], found.bias[first + k] = sign * q.rate, -sign * q.row.gamma
        place(found.J, first + k, A, q.i, q.j, sign, q.row)
