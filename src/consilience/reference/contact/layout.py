"""Rows of the contacts, stops and dry frictions of a mechanism, with their laws.

The order of rows: n, t1, t2 of each elementary contact; three of relative rotation for each with friction moments; then
joint coordinates, the sides of stops first, dry frictions last. *Normals* cannot be penetrated: rigid contacts and
sides of stops. *Springs* are the normals of compliant contacts: the state gives their forces. *Sites* are what the
mechanism declares: contacts, then stops, then dry frictions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import ASSOCIATED_ALONE, Array, DryFriction, JointSpring, Mechanism, contact_parts
from consilience.reference.bodies.arrays import ANGLE, DISTANCE, Model, flatten
from consilience.reference.contact.pairs import LIMIT, pairs_of
from consilience.reference.contact.problem import FrictionSet


@dataclass(frozen=True, eq=False)
class RowLayout:
    """Rows of a mechanism with contacts.

    Attributes
    ----------
    mechanism : Mechanism
    smooth : Mechanism
        The same without contacts, stops and dry friction; a joint spring of no stiffness for each joint coordinate.
    model : Model
        Of `smooth`.
    parts : tuple of elementary contacts, length n
    pairs : ndarray, shape (n,) of PAIR
    limits : ndarray, shape (n_l,) of LIMIT
    names : tuple of str, length m
        Of the rows.
    site : ndarray of int, shape (m,)
        Of the rows.
    normals : tuple of int, length n_n
        Rows that cannot be penetrated: those of the rigid parts, then of the sides of stops.
    normal_rows : ndarray of int, shape (n_n,)
        The same as an array.
    springs : tuple of int, length n_s
        Compliant parts.
    gaps : ndarray of int, shape (n_n,)
        Index of each normal in `RowMotion.gap`.
    restitution : ndarray, shape (n_n,)
    rebound_threshold : ndarray, shape (n_n,), m/s
    friction : tuple of FrictionSet
        The load of a compliant contact is its normal row. Bounds that are reactions of joints have the offset 0.
    dry : tuple of DryFriction or None, length of `friction`
        Dry friction of each set; None for one of a contact.
    """

    mechanism: Mechanism
    smooth: Mechanism
    model: Model
    parts: tuple[Any, ...]
    pairs: Array
    limits: Array
    names: tuple[str, ...]
    site: Array
    normals: tuple[int, ...]
    springs: tuple[int, ...]
    gaps: Array
    restitution: Array
    rebound_threshold: Array
    friction: tuple[FrictionSet, ...]
    dry: tuple[Any, ...]

    @cached_property
    def normal_rows(self) -> Array:
        """`normals` as an array."""
        return np.array(self.normals, dtype=np.int64)

    @property
    def sums(self) -> int:
        """Return how many numbers are summed over time: impulses of contacts, one of all forces, and the loss.

        Steps follow what is summed. The one of all forces, with weights, is there where impulses of contacts do not
        tell all of them: several parts of a contact, friction moments, stops and dry friction.
        """
        contacts = 3 * len(self.mechanism.contacts)
        return contacts + (len(self.names) > contacts) + 1

    def part_of(self, normal: int) -> int | None:
        """Return the part of a normal (index into `normals`); None for a side of a stop."""
        row = int(self.normals[normal])
        return row // 3 if row < 3 * len(self.parts) else None

    def rebounds(self, approach: Array) -> Array:
        """Return the restitution of each normal for a speed of approach (n_n,), m/s; 0 up to its threshold."""
        slow = self.restitution * np.maximum(approach, 0.0) <= self.rebound_threshold
        return np.where(slow & (self.rebound_threshold > 0.0), 0.0, self.restitution)

    @property
    def sites(self) -> tuple[str, ...]:
        """Return what each site is, in words."""
        m = self.mechanism
        return (
            *(f"contact '{c.name}'" for c in m.contacts),
            *(f"stop '{s.name}'" for s in m.stops),
            *(f"dry friction '{d.name}'" for d in m.dry_frictions),
        )


def smooth_mechanism(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without its contacts, stops and dry frictions, and with probes of their joint coordinates."""
    read = dict.fromkeys(
        [(s.joint, s.coordinate) for s in mechanism.stops] + [(d.joint, d.coordinate) for d in mechanism.dry_frictions]
    )
    probes = tuple(JointSpring(f"coordinate {j} {c}", j, c, 0.0, 0.0, 0.0) for j, c in read)
    springs = (*mechanism.joint_springs, *probes)
    return replace(mechanism, joint_springs=springs, contacts=(), stops=(), dry_frictions=())


