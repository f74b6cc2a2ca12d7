"""Dense output of a step: a polynomial of degree seven through its end points, derivatives and stages."""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import kernel
from consilience.reference.tree.methods import END


@kernel
def interpolate(dense: Array, z: Array, end: Array, K: Array, h: float, F: Array) -> None:
    """Compute the dense output of a step, F of shape (7, n_z), in the nested form of `integrators.tableaus`."""
    for n in range(z.shape[0]):
        F[0, n] = end[n] - z[n]
        F[1, n] = h * K[0, n] - F[0, n]
        F[2, n] = 2.0 * F[0, n] - h * (K[0, n] + K[END, n])
        for i in range(dense.shape[0]):
            total = 0.0
            for j in range(dense.shape[1]):
                total += dense[i, j] * K[j, n]
            F[3 + i, n] = h * total


@kernel
def dense_output(z: Array, F: Array, x: float, state: Array) -> None:
    """Evaluate the dense output F at the fraction x of a step."""
    for n in range(z.shape[0]):
        total = 0.0
        for i in range(F.shape[0] - 1, -1, -1):
            total = (total + F[i, n]) * (1.0 - x if i % 2 else x)
        state[n] = z[n] + total
