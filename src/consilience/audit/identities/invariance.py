"""Identities between the answers about two descriptions of one mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from consilience.audit.identities import descriptions
from consilience.audit.identities.descriptions import Description
from consilience.audit.identities.equations import Equations, largest
from consilience.audit.identities.result import NotApplicableError, Residual, relative, worst
from consilience.audit.identities.subject import IdentitySubject
from consilience.engine import InstantAnswer, Question
from consilience.mechanism import (
    Mechanism,
    characteristic_length,
    kinetic_energy,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)

_TURN = rotation_from_quaternion(quaternion_from_rotation_vector(np.array([1.1, -0.7, 2.0])))
"""Rotation of the world that leaves no axis near a coordinate axis."""

_AWAY = np.array([0.48, -0.64, 0.6])
"""Unit vector, along no coordinate axis, in whose direction the world moves by a characteristic length."""

UNITS = {"length": 3.0, "mass": 7.0, "time": 0.3}
"""Number of new units in a metre, a kilogram, a second: no factor is a power of two or ten."""


def _reordered(mechanism: Mechanism) -> Description:
    n_b, n_j = len(mechanism.bodies), len(mechanism.joints)
    if n_b == n_j == 1:
        raise NotApplicableError("one body and one joint have one order")
    return descriptions.reordered(mechanism, range(n_b)[::-1], range(n_j)[::-1])


def _recut(mechanism: Mechanism) -> Description:
    found = descriptions.recut(mechanism)
    if found is None:
        raise NotApplicableError("no order of the joints cuts a loop elsewhere")
    return found


_DESCRIPTIONS: dict[str, Callable[[Mechanism], Description]] = {
    "rotated world": lambda m: descriptions.rotated(m, _TURN),
    "moved world": lambda m: descriptions.moved(m, characteristic_length(m) * _AWAY),
    "bodies and joints reordered": _reordered,
    "sides of joints swapped": descriptions.swapped,
    "other units": lambda m: descriptions.scaled_units(m, **UNITS),
    "loops cut elsewhere": _recut,
    "a body in two welded parts": descriptions.split,
}


def _invariance(describe: Callable[[Mechanism], Description]) -> Callable[[IdentitySubject], Iterator[Residual]]:
    def measure(subject: IdentitySubject) -> Iterator[Residual]:
        """Yield the worst residual between the two descriptions at each state."""
        description = describe(subject.mechanism)
        method = subject.asker.method(description.mechanism, Question.INSTANT, subject.method.name)
        states = [description.state(s) for s in subject.states]
        found = subject.asker.instant(description.mechanism, states, method)
        told = description.answer(subject.states, found)
        for n, eq in enumerate(subject.equations):
            yield worst(list(_differences(subject, eq, told, n)))

    return measure


def _differences(subject: IdentitySubject, eq: Equations, told: InstantAnswer, n: int) -> Iterator[Residual]:
    """Yield residuals of accelerations, determined reactions and energies of state n; both answers may have errors."""
    own, solution = subject.answer, eq.solution
    x = eq.motion(told.a_WB_W[n], told.alpha_WB_W[n])
    allowed = 2.0 * eq.acceleration_error(solution, subject.route)
    size = largest(solution.x)
    yield relative(largest(x - subject.accelerations(n)), allowed, size, f"state {n}, accelerations")
    if own.force_F is not None and own.torque_F is not None and told.force_F is not None and told.torque_F is not None:
        first = eq.scaled_reactions(own.force_F[n], own.torque_F[n])
        left = (eq.scaled_reactions(told.force_F[n], told.torque_F[n]) - first)[eq.determined]
        allowed = 2.0 * eq.reaction_error(solution)
        size = largest(eq.reaction_map @ solution.mu)
        yield relative(largest(left), allowed, size, f"state {n}, reactions")
    sizes = {"kinetic": kinetic_energy(eq.mechanism, eq.state), "potential": eq.potential_size}
    for name, size in sizes.items():
        change = float(getattr(told, name)[n] - getattr(own, name)[n])
        yield relative(abs(change), 2.0 * eq.guard * size, size, f"state {n}, {name} energy")


INVARIANCES = {name: _invariance(describe) for name, describe in _DESCRIPTIONS.items()}
"""Identities by name: each asks the engine about another description of the mechanism."""
