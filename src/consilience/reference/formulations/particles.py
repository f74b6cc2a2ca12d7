"""Ten particles that are dynamically equivalent to a rigid body [ATTIA (1), (7)-(12)].

Four primary particles, not in one plane, and six secondary ones at the midpoints of their pairs. The ten masses solve a
linear system: mass, first and second moments about a body-fixed origin,

    sum m_k = m,   sum m_k xi_k = m c,   sum m_k xi_k xi_k^T = 1/2 tr(I_O) 1 - I_O.        [ATTIA (1)]

The solution is unique: ten nodes at corners and edge midpoints of a tetrahedron determine a quadratic polynomial.
Masses may be negative.

Secondary particles are eliminated as means of their ends. With m_ij at the midpoint of i and j,

    sum_k m_k r_k''             = sum_j mbar_j r_j'',  mbar_j = m_j + 1/2 sum_i m_ij       [ATTIA (5), (7), (9)]
    sum_k (r_k - c) x m_k r_k'' = sum_j A_j x r_j'',   A_j = sum_i mu_ij (r_i - c)         [ATTIA (6), (8)]
    mu_jj = m_j + 1/4 sum_i m_ij,  mu_ij = 1/4 m_ij,   mbar_j = sum_i mu_ij.

Particle 3, and any other point of the body, follows from particles 1, 2, 4:

    r = r1 + tau r21 + mu r41 + lam (r21 x r41)                                           [ATTIA (12)]

with constants tau, mu, lam. This is linear in the four *generators* g = (r1, r21, r41, r21 x r41) of a body,
``r = c0 g0 + tau g1 + mu g2 + lam g3``, c0 = 1 for a point and 0 for a free vector.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import Array, Body

PAIRS = tuple(combinations(range(4), 2))
"""Pairs of primary particles (0 to 3) with the secondary particles 5 to 10 at their midpoints [ATTIA (4.7)-(4.12)]."""

_FLAT = 1e-9
"""Relative volume of the tetrahedron of primary particles below which they count as coplanar."""


def ten_particles(primary: Array) -> Array:
    """Return the positions of the primary particles and of the midpoints of `PAIRS`, shape (10, 3)."""
    return np.vstack([primary, [(primary[i] + primary[j]) / 2 for i, j in PAIRS]])


def particle_masses(body: Body, primary: Array) -> Array:
    """Compute the masses of the ten particles that are equivalent to a body [ATTIA (1)].

    Parameters
    ----------
    primary : ndarray, shape (4, 3), m
        Primary particles from the body's origin, in body axes.

    Returns
    -------
    ndarray, shape (10,), kg
        In the order of `ten_particles`.

    Raises
    ------
    InvalidInput
        If the four lie in one plane.
    """
    edges = primary[1:] - primary[0]
    if abs(np.linalg.det(edges)) <= _FLAT * np.prod(np.linalg.norm(edges, axis=1)):
        where = f"body '{body.name}': primary particles"
        raise InvalidInput(where, "they lie in one plane", "Place one of them off it.")
    # about particle 1, in units of the distances, so that the ten equations have similar size
    length = float(np.max(np.linalg.norm(edges, axis=1)))
    xi = (ten_particles(primary) - primary[0]) / length
    c = (body.com - primary[0]) / length
    I_O = body.inertia / length**2 + body.mass * ((c @ c) * np.eye(3) - np.outer(c, c))
    second = 0.5 * np.trace(I_O) * np.eye(3) - I_O
    upper = np.triu_indices(3)
    products = xi[:, upper[0]] * xi[:, upper[1]]
    system = np.column_stack([np.ones(10), xi, products]).T
    return np.linalg.solve(system, np.concatenate([[body.mass], body.mass * c, second[upper]]))


def primary_mass_matrix(masses: Array) -> Array:
    """Eliminate the secondary particles: masses mu_ij of the primary ones, shape (4, 4) [ATTIA (7)-(9)].

    ``2 T = sum mu_ij v_i . v_j`` and ``mbar_j`` is the sum of a column.
    """
    mu = np.diag(masses[:4])
    for m, (i, j) in zip(masses[4:], PAIRS, strict=True):
        mu[np.ix_([i, j], [i, j])] += m / 4
    return mu


def generators(primary: Array) -> Array:
    """Return the generators r1, r21, r41 and r21 x r41 of four primary particles, shape (4, 3)."""
    r21, r41 = primary[1] - primary[0], primary[3] - primary[0]
    return np.array([primary[0], r21, r41, np.cross(r21, r41)])


def combination(basis: Array, points: Array) -> Array:
    """Return the constants (1, tau, mu, lam) of body-fixed points [ATTIA (12)].

    Parameters
    ----------
    basis : ndarray, shape (4, 3)
        Generators in body axes.
    points : ndarray, shape (n, 3), m
        Points from the body's origin, in body axes.

    Returns
    -------
    ndarray, shape (n, 4)
    """
    return np.column_stack([np.ones(len(points)), vector_combination(basis, points - basis[0])[:, 1:]])


def vector_combination(basis: Array, vectors: Array) -> Array:
    """Return the constants (0, tau, mu, lam) of body-fixed vectors, shape (n, 4); parameters as in `combination`."""
    return np.column_stack([np.zeros(len(vectors)), np.linalg.solve(basis[1:].T, vectors.T).T])


def angular_rate(basis: Array, rate: Array) -> Array:
    """Return the angular velocity w of ``a_k' = w x a_k``, a_k the generators that are vectors: ``1/2 sum a^k x a_k'``.

    a^k is the reciprocal basis. Second rates give the angular acceleration: their other terms cancel in the sum.

    Parameters
    ----------
    basis, rate : ndarray, shape (n, 4, 3)
        Generators of n bodies and their first or second rates, world axes.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    reciprocal = np.swapaxes(np.linalg.inv(basis[:, 1:]), 1, 2)
    return 0.5 * np.cross(reciprocal, rate[:, 1:]).sum(axis=1)


def orientation(basis: Array, drawn: Array) -> Array:
    """Return the rotation matrices from `drawn` to `basis`, both of shape (n, 4, 3), from three points [INTRO].

    Triads of particles 1, 2 and 4 are orthogonal even if distances have errors.
    """
    return _triads(basis) @ np.swapaxes(_triads(drawn), 1, 2)


def _triads(basis: Array) -> Array:
    """Return orthogonal triads of generators, shape (n, 3, 3)."""
    i = basis[:, 1] / np.linalg.norm(basis[:, 1], axis=1, keepdims=True)
    k = basis[:, 3] / np.linalg.norm(basis[:, 3], axis=1, keepdims=True)
    return np.stack([i, np.cross(k, i), k], axis=-1)
