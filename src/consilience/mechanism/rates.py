"""Rates of a mechanism: how fast its fastest mode oscillates or decays, and how fast the direction of a spring turns.

An integrator resolves a motion where its step times the fastest rate is of the order of one; an explicit method of
order one to four is stable up to about 2 to 2.8 [E. Hairer, G. Wanner, Solving ODEs II, 1996, section IV.2].
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.mechanism.applied_forces import applied_wrenches
from consilience.mechanism.constraints import free_directions
from consilience.mechanism.elements import Friction, JointSpring, Spring
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.observables import SampledMotion, body_point, mass_matrix
from consilience.mechanism.singular import move
from consilience.mechanism.spatial import Array
from consilience.mechanism.units import characteristic_length, in_units, own_units

DISPLACEMENT = 1e-5
"""Displacement of the difference quotients relative to the largest entry of a direction: central, error 1e-10."""

PUSH = 1e-7
"""The same for velocities: friction is steep within its speed, and forces have no large terms that cancel."""

LEAST_SPEED = 1e-7
"""Least regularising speed of friction, in rad/s or characteristic lengths per second: below, the digits of a velocity
within the speed, and of its Jacobian by differences, do not suffice for steps of a useful length."""

CHORDS = 64
"""Chords of an interpolated curve in a sample interval."""


def frictions_too_steep(mechanism: Mechanism) -> list[Friction]:
    """Return the friction elements whose Coulomb part no step of an integrator resolves."""
    if not mechanism.frictions:
        return []
    sizes = {"distance": characteristic_length(mechanism)}
    return [f for f in mechanism.frictions if f.coulomb > 0.0 and f.speed < LEAST_SPEED * sizes.get(f.coordinate, 1.0)]


def rough_dampers(mechanism: Mechanism) -> list[JointSpring]:
    """Return the joint springs with a damping ``c1 |v| v``, whose second derivative jumps where v changes sign."""
    return [s for s in mechanism.joint_springs if s.laws[1][1] != 0.0]


def fastest_rate(mechanism: Mechanism, state: State, t: float = 0.0) -> float:
    """Return the largest eigenvalue of the equations linearised at a state, or angular velocity of a body, rad/s.

    In free directions N the displacements x obey ``N^T M N x'' + C x' + K x = 0``, with the slopes K and C of the
    applied forces as seen in constant directions. The magnitude of the largest eigenvalue is the angular frequency of
    an oscillation or the rate of a decay, 1/s. A mechanism without elements swings at no more than sqrt(g / L) or so, L
    the characteristic length of a body.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    t : float, s
        Time of functions of time.
    """
    units = own_units(mechanism)  # displacements are in characteristic lengths
    mechanism, state = in_units(mechanism, *units), units.convert(state)
    spin = float(np.max(np.linalg.norm(state.w_WB_W, axis=1), initial=0.0))
    m = mechanism
    if not (m.springs or m.joint_springs or m.frictions or m.controls or m.loads):
        return max(spin, float(np.sqrt(np.linalg.norm(m.gravity) / characteristic_length(m))))
    N = free_directions(mechanism, state, t=t)
    count = N.shape[1]
    if count == 0:
        return spin

    def forces(at: State) -> Array:
        return np.asarray(N.T @ applied_wrenches(mechanism, at, t).total.ravel())

    def slope(displaced: list[tuple[State, State]], size: float) -> Array:
        columns = [(forces(back) - forces(on)) / (2.0 * size) for on, back in displaced]
        return np.column_stack(columns)

    K = slope([(move(state, DISPLACEMENT * d), move(state, -DISPLACEMENT * d)) for d in N.T], DISPLACEMENT)
    C = slope([(_pushed(state, PUSH * d), _pushed(state, -PUSH * d)) for d in N.T], PUSH)
    M = N.T @ mass_matrix(mechanism, state) @ N
    zero, one = np.zeros((count, count)), np.eye(count)
    try:
        system = np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    except np.linalg.LinAlgError:  # a direction without inertia, to the digits of a float
        return np.inf
    if not np.all(np.isfinite(system)):
        return np.inf
    return max(spin, float(np.max(np.abs(np.linalg.eigvals(system)))))


def _pushed(state: State, increments: Array) -> State:
    """Add velocities ``(dv, dw)`` of every body, m/s and rad/s in world axes, to a state."""
    steps = increments.reshape(-1, 6)
    return replace(state, v_WB_W=state.v_WB_W + steps[:, :3], w_WB_W=state.w_WB_W + steps[:, 3:])


def turning_rate(mechanism: Mechanism, motion: SampledMotion, time: Array) -> float:
    """Return the fastest turning of the direction of a spring with a free length, rad/s; zero without any.

    The vector between the ends is followed between samples by cubic Hermite interpolation. At its shortest length d and
    relative speed v the direction turns at v / d. Where the ends meet, the direction jumps, and the force with it.

    Parameters
    ----------
    mechanism : Mechanism
    motion : SampledMotion
        Poses and velocities at each sample.
    time : ndarray, shape (n_t,), s
    """
    return max(
        (_turning(*_across(mechanism, s, motion), time) for s in mechanism.springs if s.free_length), default=0.0
    )


def _across(mechanism: Mechanism, spring: Spring, motion: SampledMotion) -> tuple[Array, Array]:
    """Vector from the predecessor's end of a spring to the successor's, and its rate, shape (n_t, 3)."""
    p_i, v_i = body_point(mechanism, motion, spring.predecessor, spring.point_predecessor)
    p_j, v_j = body_point(mechanism, motion, spring.successor, spring.point_successor)
    shape = motion.p_WB.shape[0], 3
    return np.broadcast_to(p_j - p_i, shape), np.broadcast_to(v_j - v_i, shape)


def _turning(r: Array, v: Array, time: Array) -> float:
    """Largest rate at which the direction of r(t) turns, rad/s, from chords of the Hermite interpolation."""
    h, x = np.diff(time)[:, None, None], np.linspace(0.0, 1.0, CHORDS + 1)[:, None]
    values = (1.0 + 2.0 * x) * (1.0 - x) ** 2 * r[:-1, None] + x**2 * (3.0 - 2.0 * x) * r[1:, None]
    slopes = x * (1.0 - x) ** 2 * v[:-1, None] - x**2 * (1.0 - x) * v[1:, None]
    points = values + h * slopes
    chords = np.diff(points, axis=1)
    squares = np.maximum(np.sum(chords**2, axis=2), np.finfo(float).tiny)
    nearest = np.clip(-np.sum(points[:, :-1] * chords, axis=2) / squares, 0.0, 1.0)
    lengths = np.linalg.norm(points[:, :-1] + nearest[:, :, None] * chords, axis=2)
    with np.errstate(divide="ignore"):
        return float(np.max(np.sqrt(squares) * CHORDS / h[:, :, 0] / lengths, initial=0.0))
