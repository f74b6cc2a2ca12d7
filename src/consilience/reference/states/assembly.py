"""Assembly of a known mechanism, compiled: the method of `consilience.mechanism.assembly`, on the rows of the kernels.

Poses by Newton's method with steps of least norm, velocities by least squares, displacements of the bodies' origins in
characteristic lengths and rad. The compiled method answers only where nothing is in doubt. A residual that stays, a
guess that a dead centre may block, a joint that flips over, rates that contradict each other: there the method in NumPy
decides, and words the refusal.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array, Initial, Mechanism, State, characteristic_length, require_states, row_sizes
from consilience.mechanism.assembly import CONVERGED, LONGEST_WAY, MAX_ITERATIONS, HeldCoordinates, held_sizes
from consilience.mechanism.start import Start, assemble, checked_start
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import ROWS, Model, flatten, holonomic_rows, workspace
from consilience.reference.bodies.motion import arm
from consilience.reference.kernel.compiled import inner, threaded
from consilience.reference.kernel.least_squares import factorise_rows, least_squares, solve_transposed
from consilience.reference.kernel.mechanism_record import fields_of, record_array
from consilience.reference.kernel.vectors import add, assign, column, cross, dot, load, scale, store
from consilience.reference.states.assembly_rows import (
    HELD,
    HELD_KINDS,
    ORIENTATION,
    POSITION,
    AssemblyArrays,
    evaluate,
    place_bodies,
    write_held,
    write_rows,
)

_LARGEST_LEFT = 1e-3
"""Residual of the linear model, in rad or characteristic lengths, above which a dead centre may be in the way."""

_CONTRADICTION = 1e-10
"""Residual of rates, over the largest rate, above which rates contradict each other."""

_D12, _D13 = ROWS.index("D12"), ROWS.index("D13")


@inner
def _solve(a: AssemblyArrays) -> int:
    """Compute the step of least norm that minimises ``|J step - right|``; return the rank."""
    for row in range(a.J.shape[0]):
        for c in range(a.J.shape[1]):
            a.by.B[c, row] = a.J[row, c]
    rank = factorise_rows(a.by)
    solve_transposed(a.by, rank, a.right, a.step)
    return rank


@inner
def _left(a: AssemblyArrays, x: Array) -> float:
    """Return the largest entry of ``|J x - right|``."""
    largest = 0.0
    for row in range(a.J.shape[0]):
        s = -a.right[row]
        for c in range(x.shape[0]):
            s += a.J[row, c] * x[c]
        largest = max(largest, abs(s)) if np.isfinite(s) else np.inf
    return largest


@inner
def _move(a: AssemblyArrays, most: float) -> None:
    """Move the poses by minus the step, at most by `most` characteristic lengths and a radian."""
    largest = 1.0
    for n in range(a.step.shape[0]):
        largest = max(largest, abs(a.step[n]) / (most if n % 6 < 3 else 1.0))
    for b in range(a.pose.shape[0]):
        dr, phi = load(a.step[6 * b : 6 * b + 3]), load(a.step[6 * b + 3 : 6 * b + 6])
        store(a.pose[b, 0:3], add(load(a.pose[b, 0:3]), scale(-a.length / largest, dr)), 1.0)
        phi = scale(-1.0 / largest, phi)
        angle = np.sqrt(dot(phi, phi))
        u0 = np.cos(0.5 * angle)
        u = scale(np.sin(0.5 * angle) / angle if angle > 0.0 else 0.5, phi)
        e0, e = a.pose[b, 3], load(a.pose[b, 4:7])
        turned = add(add(scale(u0, e), scale(e0, u)), cross(u, e))
        first = u0 * e0 - dot(u, e)
        norm = np.sqrt(first * first + dot(turned, turned))
        a.pose[b, 3] = first / norm
        store(a.pose[b, 4:7], turned, 1.0 / norm)


@inner
def _copy(into: Array, poses: Array) -> None:
    """Copy poses; a slice would make another array object."""
    for b in range(into.shape[0]):
        assign(into[b], poses[b])


@inner
def _flipped(a: AssemblyArrays) -> bool:
    """Whether a joint closes with frame M turned by half a turn."""
    model, A = a.model, a.ws.A
    for n in range(model.body_i.shape[0]):
        for row in range(model.first_row[n], model.first_row[n + 1]):
            kind = model.row_kind[row]
            if kind in (_D13, _D12):
                k = 2 if kind == _D13 else 0
                u = arm(A, model.body_i[n], column(model.axes_i[n], k))
                if dot(u, arm(A, model.body_j[n], column(model.axes_j[n], k))) < 0.0:
                    return True
    return False


@threaded
def _assemble_positions(record: AssemblyArrays, held: Array, t: float, converged: float, most: int, far: int) -> bool:
    """Assemble the poses; return whether nothing is in doubt.

    Parameters
    ----------
    record : AssemblyArrays
        As a record array; ``pose`` is the guess, and afterwards the pose of the least residual.
    held : ndarray of HELD, shape (h,)
    t : float, s
    converged, most, far
        Largest residual, number of iterations, and largest number of further ones for poses that are far away.
    """
    a = fields_of(record)
    before, longest = np.inf, 1.0
    for n in range(most + far + 1):
        largest = evaluate(a, held, t)
        if before < converged and largest >= before:
            break
        _copy(a.kept, a.pose)
        before = largest
        if n == 0 and largest < np.inf:
            most += int(min(largest, float(far)))
            longest = max(1.0, largest / far)
        if largest == 0.0 or n >= most:
            break
        _solve(a)
        if n == 0 and _left(a, a.step) > _LARGEST_LEFT:
            return False
        _move(a, longest)
    _copy(a.pose, a.kept)
    place_bodies(a)
    distance = 0.0
    for b in range(a.pose.shape[0]):
        for k in range(3):
            distance = max(distance, abs(a.pose[b, k]))
    return before <= converged * max(1.0, distance / a.length) and not _flipped(a)


@threaded
def _assemble_velocities(record: AssemblyArrays, held: Array, t: float) -> bool:
    """Assemble the velocities in ``v`` at the poses; return whether nothing is in doubt."""
    a = fields_of(record)
    place_bodies(a)
    constraints.evaluate(a.model, t, a.y, a.turns, a.ws)
    row = a.ws.Q.shape[0]
    write_rows(a, row)
    for n in range(held.shape[0]):
        row = write_held(a, held, n, row)
    largest = 0.0
    for _ in range(2):  # the second pass removes the rounding of the first
        _write_rates(a, held)
        for n in range(a.right.shape[0]):
            largest = max(largest, abs(a.right[n]))
            for c in range(a.v.shape[0]):
                a.right[n] -= a.J[n, c] * a.v[c]
        _solve(a)
        for c in range(a.v.shape[0]):
            a.v[c] += a.step[c]
    for v in a.v:
        largest = max(largest, abs(v))
    _write_rates(a, held)
    return _left(a, a.v) <= _CONTRADICTION * largest


@inner
def _write_rates(a: AssemblyArrays, held: Array) -> None:
    """Write the rates that rows are to have, scaled."""
    row = a.ws.rate.shape[0]
    for n in range(row):
        a.right[n] = a.ws.rate[n] / a.size[n]
    for n in range(held.shape[0]):
        three = held[n].kind in (POSITION, ORIENTATION)
        for k in range(3 if three else 1):
            a.right[row] = held[n].value[k] / a.size[row]
            row += 1


class _HeldArrays(NamedTuple):
    """Arrays for held coordinates and rates of some joints."""

    arrays: AssemblyArrays  # of positions; poses and velocities are shared
    positions: AssemblyArrays  # record arrays
    velocities: AssemblyArrays
    coordinates: Array  # of HELD
    rates: Array


class CompiledAssembly:
    """Assembly of one mechanism, or of its parameter sets; not to be used by two threads at once.

    Parameters
    ----------
    mechanism : Mechanism
    model, com : Model and ndarray, shape (n_b, 3), optional
        Arrays of the mechanism that exist already, whose numbers may change between calls.
    """

    def __init__(self, mechanism: Mechanism, model: Model | None = None, com: Array | None = None) -> None:
        self._model = flatten(mechanism) if model is None else model
        self._com = np.array([body.com for body in mechanism.bodies]) if com is None else com
        self._joints, self._length = mechanism.joint_index, characteristic_length(mechanism)
        self._sizes = row_sizes(mechanism)
        self._held: dict[tuple[tuple[tuple[str, str], ...], ...], _HeldArrays] = {}

    def assemble(self, start: Start, t: float) -> State | None:
        """Return the consistent state of the mechanism whose numbers the arrays hold; None if anything is in doubt.

        Parameters
        ----------
        start : Start
            Of this mechanism, or of one whose joints have the same names and kinds.
        t : float, s
        """
        key = tuple(tuple((joint.name, name) for joint, name, _ in held) for held in start[1:])
        if key not in self._held:
            self._held[key] = self._arrays(start)
        by = self._held[key]
        pose, v, guess = by.arrays.pose, by.arrays.v.reshape(-1, 6), start.guess
        for records, held in ((by.coordinates, start.coordinates), (by.rates, start.rates)):
            for n, (_, _, value) in enumerate(held):
                records["value"][n, : np.size(value)] = value
        pose[:, :3], pose[:, 3:] = guess.p_WB, guess.quat_WB
        v[:, :3], v[:, 3:] = guess.v_WB_W / self._length, guess.w_WB_W
        limits = CONVERGED, MAX_ITERATIONS, LONGEST_WAY
        if _assemble_positions(by.positions, by.coordinates, t, *limits) and _assemble_velocities(
            by.velocities, by.rates, t
        ):
            return State(pose[:, :3], pose[:, 3:], self._length * v[:, :3], v[:, 3:])
        return None

    def _arrays(self, start: Start) -> _HeldArrays:
        model, n = self._model, len(self._com)
        ws, count = workspace(model), holonomic_rows(model)
        pose, kept, v, step = np.zeros((n, 7)), np.zeros((n, 7)), np.zeros(6 * n), np.zeros(6 * n)
        y, turns = np.zeros((n, 13)), np.zeros(len(model.coordinate))
        found = []
        for sizes, held in ((self._sizes[:count], start.coordinates), (self._sizes, start.rates)):
            size = np.concatenate([sizes, held_sizes(self._length, held)])
            J, right, by = np.zeros((len(size), 6 * n)), np.zeros(len(size)), least_squares(6 * n, len(size))
            own = model, ws, self._com, self._length, size, count, turns, y, pose, kept, J, right, step, v, by
            found.append(AssemblyArrays(*own))
        records = [self._records(held) for held in (start.coordinates, start.rates)]
        return _HeldArrays(found[0], record_array(found[0]), record_array(found[1]), *records)

    def _records(self, held: HeldCoordinates) -> Array:
        found = np.zeros(len(held), HELD)
        for n, (joint, name, _) in enumerate(held):
            found["joint"][n], found["kind"][n] = self._joints[joint.name], HELD_KINDS[name]
        return found


@lru_cache(maxsize=8)
def _idle(mechanism: Mechanism) -> list[CompiledAssembly]:
    """Return the assemblies of a mechanism that no thread uses; the last mechanisms are kept."""
    return []


def initial_state(mechanism: Mechanism, initial: Initial | None = None, t: float = 0.0) -> State:
    """Return the consistent state of a mechanism at the time t, in s, for given initial conditions.

    As `consilience.mechanism.initial_state`, compiled.

    Raises
    ------
    InvalidInput, CannotAssemble
    """
    require_states(mechanism, ())
    start, idle = checked_start(mechanism, initial), _idle(mechanism)
    try:  # another thread may take the last one
        assembly = idle.pop()
    except IndexError:
        assembly = CompiledAssembly(mechanism)
    found = assembly.assemble(start, float(t))
    idle.append(assembly)
    return assemble(mechanism, start, float(t)) if found is None else found
