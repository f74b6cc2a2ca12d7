"""Linear vibrations about a static equilibrium: ``M y'' + D y' + K y = 0`` in the free directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from consilience.errors import InvalidInput
from consilience.mechanism import Array, Mechanism, State, assemble_positions, body_point, free_directions, move
from consilience.reference.analyses.statics import require_equilibrium, require_static, solver_velocities
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.formulations import compiled_choice

Complex = NDArray[np.complex128]

_DIFFERENCE = 0.003
"""Largest displacement of the differences, rad, and in lengths of the mechanism. Three levels of Richardson's
extrapolation leave an error of its sixth power; measured on lumpy bodies that hang on short rods, where the forces
change fastest, it is then as small as the rounding of the accelerations over the finest step, 1e-11 relative."""
_EQUILIBRIUM = 1e-8
_NEUTRAL = 1e-5
"""Eigenvalues below this fraction of the largest are zero up to the square root of rounding."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Linear equations of motion about an equilibrium, d degrees of freedom, and their modes.

    Attributes
    ----------
    directions : ndarray, shape (6 n_b, d)
        Orthonormal free directions J: ``(v_WB_W, w_WB_W) = J y'`` (m/s and rad/s, world axes).
    M, D, K : ndarray, shape (d, d)
        Mass, damping and stiffness matrices in the coordinates y (SI units of mixed kind). K holds the stiffness that
        the joints' reactions add; it is symmetric if the forces have a potential.
    eigenvalues : complex ndarray, shape (m,), 1/s
        With imaginary part >= 0 (each pair of conjugates once, real ones each), by increasing magnitude.
    frequencies : ndarray, shape (m,), rad/s
        Natural frequencies, the magnitudes of the eigenvalues.
    damping_ratios : ndarray, shape (m,)
        ``-Re(s)/|s|``: 0 undamped, 1 aperiodic, negative growing; not a number for a neutral direction.
    modes : complex ndarray, shape (m, n_b, 6)
        Velocities of the bodies' origins and angular velocities (world axes) of each mode, largest component 1.
    """

    directions: Array
    M: Array
    D: Array
    K: Array
    eigenvalues: Complex
    frequencies: Array
    damping_ratios: Array
    modes: Complex

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies in Hz, shape (m,)."""
        return self.frequencies / (2.0 * np.pi)

    @property
    def stable(self) -> bool:
        """Whether no mode grows; neutral directions count as not growing."""
        limit = _NEUTRAL * float(np.max(self.frequencies, initial=0.0))
        return bool(np.all(self.eigenvalues.real <= limit))


def linearise(mechanism: Mechanism, equilibrium: State) -> Linearisation:
    """Linearise the equations of motion about a static equilibrium and solve for the modes.

    Parameters
    ----------
    mechanism : Mechanism
    equilibrium : State
        Consistent, at rest and in equilibrium (see `static_equilibrium`).

    Returns
    -------
    Linearisation

    Raises
    ------
    InvalidInput
        If the state or a drive moves; a controller with an integral.
    NoEquilibrium
        If forces along the free directions are left.

    Notes
    -----
    Accelerations of the reference solver are differentiated, ``dy'' = -M^-1 (K dy + D dy')``, at consistent states
    displaced along the constraint manifold: what the reactions contribute to K is in them. K: central differences at
    three steps, the largest 0.003 rad or lengths, extrapolated by Richardson to the sixth order. D: one central
    difference, exact because accelerations are of second degree in the velocities. M is that of the minimal form
    ``J^T M J`` [C4 (4.99)-(4.110)]. Angles of joint springs are in (-pi, pi] at the equilibrium, and counted on from
    there. A direction in which the forces change like the root of a displacement (a spring of no length) has no
    linear equations.
    """
    if np.any(equilibrium.v_WB_W) or np.any(equilibrium.w_WB_W):
        raise InvalidInput("equilibrium", "the state moves", "Give a state of rest, for example of static_equilibrium.")
    require_static(mechanism)
    require_equilibrium(mechanism, equilibrium, _EQUILIBRIUM)
    N = free_directions(mechanism, equilibrium)
    T = solver_velocities(mechanism, equilibrium) @ N
    M = T.T @ mass_matrix(flatten(mechanism)) @ T
    K = -M @ _by_position(mechanism, equilibrium, N)
    D = -M @ _by_velocity(mechanism, equilibrium, N)
    eigenvalues, shapes = _eigen(M, D, K)
    frequencies = np.abs(eigenvalues)
    neutral = frequencies <= _NEUTRAL * np.max(frequencies, initial=0.0)
    ratios = np.full(len(frequencies), np.nan)
    ratios[~neutral] = -eigenvalues.real[~neutral] / frequencies[~neutral]
    modes = (N @ shapes).T
    largest = np.argmax(np.abs(modes), axis=1)
    modes = modes / modes[np.arange(len(modes)), largest][:, None]
    return Linearisation(
        N, M, D, K, eigenvalues, frequencies, ratios, modes.reshape(-1, len(mechanism.bodies), 6).astype(np.complex128)
    )


