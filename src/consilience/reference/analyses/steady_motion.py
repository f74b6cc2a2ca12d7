"""Linear vibrations about a steady motion: a relative equilibrium, in which only cyclic joint coordinates change.

Perturbations are taken in joint coordinates q, d of them independent, and their speeds u, which see the steady motion
at rest:

    x = (dq, du),    dq' = B dq + du,    du' = (df/dq) dq + (df/du + C) du,    x' = A x,

where ``u' = f(q, u)`` are the accelerations of the reference solver along the constraint manifold. A does not depend
on time, because f does not depend on the cyclic coordinates. For scalar coordinates B = C = 0. An orientation moves
steadily as ``R_FM = Rz(W t) R0 Rz(s t)``: precession W about z of F and spin s about z of M; perturbed,

    R_FM = Rz(W t) exp(~xi) R0 Rz(s t),    xi' = dw + s z_M x xi,    dw' = df - W z_F x dw,

to the first order, with xi and dw in axes of F that precess (Magnus, Kreisel, 1971; Landau and Lifshitz, section 35).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from consilience.errors import ConsilienceError, InvalidInput
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    assemble_positions,
    constraint_jacobian,
    free_directions,
    move,
    quaternion_product,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
    skew,
)
from consilience.reference.analyses.joint_rows import (
    JointCoordinate,
    all_coordinates,
    coordinate_rows,
    coordinate_values,
    named_coordinate,
    width,
)
from consilience.reference.analyses.linearisation import _DIFFERENCE, _NEUTRAL, Complex, _length
from consilience.reference.analyses.placing import require_holonomic
from consilience.reference.analyses.statics import force_scale
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.canonical import at_origins
from consilience.reference.bodies.forces import count_turns
from consilience.reference.formulations import compiled_choice
from consilience.reference.solver import simulate

_STEADY = 1e-7
"""Departure from a steady motion, over the speeds and accelerations in it, up to which a state counts as one."""
_INDEPENDENT = 1e-6
_Z = np.array([0.0, 0.0, 1.0])


class NotSteady(ConsilienceError):
    """The state does not lie on a steady motion in the coordinates named; the message says how far it is from one."""


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """Linear equations of motion about a steady motion of d degrees of freedom, and their modes.

    Attributes
    ----------
    coordinates : tuple of str
        Independent joint coordinates q, ``joint.coordinate``; components of a vector one by one, cyclic ones first.
    A : ndarray, shape (2 d, 2 d)
        ``x' = A x`` in their perturbations and those of their speeds (see the module), SI units of mixed kind.
    eigenvalues : complex ndarray, shape (m,), 1/s
        With imaginary part >= 0 (each pair of conjugates once, real ones each), by increasing magnitude. A cyclic
        coordinate has two that are zero.
    frequencies : ndarray, shape (m,), rad/s
        Magnitudes of the eigenvalues.
    damping_ratios : ndarray, shape (m,)
        ``-Re(s)/|s|``; not a number for a neutral direction.
    shapes : complex ndarray, shape (m, 2 d)
        Eigenvectors x.
    modes : complex ndarray, shape (m, n_b, 6)
        Displacements of the bodies' origins and rotation vectors (world axes) of each mode at the state given, largest
        component 1.
    """

    coordinates: tuple[str, ...]
    A: Array
    eigenvalues: Complex
    frequencies: Array
    damping_ratios: Array
    shapes: Complex
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


@dataclass(frozen=True, eq=False)
class _SteadyPoint:
    """A mechanism in steady motion: all coordinates, their values, their rows' speeds, B and C by rows."""

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
    """Linearise the equations of motion about a steady motion and solve for the modes.

    Parameters
    ----------
    mechanism : Mechanism
        Tree or loops, redundant rows included. Its joint coordinates must describe every motion it is free for.
    state : State
        Consistent state on the steady motion.
    cyclic : sequence of (joint, coordinate)
        Coordinates that change steadily. Scalar ones and positions at a constant rate; an orientation by precession
        about z of F and spin about z of M (where the two are parallel, by spin alone). All others rest.

    Returns
    -------
    SteadyMotion

    Raises
    ------
    InvalidInput
        Unknown coordinates; rolling bodies and skates; a motion that joint coordinates do not describe (the idle spin
        of a link between balls).
    NotSteady
        If other coordinates move, if speeds change, or if they do after a while: the coordinates are not cyclic.

    Notes
    -----
    df/dq: central differences at three steps of assembled states, extrapolated to the sixth order; df/du: one central
    difference, exact because accelerations are of second degree in the speeds. That the motion stays steady is
    checked by the reference solver, over one radian of its fastest coordinate. Angles of joint springs are in
    (-pi, pi] at the state.
    """
    why = "it holds velocities: perturbations of positions and of speeds differ in number"
    require_holonomic(mechanism, why, "Differentiate accelerations along the motion.")
    point = _frame(mechanism, state, [named_coordinate(mechanism, *name, "cyclic") for name in cyclic])
    _require_steady(point)
    N = free_directions(mechanism, state)
    rows = _independent(point, N)
    D, df_dq = _by_position(point, N, rows)
    df_du = _by_speed(point, rows)
    block = np.ix_(rows, rows)
    df_dq = np.linalg.solve(D.T, df_dq.T).T
    A = np.block([[point.B[block], np.eye(len(rows))], [df_dq, df_du + point.C[block]]])
    values, vectors = np.linalg.eig(A) if len(A) else (np.zeros(0, complex), np.zeros((0, 0), complex))
    kept = np.flatnonzero(values.imag >= 0.0)
    kept = kept[np.argsort(np.abs(values[kept]), kind="stable")]
    eigenvalues, shapes = values[kept].astype(np.complex128), vectors[:, kept].T.astype(np.complex128)
    frequencies = np.abs(eigenvalues)
    moving = frequencies > _NEUTRAL * np.max(frequencies, initial=0.0)
    ratios = np.full(len(frequencies), np.nan)
    ratios[moving] = -eigenvalues.real[moving] / frequencies[moving]
    modes = (N @ np.linalg.solve(D.astype(complex), shapes[:, : len(rows)].T)).T
    largest = np.argmax(np.abs(modes), axis=1)
    modes = modes / modes[np.arange(len(modes)), largest][:, None]
    labels = _labels(point.wanted)
    return SteadyMotion(
        tuple(labels[row] for row in rows),
        A,
        eigenvalues,
        frequencies,
        ratios,
        shapes,
        modes.reshape(-1, len(mechanism.bodies), 6),
    )


