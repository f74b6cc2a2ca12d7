"""Linear vibrations about a static equilibrium: ``M y'' + D y' + K y = 0`` in the free directions.

Also the spectrum, differences and modes that `steady_motion` shares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from consilience.errors import InvalidInput
from consilience.mechanism import (
    Array,
    Friction,
    JointSpring,
    Mechanism,
    State,
    assemble_positions,
    free_directions,
    friction_law,
    joint_spring_motion,
    move,
    spring_damper_law,
)
from consilience.reference.analyses.joint_rows import with_velocities
from consilience.reference.analyses.statics import (
    require_equilibrium,
    require_static,
    solver_velocities,
    spring_length,
    step_size,
)
from consilience.reference.analyses.touching import refuse_touching
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.formulations import descriptor

Complex = NDArray[np.complex128]

_DIFFERENCE = 0.003
"""Largest displacement of the differences, rad and lengths of the mechanism: truncation (sixth order) and rounding are
then both about 1e-11, relative."""
_EQUILIBRIUM = 1e-8
NEUTRAL = 1e-5
"""Eigenvalues below this fraction of the largest count as zero: they are the square root of rounding errors."""


class Spectrum:
    """Frequencies in Hz and stability of linear equations of motion with given eigenvalues."""

    eigenvalues: Complex
    frequencies: Array

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies in Hz, shape (m,)."""
        return self.frequencies / (2.0 * np.pi)

    @property
    def stable(self) -> bool:
        """Whether no mode grows; neutral directions count as not growing."""
        limit = NEUTRAL * float(np.max(self.frequencies, initial=0.0))
        return bool(np.all(self.eigenvalues.real <= limit))


@dataclass(frozen=True, eq=False)
class Linearisation(Spectrum):
    """Linear equations of motion about an equilibrium, d degrees of freedom, and their modes.

    Attributes
    ----------
    directions : ndarray, shape (6 n_b, d)
        Orthonormal free directions J: ``(v_WB_W, w_WB_W) = J y'`` (m/s and rad/s, world axes).
    M, D, K : ndarray, shape (d, d)
        Mass, damping and stiffness matrices in the coordinates y (SI units of mixed kind). K includes the geometric
        stiffness of the joint reactions; K is symmetric if the forces have a potential.
    eigenvalues : complex ndarray, shape (m,), 1/s
        Eigenvalues with imaginary part >= 0 (one of each conjugate pair, all real ones), by increasing magnitude.
    frequencies : ndarray, shape (m,), rad/s
        Natural frequencies, the magnitudes of the eigenvalues.
    damping_ratios : ndarray, shape (m,)
        ``-Re(s)/|s|``: 0 undamped, 1 aperiodic, negative growing; NaN for a neutral direction.
    modes : complex ndarray, shape (m, n_b, 6)
        Velocities of the body origins and angular velocities, world axes, of each mode; largest component 1.
    """

    directions: Array
    M: Array
    D: Array
    K: Array
    eigenvalues: Complex
    frequencies: Array
    damping_ratios: Array
    modes: Complex


def linearise(mechanism: Mechanism, equilibrium: State) -> Linearisation:
    """Linearise the equations of motion about a static equilibrium; compute the modes.

    Parameters
    ----------
    mechanism : Mechanism
    equilibrium : State
        Consistent state of rest in equilibrium (see `static_equilibrium`).

    Returns
    -------
    Linearisation

    Raises
    ------
    InvalidInput
        A state or drive in motion, a controller with an integral, or contacts, stops or dry friction that act.
    NoEquilibrium
        If the forces along the free directions do not vanish.

    Notes
    -----
    ``dy'' = -M^-1 (K dy + D dy')`` by differences of accelerations at consistent states, so that K includes the
    contribution of reactions. K: central differences at three steps, the largest 0.003 rad or lengths, extrapolated to
    the sixth order (Richardson). D: one central difference, exact because accelerations are of second degree in the
    velocities once dampers and friction in joints are replaced by their tangents. M: minimal form ``J^T M J`` [C4
    (4.99)-(4.110)]. Angles of joint springs are in (-pi, pi] at the equilibrium. Forces that are not differentiable (a
    spring of zero length) have no linearisation.
    """
    if np.any(equilibrium.v_WB_W) or np.any(equilibrium.w_WB_W):
        raise InvalidInput("equilibrium", "the state moves", "Give a state of rest, for example of static_equilibrium.")
    require_static(mechanism)
    refuse_touching(mechanism, equilibrium)
    require_equilibrium(mechanism, equilibrium, _EQUILIBRIUM)
    N = free_directions(mechanism, equilibrium)
    T = solver_velocities(mechanism, equilibrium) @ N
    M = T.T @ mass_matrix(flatten(mechanism)) @ T
    K = -M @ _by_position(mechanism, equilibrium, N)
    D = -M @ _by_velocity(mechanism, equilibrium, N)
    eigenvalues, shapes = _eigen(M, D, K)
    modes = normalised_modes((N @ shapes).T).astype(np.complex128)
    return Linearisation(N, M, D, K, eigenvalues, np.abs(eigenvalues), damping_ratios(eigenvalues), modes)


def damping_ratios(eigenvalues: Complex) -> Array:
    """Return ``-Re(s)/|s|`` of eigenvalues s, NaN where s counts as zero."""
    frequencies = np.abs(eigenvalues)
    moving = frequencies > NEUTRAL * np.max(frequencies, initial=0.0)
    ratios = np.full(len(frequencies), np.nan)
    ratios[moving] = -eigenvalues.real[moving] / frequencies[moving]
    return ratios


