"""Comparison of answers to `model` and `instant`: relative differences of vectors, against bars.

A difference is relative to the largest component of the reference's vector.

The bars (docs/verdicts.md):

====================================  ==========================================================
accelerations                         1e-11
accelerations, extrapolated route     1e-8: solvers of constraints at velocity level
reactions (determined components)     1e-10; extrapolated route 1e-7
energies, mass, centre of mass        1e-12
inertia of the whole                  1e-12
====================================  ==========================================================

The bars of accelerations and reactions hold for well-conditioned equations. At each state they grow by the factor
``1 + 4 eps kappa / 1e-11``, where kappa is the worst condition number of the equations of motion in any usual form
(`consilience.mechanism.conditioning`).

Accelerations and reactions are compared state by state. Where the whole vector is small (a rod without load at the
moment of release, a mechanism near equilibrium), a relative difference would be rounding over rounding. The divisor is
therefore at least `FLOOR` times the largest component over all states, and `FLOOR` times the terms of the sum: for
accelerations gravity, the centripetal acceleration at the characteristic length of a body, and what springs, loads,
controls and drives would give a body that nothing holds; for reactions the mass times these and the accelerations; for
an energy the other energy. Angular accelerations are multiplied, and torques divided, by the characteristic length. The
potential energy of gravity is a sum whose terms may cancel, and is relative to the sum of their magnitudes. The pose of
a body carries the rounding of all joints between it and the ground: for more than `MANY` bodies the bars of energies
grow in proportion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from consilience.compare.result import Comparison, Quantity, Verdict, compare_by_bars
from consilience.compare.softness import SCALES, Softness, of_accelerations
from consilience.engine import InstantAnswer, Method, ModelAnswer, Question, Route
from consilience.mechanism import (
    GROUND,
    Array,
    Mechanism,
    State,
    applied_wrenches,
    centres_of_mass,
    characteristic_length,
    contact_pairs,
    determinate_forces,
    worst_condition,
)

EPS = float(np.finfo(float).eps)
EXACT = 1e-12
SOFTENED = frozenset({"accelerations", "reactions", "contact forces"})
"""Quantities of an instant that depend on the softness of constraints."""

FLOOR = 1e-2
MANY = 10


@dataclass(frozen=True)
class Bars:
    """Bars of accelerations and reactions for a route."""

    acceleration: float = 1e-11
    reaction: float = 1e-10


BARS: dict[Route, Bars] = {Route.EXTRAPOLATED: Bars(acceleration=1e-8, reaction=1e-7)}
"""Bars of the routes that differ from the usual ones."""

CONTACT = Bars(acceleration=1e-6, reaction=1e-5)
"""Bars where a contact pushes and the engine finds its force by its own softness, overlap or step."""

EXACT_ROUTES = (Route.REFERENCE, Route.HARNESS_SOLVE)
"""Routes whose forces of contacts are as exact as others."""


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
            max(_largest(s.w_WB_W) for s in states),
            max(_largest(s.v_WB_W) for s in states),
            max(_driven(mechanism, s) for s in states),
            max(float(np.sum(np.abs(masses * (centres_of_mass(mechanism, s)[0] @ mechanism.gravity)))) for s in states),
            max(_swings(mechanism, s, masses) for s in states),
            len(mechanism.bodies),
            contact_pairs(mechanism.contacts),
            np.array([one.pairs for one in determined]),
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

    def inertial(self, reference: InstantAnswer) -> float:
        """Return the magnitude of the inertial forces and weights that reactions may have to bear, N."""
        found = _largest(reference.a_WB_W) + _largest(reference.alpha_WB_W) * self.characteristic_length
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
    return 0.5 * float(np.sum(masses * np.linalg.norm(velocities, axis=1) * reach)) * _largest(state.w_WB_W)


def _driven(mechanism: Mechanism, state: State) -> float:
    """Return the largest acceleration of a body by its applied forces alone, or of a coordinate by a drive, m/s^2."""
    length = characteristic_length(mechanism)
    forces, torques = applied_wrenches(mechanism, state).magnitude.T
    alone = (forces + torques / length) / [b.mass for b in mechanism.bodies]
    drives = [abs(d.motion.at(0.0)[2]) * (1.0 if d.coordinate == "distance" else length) for d in mechanism.drives]
    return float(np.max([*alone, *drives]))


def instants_at(answer: InstantAnswer, states: Sequence[int]) -> InstantAnswer:
    """Return an answer at some of its states, by their numbers."""
    own = {field.name: getattr(answer, field.name) for field in fields(answer)}
    chosen: dict[str, Any] = {name: None if a is None else a[list(states)] for name, a in own.items()}
    return InstantAnswer(**chosen)


def relative_difference(found: ArrayLike, expected: ArrayLike, floor: float = 0.0) -> float:
    """Return the largest difference divided by the largest component of `expected`, or by `floor` if larger."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    size = max(_largest(expected), floor)
    difference = _largest(found - expected)
    if difference == 0.0:
        return 0.0
    return difference / size if size > 0 else np.inf


