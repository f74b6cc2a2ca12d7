"""Subject of the identities: a mechanism at some states, an engine and a method, and the answers so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from consilience.audit.identities.asking import Asker
from consilience.audit.identities.equations import Equations, largest
from consilience.audit.identities.result import NotApplicableError
from consilience.engine import InstantAnswer, Method, Question, Route
from consilience.mechanism import Array, Load, Mechanism, State

MOST_DIRECTIONS = 6
"""Free directions with a load; if there are more, as many random directions among them."""


@dataclass(frozen=True, eq=False)
class Mobility:
    """Response of the accelerations to loads in free directions, in one state.

    Attributes
    ----------
    W : ndarray, shape (k, k)
        Response along direction i to a unit of load along direction j.
    neutral : ndarray, shape (k, k)
        The same response from the mass matrix.
    allowed : float
        Largest allowed error of an entry.
    """

    W: Array
    neutral: Array
    allowed: float


@dataclass(frozen=True, eq=False)
class IdentitySubject:
    """A mechanism, some of its consistent states, and the engine and method that answer."""

    mechanism: Mechanism
    states: Sequence[State]
    asker: Asker
    method: Method

    @property
    def route(self) -> Route:
        """Route of the method."""
        return self.method.route

    @cached_property
    def equations(self) -> list[Equations]:
        """Neutral equations of every state."""
        return [Equations(self.mechanism, state) for state in self.states]

    @cached_property
    def answer(self) -> InstantAnswer:
        """The engine's answer about the mechanism without loads of an identity."""
        return self.asker.instant(self.mechanism, self.states, self.method)

    def accelerations(self, n: int) -> Array:
        """Return the scaled accelerations of state n, shape (6 n_b,)."""
        return self.equations[n].motion(self.answer.a_WB_W[n], self.answer.alpha_WB_W[n])

    def reactions(self, n: int) -> tuple[Array, Array]:
        """Return the joint reactions of state n, forces and torques, each shape (n_j, 3).

        Raises
        ------
        NotApplicableError
            The method gives no reactions.
        """
        if self.answer.force_F is None or self.answer.torque_F is None:
            raise NotApplicableError("the method gives no reactions")
        return self.answer.force_F[n], self.answer.torque_F[n]

    def loaded(self, n: int, load: Array) -> InstantAnswer:
        """Return the answer about state n with a scaled wrench added to the bodies as loads.

        Raises
        ------
        NotApplicableError
            The engine has no loads.
        """
        mechanism = _with_loads(self.mechanism, self.equations[n].unscaled(load))
        return self.asker.instant(mechanism, [self.states[n]], self._method_with_loads)

    @cached_property
    def _method_with_loads(self) -> Method:
        """The method for the mechanism with loads on all bodies."""
        mechanism = _with_loads(self.mechanism, np.zeros((len(self.mechanism.bodies), 6)))
        return self.asker.method(mechanism, Question.INSTANT, self.method.name)

    def response(self, n: int, load: Array) -> Array:
        """Return the change of the scaled accelerations of state n by a scaled wrench, shape (6 n_b,)."""
        answer = self.loaded(n, load)
        return self.equations[n].motion(answer.a_WB_W[0], answer.alpha_WB_W[0]) - self.accelerations(n)

    def response_error(self, n: int, load: Array) -> float:
        """Return the largest allowed error of a response: of the answers with and without the load."""
        eq = self.equations[n]
        return eq.acceleration_error(eq.solve(load), self.route) + eq.acceleration_error(eq.solution, self.route)

    def directions(self, n: int) -> Array:
        """Return orthonormal directions among the free directions of state n, shape (freedom, k).

        Raises
        ------
        NotApplicableError
            There is no free direction.
        """
        freedom = self.equations[n].N.shape[1]
        if freedom == 0:
            raise NotApplicableError("nothing can move")
        if freedom <= MOST_DIRECTIONS:
            return np.eye(freedom)
        return np.linalg.qr(np.random.default_rng(n).normal(size=(freedom, MOST_DIRECTIONS)))[0]

    def push(self, n: int, direction: Array) -> Array:
        """Return a load along a free direction, as large as the forces without the load."""
        eq = self.equations[n]
        size = largest(eq.b) or sum(b.mass for b in self.mechanism.bodies)
        return size * (eq.N @ direction)

    @cached_property
    def mobility(self) -> list[Mobility]:
        """Mobility of every state."""
        found = []
        for n, eq in enumerate(self.equations):
            P = self.directions(n)
            loads = [self.push(n, direction) for direction in P.T]
            size = float(np.linalg.norm(loads[0]))
            responses = np.array([self.response(n, load) for load in loads]).T / size
            # a component along a unit vector sums the errors of all components
            allowed = np.sqrt(len(eq.velocity)) * max(self.response_error(n, load) for load in loads) / size
            found.append(Mobility(P.T @ (eq.N.T @ responses), P.T @ eq.reduced_inverse @ P, allowed))
        return found


def _with_loads(mechanism: Mechanism, wrenches: Array) -> Mechanism:
    """Add forces and torques about the origins of the bodies, shape (n_b, 6), world axes, as loads."""
    loads = []
    for body, wrench in zip(mechanism.bodies, wrenches, strict=True):
        loads.append(Load(f"force on {body.name} (identity)", "force", body.name, wrench[:3], "world"))
        loads.append(Load(f"torque on {body.name} (identity)", "torque", body.name, wrench[3:], "world"))
    return replace(mechanism, loads=(*mechanism.loads, *loads))
