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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from consilience.compare.instants import BARS, Bars, Instants, largest
from consilience.compare.result import Comparison, Quantity, Verdict, compare_by_bars
from consilience.compare.softness import SCALES, Softness, of_vectors
from consilience.engine import InstantAnswer, Method, ModelAnswer, Question, Route
from consilience.mechanism import Array

EXACT = 1e-12

_VECTORS: dict[str, Callable[[Instants, InstantAnswer], Sequence[Array] | Array | None]] = {
    "accelerations": Instants.accelerations,
    "reactions": Instants.reactions,
    "contact forces": Instants.contact_forces,
}
"""Vectors at each state, by quantity."""

SOFTENED = frozenset(_VECTORS)
"""Quantities of an instant that depend on the softness of constraints."""

FLOOR = 1e-2
MANY = 10

CONTACT = Bars(acceleration=1e-6, reaction=1e-5)
"""Bars where a contact pushes and the engine finds its force by its own softness, overlap or step."""

CONTACT_SOLVER_RULE = "contact solver"
"""Name of a rule (`rules.INSTANT_RULES`)."""

EXACT_ROUTES = (Route.REFERENCE, Route.HARNESS_SOLVE)
"""Routes whose forces of contacts are as exact as others."""


def relative_difference(found: ArrayLike, expected: ArrayLike, floor: float = 0.0) -> float:
    """Return the largest difference divided by the largest component of `expected`, or by `floor` if larger."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    size = max(largest(expected), floor)
    difference = largest(found - expected)
    if difference == 0.0:
        return 0.0
    return difference / size if size > 0 else np.inf


def _floor(size: float, scale: float) -> float:
    """Return the least divisor of a difference, see the text of the module."""
    return FLOOR * max(size, scale)


def _sizes(expected: Sequence[Array] | Array, scale: float) -> Array:
    """Return the divisor of a difference at each state, shape (n_s,)."""
    floor = _floor(max(largest(e) for e in expected), scale)
    return np.array([max(largest(e), floor) for e in expected])


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

    The verdict is regularisation where only accelerations, reactions or contact forces miss their bars, and each that
    does converges to the reference as the softness of the engine's constraints decreases.

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
    energies = {"kinetic": largest(reference.kinetic), "potential": largest(reference.potential)}
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
    if softer:
        compared = _with_softness(compared, [answer, *softer], SCALES[method.profile], reference, instants)
    own = instants.touching and method.route not in EXACT_ROUTES
    return _by_its_contact_solver(compared) if own else compared


def _by_its_contact_solver(one: Comparison) -> Comparison:
    """Leave unresolved what misses its bars by no more than forces that an engine's solver of contacts finds may.

    Stops, dry friction and contacts without force go through that solver as contacts that push do.
    """
    may = {"accelerations": CONTACT.acceleration, "reactions": CONTACT.reaction, "contact forces": CONTACT.reaction}
    missed = [q for q in one.quantities if not q.met]
    if one.verdict is not Verdict.MODEL or any(q.difference > may.get(q.name, 0.0) for q in missed):
        return one
    why = f"{one.why}; as much may be lost by its solver of contacts, stops and dry friction"
    return replace(one, verdict=Verdict.UNRESOLVED, rule=CONTACT_SOLVER_RULE, why=why)


def _with_softness(
    compared: Comparison,
    answers: Sequence[InstantAnswer],
    scales: Sequence[float],
    reference: InstantAnswer,
    instants: Instants,
) -> Comparison:
    """Change the verdict to regularisation where softness explains every bar that is missed.

    Parameters
    ----------
    answers : sequence of InstantAnswer
        The judged answer, then those at other softness.
    scales : sequence of float
        Factors of the softness of the other answers.
    """

    def softness_of(name: str) -> Softness:
        *found, expected = (_VECTORS[name](instants, one) for one in (*answers, reference))
        given = [one for one in found if one is not None]  # all of them: one method gives all answers
        assert expected is not None
        return of_vectors(given, scales, expected, _sizes(expected, _scale(name, reference, instants)))

    compared = replace(compared, softness=softness_of("accelerations"))
    missed = [q for q in compared.quantities if not q.met]
    if not missed or not SOFTENED.issuperset(q.name for q in missed):
        return compared
    found = [(q, softness_of(q.name)) for q in missed]
    if not all(soft.matters(q.difference) for q, soft in found):
        return compared
    for q, soft in found:
        if not soft.explains(q.difference, q.bar):
            why = (
                f"{q.name}: difference {q.difference:.2g}, and softness moves it without settling: harder constraints "
            )
            return replace(compared, verdict=Verdict.UNRESOLVED, rule="softness unclear", why=f"{why}are needed")
    q, soft = found[0]
    why = f"{q.name}: difference {q.difference:.2g}, {soft.limit:.2g} without softness ({soft.observed})"
    return replace(compared, verdict=Verdict.REGULARISATION, rule="softness", why=f"{why}: the constraints are soft")


def _scale(name: str, reference: InstantAnswer, instants: Instants) -> float:
    """Return the magnitude of the terms of a quantity, m/s^2 or N."""
    return instants.acceleration if name == "accelerations" else instants.inertial(reference)


def _contact_forces(
    answer: InstantAnswer, reference: InstantAnswer, instants: Instants, bar: float
) -> Iterator[Quantity]:
    """Compare the forces between pairs of bodies in contact."""
    expected = instants.contact_forces(reference)
    if expected is None or not len(instants.contact_pairs):
        return
    found = instants.contact_forces(answer)
    if found is None:
        yield Quantity("contact forces", 0.0, bar, 0, "this method gives none")
        return
    known = instants.determined_pairs
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
    found, expected = instants.reactions(answer), instants.reactions(reference)
    if found is None:
        return Quantity("reactions", 0.0, bar, 0, "this method gives none")
    assert expected is not None
    _, difference, grown = _worst(found, expected, instants.inertial(reference), bar * instants.rounding)
    return Quantity("reactions", difference, grown, int(np.sum(instants.determined)), _open_remark(instants.determined))


def _open_remark(determined: NDArray[np.bool_]) -> str:
    open_ones = int(np.sum(~determined))
    return f"{open_ones} values not determined by equilibrium and not compared" if open_ones else ""