def _largest(values: ArrayLike) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _floor(largest: float, scale: float) -> float:
    """Return the least divisor of a difference, see the text of the module."""
    return FLOOR * max(largest, scale)


def _sizes(expected: Sequence[Array] | Array, scale: float) -> Array:
    """Return the divisor of a difference at each state, shape (n_s,)."""
    floor = _floor(max(_largest(e) for e in expected), scale)
    return np.array([max(_largest(e), floor) for e in expected])


def compare_model(
    case: str, engine: str, method: Method, answer: ModelAnswer, reference: ModelAnswer, length: float
) -> Comparison:
    """Compare mass properties and degrees of freedom.

    Parameters
    ----------
    case, engine : str
    method : Method
    answer, reference : ModelAnswer
    length : float, m
        Size of the mechanism, to which the centre of mass is relative.
    """
    freedom = float(abs(answer.freedom - reference.freedom))
    quantities = (
        Quantity("total mass", relative_difference(answer.mass, reference.mass), EXACT, 1),
        Quantity("centre of mass", relative_difference(answer.com, reference.com, length), EXACT, 3),
        Quantity("inertia of the whole", relative_difference(answer.inertia, reference.inertia), EXACT, 9),
        Quantity("degrees of freedom", freedom, 0.0, 1, f"{answer.freedom}, reference {reference.freedom}"),
    )
    return compare_by_bars(case, engine, Question.MODEL, method, quantities)


def compare_instant(
    case: str,
    engine: str,
    method: Method,
    answer: InstantAnswer,
    reference: InstantAnswer,
    instants: Instants,
    softer: Sequence[InstantAnswer] = (),
) -> Comparison:
    """Compare accelerations, determined reactions and energies at all states.

    The verdict is regularisation where only accelerations or reactions miss their bars, and the accelerations converge
    to the reference as the softness of the engine's constraints decreases.

    Parameters
    ----------
    case, engine : str
    method : Method
    answer, reference : InstantAnswer
    instants : Instants
    softer : sequence of InstantAnswer
        Answers at the scales of `softness.SCALES`, or none.
    """
    bars = BARS.get(method.route, Bars())
    pushed = reference.contact_force is not None and np.any(reference.contact_force)
    if pushed and method.route not in EXACT_ROUTES:
        bars = CONTACT
    energies = {"kinetic": _largest(reference.kinetic), "potential": _largest(reference.potential)}
    most, terms = max(energies.values()), {"kinetic": instants.swings, "potential": instants.weights}
    compared = compare_by_bars(
        case,
        engine,
        Question.INSTANT,
        method,
        (
            _accelerations(answer, reference, instants, bars.acceleration),
            _reactions(answer, reference, instants, bars.reaction),
            *_contact_forces(answer, reference, instants, bars.reaction),
            *(
                Quantity(
                    f"{name} energy",
                    relative_difference(
                        getattr(answer, name), getattr(reference, name), max(_floor(size, most), terms[name])
                    ),
                    EXACT * max(1.0, instants.bodies / MANY),
                    len(reference.kinetic),
                )
                for name, size in energies.items()
            ),
        ),
    )
    if not softer:
        return compared
    found, *others, expected = (instants.accelerations(a) for a in (answer, *softer, reference))
    sizes = _sizes(expected, instants.acceleration)
    return _with_softness(compared, of_accelerations([found, *others], SCALES[method.profile], expected, sizes))