def _limits(mechanism: Mechanism, model: Model) -> tuple[Array, list[int], list[float]]:
    """Return the records of stops and dry frictions, with the index of each among them, and restitutions of sides."""
    kinds = {"angle": ANGLE, "distance": DISTANCE}
    rows, owners, restitution = [], [], []
    for s, stop in enumerate(mechanism.stops):
        for sign, target in ((1.0, stop.lower), (-1.0, stop.upper)):
            if target is not None:
                rows.append((stop.joint, stop.coordinate, sign, target))
                owners.append(s)
                restitution.append(stop.restitution)
    rows += [(d.joint, d.coordinate, 1.0, 0.0) for d in mechanism.dry_frictions]
    owners += [len(mechanism.stops) + d for d in range(len(mechanism.dry_frictions))]
    found = np.zeros(len(rows), LIMIT)
    for record, (joint, name, sign, target) in zip(found, rows, strict=True):
        here = (model.coordinate["joint"] == mechanism.joint_index[joint]) & (model.coordinate["kind"] == kinds[name])
        record["coordinate"], record["sign"], record["target"] = np.flatnonzero(here)[0], sign, target
    return found, owners, restitution


def _of_contact(part: Any, k: int, turning: int) -> list[FrictionSet]:
    """Return the friction of an elementary contact k, its rows of rotation from `turning` on."""
    n, static, found = 3 * k, part.friction if part.static_friction is None else part.static_friction, []
    where, cone = f"contact '{part.name}'", part.cone
    if static > 0.0:
        if cone.kind == "box":
            found += [FrictionSet(where, (n + i,), part.friction, static, n) for i in (1, 2)]
        else:
            facets = cone.facets if cone.kind == "pyramid" else 0
            rows = (n + 1, n + 2)
            found.append(FrictionSet(where, rows, part.friction, static, n, 0.0, facets, cone.offset, part.associated))
    if part.torsional > 0.0:
        found.append(FrictionSet(f"torsion of {where}", (turning,), part.torsional, part.torsional, n))
    if part.rolling > 0.0:
        found.append(FrictionSet(f"rolling of {where}", (turning + 1, turning + 2), part.rolling, part.rolling, n))
    return found


def _coefficients(dry: DryFriction) -> tuple[float, float]:
    """Return the coefficients of a dry friction: of a reaction its own, times the radius of a pin, m; else 1."""
    mu = 1.0 if dry.coefficient is None else dry.coefficient * (dry.radius or 1.0)
    return mu, mu


def not_covered(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the contacts whose laws have no equations together: an associated cone beside another law."""
    return tuple(c.name for c in mechanism.contacts if c.mixes_associated)


@lru_cache(maxsize=8)  # one mechanism from many states
def layout_of(mechanism: Mechanism) -> RowLayout:
    """Lay out the rows of a mechanism's contacts, stops and dry frictions.

    Raises
    ------
    InvalidInput
        A law that is not covered.
    """
    for name in not_covered(mechanism):
        raise InvalidInput(f"contact '{name}'", ASSOCIATED_ALONE, "Leave the other law out.")
    smooth = smooth_mechanism(mechanism)
    model = flatten(smooth)
    split = [contact_parts(c) for c in mechanism.contacts]
    parts = tuple(part for own in split for part in own)
    owner = [c for c, own in enumerate(split) for _ in own]
    pairs = pairs_of(mechanism, parts)
    limits, owners, restitution = _limits(mechanism, model)
    sides = len(restitution)
    turning = [k for k in range(len(parts)) if pairs["turning"][k] >= 0]
    rows_of_parts = [*np.repeat(np.arange(len(parts)), 3), *np.repeat(turning, 3).astype(int)]
    first = len(rows_of_parts)
    friction = [one for k, part in enumerate(parts) for one in _of_contact(part, k, int(pairs["turning"][k]))]
    dry_sets = [
        FrictionSet(f"dry friction '{d.name}'", (first + sides + i,), *_coefficients(d), None, d.bound or 0.0)
        for i, d in enumerate(mechanism.dry_frictions)
    ]
    rigid = [k for k, part in enumerate(parts) if part.compliance is None]
    joint_names = [f"stop '{mechanism.stops[owners[s]].name}'" for s in range(sides)]
    return RowLayout(
        mechanism,
        smooth,
        model,
        parts,
        pairs,
        limits,
        names=(
            *(f"contact '{parts[k].name}'" for k in rows_of_parts),
            *joint_names,
            *(f"dry friction '{d.name}'" for d in mechanism.dry_frictions),
        ),
        site=np.array(
            [*(owner[k] for k in rows_of_parts), *(len(mechanism.contacts) + o for o in owners)], dtype=np.int64
        ),
        normals=(*(3 * k for k in rigid), *range(first, first + sides)),
        springs=tuple(k for k, part in enumerate(parts) if part.compliance is not None),
        gaps=np.array([*rigid, *range(len(parts), len(parts) + sides)], dtype=np.int64),
        restitution=np.array([*(parts[k].restitution for k in rigid), *restitution]),
        rebound_threshold=np.array([*(parts[k].rebound_threshold for k in rigid), *np.zeros(sides)]),
        friction=(*friction, *dry_sets),
        dry=(*(None for _ in friction), *mechanism.dry_frictions),
    )
