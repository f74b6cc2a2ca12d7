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
from consilience.reference.tree import records as col
from consilience.reference.tree.arrays import BODY
from consilience.reference.tree.inertia import (
    add_inertia,
    inertia_times,
    load_inertia,
    power,
    rank_one_update,
    rotate_inertia,
    shift_inertia,
    symmetric_times,
)
from consilience.reference.tree.kinematics import load_matrix, load_vector, place_links, store_vector


@kernel
def rigid_inertias(link: Array) -> None:
    """``diag(m 1, I)`` of all links, in world axes, into their rows."""
    for k in range(link.shape[0] - 1):
        m, at = link[k, col.MASS], col.INERTIA
        given = link[k, at], link[k, at + 1], link[k, at + 2], link[k, at + 3], link[k, at + 4], link[k, at + 5]
        J = rotate_inertia(load_matrix(link, k, col.X), given)
        for n in range(15):
            link[k, col.ARTICULATED + n] = 0.0
        link[k, col.ARTICULATED], link[k, col.ARTICULATED + 3], link[k, col.ARTICULATED + 5] = (m, m, m)
        for n in range(6):
            link[k, col.ARTICULATED + 15 + n] = J[n]


@kernel
def gravity_biases(link: Array) -> None:
    """Biases of gravity and gyroscopic torques alone, ``-(m g, -w x I w)``, from inertias of single bodies."""
    ground = link.shape[0] - 1
    g = load_vector(link, ground, col.GRAVITY)
    for k in range(ground):
        w, at = load_vector(link, k, col.SPIN), col.ARTICULATED + 15
        J = link[k, at], link[k, at + 1], link[k, at + 2], link[k, at + 3], link[k, at + 4], link[k, at + 5]
        store_vector(link, k, col.BIAS, scale(-link[k, col.MASS], g))
        store_vector(link, k, col.BIAS + 3, cross(w, symmetric_times(J, w)))


@inner
def force_biases(layout: Array, f: Array, A: Array, link: Array) -> None:
    """Biases of the links from generalised forces (world, body axes) of the bodies."""
    for k in range(layout.shape[0]):
        b = layout[k, BODY]
        at = 6 * b
        store_vector(link, k, col.BIAS, (-f[at], -f[at + 1], -f[at + 2]))
        store_vector(link, k, col.BIAS + 3, scale(-1.0, rotate(A[b], (f[at + 3], f[at + 4], f[at + 5]))))


@inner
def articulated_inertias(link: Array, free: Array) -> None:
    """Articulated inertias, U and D: what does not depend on forces or velocities."""
    for k in range(link.shape[0] - 2, -1, -1):
        I = load_inertia(link, k)
        for n in range(int(link[k, col.LAST]) - 1, int(link[k, col.FIRST]) - 1, -1):
            e, m = load_vector(free, n, col.S), load_vector(free, n, col.S + 3)
            x, y = inertia_times(I, e, m)
            pivot = power(e, m, x, y)
            store_vector(free, n, col.U, x)
            store_vector(free, n, col.U + 3, y)
            free[n, col.PIVOT] = pivot
            I = rank_one_update(I, x, y, 1.0 / pivot)
        p = int(link[k, col.PARENT])
        if p >= 0:
            add_inertia(link, p, shift_inertia(I, load_vector(link, k, col.OFFSET)))


@kernel
def inward_sweep(link: Array, free: Array) -> None:
    """`articulate`, and the remaining joint forces of the biases, which are overwritten."""
    for k in range(link.shape[0] - 2, -1, -1):
        I, force, torque = load_inertia(link, k), load_vector(link, k, col.BIAS), load_vector(link, k, col.BIAS + 3)
        for n in range(int(link[k, col.LAST]) - 1, int(link[k, col.FIRST]) - 1, -1):
            e, m = load_vector(free, n, col.S), load_vector(free, n, col.S + 3)
            x, y = inertia_times(I, e, m)
            pivot, joint_force = power(e, m, x, y), -power(e, m, force, torque)
            store_vector(free, n, col.U, x)
            store_vector(free, n, col.U + 3, y)
            free[n, col.PIVOT], free[n, col.JOINT_FORCE] = pivot, joint_force
            inverse = 1.0 / pivot
            I = rank_one_update(I, x, y, inverse)
            force, torque = add(force, scale(joint_force * inverse, x)), add(torque, scale(joint_force * inverse, y))
        p = int(link[k, col.PARENT])
        if p >= 0:
            x, y = inertia_times(
                I, load_vector(link, k, col.VELOCITY_PRODUCT), load_vector(link, k, col.VELOCITY_PRODUCT + 3)
            )
            step, force = load_vector(link, k, col.OFFSET), add(force, x)
            add_inertia(link, p, shift_inertia(I, step))
            store_vector(link, p, col.BIAS, add(load_vector(link, p, col.BIAS), force))
            store_vector(
                link, p, col.BIAS + 3, add(load_vector(link, p, col.BIAS + 3), add(add(torque, y), cross(step, force)))
            )


@inner
def outward_sweep(link: Array, free: Array, u: Array, velocity_terms: float) -> None:
    """Accelerations of the links and, into u, of the directions; moving: 1, at rest: 0."""
    for k in range(link.shape[0] - 1):
        p = int(link[k, col.PARENT])
        angular = load_vector(link, p, col.ACCELERATION + 3)
        linear = add(load_vector(link, p, col.ACCELERATION), cross(angular, load_vector(link, k, col.OFFSET)))
        linear = add(linear, scale(velocity_terms, load_vector(link, k, col.VELOCITY_PRODUCT)))
        angular = add(angular, scale(velocity_terms, load_vector(link, k, col.VELOCITY_PRODUCT + 3)))
        for n in range(int(link[k, col.FIRST]), int(link[k, col.LAST])):
            taken = power(linear, angular, load_vector(free, n, col.U), load_vector(free, n, col.U + 3))
            u[n] = (free[n, col.JOINT_FORCE] - taken) / free[n, col.PIVOT]
            linear = add(linear, scale(u[n], load_vector(free, n, col.S)))
            angular = add(angular, scale(u[n], load_vector(free, n, col.S + 3)))
        store_vector(link, k, col.ACCELERATION, linear)
        store_vector(link, k, col.ACCELERATION + 3, angular)


@fused
def tree_accelerations(link: Array, free: Array, q: Array, v: Array, u: Array) -> None:
    """Accelerations u of the directions of a tree without elements, at coordinates q and speeds v.

    q may go on behind the coordinates, so that a whole state z will do.
    """
    place_links(link, free, q, v)
    rigid_inertias(link)
    gravity_biases(link)
    inward_sweep(link, free)
    outward_sweep(link, free, u, 1.0)
