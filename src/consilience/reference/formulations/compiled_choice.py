"""The one place where a formulation is chosen inside compiled code.

Formulations are bound here by number and not passed as functions: a kernel that takes another compiled function as an
argument is compiled again in every process, one that names it is cached.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.forces import control_errors
from consilience.reference.formulations import descriptor, null_space
from consilience.reference.kernel.compiled import inlined

FORMULATIONS = {"descriptor": 0, "null_space": 1}
"""Selectable formulations and their numbers."""


@inlined
def accelerations(formulation: int, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Accelerations (dv/dt, dw'/dt), shape (6 n_b,), by the formulation of that number; the constraint rank."""
    if formulation == 0:
        return descriptor.accelerations(model, t, y, turns, ws, a)
    return null_space.accelerations(model, t, y, turns, ws, a)


@inlined
def derivative(
    formulation: int, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array, dy: Array
) -> None:
    """State derivative: ``r' = v``, ``p' = 1/2 G^T w'`` [MASS (38)], and the accelerations, shape of y."""
    accelerations(formulation, model, t, y, turns, ws, a)
    if model.control.shape[0]:
        control_errors(model, t, y, turns, ws, dy)
    for b in range(model.mass.shape[0]):
        e0, e1, e2, e3 = y[b, 3], y[b, 4], y[b, 5], y[b, 6]
        w1, w2, w3 = y[b, 10], y[b, 11], y[b, 12]
        for k in range(3):
            dy[b, k] = y[b, 7 + k]
        dy[b, 3] = -0.5 * (e1 * w1 + e2 * w2 + e3 * w3)
        dy[b, 4] = 0.5 * (e0 * w1 + e2 * w3 - e3 * w2)
        dy[b, 5] = 0.5 * (e0 * w2 + e3 * w1 - e1 * w3)
        dy[b, 6] = 0.5 * (e0 * w3 + e1 * w2 - e2 * w1)
        for k in range(6):
            dy[b, 7 + k] = a[6 * b + k]