def _labels(wanted: Sequence[JointCoordinate]) -> list[str]:
    return [
        f"{joint.name}.{name}" + (f"[{k}]" if width(name) == 3 else "")
        for joint, name in wanted
        for k in range(width(name))
    ]


def _frame(mechanism: Mechanism, state: State, cyclic: list[JointCoordinate]) -> _SteadyPoint:
    """The motion at the state, cyclic coordinates first."""
    wanted = [*cyclic, *(c for c in all_coordinates(mechanism) if c not in cyclic)]
    unturned = {"orientation": np.array([1.0, 0.0, 0.0, 0.0])}
    values = coordinate_values(mechanism, state, {c: unturned.get(c[1], np.zeros(())) for c in wanted})
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
    """Angular velocity, axes of F, as one about z of F and one about z of M; the latter alone where they agree."""
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
    """The speeds are the same after a while, up to the precession of an orientation."""
    run = simulate(point.mechanism, point.state, np.array([0.0, span]))
    later = State(run.p_WB[-1], run.quat_WB[-1], run.v_WB_W[-1], run.w_WB_W[-1])
    rows, _ = coordinate_rows(point.mechanism, later, point.wanted)
    u = rows @ np.hstack([later.v_WB_W, later.w_WB_W]).ravel()
    asked = scipy.linalg.expm(-span * point.C) @ point.u
    wrong = np.abs(u - asked)
    if np.max(wrong) > _STEADY * float(np.max(np.abs(point.u))):
        worst = int(np.argmax(wrong))
        raise NotSteady(
            f"mechanism '{point.mechanism.name}': the motion is not steady: the speed of "
            f"'{_labels(point.wanted)[worst]}' has changed by {wrong[worst]:.3g} after {span:.3g} s. "
            "The coordinates named are not cyclic."
        )


