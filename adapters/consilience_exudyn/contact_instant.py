"""Accelerations at an instant with closed contacts, stops and dry friction.

Exudyn's contacts exert penalty forces: none at a gap of zero, and friction that is zero at rest. The force of a contact
that slides is Exudyn's, by a sphere enlarged by `OVERLAP`, its stiffness found from ``g'' = 0``. A contact that sticks,
one without friction and a stop are rows of the harness's solve, as the constraints of joints are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from consilience.engine import CannotRepresent
from consilience.mechanism import (
    GROUND,
    TOUCHING,
    Array,
    Mechanism,
    State,
    characteristic_length,
    joint_spring_motion,
    null_space,
)
from consilience_exudyn.contact_rows import TouchRow, contact_row, coordinate_row
from consilience_exudyn.contacts import limits_of, parts_of
from consilience_exudyn.terms import Equations, Terms

AT_REST = 1e-9
"""Velocity in m/s or rad/s below which a contact sticks; the same of a coordinate with dry friction."""

_RANK = 1e-10
_DEAR = 1e3
"""Weight of friction in the least norm of undetermined forces: normal forces that hold one another need less of it."""

_PULL = 1e-9
"""Force that pulls, over the largest force, above which a contact is opened."""

_LEFT = 1e-9
"""Acceleration of what is closed, over that of the bodies, above which there is no answer."""

_MOST_TRIED = 10
"""Contacts and stops of which all sets are tried, a thousand."""

_PASSES, _MARGIN = 1000, 1e-6
"""Projections onto cones and balance, one after the other; part of friction that is left out of the cones."""

_NOTHING_AT_REST = "Exudyn's friction is zero at rest, and it has none to start with"


@dataclass(eq=False)
class _Active:
    """Rows ``S a = rhs`` and columns of forces for their unknowns, in the velocities of all bodies.

    Attributes
    ----------
    rows, columns : ndarray, shape (k, 6 n_b)
    rhs : ndarray, shape (k,)
    bound : float
        Largest effort of dry friction that sticks; the coefficient of a contact that sticks; infinite: pushes alone.
    contact, number : TouchRow or None, int
        Elementary contact, and its number.
    dry : bool
    """

    rows: Array
    columns: Array
    rhs: Array
    bound: float
    contact: TouchRow | None = None
    number: int = -1
    dry: bool = False


def closed_contacts(mechanism: Mechanism, state: State) -> list[tuple[int, TouchRow]]:
    """Return the elementary contacts that are closed and do not separate, with their numbers.

    Raises
    ------
    RuntimeError
        One closes with a velocity.
    """
    slack, found = TOUCHING * characteristic_length(mechanism), []
    for number, (contact, part) in enumerate(parts_of(mechanism)):
        row = contact_row(mechanism, state, part, contact)
        if row.gap <= slack and row.rate <= AT_REST:
            if row.rate < -AT_REST:
                raise RuntimeError(f"contact '{part.name}' closes at {-row.rate:.3g} m/s: that is an impact")
            found.append((number, row))
    return found


def contact_accelerations(terms: Terms, state: State, equations: Equations) -> tuple[Array, Array, Array]:
    """Solve the equations with contacts, stops and dry friction.

    Returns
    -------
    a, mu : ndarray
        As `solve_constrained`.
    forces : ndarray, shape (n, 3), N
        Force of every elementary contact on its `body`.

    Raises
    ------
    CannotRepresent
        A contact or coordinate starts to slide, for which Exudyn has no friction.
    RuntimeError
        No set of closed contacts fits.
    ArithmeticError
        What is closed would accelerate: it depends on the joints nearly to rounding.
    """
    mechanism = terms.model.mechanism
    closed = closed_contacts(mechanism, state)
    without = terms.contact_force(state, None)
    active = []
    for number, row in closed:
        slides = row.part.friction > 0.0 and np.linalg.norm(row.slip) > AT_REST
        active.append(_contact(number, row, terms.contact_force(state, number) - without if slides else None))
    terms.contact_force(state, None)
    force, stuck = _joint_efforts(mechanism, state)
    balance = _balanced(equations, equations.f + force, [*active, *stuck])
    _refuse_start(balance.sliding)
    balance.refuse_left(equations)
    found = np.zeros((len(parts_of(mechanism)), 3))
    for one, x in zip(balance.closed, balance.unknowns, strict=True):
        if one.contact is not None:
            found[one.number] = _on_body(mechanism, one.contact, x @ one.columns)
    return balance.a, balance.mu, found


@dataclass(frozen=True, eq=False)
class _Balance:
    """Solution with some of the contacts, stops and dry frictions closed; the others are open.

    Attributes
    ----------
    closed : list of _Active
    a, mu : ndarray
    unknowns : list of ndarray
        Forces of `closed`.
    """

    closed: list[_Active]
    a: Array
    mu: Array
    unknowns: list[Array]

    @property
    def pulling(self) -> int | None:
        """What pulls most; None if nothing does."""
        largest = max((float(np.max(np.abs(x))) for x in self.unknowns), default=0.0)
        pulls = [np.inf if one.dry else float(x[0]) for one, x in zip(self.closed, self.unknowns, strict=True)]
        return int(np.argmin(pulls)) if min(pulls, default=0.0) < -_PULL * max(1.0, largest) else None

    def overlaps(self, active: Sequence[_Active]) -> bool:
        """Whether one of all that is open would close."""
        least = -_PULL * max(1.0, float(np.max(np.abs(self.a))))
        return any(one.rows[0] @ self.a - one.rhs[0] < least for one in active if one not in self.closed)

    @property
    def sliding(self) -> _Active | None:
        """Contact or dry friction that cannot stick; None if all can."""
        for one, x in zip(self.closed, self.unknowns, strict=True):
            across = abs(float(x[0])) if one.dry else float(np.linalg.norm(x[1:]))
            limit = one.bound if one.dry or len(x) == 1 else one.bound * float(x[0])
            if across > limit * (1.0 + _PULL):
                return one
        return None

    def refuse_left(self, equations: Equations) -> None:
        """Raise `ArithmeticError` where joints, or what is closed, accelerate."""
        rows = np.vstack([equations.J, *(one.rows for one in self.closed)])
        left = rows @ self.a - np.concatenate([equations.gamma, *(one.rhs for one in self.closed)])
        size = np.abs(rows) @ np.abs(self.a)
        worst = float(np.max(np.abs(left), initial=0.0))
        if worst > _LEFT * max(float(np.max(size, initial=0.0)), 1.0):
            raise ArithmeticError(f"accelerations of joints and of closed contacts stay at {worst:.2g} m/s^2")


def _balanced(equations: Equations, f: Array, active: Sequence[_Active]) -> _Balance:
    """Open what pulls whatever forces are chosen, one after the other; if others would close again, try all sets.

    Friction that sticks is not bounded in a set: it may jam, and hide which contacts open.
    """

    def solved(closed: Sequence[_Active]) -> _Balance:
        return _Balance(list(closed), *_solve(equations, f, closed))

    found = _held(equations, solved(active))
    while (pulling := found.pulling) is not None:
        found = _held(equations, solved([one for n, one in enumerate(found.closed) if n != pulling]))
    if found.overlaps(active):
        dry, pushing = [one for one in active if one.dry], [one for one in active if not one.dry]
        if len(pushing) > _MOST_TRIED:
            raise RuntimeError("no set of closed contacts and stops fits: an opened one would close again")
        sets = chain.from_iterable(combinations(pushing, n) for n in range(len(pushing), -1, -1))
        tried = (solved([*some, *dry]) for some in sets)
        fits = (one for one in tried if one.pulling is None and not one.overlaps(active) and one.sliding is None)
        fitting = next(fits, None)
        if fitting is None:
            raise CannotRepresent("contacts of which none fit at rest: one starts to slide", _NOTHING_AT_REST)
        return fitting
    return found


def _held(equations: Equations, balance: _Balance) -> _Balance:
    """Return the solution with other forces that equilibrium leaves open, where those of least norm pull or slip.

    Projections onto the cones and onto forces of the same sums, in turn, come to forces within both, if there are any.
    """
    if balance.sliding is None and balance.pulling is None:
        return balance
    free = null_space(np.vstack([equations.J, *(one.columns for one in balance.closed)]).T)
    joints, ends = len(balance.mu), np.cumsum([len(x) for x in balance.unknowns])[:-1]
    bounded, least = free[joints:], np.concatenate(balance.unknowns)
    U, singular, Vt = np.linalg.svd(bounded, full_matrices=False)
    rank = int(np.sum(singular > _RANK))  # of orthonormal columns: others are forces of joints alone
    nearest, forces = Vt[:rank].T / singular[:rank] @ U[:, :rank].T, least
    for _ in range(_PASSES if rank else 0):
        parts = zip(balance.closed, np.split(forces, ends), strict=True)
        z = nearest @ (np.concatenate([_within(one, x) for one, x in parts]) - least)
        forces = least + bounded @ z
        found = replace(balance, mu=balance.mu + free[:joints] @ z, unknowns=np.split(forces, ends))
        if found.sliding is None and found.pulling is None:
            return found
    return balance


def _within(one: _Active, x: Array) -> Array:
    """Return the nearest forces that one contact, stop or dry friction may have."""
    bound = (1.0 - _MARGIN) * one.bound
    if one.dry:
        return np.clip(x, -bound, bound)
    across = float(np.linalg.norm(x[1:]))
    if len(x) == 1 or across <= bound * x[0]:
        return np.maximum(x, 0.0) if len(x) == 1 else x
    if bound * across <= -x[0]:
        return np.zeros(3)
    normal = (x[0] + bound * across) / (1.0 + bound**2)
    return np.concatenate([[normal], bound * normal / across * x[1:]])


def _contact(number: int, row: TouchRow, friction: Array | None) -> _Active:
    """Rows and columns of a closed contact: sliding by Exudyn's friction, without friction, or sticking."""
    n = row.normal
    normal = n @ row.J, -(n @ row.gamma) - row.n_dot @ row.u
    if friction is not None or row.part.friction == 0.0:
        column = normal[0] if friction is None else friction
        return _Active(normal[0][None], column[None], np.array([normal[1]]), np.inf, row, number)
    t = np.linalg.svd(n[None])[2][1:]
    rows = np.vstack([normal[0], t @ row.J])
    return _Active(rows, rows, np.array([normal[1], *(-(t @ row.gamma))]), row.part.friction, row, number)