def _with_softness(compared: Comparison, soft: Softness) -> Comparison:
    """Change the verdict to regularisation where softness explains all missed bars."""
    missed = {q.name for q in compared.quantities if not q.met}
    found = next(q for q in compared.quantities if q.name == "accelerations")
    compared = replace(compared, softness=soft)
    if not missed or not missed <= SOFTENED:
        return compared
    what = f"accelerations: difference {found.difference:.2g}"
    if soft.matters(found.difference) and soft.explains(found.difference, found.bar):
        why = f"{what}, {soft.limit:.2g} without softness (order {soft.order:.2f} in it): the constraints are soft"
        return replace(compared, verdict=Verdict.REGULARISATION, rule="softness", why=why)
    if soft.matters(found.difference):
        why = f"{what}, and softness moves it without settling: harder constraints are needed"
        return replace(compared, verdict=Verdict.UNRESOLVED, rule="softness unclear", why=why)
    return compared


def _contact_forces(
    answer: InstantAnswer, reference: InstantAnswer, instants: Instants, bar: float
) -> Iterator[Quantity]:
    """Compare the forces between pairs of bodies in contact."""
    if reference.contact_force is None or not len(instants.contact_pairs):
        return
    if answer.contact_force is None:
        yield Quantity("contact forces", 0.0, bar, 0, "this method gives none")
        return
    known, forces = instants.determined_pairs, (answer.contact_force, reference.contact_force)
    found, expected = (np.where(known, instants.contact_pairs @ one, 0.0) for one in forces)
    _, difference, grown = _worst(found, expected, instants.inertial(reference), bar * instants.rounding)
    yield Quantity("contact forces", difference, grown, int(np.sum(known)), _open_remark(known))


def _worst(
    found: Sequence[Array] | Array, expected: Sequence[Array] | Array, scale: float, bars: Array
) -> tuple[int, float, float]:
    """Return the state with the largest ratio of difference to bar (NaN is the largest), its difference and its bar.

    Parameters
    ----------
    found, expected : sequence of ndarray
        Vectors at each state.
    scale : float
        Magnitude of the terms of the quantity, in its unit.
    bars : ndarray, shape (n_s,)
    """
    sizes = _sizes(expected, scale).tolist()
    differences = np.array([relative_difference(f, e, s) for f, e, s in zip(found, expected, sizes, strict=True)])
    ratios = differences / bars
    n = int(np.argmax(np.where(np.isnan(ratios), np.inf, ratios)))
    return n, float(differences[n]), float(bars[n])


def _accelerations(answer: InstantAnswer, reference: InstantAnswer, instants: Instants, bar: float) -> Quantity:
    """Compare linear and angular accelerations of all bodies."""
    found, expected = instants.accelerations(answer), instants.accelerations(reference)
    n, difference, grown = _worst(found, expected, instants.acceleration, bar * instants.rounding)
    remark = f"state {n}, condition of the equations {instants.condition[n]:.3g}"
    return Quantity("accelerations", difference, grown, expected.size, remark)


def _reactions(answer: InstantAnswer, reference: InstantAnswer, instants: Instants, bar: float) -> Quantity:
    """Compare the reaction components that equilibrium determines."""
    determined = instants.determined
    if answer.force_F is None or answer.torque_F is None:
        return Quantity("reactions", 0.0, bar, 0, "this method gives none")

    def compared(force_F: Array | None, torque_F: Array | None) -> list[Array]:
        """Determined components at each state."""
        assert force_F is not None
        assert torque_F is not None
        wrenches = np.concatenate([force_F, torque_F / instants.characteristic_length], axis=2)
        return [values[known] for values, known in zip(wrenches, determined, strict=True)]

    found, expected = compared(answer.force_F, answer.torque_F), compared(reference.force_F, reference.torque_F)
    _, difference, grown = _worst(found, expected, instants.inertial(reference), bar * instants.rounding)
    return Quantity("reactions", difference, grown, int(np.sum(determined)), _open_remark(determined))


def _open_remark(determined: NDArray[np.bool_]) -> str:
    open_ones = int(np.sum(~determined))
    return f"{open_ones} values not determined by equilibrium and not compared" if open_ones else ""
