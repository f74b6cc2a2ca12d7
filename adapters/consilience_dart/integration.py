"""DART's accelerations with the harness's Runge-Kutta method of order four.

Orientations are integrated as quaternions: DART's rotation vectors are singular at a full turn, and their rate is not
DART's velocity.
"""

from __future__ import annotations

import numpy as np

from consilience.harness import runge_kutta_4
from consilience.mechanism import Mechanism, State
from consilience.spatial import Array, euler_parameter_matrix
from consilience_dart.dynamics import constrained_dynamics, forward_dynamics
from consilience_dart.loads import Apply, appliers
from consilience_dart.state import Coordinates, from_state, read, rotations, send
from consilience_dart.translation import Model, build


def accelerations(model: Model, forces: list[Apply]) -> Array:
    """Generalised accelerations: articulated bodies for a tree, the saddle-point system for loops."""
    if model.tree.welds:
        return constrained_dynamics(model, forces)[0]
    return forward_dynamics(model, forces)


def _quaternion_rate(quat: Array, w: Array, in_parent: bool) -> Array:
    """Rate of a quaternion from the angular velocity in axes of the link, or of the parent."""
    if in_parent:  # dq/dt = 1/2 w q, and its conjugate is -1/2 q* w
        conjugate = quat * np.array([1.0, -1.0, -1.0, -1.0])
        rate = -0.5 * euler_parameter_matrix(conjugate).T @ w
        return np.asarray(rate * np.array([1.0, -1.0, -1.0, -1.0]))
    return np.asarray(0.5 * euler_parameter_matrix(quat).T @ w)


def rk4_trajectory(mechanism: Mechanism, state: State, times: Array, substeps: int) -> tuple[list[Array], int]:
    """Positions, quaternions, velocities and angular velocities at `times`, and the evaluations spent."""
    model = build(mechanism)
    forces = appliers(model)
    turning = rotations(model)
    n = model.skeleton.getNumDofs()
    scalar = np.ones(n)
    for i, _ in turning:
        scalar[i : i + 3] = 0.0  # the quaternions tell these
    samples = []

    def put(y: Array) -> Coordinates:
        quats = y[2 * n :].reshape(-1, 4)
        c = Coordinates(y[:n], y[n : 2 * n], quats / np.linalg.norm(quats, axis=1)[:, None])
        send(model, c)
        return c

    def derivative(y: Array) -> Array:
        """State derivative: rates of the coordinates, accelerations, rates of the quaternions."""
        c = put(y)
        # the quaternion of y itself, not the unit one: its norm is a first integral, and the order stays four
        quats = y[2 * n :].reshape(-1, 4)
        rates = [_quaternion_rate(q, c.v[i : i + 3], outer) for q, (i, outer) in zip(quats, turning, strict=True)]
        return np.concatenate([c.v * scalar, accelerations(model, forces), *rates])

    def record(y: Array) -> None:
        put(y)
        samples.append(read(model))

    start = from_state(model, state)
    count = substeps * (len(times) - 1)
    y0 = np.concatenate([start.q, start.v, start.quats.ravel()])
    runge_kutta_4(derivative, y0, (times[1] - times[0]) / substeps, count, record, substeps)
    return [np.array(column) for column in zip(*samples, strict=True)], 4 * count