def _joint_efforts(mechanism: Mechanism, state: State) -> tuple[Array, list[_Active]]:
    """Generalised force of dry friction that slides; rows of dry friction that sticks, and of closed stops."""
    force, found = np.zeros(6 * len(mechanism.bodies)), list[_Active]()
    for dry in mechanism.dry_frictions:
        row, gamma = coordinate_row(mechanism, state, dry.joint, dry.coordinate)
        _, rate = joint_spring_motion(mechanism, state, dry.joint, dry.coordinate)
        bound = float(dry.bound or 0.0)
        if abs(rate) > AT_REST:
            force -= bound * np.sign(rate) * row
        else:
            found.append(_Active(row[None], row[None], np.array([gamma]), bound, dry=True))
    for limit in limits_of(mechanism):
        q, rate = joint_spring_motion(mechanism, state, limit.joint, limit.coordinate)
        if limit.side * (q - limit.value) <= TOUCHING and limit.side * rate <= AT_REST:
            if limit.side * rate < -AT_REST:
                raise RuntimeError(f"a stop of joint '{limit.joint}' is hit at {abs(rate):.3g}: that is an impact")
            row, gamma = coordinate_row(mechanism, state, limit.joint, limit.coordinate)
            row = limit.side * row
            found.append(_Active(row[None], row[None], np.array([limit.side * gamma]), np.inf))
    return force, found


