"""Canonical states in, canonical observables out: the reference solver as a library."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.errors import ConsilienceError, InvalidInput
from consilience.mechanism import Mechanism, State
from consilience.observe import kinetic_energy, potential_energy, reaction_map
from consilience.reference import dynamics
from consilience.reference.forces import remember
from consilience.reference.formulations import descriptor
from consilience.reference.integrators import dop853
from consilience.reference.model import Model, flatten, pack, unpack
from consilience.reference.workspace import Workspace, workspace
from consilience.run import InstantAnswer, TrajectoryAnswer
from consilience.spatial import Array, continuous_in_time, rotation_from_quaternion


class NumericalFailure(ConsilienceError):
    """The integration cannot go on; the message says when and why."""


def _formulation(name: str) -> int:
    if name not in dynamics.FORMULATIONS:
        known = ", ".join(dynamics.FORMULATIONS)
        raise InvalidInput(f"formulation '{name}'", "there is none of that name", f"Formulations: {known}.")
    return dynamics.FORMULATIONS[name]


def _memory(model: Model, y: Array, ws: Workspace) -> Array:
    """Joint coordinates that elements read at a first state, angles within half a turn of zero."""
    memory = np.zeros(len(model.coordinate))
    remember(model, y, ws, memory)
    return memory


def simulate(
    mechanism: Mechanism, state: State, times: Array, tolerance: float = 1e-12, formulation: str = "descriptor"
) -> TrajectoryAnswer:
    """Motion of a mechanism by the reference solver.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at ``times[0]`` (see `consilience.assembly`).
    times : ndarray, shape (n_t,), s
        Increasing sample times.
    tolerance : float
        Bound on the scaled local error of a step, 1e-14 to 1e-3.
    formulation : str
        Key of `dynamics.FORMULATIONS`.

    Returns
    -------
    TrajectoryAnswer
        With the counters ``steps``, ``rejected`` and ``evaluations``.

    Raises
    ------
    InvalidInput
        Unknown formulation, tolerance out of range, times that do not increase.
    NumericalFailure
        With the status of the integrator.
    """
    number = _formulation(formulation)
    times = np.asarray(times, dtype=float)
    if not 1e-14 <= tolerance <= 1e-3:
        raise InvalidInput("tolerance", f"{tolerance} is out of range", "Choose 1e-14 to 1e-3.")
    if times.ndim != 1 or len(times) < 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
        raise InvalidInput("times", "they do not increase", "Give finite, increasing sample times.")
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    motion = np.empty((len(times), *y.shape))
    counters = np.zeros(3, dtype=np.int64)
    status = dop853.integrate(number, model, y, times, float(tolerance), _memory(model, y, ws), ws, motion, counters)
    if status:
        raise NumericalFailure(f"reference, {formulation}, tolerance {tolerance:g}: {dop853.STATUS[status]}")
    p, quat, v, w = unpack(mechanism, motion)
    names = ("steps", "rejected", "evaluations")
    counts: dict[str, int | float] = {name: int(n) for name, n in zip(names, counters, strict=True)}
    return TrajectoryAnswer(times, p, continuous_in_time(quat), v, w, counts)


def _at_origins(mechanism: Mechanism, y: Array, a: Array) -> tuple[Array, Array]:
    """Accelerations of the body origins and angular accelerations, world axes, from those of the solver."""
    y = y[: len(mechanism.bodies)]
    A = rotation_from_quaternion(y[:, 3:7])
    a = a.reshape(-1, 6)
    alpha = np.einsum("bij,bj->bi", A, a[:, 3:])
    w = np.einsum("bij,bj->bi", A, y[:, 10:13])
    c = np.einsum("bij,bj->bi", A, np.array([b.com for b in mechanism.bodies]))
    return a[:, :3] - np.cross(alpha, c) - np.cross(w, np.cross(w, c)), alpha


def accelerations(
    mechanism: Mechanism, states: Sequence[State], formulation: str = "descriptor", t: float = 0.0
) -> InstantAnswer:
    """Accelerations, reactions and energies at consistent states, drives and loads at the time t.

    Reactions come with the descriptor form only; they are of least norm where dependent constraints leave them open
    (`consilience.observe.determinate_reactions` says which components are determined).

    Raises
    ------
    NumericalFailure
        If the accelerations are not finite, for example at a spring of no length.
    """
    number = _formulation(formulation)
    model = flatten(mechanism)
    ws = workspace(model)
    a = np.empty(6 * len(mechanism.bodies))
    linear, angular, forces, torques = [], [], [], []
    for state in states:
        y = pack(mechanism, state)
        memory = _memory(model, y, ws)
        dynamics.accelerations(number, model, t, y, memory, ws, a)
        if not np.all(np.isfinite(a)):
            raise NumericalFailure(f"reference, {formulation}: {dop853.STATUS[2]}")
        if formulation == "descriptor":
            lam = descriptor.multipliers(model, t, y, memory, ws, a)
            wrench = _reactions(mechanism, state, lam)
            forces.append(wrench[:, :3])
            torques.append(wrench[:, 3:])
        a_B, alpha = _at_origins(mechanism, y, a)
        linear.append(a_B)
        angular.append(alpha)
    return InstantAnswer(
        a_WB_W=np.array(linear),
        alpha_WB_W=np.array(angular),
        force_F=np.array(forces) if forces else None,
        torque_F=np.array(torques) if torques else None,
        kinetic=np.array([kinetic_energy(mechanism, s) for s in states]),
        potential=np.array([potential_energy(mechanism, s) for s in states]),
    )


def _reactions(mechanism: Mechanism, state: State, lam: Array) -> Array:
    """Joint wrenches of multipliers: on the successor, at the origin of M, axes of F, shape (n_j, 6)."""
    wrenches, start = [], 0
    for joint in mechanism.joints:
        rows = slice(start, start + len(joint.rows))
        start = rows.stop
        wrenches.append(reaction_map(mechanism, state, joint) @ lam[rows])
    return np.array(wrenches)
