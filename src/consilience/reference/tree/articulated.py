"""Articulated-body algorithm, one free direction eliminated after the other [Featherstone 2008, table 7.1].

Inward, for the directions of a link from last to first,

    U = I^A s,   D = s . U,   r = -s . p^A,   I^A <- I^A - U U^T / D,   p^A <- p^A + U r / D,

which for a joint of several directions is the block elimination of the table, and then, with c of the whole joint and
X = [1 -~d; 0 1] to the parent, ``I^A_p += X^T I^A X``, ``p^A_p += X^T (p^A + I^A c)``. Outward,

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
    """Set the articulated inertia of all links to that of the rigid body, ``diag(m 1, J)``, in world axes."""
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
    """Set the biases to gravity and gyroscopic torques, ``-(m g, -w x J w)``, from inertias of rigid bodies."""
    ground = link.shape[0] - 1
    g = load_vector(link, ground, col.GRAVITY)
    for k in range(ground):
        w, at = load_vector(link, k, col.SPIN), col.ARTICULATED + 15
        J = link[k, at], link[k, at + 1], link[k, at + 2], link[k, at + 3], link[k, at + 4], link[k, at + 5]
        store_vector(link, k, col.BIAS, scale(-link[k, col.MASS], g))
        store_vector(link, k, col.BIAS + 3, cross(w, symmetric_times(J, w)))


@inner
def force_biases(layout: Array, f: Array, A: Array, link: Array) -> None:
    """Set the biases of the links from the generalised forces (world, body axes) of the bodies."""
    for k in range(layout.shape[0]):
        b = layout[k, BODY]
        at = 6 * b
        store_vector(link, k, col.BIAS, (-f[at], -f[at + 1], -f[at + 2]))
        store_vector(link, k, col.BIAS + 3, scale(-1.0, rotate(A[b], (f[at + 3], f[at + 4], f[at + 5]))))


@inner
def articulated_inertias(link: Array, free: Array) -> None:
    """Compute articulated inertias, U and D, which do not depend on forces or velocities."""
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
    """Compute articulated inertias and biases, U, D and the remaining joint forces r; overwrites the biases."""
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
    """Compute the accelerations of the links and, into u, of the free directions; see `arrays` for `velocity_terms`."""
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
    """Compute the accelerations of the free directions of a tree with gravity alone.

    Parameters
    ----------
    link, free : see `arrays`
    q, v : ndarray, shapes (n_q,) and (N,)
        Coordinates and speeds; q may be longer, so that a whole state z will do.
    u : ndarray, shape (N,)
        Overwritten: accelerations, m/s^2 or rad/s^2.
    """
    place_links(link, free, q, v)
    rigid_inertias(link)
    gravity_biases(link)
    inward_sweep(link, free)
    outward_sweep(link, free, u, 1.0)
