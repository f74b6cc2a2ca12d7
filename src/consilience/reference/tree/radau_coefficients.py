"""Coefficients of Radau IIA of seven stages [Hairer and Wanner, sections IV.5 and IV.8], computed at import."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import legroots, legvander

from consilience.mechanism import Array
from consilience.reference.tree.gauss import lagrange_integrals

STAGES = 7


def _nodes() -> Array:
    """Return the right Radau nodes in (0, 1]: where the Legendre polynomials of degrees s and s - 1 are equal."""
    series = np.zeros(STAGES + 1)
    series[-2:] = -1.0, 1.0
    return 0.5 * (np.sort(legroots(series)) + 1.0)


def _weights(c: Array) -> Array:
    """Return the weights of the quadrature with these nodes."""
    moments = np.zeros(STAGES)
    moments[0] = 1.0
    return np.linalg.solve(legvander(2.0 * c - 1.0, STAGES - 1).T, moments)


def _nested(c: Array) -> Array:
    """Return the weights of the stages in the nested form of `dense_output.dense_output`, shape (7, 7)."""
    factors = [c if i % 2 == 0 else 1.0 - c for i in range(STAGES)]
    return np.linalg.inv(np.cumprod(factors, axis=0).T)


C = _nodes()
B = _weights(C)
A = 0.5 * lagrange_integrals(2.0 * C - 1.0, 2.0 * B)
NESTED = _nested(C)

_EIGENVALUES, _VECTORS = np.linalg.eig(np.linalg.inv(A))
_UPPER = np.argsort(np.abs(_EIGENVALUES.imag))
_UPPER = _UPPER[_EIGENVALUES.imag[_UPPER] > -1e-9]
LAMBDA = _EIGENVALUES[_UPPER]
"""Eigenvalues of the inverse of A: the real one first, then one of each pair."""

OUT = _VECTORS[:, _UPPER] * np.where(np.arange(len(_UPPER)) == 0, 1.0, 2.0)
"""Eigenvectors, shape (7, 4); a pair contributes twice the real part of one of its vectors."""

IN = np.linalg.inv(_VECTORS)[_UPPER]
"""Rows of the inverse of the eigenvector matrix, shape (4, 7)."""

_POWERS = np.arange(STAGES)
_EMBEDDED = np.linalg.solve(
    (C ** _POWERS[:, None]), 1.0 / (_POWERS + 1.0) - np.where(_POWERS == 0, 1.0 / LAMBDA[0].real, 0.0)
)
ESTIMATE = LAMBDA[0].real * ((_EMBEDDED - B) @ np.linalg.inv(A))
"""Weights e of the stages in the error estimate."""
