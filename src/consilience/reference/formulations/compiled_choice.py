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
def derivative(
    formulation: int, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array, dy: Array
) -> None:
    """Compute the state derivative dy, shape of y, with the accelerations a on the way.

    Parameters
    ----------
    formulation : int
        Number in `FORMULATIONS`.
    model, t, y, turns, ws, a
        As in `descriptor.accelerations`.
    dy : ndarray, shape (n_b + n_e, 13)
        Overwritten.
    """
    if formulation == 0:
        descriptor.accelerations(model, t, y, turns, ws, a)
    else:
        null_space.accelerations(model, t, y, turns, ws, a)
    if model.control.shape[0]:
        control_errors(model, t, y, turns, ws, dy)
    state_rates(y, a, dy)
