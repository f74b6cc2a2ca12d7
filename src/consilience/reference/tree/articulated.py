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
from consilience.reference.kernel.vectors import add, cross, load, put, rotate, scale
from consilience.reference.tree.inertia import (
    add_inertia,
    columns,
    inertia_times,
    load_inertia,
    load_six,
    power,
    rank_one_update,
    rotate_inertia,
    shift_inertia,
    symmetric_times,
)
from consilience.reference.tree.kinematics import place_links


@kernel
def rigid_inertias(link: Array) -> None:
    """Set the articulated inertia of all links to that of the rigid body, ``diag(m 1, J)``, in world axes."""
    for k in range(link.shape[0] - 1):
        m, J = link[k].mass, rotate_inertia(columns(link[k].axes), load_six(link[k].inertia))
        link[k].M[:] = 0.0
        link[k].H[:] = 0.0
        link[k].M[0], link[k].M[3], link[k].M[5] = m, m, m
        for n in range(6):
            link[k].J[n] = J[n]


@kernel
def gravity_biases(link: Array) -> None:
    """Set the biases to gravity and gyroscopic torques, ``-(m g, -w x J w)``, from inertias of rigid bodies."""
    ground = link.shape[0] - 1
    g = load(link[ground].inboard_axes[0])
    for k in range(ground):
        w, J = load(link[k].spin), load_six(link[k].J)
        put(link[k].bias[0], scale(-link[k].mass, g))
        put(link[k].bias[1], cross(w, symmetric_times(J, w)))


@inner
def force_biases(layout: Array, f: Array, A: Array, link: Array) -> None:
    """Set the biases of the links from the generalised forces (world, body axes) of the bodies."""
    for k in range(layout.shape[0]):
        b = layout[k].body
        at = 6 * b
        put(link[k].bias[0], (-f[at], -f[at + 1], -f[at + 2]))
        put(link[k].bias[1], scale(-1.0, rotate(A[b], (f[at + 3], f[at + 4], f[at + 5]))))


@inner
def articulated_inertias(link: Array, free: Array) -> None:
    """Compute articulated inertias, U and D, which do not depend on forces or velocities."""
    for k in range(link.shape[0] - 2, -1, -1):
        I = load_inertia(link, k)
        for n in range(link[k].last - 1, link[k].first - 1, -1):
            e, m = load(free[n].s[0]), load(free[n].s[1])
            x, y = inertia_times(I, e, m)
            pivot = power(e, m, x, y)
            put(free[n].U[0], x)
            put(free[n].U[1], y)
            free[n].pivot = pivot
            I = rank_one_update(I, x, y, 1.0 / pivot)
        p = link[k].parent
        if p >= 0:
            add_inertia(link, p, shift_inertia(I, load(link[k].offset)))


@kernel
def inward_sweep(link: Array, free: Array) -> None:
    """Compute articulated inertias and biases, U, D and the remaining joint forces r; overwrites the biases."""
    for k in range(link.shape[0] - 2, -1, -1):
        I, force, torque = load_inertia(link, k), load(link[k].bias[0]), load(link[k].bias[1])
        for n in range(link[k].last - 1, link[k].first - 1, -1):
            e, m = load(free[n].s[0]), load(free[n].s[1])
            x, y = inertia_times(I, e, m)
            pivot, joint_force = power(e, m, x, y), -power(e, m, force, torque)
            put(free[n].U[0], x)
            put(free[n].U[1], y)
            free[n].pivot, free[n].joint_force = pivot, joint_force
            inverse = 1.0 / pivot
            I = rank_one_update(I, x, y, inverse)
            force, torque = add(force, scale(joint_force * inverse, x)), add(torque, scale(joint_force * inverse, y))
        p = link[k].parent
        if p >= 0:
            x, y = inertia_times(I, load(link[k].velocity_product[0]), load(link[k].velocity_product[1]))
            step, force = load(link[k].offset), add(force, x)
            add_inertia(link, p, shift_inertia(I, step))
            put(link[p].bias[0], add(load(link[p].bias[0]), force))
            put(link[p].bias[1], add(load(link[p].bias[1]), add(add(torque, y), cross(step, force))))


@inner
def outward_sweep(link: Array, free: Array, u: Array, velocity_terms: float) -> None:
    """Compute the accelerations of the links and, into u, of the free directions; see `arrays` for `velocity_terms`."""
    for k in range(link.shape[0] - 1):
        p = link[k].parent
        angular = load(link[p].acceleration[1])
        linear = add(load(link[p].acceleration[0]), cross(angular, load(link[k].offset)))
        linear = add(linear, scale(velocity_terms, load(link[k].velocity_product[0])))
        angular = add(angular, scale(velocity_terms, load(link[k].velocity_product[1])))
        for n in range(link[k].first, link[k].last):
            taken = power(linear, angular, load(free[n].U[0]), load(free[n].U[1]))
            u[n] = (free[n].joint_force - taken) / free[n].pivot
            linear = add(linear, scale(u[n], load(free[n].s[0])))
            angular = add(angular, scale(u[n], load(free[n].s[1])))
        put(link[k].acceleration[0], linear)
        put(link[k].acceleration[1], angular)


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
