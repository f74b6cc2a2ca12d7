"""Which reactions and contact forces equilibrium determines, where contacts are closed, stops reached, joints stuck.

Forces are unique up to the null space of the transposed rows, as those of joints alone (`determinate_reactions`). A
closed contact has a row for each direction in which its force is free: one where it slides on Coulomb's circle or has
no friction, three elsewhere. Which contacts push, and bounds of friction, are not asked: a component that they alone
determine counts as undetermined.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from consilience.mechanism.constraints import constraint_rates, null_space, row_sizes, scaled_jacobian, velocity_sizes
from consilience.mechanism.contact_geometry import TOUCHING, NearestPoints, coordinate_row, nearest_points
from consilience.mechanism.contacts import Contact, ElementaryContact, contact_parts
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.observables import DETERMINED_TOLERANCE, joint_spring_motion, reaction_map
from consilience.mechanism.spatial import Array, orthogonal_triad, skew
from consilience.mechanism.stops import Stop
from consilience.mechanism.units import characteristic_length

RESTING = 1e-10
"""Largest speed of what rests, over the largest of the state and that of a fall by the characteristic length."""


def contact_pairs(contacts: Sequence[Contact]) -> Array:
    """Return the signs of the contacts in the force between each pair of bodies, shape (n_p, n_c)."""
    ends = [(contact.body, contact.partner) for contact in contacts]
    pairs = dict.fromkeys((min(pair), max(pair)) for pair in ends)
    signs = [[(pair == end) - (pair == end[::-1]) for end in ends] for pair in pairs]
    return np.array(signs, dtype=float).reshape(len(pairs), len(ends))


class DeterminateForces(NamedTuple):
    """Components of forces that equilibrium determines.

    Attributes
    ----------
    reactions : ndarray of bool, shape (n_j, 6)
        Of joints: force, then torque, axes of F.
    pairs : ndarray of bool, shape (n_p, 3)
        Of the forces between bodies, in the order of `contact_pairs`, world axes.
    contacts : ndarray of bool, shape (n_c, 3)
        Of the force of each contact, the sum over its parts, world axes.
    """

    reactions: NDArray[np.bool_]
    pairs: NDArray[np.bool_]
    contacts: NDArray[np.bool_]


def determinate_forces(mechanism: Mechanism, state: State, touched: Collection[str] = ()) -> DeterminateForces:
    """Tell which components of joint reactions and of contact forces equilibrium determines.

    Parameters
    ----------
    touched : collection of str
        Contacts and stops that count as closed though the state has them apart, as where they have just hit.
    """
    free, directions = _open_forces(mechanism, state, touched)
    sums = _contact_sums(free[mechanism.constraint_count() :], directions)
    pairs = np.einsum("pc,cik->pik", contact_pairs(mechanism.contacts), sums)
    determined = (np.linalg.norm(forces, axis=2) < DETERMINED_TOLERANCE for forces in (pairs, sums))
    return DeterminateForces(_reactions(mechanism, state, free, characteristic_length(mechanism)), *determined)


def determinate_power(mechanism: Mechanism, state: State, t: float, touched: Collection[str] = ()) -> bool:
    """Tell whether equilibrium determines the power of all drives, and with it what contacts and frictions lose.

    Forces that are open do no work together, as they are in equilibrium: what contacts among them take, drives give.

    Parameters
    ----------
    t : float, s
        Time at which drives are evaluated.
    touched : collection of str
        As in `determinate_forces`.
    """
    rates = constraint_rates(mechanism, t) / row_sizes(mechanism)
    if not np.any(rates):
        return True
    free, _ = _open_forces(mechanism, state, touched)
    return float(np.linalg.norm(rates @ free[: len(rates)])) < DETERMINED_TOLERANCE * float(np.linalg.norm(rates))


def _open_forces(mechanism: Mechanism, state: State, touched: Collection[str]) -> tuple[Array, list[list[Array]]]:
    """Return a basis of the forces that are in equilibrium by themselves, and the directions of those of contacts.

    Returns
    -------
    free : ndarray, shape (n, n_open)
        Multipliers of the scaled rows of constraints, contacts, stops and dry frictions, in this order.
    directions : list of lists of ndarray, each of shape (n_rows, 3)
        Of each contact, a block for each part that is closed.
    """
    rows, directions = closed_rows(mechanism, state, touched)
    return null_space(np.vstack([scaled_jacobian(mechanism, state), rows]).T), directions


def closed_rows(mechanism: Mechanism, state: State, touched: Collection[str] = ()) -> tuple[Array, list[list[Array]]]:
    """Return the rows of closed contacts, reached stops and dry friction at rest, and the directions of the contacts.

    Parameters
    ----------
    touched : collection of str
        As in `determinate_forces`.

    Returns
    -------
    rows : ndarray, shape (n, 6 n_b)
        Scaled as those of `scaled_jacobian`, one for each direction in which a force is free.
    directions : list of lists of ndarray, each of shape (n_rows, 3)
        Of each contact, a block for each part that is closed.
    """
    length, sizes = characteristic_length(mechanism), velocity_sizes(mechanism)
    resting = _resting(mechanism, state) / np.array([1.0, length])
    blocks, directions = list[Array](), list[list[Array]]()
    for contact in mechanism.contacts:
        directions.append([])
        parts = [(part, nearest_points(mechanism, state, part)) for part in contact_parts(contact)]
        closed = [(part, near) for part, near in parts if near.gap <= TOUCHING * length]
        hit = not closed and contact.name in touched  # by which of its parts, and with which slip, is not known
        for part, near in parts if hit else closed:
            rows = _contact_rows(mechanism, state, part, near)
            motion = np.zeros(6) if hit else rows @ _velocity(state)
            free = _free_forces(part, near, motion, resting)
            blocks.append(free @ rows * sizes / length)
            directions[-1].append(free[:, :3])
    blocks.append(_joint_efforts(mechanism, state, touched) * sizes)
    return np.vstack(blocks), directions


def _velocity(state: State) -> Array:
    return np.hstack([state.v_WB_W, state.w_WB_W]).ravel()


def _resting(mechanism: Mechanism, state: State) -> float:
    """Return the largest rate of what rests: m/s, or rad/s times the characteristic length."""
    length = characteristic_length(mechanism)
    sizes = np.concatenate([state.v_WB_W, length * state.w_WB_W]).ravel()
    falling = float(np.sqrt(np.linalg.norm(mechanism.gravity) * length))
    return RESTING * max(float(np.max(np.abs(sizes), initial=0.0)), falling)


def _contact_rows(mechanism: Mechanism, state: State, part: ElementaryContact, near: NearestPoints) -> Array:
    """Return the rows of the relative velocity of the material points in contact, and of the bodies, (6, 6 n_b)."""
    rows = np.zeros((6, 6 * len(mechanism.bodies)))
    for body, point, sign in ((part.body, near.on_body, 1.0), (part.partner, near.on_partner, -1.0)):
        i = mechanism.body_index[body]
        if i >= 0:
            rows[:3, 6 * i : 6 * i + 6] = sign * np.hstack([np.eye(3), -skew(point - state.p_WB[i])])
            rows[3:, 6 * i + 3 : 6 * i + 6] = sign * np.eye(3)
    return rows


def _free_forces(part: ElementaryContact, near: NearestPoints, motion: Array, resting: Array) -> Array:
    """Return the directions of force and moment that a closed contact may have, shape (n, 6): those that no law gives.

    The overlap of a compliant contact gives its normal force, and with it the friction of what slides.

    Parameters
    ----------
    motion : ndarray, shape (6,)
        Relative velocity of the material points in contact, then of the bodies, m/s and rad/s.
    resting : ndarray, shape (2,)
        Largest rates of what rests, m/s and rad/s.
    """
    n, across = near.normal, np.eye(3) - np.outer(near.normal, near.normal)
    tangents = np.array([t / np.linalg.norm(t) for t in orthogonal_triad(n)[:2]])
    laws = (
        (part.friction, tangents, across @ motion[:3], slice(0, 3), resting[0], part.cone.kind == "circle"),
        (part.torsional, n[None], n * (n @ motion[3:]), slice(3, 6), resting[1], True),
        (part.rolling, tangents, across @ motion[3:], slice(3, 6), resting[1], True),
    )
    pressed, free = np.concatenate([n, np.zeros(3)]), []
    for share, along, rates, place, still, opposes in laws:
        rate = float(np.linalg.norm(rates))
        if share > 0.0 and opposes and rate > still:
            pressed[place] -= share * rates / rate
        elif share > 0.0:
            free.append(np.zeros((len(along), 6)))
            free[-1][:, place] = along
    return np.vstack([np.zeros((0, 6)) if part.compliance is not None else pressed[None], *free])


def _reached_stops(mechanism: Mechanism, state: State) -> list[Stop]:
    """Return the stops of which a limit is reached at a state."""
    found = []
    for stop in mechanism.stops:
        q, _ = joint_spring_motion(mechanism, state, stop.joint, stop.coordinate)
        room = TOUCHING * (characteristic_length(mechanism) if stop.coordinate == "distance" else 1.0)
        if any(limit is not None and abs(q - limit) <= room for limit in (stop.lower, stop.upper)):
            found.append(stop)
    return found


def _joint_efforts(mechanism: Mechanism, state: State, touched: Collection[str]) -> Array:
    """Return the rows of joint coordinates whose stop is reached or whose dry friction sticks, shape (n, 6 n_b)."""
    length = characteristic_length(mechanism)
    reached = _reached_stops(mechanism, state)
    reached += [stop for stop in mechanism.stops if stop.name in touched and stop not in reached]
    rows = [coordinate_row(mechanism, state, s.joint, s.coordinate) for s in reached]
    for dry in mechanism.dry_frictions:
        _, rate = joint_spring_motion(mechanism, state, dry.joint, dry.coordinate)
        unit = 1.0 if dry.coordinate == "distance" else length
        if abs(rate) * unit <= _resting(mechanism, state):
            rows.append(coordinate_row(mechanism, state, dry.joint, dry.coordinate))
    return np.array(rows).reshape(-1, 6 * len(mechanism.bodies))


def _reactions(mechanism: Mechanism, state: State, free: Array, length: float) -> NDArray[np.bool_]:
    sizes, arm, start, found = row_sizes(mechanism)[:, None], np.repeat([length, 1.0], 3), 0, []
    multipliers = free[: len(sizes)] / sizes
    for joint in mechanism.joints:
        rows = slice(start, start + len(joint.rows))
        start = rows.stop
        found.append(arm * np.linalg.norm(reaction_map(mechanism, state, joint) @ multipliers[rows], axis=1))
    return np.array(found).reshape(-1, 6) < DETERMINED_TOLERANCE


def _contact_sums(free: Array, directions: list[list[Array]]) -> Array:
    """Sum the free forces of the parts over contacts, shape (n_c, 3, free directions)."""
    sums, start = np.zeros((len(directions), 3, free.shape[1])), 0
    for c, parts in enumerate(directions):
        for along in parts:
            sums[c] += along.T @ free[start : start + len(along)]
            start += len(along)
    return sums