def _eigen(M: Array, D: Array, K: Array) -> tuple[Complex, Complex]:
    """Eigenvalues s with ``(s^2 M + s D + K) x = 0`` and imaginary part >= 0, and x as columns."""
    d = len(M)
    if d == 0:
        return np.zeros(0, dtype=np.complex128), np.zeros((0, 0), dtype=np.complex128)
    # in coordinates in which M is 1, so that rounding does not depend on the units of the free directions
    L = np.linalg.cholesky(M)
    stiffness, damping = (np.linalg.solve(L, np.linalg.solve(L, X).T).T for X in (K, D))
    values, vectors = np.linalg.eig(np.block([[np.zeros((d, d)), np.eye(d)], [-stiffness, -damping]]))
    kept = np.flatnonzero(values.imag >= 0.0)
    kept = kept[np.argsort(np.abs(values[kept]), kind="stable")]
    shapes = np.linalg.solve(L.T, vectors[:d, kept])
    return values[kept].astype(np.complex128), shapes.astype(np.complex128)


def _accelerations(mechanism: Mechanism, equilibrium: State, states: Sequence[State]) -> Array:
    """Accelerations of the origins and angular ones (n, 6 n_b), world axes, up to terms even in the velocities.

    Angles of joint springs are counted on from the equilibrium.
    """
    model = flatten(mechanism)
    ws = workspace(model)
    turns, a = np.zeros(len(model.coordinate)), np.empty(6 * len(mechanism.bodies))
    count_turns(model, pack(mechanism, equilibrium), ws, turns)
    found = []
    for state in states:
        y = pack(mechanism, state)
        compiled_choice.accelerations(compiled_choice.FORMULATIONS["descriptor"], model, 0.0, y, turns.copy(), ws, a)
        found.append(np.linalg.solve(solver_velocities(mechanism, state), a))
    return np.array(found)


def _by_position(mechanism: Mechanism, equilibrium: State, N: Array) -> Array:
    """``dy''/dy``, shape (d, d)."""
    length = _length(mechanism, equilibrium)
    columns = []
    for direction in N.T:
        motion = np.abs(direction).reshape(-1, 6)
        step = _DIFFERENCE / max(float(np.max(motion[:, :3])) / length, float(np.max(motion[:, 3:])))
        steps = [step, step / 2, step / 4]
        states = [
            assemble_positions(mechanism, move(equilibrium, sign * h * direction)) for h in steps for sign in (1, -1)
        ]
        a = _accelerations(mechanism, equilibrium, states) @ N
        coarse, middle, fine = ((a[2 * n] - a[2 * n + 1]) / (2 * h) for n, h in enumerate(steps))
        first, second = (4 * middle - coarse) / 3, (4 * fine - middle) / 3
        columns.append((16 * second - first) / 15)
    return np.array(columns).reshape(N.shape[1], N.shape[1]).T


def _by_velocity(mechanism: Mechanism, equilibrium: State, N: Array) -> Array:
    """``dy''/dy'``, shape (d, d)."""
    columns = []
    for direction in N.T:
        moving = []
        for sign in (1.0, -1.0):
            v = sign * direction.reshape(-1, 6)
            moving.append(State(equilibrium.p_WB, equilibrium.quat_WB, v[:, :3], v[:, 3:]))
        ahead, behind = _accelerations(mechanism, equilibrium, moving) @ N
        columns.append(0.5 * (ahead - behind))
    return np.array(columns).reshape(N.shape[1], N.shape[1]).T


def _length(mechanism: Mechanism, state: State) -> float:
    """Smallest length over which forces change: that of the joints' arms, of a rod or of a spring, m."""
    lengths = [flatten(mechanism).length, *(j.length for j in mechanism.joints)]
    for s in mechanism.springs:
        start = body_point(mechanism, state, s.predecessor, s.point_predecessor)[0]
        end = body_point(mechanism, state, s.successor, s.point_successor)[0]
        lengths.append(float(np.linalg.norm(end - start)))
    return min(length for length in lengths if length > 0.0)
