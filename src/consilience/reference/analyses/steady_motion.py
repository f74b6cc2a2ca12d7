"""Linear vibrations about a steady motion (relative equilibrium), in which only cyclic joint coordinates change.

Perturbations of d independent joint coordinates q and of their speeds u obey

    x = (dq, du),    dq' = B dq + du,    du' = (df/dq) dq + (df/du + C) du,    x' = A x,

with the accelerations ``u' = f(q, u)`` of the reference solver along the constraint manifold. A is constant, because f
does not depend on the cyclic coordinates. For scalar coordinates B = C = 0. The steady motion of an orientation is
``R_FM = Rz(W t) R0 Rz(s t)``, precession W about z of F and spin s about z of M; its perturbation is

    R_FM = Rz(W t) exp(~xi) R0 Rz(s t),    xi' = dw + s z_M x xi,    dw' = df - W z_F x dw,

to first order, xi and dw in precessing axes of F (Magnus, Kreisel, 1971; Landau and Lifshitz, section 35).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from consilience.errors import ConsilienceError, InvalidInput
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    constraint_jacobian,
    free_directions,
    rotation_from_quaternion,
    skew,
)
from consilience.reference.analyses.joint_rows import (
    JointCoordinate,
    all_coordinates,
    coordinate_rows,
    coordinate_values,
    least_squares,
    named_coordinate,
    turn_between,
    unturned,
    width,
    with_velocities,
)
from consilience.reference.analyses.linearisation import (
    Complex,
    Spectrum,
    damping_ratios,
    derivatives_along,
    normalised_modes,
    solver_accelerations,
    upper_half_plane,
    with_tangent_dampers,
)
from consilience.reference.analyses.placing import require_holonomic
from consilience.reference.analyses.statics import force_scale
from consilience.reference.analyses.touching import refuse_touching
from consilience.reference.bodies.canonical import at_origins
from consilience.reference.solver import simulate

_STEADY = 1e-7
"""Largest deviation of a steady motion, relative to its speeds and accelerations."""
_INDEPENDENT = 1e-6
_Z = np.array([0.0, 0.0, 1.0])


class NotSteady(ConsilienceError):
    """The motion is not steady in the named coordinates; the message tells the deviation."""


@dataclass(frozen=True, eq=False)
class SteadyMotion(Spectrum):
    """Linear equations of motion about a steady motion of d degrees of freedom, and their modes.

    Attributes
    ----------
    coordinates : tuple of str
        Independent joint coordinates q, ``joint.coordinate``, vectors by component; cyclic coordinates first.
    A : ndarray, shape (2 d, 2 d)
        ``x' = A x``, x the perturbations of the coordinates and of their speeds, SI units of mixed kind.
    eigenvalues : complex ndarray, shape (m,), 1/s
        Eigenvalues with imaginary part >= 0 (one of each conjugate pair, all real ones), by increasing magnitude; two
        are zero for each cyclic coordinate.
    frequencies : ndarray, shape (m,), rad/s
        Magnitudes of the eigenvalues.
    damping_ratios : ndarray, shape (m,)
        ``-Re(s)/|s|``; NaN for a neutral direction.
    shapes : complex ndarray, shape (m, 2 d)
        Eigenvectors x.
    modes : complex ndarray, shape (m, n_b, 6)
        Displacements of the body origins and rotation vectors, world axes, of each mode at the given state; largest
        component 1.
    """

    coordinates: tuple[str, ...]
    A: Array
    eigenvalues: Complex
    frequencies: Array
    damping_ratios: Array
    shapes: Complex
    modes: Complex


@dataclass(frozen=True, eq=False)
class _SteadyPoint:
    """Steady motion at one state: coordinates, values, speeds u, B, C and expected accelerations by rows."""

    mechanism: Mechanism
    state: State
    wanted: list[JointCoordinate]
    cyclic: set[int]
    values: dict[JointCoordinate, Array]
    u: Array
    B: Array
    C: Array
    expected: Array


def linearise_steady_motion(mechanism: Mechanism, state: State, cyclic: Sequence[tuple[str, str]]) -> SteadyMotion:
    """Linearise the equations of motion about a steady motion; compute the modes.

    Parameters
    ----------
    mechanism : Mechanism
        Tree or loops, also with redundant rows. The joint coordinates must describe all degrees of freedom.
    state : State
        Consistent state on the steady motion.
    cyclic : sequence of (joint, coordinate)
        Coordinates that change: scalars and positions at a constant rate, an orientation by precession about z of F and
        spin about z of M (by spin alone if the axes are parallel). All other coordinates rest.

    Returns
    -------
    SteadyMotion

    Raises
    ------
    InvalidInput
        Unknown coordinates; rolling bodies and skates; a freedom that joint coordinates do not describe (the spin of a
        link between two spherical joints); contacts, stops or dry friction that act.
    NotSteady
        If other coordinates move, or if speeds change at the state or after one radian of motion.

    Notes
    -----
    df/dq: central differences of assembled states, extrapolated to the sixth order; df/du: one difference, exact
    because accelerations are of second degree in the speeds, with tangents of dampers and friction in joints. An
    integration over one radian of the fastest coordinate checks that the motion stays steady. Angles of joint springs
    are in (-pi, pi] at the state.
    """
    why = "it holds velocities: perturbations of positions and of speeds differ in number"
    require_holonomic(mechanism, why, "Differentiate accelerations along the motion.")
    refuse_touching(mechanism, state)
    point = _steady_point(mechanism, state, [named_coordinate(mechanism, *name, "cyclic") for name in cyclic])
    _require_steady(point)
    N = free_directions(mechanism, state)
    rows = _independent(point, N)
    D, df_dq = _by_position(point, N, rows)
    df_du = _by_speed(point, rows)
    block = np.ix_(rows, rows)
    df_dq = np.linalg.solve(D.T, df_dq.T).T
    A = np.block([[point.B[block], np.eye(len(rows))], [df_dq, df_du + point.C[block]]])
    values, vectors = np.linalg.eig(A) if len(A) else (np.zeros(0, complex), np.zeros((0, 0), complex))
    kept = upper_half_plane(values)
    eigenvalues, shapes = values[kept].astype(np.complex128), vectors[:, kept].T.astype(np.complex128)
    modes = (N @ np.linalg.solve(D.astype(complex), shapes[:, : len(rows)].T)).T
    labels = _labels(point.wanted)
    return SteadyMotion(
        tuple(labels[row] for row in rows),
        A,
        eigenvalues,
        np.abs(eigenvalues),
        damping_ratios(eigenvalues),
        shapes,
        normalised_modes(modes),
    )


def _labels(wanted: Sequence[JointCoordinate]) -> list[str]:
    return [
        f"{joint.name}.{name}" + (f"[{k}]" if width(name) == 3 else "")
        for joint, name in wanted
        for k in range(width(name))
    ]


def _steady_point(mechanism: Mechanism, state: State, cyclic: list[JointCoordinate]) -> _SteadyPoint:
    """Evaluate the steady motion at a state, cyclic coordinates first."""
    wanted = [*cyclic, *(c for c in all_coordinates(mechanism) if c not in cyclic)]
    values = coordinate_values(mechanism, state, unturned(wanted))
    rows, _ = coordinate_rows(mechanism, state, wanted)
    u = rows @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    n = len(u)
    B, C, expected, first = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), 0
    cyclic_rows = set(range(sum(width(name) for _, name in cyclic)))
    for joint, name in wanted:
        here = slice(first, first + width(name))
        first = here.stop
        if name == "orientation" and here.start in cyclic_rows:
            precession, spin = _precession_and_spin(mechanism, joint.name, values[joint, name], u[here])
            B[here, here], C[here, here] = skew(spin), -skew(precession)
            expected[here] = np.cross(precession, u[here])
    return _SteadyPoint(mechanism, state, wanted, cyclic_rows, values, u, B, C, expected)


def _precession_and_spin(mechanism: Mechanism, joint: str, quat: Array, w: Array) -> tuple[Array, Array]:
    """Split an angular velocity, axes of F, into parts about z of F and z of M; the latter alone if parallel."""
    axes = np.column_stack([_Z, rotation_from_quaternion(quat)[:, 2]])
    if np.linalg.norm(np.cross(axes[:, 0], axes[:, 1])) < 1e-9:
        axes[:, 0] = 0.0
    parts = np.linalg.lstsq(axes, w, rcond=1e-12)[0]
    left = float(np.linalg.norm(w - axes @ parts))
    if left > _STEADY * float(np.linalg.norm(w)):
        raise NotSteady(
            f"mechanism '{mechanism.name}': the orientation of joint '{joint}' nutates: {left:.3g} rad/s are left "
            "beside a precession about z of F and a spin about z of M."
        )
    return parts[0] * axes[:, 0], parts[1] * axes[:, 1]


def _require_steady(point: _SteadyPoint) -> None:
    mechanism, labels = point.mechanism, _labels(point.wanted)
    fastest = float(np.max(np.abs(point.u), initial=0.0))
    for row, speed in enumerate(point.u):
        if row not in point.cyclic and abs(speed) > _STEADY * fastest:
            raise NotSteady(f"mechanism '{mechanism.name}': '{labels[row]}' is not cyclic, but moves at {speed:.3g}.")
    accelerations = _rates(point, [point.state])
    free = force_scale(mechanism, point.state) / sum(b.mass for b in mechanism.bodies)
    scale = max(float(np.max(np.abs(accelerations[1]))), fastest**2, free)
    wrong = np.abs(accelerations[0][0] - point.expected)
    if np.max(wrong, initial=0.0) > _STEADY * scale:
        worst = int(np.argmax(wrong))
        raise NotSteady(
            f"mechanism '{mechanism.name}': the motion is not steady: '{labels[worst]}' accelerates by "
            f"{wrong[worst]:.3g} (m/s^2, rad/s^2), {wrong[worst] / scale:.3g} of the accelerations in it."
        )
    if fastest > 0.0:
        _require_lasting(point, 1.0 / fastest)


def _require_lasting(point: _SteadyPoint, span: float) -> None:
    """Refuse a motion whose speeds change within `span` s, up to the precession of orientations."""
    run = simulate(point.mechanism, point.state, np.array([0.0, span]))
    later = State(run.p_WB[-1], run.quat_WB[-1], run.v_WB_W[-1], run.w_WB_W[-1])
    rows, _ = coordinate_rows(point.mechanism, later, point.wanted)
    u = rows @ np.hstack([later.v_WB_W, later.w_WB_W]).ravel()
    expected = scipy.linalg.expm(-span * point.C) @ point.u
    wrong = np.abs(u - expected)
    if np.max(wrong) > _STEADY * float(np.max(np.abs(point.u))):
        worst = int(np.argmax(wrong))
        raise NotSteady(
            f"mechanism '{point.mechanism.name}': the motion is not steady: the speed of "
            f"'{_labels(point.wanted)[worst]}' has changed by {wrong[worst]:.3g} after {span:.3g} s. "
            "The coordinates named are not cyclic."
        )


def _independent(point: _SteadyPoint, N: Array) -> Array:
    """Choose rows of independent coordinates that describe all free directions, cyclic ones first."""
    rows, _ = coordinate_rows(point.mechanism, point.state, point.wanted)
    G, n = rows @ N, len(point.cyclic)
    sizes = np.linalg.svd(G[:n], compute_uv=False)
    if n and (n > N.shape[1] or sizes[-1] < _INDEPENDENT * sizes[0]):
        raise InvalidInput("cyclic", "the coordinates named depend on one another", "Name independent ones.")
    basis, _ = np.linalg.qr(G[:n].T)
    _, R, order = scipy.linalg.qr((G[n:] - (G[n:] @ basis) @ basis.T).T, mode="economic", pivoting=True)
    more = N.shape[1] - n
    if more and (len(order) < more or abs(R[more - 1, more - 1]) < _INDEPENDENT):
        raise InvalidInput(
            f"mechanism '{point.mechanism.name}'",
            f"its joint coordinates do not describe all of its {N.shape[1]} degrees of freedom",
            "Use a universal joint at one end of a link between two balls, joints in place of rods.",
        )
    return np.array([*range(n), *(n + np.sort(order[:more]))], dtype=int)


def _moving(point: _SteadyPoint, placed: State, rows: Array, u: Array) -> State:
    """Return a pose with velocities of given speeds of the independent coordinates."""
    Q = constraint_jacobian(point.mechanism, placed)
    all_rows, _ = coordinate_rows(point.mechanism, placed, point.wanted)
    S, b = np.vstack([Q, all_rows[rows]]), np.concatenate([np.zeros(len(Q)), u])
    return with_velocities(placed, least_squares(S, b))


def _rates(point: _SteadyPoint, states: Sequence[State]) -> tuple[Array, Array]:
    """Return ``u'`` of all coordinates, (n, rows), and accelerations of all bodies, (n, 6 n_b), world axes."""
    rates, bodies = [], []
    found = solver_accelerations(point.mechanism, point.state, states)
    for state, (y, a) in zip(states, found, strict=True):
        of_bodies = np.hstack(at_origins(point.mechanism, y, a)).ravel()
        rows, drift = coordinate_rows(point.mechanism, state, point.wanted)
        rates.append(rows @ of_bodies + drift)
        bodies.append(of_bodies)
    return np.array(rates), np.array(bodies)


