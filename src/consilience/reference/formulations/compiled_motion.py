"""Motions in body coordinates, compiled: Dormand-Prince 8(5,3) with projection after every step.

Steps end exactly on the sample times. The state z of `steppers` is y, row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.projection import project
from consilience.reference.formulations.compiled_choice import FORMULATIONS, derivative
from consilience.reference.kernel.compiled import inlined
from consilience.reference.kernel.operation import Operation
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers import explicit
from consilience.reference.steppers.driver import Integration, new_integration
from consilience.reference.steppers.motion import ANGLE, BEGIN, DERIVATIVE, DISTANCE, INTEGRAL, SPEED, SPIN

_KINDS = [DISTANCE] * 3 + [ANGLE] * 4 + [SPEED] * 3 + [SPIN] * 3
"""Kinds of the columns of y."""

_LANDING = explicit.STEPPERS["dop853"]._replace(lands=True)


class BodyRecord(NamedTuple):
    """Record of `serve`."""

    formulation: int  # number in `compiled_choice.FORMULATIONS`
    model: Model
    turns: Array  # (n_c,) joint coordinates that elements read, full turns counted (m, rad)
    ws: Workspace
    a: Array  # (6 n_b,) accelerations


@inlined
def _rows(z: Array) -> Array:
    """Return z as y, shape (n_b + n_e, 13)."""
    return z.reshape((z.shape[0] // 13, 13))


@Operation
def serve(bodies: BodyRecord, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of integrators: see `steppers.motion.BEGIN`. The first state is consistent."""
    model, ws, turns, y = bodies.model, bodies.ws, bodies.turns, _rows(z)
    if request == DERIVATIVE:
        derivative(bodies.formulation, model, t, y, turns, ws, bodies.a, _rows(out))
        return np.inf
    if request == BEGIN:
        turns[:] = 0.0
    else:
        project(model, t, y, turns, ws)
    count_turns(model, y, ws, turns)
    if out.shape[0]:
        assign(out, z)
    return np.inf


def body_integration(formulation: str, model: Model, ws: Workspace, bodies: int, rows: int) -> Integration:
    """Return the arrays of a motion.

    Parameters
    ----------
    formulation : str
        Key of `compiled_choice.FORMULATIONS`.
    model : Model
    ws : Workspace
    bodies, rows : int
        Numbers of bodies and of rows of y; rows behind the bodies hold integrals of controllers.
    """
    turns, a = np.zeros(len(model.coordinate)), np.empty(6 * bodies)
    record = BodyRecord(FORMULATIONS[formulation], model, turns, ws, a)
    kinds = np.array(_KINDS * bodies + [INTEGRAL] * (13 * (rows - bodies)), dtype=np.int64)
    return new_integration(_LANDING, kinds, model.length, (serve, record))
