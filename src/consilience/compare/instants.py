"""Instants of a mechanism: the properties on which the bars of accelerations and reactions depend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from consilience.engine import InstantAnswer, Route
from consilience.mechanism import (
    GROUND,
    Array,
    Mechanism,
    State,
    acting,
    applied_wrenches,
    centres_of_mass,
    characteristic_length,
    contact_pairs,
    determinate_forces,
    worst_condition,
)

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Bars:
    """Bars of accelerations and reactions for a route."""

    acceleration: float = 1e-11
    reaction: float = 1e-10


BARS: dict[Route, Bars] = {Route.EXTRAPOLATED: Bars(acceleration=1e-8, reaction=1e-7)}
"""Bars of the routes that differ from the usual ones."""


@dataclass(frozen=True, eq=False)
class Instants:
    """Properties of mechanism and states on which the bars of `instant` depend.

    Attributes
    ----------
    condition : ndarray, shape (n_s,)
        Condition number of the equations of motion, see `worst_condition`.
    determined : ndarray of bool, shape (n_s, n_j, 6)
        Reaction components that equilibrium determines.
    mass : float, kg
        Mass of the whole mechanism.
    gravity : float, m/s^2
    characteristic_length : float, m
        Characteristic length of a body.
    spin : float, rad/s
        Largest angular velocity at the states.
    speed : float, m/s
        Largest velocity at the states.
    driven : float, m/s^2
        Largest acceleration by applied forces that a body would have alone, or by a drive, at the states.
    weights : float, J
        Largest sum of the magnitudes of all potential energies of gravity, about the world origin.
    swings : float, J
        Largest kinetic energy with the velocities that the joints between a body and the ground add up: where these
        cancel, the velocity of the body has their rounding.
    bodies : int
    contact_pairs : ndarray, shape (n_p, n_c)
        Signs with which the forces of the contacts add up to the force between each pair of bodies.
    determined_pairs : ndarray of bool, shape (n_s, n_p, 3)
        Components of these forces that equilibrium determines.
    touching : bool
        Whether a contact is closed, a stop reached, or dry friction has a bound, at any of the states.
    answers : int
        Number of answers that rounding may put off by a bar: two where a formulation of the reference is compared with
        another, each of which is as far from the truth as its rounding allows.
    """

    condition: Array
    determined: NDArray[np.bool_]
    mass: float
    gravity: float
    characteristic_length: float
    spin: float
    speed: float
    driven: float
    weights: float
    swings: float
    bodies: int
    contact_pairs: Array = field(default_factory=lambda: np.zeros((0, 0)))
    determined_pairs: NDArray[np.bool_] = field(default_factory=lambda: np.ones((0, 0, 3), dtype=bool))
    touching: bool = False
    answers: int = 1

    @property
    def rounding(self) -> Array:
        """Factor of the bars at each state, shape (n_s,)."""
        return self.answers * (1.0 + 4.0 * EPS * self.condition / Bars().acceleration)

    @classmethod
    def of(cls, mechanism: Mechanism, states: Sequence[State]) -> Instants:
        """Compute the properties of the states of a mechanism."""
        masses = np.array([b.mass for b in mechanism.bodies])
        determined = [determinate_forces(mechanism, s) for s in states]
        return cls(
            np.array([worst_condition(mechanism, s) for s in states]),
            np.array([one.reactions for one in determined]),
            sum(b.mass for b in mechanism.bodies),
            float(np.linalg.norm(mechanism.gravity)),
            characteristic_length(mechanism),
            max(largest(s.w_WB_W) for s in states),
            max(largest(s.v_WB_W) for s in states),
            max(_driven(mechanism, s) for s in states),
            max(float(np.sum(np.abs(masses * (centres_of_mass(mechanism, s)[0] @ mechanism.gravity)))) for s in states),
            max(_swings(mechanism, s, masses) for s in states),
            len(mechanism.bodies),
            contact_pairs(mechanism.contacts),
            np.array([one.pairs for one in determined]),
            any(any(acting(mechanism, s)) for s in states),
        )

    @property
    def acceleration(self) -> float:
        """Magnitude of the terms of an acceleration: gravity, centripetal acceleration, forces and drives, m/s^2.

        Where none of them acts, the square of the velocity over the characteristic length.
        """
        terms = self.gravity + self.spin**2 * self.characteristic_length + self.driven
        alone = self.speed**2 / self.characteristic_length
        return terms if terms > EPS * alone else alone

    def accelerations(self, answer: InstantAnswer) -> Array:
        """Return linear accelerations, and angular ones times the characteristic length, shape (n_s, n_b, 6), m/s^2."""
        return np.concatenate([answer.a_WB_W, self.characteristic_length * answer.alpha_WB_W], axis=2)

    def reactions(self, answer: InstantAnswer) -> list[Array] | None:
        """Return the determined components at each state, torques over the characteristic length, N; None without."""
        if answer.force_F is None or answer.torque_F is None:
            return None
        wrenches = np.concatenate([answer.force_F, answer.torque_F / self.characteristic_length], axis=2)
        return [values[known] for values, known in zip(wrenches, self.determined, strict=True)]

    def contact_forces(self, answer: InstantAnswer) -> Array | None:
        """Return the determined forces between pairs of bodies, shape (n_s, n_p, 3), N; None if not given."""
        if answer.contact_force is None:
            return None
        return np.where(self.determined_pairs, self.contact_pairs @ answer.contact_force, 0.0)

    def inertial(self, reference: InstantAnswer) -> float:
        """Return the magnitude of the inertial forces and weights that reactions may have to bear, N."""
        found = largest(reference.a_WB_W) + largest(reference.alpha_WB_W) * self.characteristic_length
        return self.mass * (self.acceleration + found)


def _swings(mechanism: Mechanism, state: State, masses: Array) -> float:
    """Return half the sum of ``m |v| w r``: largest angular velocity w, distance r to the nearest joint on the ground.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    masses : ndarray, shape (n_b,), kg
    """
    centres, velocities = centres_of_mass(mechanism, state)
    sides = [(j.predecessor, j.F.p) for j in mechanism.joints if j.rows]
    sides += [(j.successor, j.M.p) for j in mechanism.joints if j.rows]
    places = [p for name, p in sides if name == GROUND]
    if not places:
        return 0.0
    reach = np.min(np.linalg.norm(centres[:, None] - np.array(places), axis=2), axis=1)
    return 0.5 * float(np.sum(masses * np.linalg.norm(velocities, axis=1) * reach)) * largest(state.w_WB_W)


def _driven(mechanism: Mechanism, state: State) -> float:
    """Return the largest acceleration of a body by what is applied alone, or of a coordinate by a drive, m/s^2.

    Bounds of dry friction count as applied to the lightest body.
    """
    length = characteristic_length(mechanism)
    forces, torques = applied_wrenches(mechanism, state).magnitude.T
    masses = [b.mass for b in mechanism.bodies]
    bounds = [(d.bound or 0.0) / (1.0 if d.coordinate == "distance" else length) for d in mechanism.dry_frictions]
    alone = np.append((forces + torques / length) / masses, np.array(bounds) / min(masses))
    drives = [abs(d.motion.at(0.0)[2]) * (1.0 if d.coordinate == "distance" else length) for d in mechanism.drives]
    return float(np.max([*alone, *drives]))


def instants_at(answer: InstantAnswer, states: Sequence[int]) -> InstantAnswer:
    """Return an answer at some of its states, by their numbers."""
    own = {field.name: getattr(answer, field.name) for field in fields(answer)}
    chosen: dict[str, Any] = {name: None if a is None else a[list(states)] for name, a in own.items()}
    return InstantAnswer(**chosen)


def largest(values: ArrayLike) -> float:
    """Return the largest magnitude; zero of no values."""
    return float(np.max(np.abs(values), initial=0.0))