def normalised_modes(modes: Complex) -> Complex:
    """Scale modes, shape (m, 6 n_b), to the largest component 1; shape (m, n_b, 6)."""
    largest = np.argmax(np.abs(modes), axis=1)
    scaled: Complex = modes / modes[np.arange(len(modes)), largest][:, None]
    return scaled.reshape(-1, modes.shape[1] // 6, 6)


def upper_half_plane(values: Complex) -> NDArray[np.intp]:
    """Return the indices of eigenvalues with imaginary part >= 0, by increasing magnitude."""
    kept = np.flatnonzero(values.imag >= 0.0)
    return kept[np.argsort(np.abs(values[kept]), kind="stable")]


def _eigen(M: Array, D: Array, K: Array) -> tuple[Complex, Complex]:
    """Return eigenvalues s of ``(s^2 M + s D + K) x = 0`` with imaginary part >= 0, and x as columns."""
    d = len(M)
    if d == 0:
        return np.zeros(0, dtype=np.complex128), np.zeros((0, 0), dtype=np.complex128)
    # in coordinates with M = 1: rounding does not depend on the units of the free directions
    L = np.linalg.cholesky(M)
    stiffness, damping = (np.linalg.solve(L, np.linalg.solve(L, X).T).T for X in (K, D))
    values, vectors = np.linalg.eig(np.block([[np.zeros((d, d)), np.eye(d)], [-stiffness, -damping]]))
    kept = upper_half_plane(values)
    shapes = np.linalg.solve(L.T, vectors[:d, kept])
    return values[kept].astype(np.complex128), shapes.astype(np.complex128)


def _accelerations(mechanism: Mechanism, equilibrium: State, states: Sequence[State]) -> Array:
    """Return the accelerations of body origins and angular accelerations (n, 6 n_b), up to terms even in velocities."""
    found = solver_accelerations(mechanism, equilibrium, states)
    return np.array(
        [np.linalg.solve(solver_velocities(mechanism, s), a) for s, (_, a) in zip(states, found, strict=True)]
    )


def solver_accelerations(mechanism: Mechanism, start: State, states: Sequence[State]) -> list[tuple[Array, Array]]:
    """Return the packed state and (dv/dt, dw'/dt), shape (6 n_b,), of each state; turns are counted from `start`."""
    model = flatten(mechanism)
    ws, turns = workspace(model), np.zeros(len(model.coordinate))
    count_turns(model, pack(mechanism, start), ws, turns)
    found = []
    for state in states:
        y, a = pack(mechanism, state), np.empty(6 * len(mechanism.bodies))
        descriptor.accelerations(model, 0.0, y, turns.copy(), ws, a)
        found.append((y, a))
    return found


def derivatives_along(
    mechanism: Mechanism, start: State, N: Array, values: Callable[[list[State]], Array]
) -> list[Array]:
    """Differentiate ``values(states)``, shape (n, m), along the columns of N; one array (m,) for each column.

    Central differences of assembled states at three steps, extrapolated to the sixth order (Richardson).
    """
    length = _shortest_length(mechanism, start)
    columns = []
    for direction in N.T:
        step = _DIFFERENCE / step_size(direction, length)
        steps = [step, step / 2, step / 4]
        found = values(
            [assemble_positions(mechanism, move(start, sign * h * direction)) for h in steps for sign in (1, -1)]
        )
        coarse, middle, fine = ((found[2 * n] - found[2 * n + 1]) / (2 * h) for n, h in enumerate(steps))
        first, second = (4 * middle - coarse) / 3, (4 * fine - middle) / 3
        columns.append((16 * second - first) / 15)
    return columns


def _by_position(mechanism: Mechanism, equilibrium: State, N: Array) -> Array:
    """Return ``dy''/dy``, shape (d, d)."""
    columns = derivatives_along(mechanism, equilibrium, N, lambda s: _accelerations(mechanism, equilibrium, s) @ N)
    return np.array(columns).reshape(N.shape[1], N.shape[1]).T


def _by_velocity(mechanism: Mechanism, equilibrium: State, N: Array) -> Array:
    """Return ``dy''/dy'``, shape (d, d)."""
    columns = []
    mechanism = with_tangent_dampers(mechanism, equilibrium)
    for direction in N.T:
        moving = [with_velocities(equilibrium, sign * direction) for sign in (1.0, -1.0)]
        ahead, behind = _accelerations(mechanism, equilibrium, moving) @ N
        columns.append(0.5 * (ahead - behind))
    return np.array(columns).reshape(N.shape[1], N.shape[1]).T


def with_tangent_dampers(mechanism: Mechanism, state: State) -> Mechanism:
    """Return the mechanism with linear dampers in place of nonlinear ones and of friction, of their slopes at a state.

    Their efforts at the state itself are others.
    """

    def spring(s: JointSpring) -> JointSpring:
        _, rate = joint_spring_motion(mechanism, state, s.joint, s.coordinate)
        return replace(s, damping=spring_damper_law(0.0, rate, *s.laws)[1], higher_damping=())

    def friction(f: Friction) -> Friction:
        _, rate = joint_spring_motion(mechanism, state, f.joint, f.coordinate)
        return replace(f, viscous=friction_law(rate, f.viscous, f.coulomb, f.speed)[1], coulomb=0.0)

    springs = tuple(s if s.is_linear else spring(s) for s in mechanism.joint_springs)
    return replace(mechanism, joint_springs=springs, frictions=tuple(friction(f) for f in mechanism.frictions))


def _shortest_length(mechanism: Mechanism, state: State) -> float:
    """Return the shortest length over which forces change: of the joints' arms, of a rod or of a spring, m."""
    lengths = [flatten(mechanism).length, *(j.length for j in mechanism.joints)]
    lengths += [spring_length(mechanism, state, spring) for spring in mechanism.springs]
    return min(length for length in lengths if length > 0.0)