def _displacement(point: _SteadyPoint, state: State) -> Array:
    """Return coordinates minus those of the steady motion, by rows; orientations as rotation vectors xi, axes of F."""
    values = coordinate_values(point.mechanism, state, point.values)
    parts = [np.zeros(0)]
    for coordinate in point.wanted:
        now, before = values[coordinate], point.values[coordinate]
        parts.append(turn_between(before, now) if coordinate[1] == "orientation" else np.atleast_1d(now - before))
    return np.concatenate(parts)


def _by_position(point: _SteadyPoint, N: Array, rows: Array) -> tuple[Array, Array]:
    """Differentiate independent coordinates and their accelerations along N at fixed speeds, each (d, d)."""

    def values(placed: list[State]) -> Array:
        states = [_moving(point, state, rows, point.u[rows]) for state in placed]
        displacements = np.array([_displacement(point, s)[rows] for s in states])
        return np.hstack([displacements, _rates(point, states)[0][:, rows]])

    d = len(rows)
    table = np.array(derivatives_along(point.mechanism, point.state, N, values)).reshape(d, 2 * d).T
    return table[:d], table[d:]


def _by_speed(point: _SteadyPoint, rows: Array) -> Array:
    """Return ``df/du``, shape (d, d)."""
    size = max(1.0, float(np.max(np.abs(point.u), initial=0.0)))
    point = replace(point, mechanism=with_tangent_dampers(point.mechanism, point.state))
    columns = []
    for direction in np.eye(len(rows)):
        moving = [_moving(point, point.state, rows, point.u[rows] + s * size * direction) for s in (1.0, -1.0)]
        ahead, behind = _rates(point, moving)[0][:, rows]
        columns.append((ahead - behind) / (2.0 * size))
    return np.array(columns).reshape(len(rows), len(rows)).T