def _independent(point: _SteadyPoint, N: Array) -> Array:
    """Rows of coordinates that describe all free directions, the cyclic ones before all others."""
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
    """The pose with given speeds of the independent coordinates."""
    Q = constraint_jacobian(point.mechanism, placed)
    all_rows, _ = coordinate_rows(point.mechanism, placed, point.wanted)
    S, b = np.vstack([Q, all_rows[rows]]), np.concatenate([np.zeros(len(Q)), u])
    v = np.linalg.lstsq(S, b, rcond=None)[0]
    v = (v + np.linalg.lstsq(S, b - S @ v, rcond=None)[0]).reshape(-1, 6)
    return State(placed.p_WB, placed.quat_WB, v[:, :3], v[:, 3:])


def _rates(point: _SteadyPoint, states: Sequence[State]) -> tuple[Array, Array]:
    """``u'`` of all coordinates, (n, rows), and accelerations of all bodies, (n, 6 n_b), world axes.

    The one place that calls the solver. Angles of joint springs are counted on from the steady motion.
    """
    model = flatten(point.mechanism)
    ws = workspace(model)
    turns, a = np.zeros(len(model.coordinate)), np.empty(6 * len(point.mechanism.bodies))
    count_turns(model, pack(point.mechanism, point.state), ws, turns)
    rates, bodies = [], []
    for state in states:
        y = pack(point.mechanism, state)
        compiled_choice.accelerations(compiled_choice.FORMULATIONS["descriptor"], model, 0.0, y, turns.copy(), ws, a)
        of_bodies = np.hstack(at_origins(point.mechanism, y, a)).ravel()
        rows, drift = coordinate_rows(point.mechanism, state, point.wanted)
        rates.append(rows @ of_bodies + drift)
        bodies.append(of_bodies)
    return np.array(rates), np.array(bodies)


def _displacement(point: _SteadyPoint, state: State) -> Array:
    """Coordinates less those of the steady motion, by rows; of an orientation the rotation vector xi, axes of F."""
    values = coordinate_values(point.mechanism, state, point.values)
    parts = [np.zeros(0)]
    for coordinate in point.wanted:
        now, before = values[coordinate], point.values[coordinate]
        if coordinate[1] == "orientation":
            turn = quaternion_product(now, before * np.array([1.0, -1.0, -1.0, -1.0]))
            parts.append(rotation_vector_from_quaternion(turn))
        else:
            parts.append(np.atleast_1d(now - before))
    return np.concatenate(parts)


def _by_position(point: _SteadyPoint, N: Array, rows: Array) -> tuple[Array, Array]:
    """Derivatives of the independent coordinates and of their accelerations along N, at fixed speeds, each (d, d)."""
    length = _length(point.mechanism, point.state)
    columns = []
    for direction in N.T:
        motion = np.abs(direction).reshape(-1, 6)
        step = _DIFFERENCE / max(float(np.max(motion[:, :3])) / length, float(np.max(motion[:, 3:])))
        steps = [step, step / 2, step / 4]
        states = []
        for h in steps:
            for sign in (1.0, -1.0):
                placed = assemble_positions(point.mechanism, move(point.state, sign * h * direction))
                states.append(_moving(point, placed, rows, point.u[rows]))
        rates = _rates(point, states)[0][:, rows]
        both = np.hstack([np.array([_displacement(point, s)[rows] for s in states]), rates])
        coarse, middle, fine = ((both[2 * n] - both[2 * n + 1]) / (2 * h) for n, h in enumerate(steps))
        first, second = (4 * middle - coarse) / 3, (4 * fine - middle) / 3
        columns.append((16 * second - first) / 15)
    d = len(rows)
    table = np.array(columns).reshape(d, 2 * d).T
    return table[:d], table[d:]


def _by_speed(point: _SteadyPoint, rows: Array) -> Array:
    """``df/du``, shape (d, d)."""
    size = max(1.0, float(np.max(np.abs(point.u), initial=0.0)))
    columns = []
    for direction in np.eye(len(rows)):
        moving = [_moving(point, point.state, rows, point.u[rows] + s * size * direction) for s in (1.0, -1.0)]
        ahead, behind = _rates(point, moving)[0][:, rows]
        columns.append((ahead - behind) / (2.0 * size))
    return np.array(columns).reshape(len(rows), len(rows)).T
