"""Selection of a formulation inside compiled code, by number.

Numba caches a kernel that names another kernel; a kernel that takes another one as an argument is compiled again in
every process.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.forces import control_errors
from consilience.reference.bodies.motion import state_rates
from consilience.reference.formulations import descriptor, null_space
from consilience.reference.kernel.compiled import inlined

FORMULATIONS = {"descriptor": 0, "null_space": 1}
"""Numbers of the formulations."""


@inlined
def accelerations(formulation: int, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Compute accelerations (dv/dt, dw'/dt) into a, shape (6 n_b,); return the rank of the constraints.

    Parameters as in `descriptor.accelerations`, after the number of the formulation.
    """
    if formulation == 0:
        return descriptor.accelerations(model, t, y, turns, ws, a)
    return null_space.accelerations(model, t, y, turns, ws, a)


@inlined
def derivative(
    formulation: int, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array, dy: Array
) -> None:
    """Compute the state derivative dy, shape of y, with the accelerations a on the way; parameters as above."""
    accelerations(formulation, model, t, y, turns, ws, a)
    if model.control.shape[0]:
        control_errors(model, t, y, turns, ws, dy)
    state_rates(y, a, dy)
