"""Static equilibrium: Newton's method along the constraint manifold, in null-space coordinates.

    J^T f = 0,    Q J = 0                                                          [C4 (4.99)-(4.110) without motion]

f: applied forces, J: basis of the free directions. Joint reactions, in the range of ``Q^T``, balance the other forces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from consilience.errors import CannotAssemble, ConsilienceError, InvalidInput
from consilience.mechanism import (
    Array,
    Mechanism,
    Spring,
    State,
    assemble_positions,
    body_point,
    free_directions,
    joint_spring_motion,
    move,
    rotation_from_quaternion,
    skew,
)
from consilience.reference.analyses.touching import refuse_touching
from consilience.reference.bodies import forces
from consilience.reference.bodies.arrays import DISTANCE, flatten, pack, workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.motion import rotations

_DIFFERENCE = 1e-5
"""Step of central differences of ``J^T f`` along unit free directions; affects convergence, not the result."""
_FLOOR = 1e-7
"""Stiffnesses below this fraction of the largest count as zero, the accuracy of the differences."""
_LONGEST = 0.5
"""Longest step, rad and lengths of the mechanism."""
_HALVINGS = 20


class NoEquilibrium(ConsilienceError):
    """No static equilibrium was found, or the given state is not an equilibrium."""


def at_rest(state: State) -> State:
    """Return the state with all velocities zero."""
    zeros = np.zeros_like(state.p_WB)
    return State(state.p_WB, state.quat_WB, zeros, zeros)


def solver_velocities(mechanism: Mechanism, state: State) -> Array:
    """Return the matrix T from ``(v_WB_W, w_WB_W)`` of all bodies to (v, w') of the solver, shape (6 n_b, 6 n_b).

    ``T^T`` converts generalised forces of the solver to forces and torques about the body origins, world axes.
    """
    n = len(mechanism.bodies)
    T = np.zeros((6 * n, 6 * n))
    for i, (body, R_WB) in enumerate(zip(mechanism.bodies, rotation_from_quaternion(state.quat_WB), strict=True)):
        block = [[np.eye(3), -skew(R_WB @ body.com)], [np.zeros((3, 3)), R_WB.T]]
        T[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.block(block)
    return T


JointValues = Mapping[str, Mapping[str, Any]]
"""Values of joint coordinates by the names of joint and coordinate."""


_model = lru_cache(maxsize=4)(flatten)
"""Arrays of a mechanism, cached by its identity: trials differ in the state alone."""


def applied_forces(mechanism: Mechanism, state: State, t: float = 0.0, near: JointValues | None = None) -> Array:
    """Compute applied and gyroscopic forces at the time t, in the velocities (v, w') of the solver, shape (6 n_b,).

    Angles are counted from `near`, or from zero. Integrals of controllers are zero.
    """
    model = _model(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    turns = np.zeros(len(model.coordinate))
    if near is not None:
        names = [
            (mechanism.joints[j].name, "distance" if kind == DISTANCE else "angle") for j, kind in model.coordinate
        ]
        turns[:] = [float(near[joint][name]) for joint, name in names]
    count_turns(model, y, ws, turns)
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    return ws.f


def step_size(step: Array, length: float) -> float:
    """Return the largest translation, over a length, or rotation (rad) of a displacement, shape (6 n_b,)."""
    motion = np.abs(step).reshape(-1, 6)
    return max(float(np.max(motion[:, :3])) / length, float(np.max(motion[:, 3:])))


def spring_length(mechanism: Mechanism, state: State, spring: Spring) -> float:
    """Return the distance of the ends of a spring, m."""
    start, _ = body_point(mechanism, state, spring.predecessor, spring.point_predecessor)
    end, _ = body_point(mechanism, state, spring.successor, spring.point_successor)
    return float(np.linalg.norm(end - start))


def force_scale(mechanism: Mechanism, state: State) -> float:
    """Sum the magnitudes of all forces, N and N m alike: weights, loads, actuators, springs, controls.

    Magnitudes, since the applied forces of an equilibrium may cancel.
    """
    scale = sum(b.mass for b in mechanism.bodies) * float(np.linalg.norm(mechanism.gravity))
    for load in mechanism.loads:
        scale += float(np.linalg.norm(load.vector)) * (abs(load.history.at(0.0)[0]) if load.history else 1.0)
    actuators = [s.actuator for s in mechanism.springs] + [s.actuator for s in mechanism.joint_springs]
    scale += sum(abs(float(actuator.at(0.0)[0])) for actuator in actuators if actuator is not None)
    for c in mechanism.controls:
        q, _ = joint_spring_motion(mechanism, state, c.joint, c.coordinate)
        scale += abs(c.proportional) * (abs(q) + abs(float(c.target.at(0.0)[0])))
    for s in mechanism.springs:
        scale += abs(s.stiffness) * (spring_length(mechanism, state, s) + abs(s.free_length))
    for k in mechanism.joint_springs:
        q, _ = joint_spring_motion(mechanism, state, k.joint, k.coordinate)
        reach, (_, k1, k2) = abs(q) + abs(k.rest), k.laws[0]
        scale += (abs(k.stiffness) + (abs(k1) + abs(k2) * reach) * reach) * reach
    return scale


@dataclass(frozen=True, eq=False)
class _Point:
    """Consistent state, free directions N, applied forces f about the origins, and ``r = N^T f``."""

    state: State
    N: Array
    f: Array
    r: Array

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.r))

    def along(self, start: _Point) -> Array:
        """Return ``J^T f``, J the free directions here, normalised by ``N_start^T J = 1``."""
        return np.linalg.solve((start.N.T @ self.N).T, self.r)


def _point(mechanism: Mechanism, state: State) -> _Point:
    """Evaluate free directions and forces at a state."""
    N = free_directions(mechanism, state)
    f = solver_velocities(mechanism, state).T @ applied_forces(mechanism, state)
    return _Point(state, N, f, N.T @ f)


def _moved(mechanism: Mechanism, start: _Point, step: Array) -> _Point:
    """Move along the free directions by a step and assemble."""
    return _point(mechanism, assemble_positions(mechanism, move(start.state, start.N @ step)))


def _stiffness(mechanism: Mechanism, point: _Point) -> Array:
    """Return ``K = -d(J^T f)/dy`` along the manifold, by central differences, shape (freedom, freedom)."""
    columns = []
    for direction in np.eye(len(point.r)):
        ahead, behind = (_moved(mechanism, point, s * _DIFFERENCE * direction) for s in (1.0, -1.0))
        columns.append((behind.along(point) - ahead.along(point)) / (2.0 * _DIFFERENCE))
    return np.array(columns).T


def _search(mechanism: Mechanism, start: _Point, step: Array, accept: Callable[[_Point], bool]) -> _Point | None:
    """Halve the step until the point can be assembled and is accepted; None if no step is accepted.

    Parameters
    ----------
    mechanism : Mechanism
    start : _Point
    step : ndarray, shape (freedom,)
    accept : function of a point to bool
    """
    longest = step_size(start.N @ step, _model(mechanism).length)
    step = step * min(1.0, _LONGEST / max(longest, 1e-300))
    for _ in range(_HALVINGS):
        try:
            trial = _moved(mechanism, start, step)
        except CannotAssemble:  # out of reach
            trial = None
        if trial is not None and accept(trial):
            return trial
        step = 0.5 * step
    return None


def _next(mechanism: Mechanism, point: _Point) -> _Point | None:
    """Return a better point, or None.

    If the stiffness has no negative eigenvalue: Newton's step with a line search on the residual. Otherwise Newton's
    method would approach an unstable equilibrium: there, or if Newton's step fails, the step uses the magnitudes of the
    stiffnesses and ends where the forces do no more work along it.
    """
    K = _stiffness(mechanism, point)
    stiffness, V = np.linalg.eigh(0.5 * (K + K.T))
    floor = _FLOOR * float(np.max(np.abs(stiffness)))
    if stiffness[0] >= -floor:
        newton = np.linalg.lstsq(K, point.r, rcond=_FLOOR)[0]
        found = _search(mechanism, point, newton, lambda trial: trial.size < (1.0 - 1e-4) * point.size)
        if found is not None:
            return found
    step = V @ ((V.T @ point.r) / np.maximum(np.abs(stiffness), max(floor, 1e-300)))
    push = float(step @ point.r)
    return _search(mechanism, point, step, lambda trial: float(step @ trial.along(point)) >= -0.5 * push)


def static_equilibrium(mechanism: Mechanism, guess: State, tolerance: float = 1e-11, iterations: int = 100) -> State:
    """Find a state of rest in which the applied forces have no component along any free direction.

    Parameters
    ----------
    mechanism : Mechanism
    guess : State
        Initial poses, which choose the branch; velocities are ignored. Angles of joint springs are in (-pi, pi].
    tolerance : float
        Bound on the norm of ``J^T f`` (J orthonormal, N and N m alike) over `force_scale`. Below the bound iterations
        continue while they halve the residual.
    iterations : int
        Largest number of steps, each at most half a radian and half the length of the mechanism.

    Returns
    -------
    State
        Assembled, all velocities zero. If the forces have a potential, the equilibrium is stable unless the guess is an
        unstable one. Of equilibria that are not isolated one near the guess.

    Raises
    ------
    NoEquilibrium
        If none is found; the message tells the residual.
    InvalidInput
        A drive that moves at time zero, a controller with an integral (see `require_static`); an equilibrium at which
        a contact is closed, a stop reached, or dry friction can hold (`refuse_touching`).
    CannotAssemble
        If the guess cannot be assembled.

    Notes
    -----
    Newton's method in null-space coordinates [C4 (4.99)-(4.110)], ``K = -d(J^T f)/dy`` by central differences of
    step 1e-5 along the constraint manifold, trial states assembled [MASS]. Drives, loads and actuators are at time 0.
    """
    require_static(mechanism)
    point = _point(mechanism, assemble_positions(mechanism, at_rest(guess)))
    for _ in range(iterations):
        if point.size == 0.0:
            break
        found = _next(mechanism, point)
        settled = point.size <= tolerance * force_scale(mechanism, point.state)
        if found is None or (settled and found.size > 0.5 * point.size):
            break
        point = found
    require_equilibrium(mechanism, point.state, tolerance)
    refuse_touching(mechanism, point.state)
    return point.state


def require_static(mechanism: Mechanism) -> None:
    """Refuse drives in motion and controllers with an integral.

    Raises
    ------
    InvalidInput
        A drive that moves at time zero; a controller with an integral.
    """
    for drive in mechanism.drives:
        if np.any(drive.motion.at(0.0)[1:]):
            raise InvalidInput(f"drive '{drive.name}'", "it moves at time zero", "Hold it, or use kinematic_motion.")
    for control in mechanism.controls:
        if control.integral:
            what = "its integral goes on while anything rests"
            raise InvalidInput(f"control '{control.name}'", what, "Leave the integral out.")


def require_equilibrium(mechanism: Mechanism, state: State, tolerance: float) -> None:
    """Refuse a state that is not an equilibrium.

    Raises
    ------
    NoEquilibrium
        If the norm of ``J^T f`` exceeds `tolerance` times `force_scale`.
    """
    residual, scale = _point(mechanism, state).size, force_scale(mechanism, state)
    if residual > tolerance * scale:
        raise NoEquilibrium(
            f"mechanism '{mechanism.name}': no static equilibrium: forces of {residual:.3g} (N, N m) are left along "
            f"the free directions, {residual / scale:.3g} of all forces at work. Start closer to the equilibrium, or "
            "check that gravity, springs and loads can balance in every direction the joints leave free."
        )
