"""Motions by DART's accelerations and the harness's Runge-Kutta method of order four.

Orientations are integrated as quaternions: DART's rotation vectors are singular at a full turn, and the rate of a
rotation vector is not DART's velocity.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import runge_kutta_4, solve_constrained
from consilience.mechanism import Array, Mechanism, State, euler_parameter_matrix
from consilience_dart.dynamics import constrained_terms, forward_dynamics
from consilience_dart.loads import Forces
from consilience_dart.redundancy import rank_limit, strongest
from consilience_dart.state import Coordinates, from_state, read, rotations, send
from consilience_dart.translation import Model, build, constrained


def accelerations(model: Model, forces: Forces, t: float, rank: int | None) -> Array:
    """Compute generalised accelerations: of a tree by articulated bodies, else by the saddle-point system.

    Parameters
    ----------
    model : Model
    forces : Forces
    t : float, s
    rank : int or None
        Rank to which dependent rows are cut (`redundancy.rank_limit`).
    """
    if not constrained(model.mechanism, model.tree):
        return forward_dynamics(model, forces, t)
    M, f, J, gamma = constrained_terms(model, forces, t)
    if rank is not None:
        J, gamma = strongest(J, gamma, rank)
    return solve_constrained(M, f, J, gamma)[0]


def _quaternion_rate(quat: Array, w: Array, in_parent: bool) -> Array:
    """Rate of a quaternion from the angular velocity in axes of the link, or of the parent (`in_parent`)."""
    if in_parent:  # dq/dt = 1/2 w q, and its conjugate is -1/2 q* w
        conjugate = quat * np.array([1.0, -1.0, -1.0, -1.0])
        rate = -0.5 * euler_parameter_matrix(conjugate).T @ w
        return np.asarray(rate * np.array([1.0, -1.0, -1.0, -1.0]))
    return np.asarray(0.5 * euler_parameter_matrix(quat).T @ w)


def rk4_trajectory(mechanism: Mechanism, state: State, times: Array, substeps: int) -> tuple[list[Array], int]:
    """Integrate a motion; return positions, quaternions, velocities, angular velocities, and the count of evaluations.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        State at ``times[0]``.
    times : ndarray, shape (n_t,), s
    substeps : int
        Steps for each sample interval.
    """
    model = build(mechanism)
    forces = Forces(model)
    rank = rank_limit(model, state)
    turning = rotations(model)
    n = model.skeleton.getNumDofs()
    parts = np.cumsum([1, n, n, 4 * len(turning)])  # time, coordinates, velocities, quaternions, integrals of control
    scalar = np.ones(n)
    for i, _ in turning:
        scalar[i : i + 3] = 0.0  # quaternions take the place of rotation vectors
    samples = []

    def put(y: Array) -> tuple[Coordinates, Array]:
        """Set skeleton and forces to an integrator's state; return its coordinates, and quaternions not normalised."""
        _, q, v, flat, integrals = np.split(y, parts)
        quats = flat.reshape(-1, 4)
        c = Coordinates(q, v, quats / np.linalg.norm(quats, axis=1)[:, None])
        send(model, c)
        forces.integrals[:] = integrals
        return c, quats

    def derivative(y: Array) -> Array:
        """Rates of time, coordinates, velocities, quaternions and integrals of control."""
        # quaternions are not normalised here: their norm is a first integral, and the order stays four
        c, quats = put(y)
        t = float(y[0])
        rates = [_quaternion_rate(q, c.v[i : i + 3], outer) for q, (i, outer) in zip(quats, turning, strict=True)]
        return np.concatenate([[1.0], c.v * scalar, accelerations(model, forces, t, rank), *rates, forces.errors(t)])

    def record(y: Array) -> None:
        put(y)
        samples.append(read(model))

    start = from_state(model, state)
    count = substeps * (len(times) - 1)
    y0 = np.concatenate([times[:1], start.q, start.v, start.quats.ravel(), forces.integrals])
    runge_kutta_4(derivative, y0, (times[1] - times[0]) / substeps, count, record, substeps)
    return [np.array(column) for column in zip(*samples, strict=True)], 4 * count
