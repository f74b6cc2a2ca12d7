"""Articulated bodies, one free direction eliminated after the other [Featherstone 2008, table 7.1].

From the tips to the ground, for the directions of a link last to first,

    U = I^A s,   D = s . U,   r = -s . p^A,   I^A <- I^A - U U^T / D,   p^A <- p^A + U r / D,

which for a joint of several directions is the block elimination of the table, and then, with c of the whole joint and
X = [1 -~d; 0 1] to the parent, ``I^A_p += X^T I^A X``, ``p^A_p += X^T (p^A + I^A c)``. Outward again,

    a' = X a_p + c,   u = (r - U . a') / D,   a' <- a' + s u.

Wrenches and accelerations are (linear, angular) in world axes at centres of mass. ``r / sqrt(D)`` are whitened forces.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import add, cross, rotate, scale
from consilience.reference.tree.arrays import BODY
from consilience.reference.tree.inertia import (
    add_inertia,
    load_inertia,
    project_on,
    push,
    reduced,
    rotated,
    shifted,
    symmetric,
)
from consilience.reference.tree.kinematics import matrix_at, place_links, put, vector_at
from consilience.reference.tree.records import (
    ACCELERATION,
    BIAS,
    FIRST,
    GRAVITY,
    INERTIA,
    LAST,
    MASS,
    PARENT,
    PIVOT,
    QUADRATIC,
    REST,
    SPIN,
    STEP,
    STIFF,
    S,
    U,
    X,
)


@kernel
def inertias(link: Array) -> None:
    """``diag(m 1, I)`` of all links, in world axes, into their rows."""
    for k in range(link.shape[0] - 1):
        m, at = link[k, MASS], INERTIA
        given = link[k, at], link[k, at + 1], link[k, at + 2], link[k, at + 3], link[k, at + 4], link[k, at + 5]
        J = rotated(matrix_at(link, k, X), given)
        for n in range(15):
            link[k, STIFF + n] = 0.0
        link[k, STIFF], link[k, STIFF + 3], link[k, STIFF + 5] = m, m, m
        for n in range(6):
            link[k, STIFF + 15 + n] = J[n]


@kernel
def free_biases(link: Array) -> None:
    """Biases of gravity and gyroscopic torques alone, ``-(m g, -w x I w)``, from inertias of single bodies."""
    ground = link.shape[0] - 1
    g = vector_at(link, ground, GRAVITY)
    for k in range(ground):
        w, at = vector_at(link, k, SPIN), STIFF + 15
        J = link[k, at], link[k, at + 1], link[k, at + 2], link[k, at + 3], link[k, at + 4], link[k, at + 5]
        put(link, k, BIAS, scale(-link[k, MASS], g))
        put(link, k, BIAS + 3, cross(w, symmetric(J, w)))


@inner
def push_wrenches(index: Array, f: Array, A: Array, link: Array) -> None:
    """Biases of the links from generalised forces (world, body axes) of the bodies."""
    for k in range(index.shape[0]):
        b = index[k, BODY]
        at = 6 * b
        put(link, k, BIAS, (-f[at], -f[at + 1], -f[at + 2]))
        put(link, k, BIAS + 3, scale(-1.0, rotate(A[b], (f[at + 3], f[at + 4], f[at + 5]))))


@inner
def articulate(link: Array, free: Array) -> None:
    """Articulated inertias, U and D: what does not depend on forces or velocities."""
    for k in range(link.shape[0] - 2, -1, -1):
        I = load_inertia(link, k)
        for n in range(int(link[k, LAST]) - 1, int(link[k, FIRST]) - 1, -1):
            e, m = vector_at(free, n, S), vector_at(free, n, S + 3)
            x, y = push(I, e, m)
            pivot = project_on(e, m, x, y)
            put(free, n, U, x)
            put(free, n, U + 3, y)
            free[n, PIVOT] = pivot
            I = reduced(I, x, y, 1.0 / pivot)
        p = int(link[k, PARENT])
        if p >= 0:
            add_inertia(link, p, shifted(I, vector_at(link, k, STEP)))


@kernel
def sweep_in(link: Array, free: Array) -> None:
    """`articulate`, and the remaining joint forces of the biases, which are overwritten."""
    for k in range(link.shape[0] - 2, -1, -1):
        I, force, torque = load_inertia(link, k), vector_at(link, k, BIAS), vector_at(link, k, BIAS + 3)
        for n in range(int(link[k, LAST]) - 1, int(link[k, FIRST]) - 1, -1):
            e, m = vector_at(free, n, S), vector_at(free, n, S + 3)
            x, y = push(I, e, m)
            pivot, rest = project_on(e, m, x, y), -project_on(e, m, force, torque)
            put(free, n, U, x)
            put(free, n, U + 3, y)
            free[n, PIVOT], free[n, REST] = pivot, rest
            inverse = 1.0 / pivot
            I = reduced(I, x, y, inverse)
            force, torque = add(force, scale(rest * inverse, x)), add(torque, scale(rest * inverse, y))
        p = int(link[k, PARENT])
        if p >= 0:
            x, y = push(I, vector_at(link, k, QUADRATIC), vector_at(link, k, QUADRATIC + 3))
            step, force = vector_at(link, k, STEP), add(force, x)
            add_inertia(link, p, shifted(I, step))
            put(link, p, BIAS, add(vector_at(link, p, BIAS), force))
            put(link, p, BIAS + 3, add(vector_at(link, p, BIAS + 3), add(add(torque, y), cross(step, force))))


@inner
def sweep_out(link: Array, free: Array, u: Array, moving: float) -> None:
    """Accelerations of the links and, into u, of the directions; moving: 1, at rest: 0."""
    for k in range(link.shape[0] - 1):
        p = int(link[k, PARENT])
        angular = vector_at(link, p, ACCELERATION + 3)
        linear = add(vector_at(link, p, ACCELERATION), cross(angular, vector_at(link, k, STEP)))
        linear = add(linear, scale(moving, vector_at(link, k, QUADRATIC)))
        angular = add(angular, scale(moving, vector_at(link, k, QUADRATIC + 3)))
        for n in range(int(link[k, FIRST]), int(link[k, LAST])):
            taken = project_on(linear, angular, vector_at(free, n, U), vector_at(free, n, U + 3))
            u[n] = (free[n, REST] - taken) / free[n, PIVOT]
            linear = add(linear, scale(u[n], vector_at(free, n, S)))
            angular = add(angular, scale(u[n], vector_at(free, n, S + 3)))
        put(link, k, ACCELERATION, linear)
        put(link, k, ACCELERATION + 3, angular)


@fused
def free_accelerations(link: Array, free: Array, q: Array, v: Array, u: Array) -> None:
    """Accelerations u of the directions of a tree without elements, at coordinates q and speeds v.

    q may go on behind the coordinates, so that a whole state z will do.
    """
    place_links(link, free, q, v)
    inertias(link)
    free_biases(link)
    sweep_in(link, free)
    sweep_out(link, free, u, 1.0)