def _solve(equations: Equations, f: Array, active: Sequence[_Active]) -> tuple[Array, Array, list[Array]]:
    """Solve with all active rows; undetermined multipliers have the least norm, with friction `_DEAR`."""
    J, M = equations.J, equations.M
    S = np.vstack([J, *(one.rows for one in active)])
    C = np.vstack([J, *(one.columns for one in active)])
    rhs = np.concatenate([equations.gamma, *(one.rhs for one in active)])
    free = np.linalg.solve(M, f)
    cost = np.concatenate([np.ones(len(J)), *(np.array([1.0, _DEAR, _DEAR])[: len(one.rhs)] for one in active)])
    response = np.linalg.solve(M, C.T)
    U, singular, Vt = np.linalg.svd(S @ response)  # without the costs, by which nearly dependent rows seem dependent
    rank = int(np.sum(singular > _RANK * np.max(singular, initial=0.0)))
    x, open_ = np.zeros(len(rhs)), Vt[rank:].T
    for _ in range(2):  # the second time for what rounding has left, as weights are large beside a small inertia
        x = x + Vt[:rank].T @ (U[:, :rank].T @ (rhs - S @ (free + response @ x)) / singular[:rank])
    x = x - open_ @ np.linalg.lstsq(cost[:, None] * open_, cost * x, rcond=None)[0]
    ends = np.cumsum([len(J), *(len(one.rhs) for one in active)])
    return free + response @ x, x[: len(J)], np.split(x, ends)[1:-1]


def _refuse_start(one: _Active | None) -> None:
    """Refuse a contact or coordinate that cannot stick."""
    if one is not None:
        what = "dry friction" if one.contact is None else f"contact '{one.contact.part.name}'"
        raise CannotRepresent(f"{what} starts to slide", _NOTHING_AT_REST)


def _on_body(mechanism: Mechanism, row: TouchRow, force: Array) -> Array:
    """Force on `body`, shape (3,), of a generalised force."""
    name, sign = (row.part.body, 1.0) if row.part.body != GROUND else (row.part.partner, -1.0)
    i = 6 * mechanism.body_index[name]
    return np.asarray(sign * force[i : i + 3])
