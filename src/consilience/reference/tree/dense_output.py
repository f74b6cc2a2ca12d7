"""Dense output of a step: a polynomial of degree seven through its end points, derivatives and stages.

Samples within a step are values of the polynomial, each projected onto the constraint manifold.
"""

from __future__ import annotations

from typing import Any

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inlined, kernel
from consilience.reference.kernel.vectors import assign
from consilience.reference.tree.arrays import LoopClosure, Planar, Spatial, TreeArrays, TreeElements
from consilience.reference.tree.loop_groups import ACTIVE
from consilience.reference.tree.methods import END
from consilience.reference.tree.projection import AT_SAMPLE, project_state, record_sample


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


@inlined
def record_samples_within(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    z: Array,
    t: float,
    step: float,
    times: Array,
    motion: Array,
    scratch: Any,
) -> None:
    """Record the bodies at times within a step, each state projected.

    Parameters
    ----------
    tree, closure, spatial, elements, planar, z : see `arrays`
    t, step : float, s
        Start and length of the step.
    times : ndarray, shape (n,), s
    motion : ndarray, shape (n, n_b + n_e, 13)
        Overwritten.
    scratch : ExplicitScratch or RadauScratch
        Holds the dense output F.
    """
    if closure is not None:
        # projecting samples selects rows; the next step needs those of the end of this step
        assign(scratch.order, closure.qr.order)
        assign(scratch.chosen, closure.qr.state[:, ACTIVE])
    for n in range(times.shape[0]):
        dense_output(z, scratch.F, (times[n] - t) / step, scratch.state)
        project_state(tree, closure, spatial, elements, planar, times[n], scratch.state, AT_SAMPLE)
        record_sample(tree, spatial, planar, motion[n])
    if closure is not None:
        assign(closure.qr.order, scratch.order)
        assign(closure.qr.state[:, ACTIVE], scratch.chosen)
