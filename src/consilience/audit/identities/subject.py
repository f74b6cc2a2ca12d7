"""What is examined: a mechanism in some states, the engine and method that answer, and its answers so far."""

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
"""Free directions that are pushed; where there are more, as many random ones."""


@dataclass(frozen=True, eq=False)
class Mobility:
    """Response of the accelerations to loads in free directions, in one state.

    Attributes
    ----------
    W : ndarray, shape (k, k)
        Response along direction i to a unit of load along direction j.
    neutral : ndarray, shape (k, k)
        The same from the mass matrix.
    allowed : float
        Largest error of an entry that is no fault.
    """

    W: Array
    neutral: Array
    allowed: float


@dataclass(frozen=True, eq=False)
class IdentitySubject:
    """A mechanism, some consistent states of it, and the engine and method that are asked about them."""

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
        """What the engine says of the mechanism as it is."""
        return self.asker.instant(self.mechanism, self.states, self.method)

    def accelerations(self, n: int) -> Array:
        """Scaled accelerations of state n, shape (6 n_b,)."""
        return self.equations[n].motion(self.answer.a_WB_W[n], self.answer.alpha_WB_W[n])

    def reactions(self, n: int) -> tuple[Array, Array]:
        """Joint reactions of state n, forces and torques, each shape (n_j, 3).

        Raises
        ------
        NotApplicableError
            If the method gives none.
        """
        if self.answer.force_F is None or self.answer.torque_F is None:
            raise NotApplicableError("the method gives no reactions")
        return self.answer.force_F[n], self.answer.torque_F[n]

    def loaded(self, n: int, load: Array) -> InstantAnswer:
        """Answer about state n alone, a scaled wrench added to the bodies as loads.

        Raises
        ------
        NotApplicableError
            If the engine has no loads.
        """
        mechanism = _with_loads(self.mechanism, self.equations[n].unscaled(load))
        return self.asker.instant(mechanism, [self.states[n]], self._method_with_loads)

    @cached_property
    def _method_with_loads(self) -> Method:
        """The method for the mechanism with loads on all bodies, whatever they are."""
        mechanism = _with_loads(self.mechanism, np.zeros((len(self.mechanism.bodies), 6)))
        return self.asker.method(mechanism, Question.INSTANT, self.method.name)

    def response(self, n: int, load: Array) -> Array:
        """What a scaled wrench adds to the scaled accelerations of state n, shape (6 n_b,)."""
        answer = self.loaded(n, load)
        return self.equations[n].motion(answer.a_WB_W[0], answer.alpha_WB_W[0]) - self.accelerations(n)

    def response_error(self, n: int, load: Array) -> float:
        """Largest error of a response that is no fault: that of an answer with, and of one without the load."""
        eq = self.equations[n]
        return eq.acceleration_error(eq.solve(load), self.route) + eq.acceleration_error(eq.solution, self.route)

    def directions(self, n: int) -> Array:
        """Orthonormal directions among the free ones of state n, shape (freedom, k).

        Raises
        ------
        NotApplicableError
            If there are none.
        """
        freedom = self.equations[n].N.shape[1]
        if freedom == 0:
            raise NotApplicableError("nothing can move")
        if freedom <= MOST_DIRECTIONS:
            return np.eye(freedom)
        return np.linalg.qr(np.random.default_rng(n).normal(size=(freedom, MOST_DIRECTIONS)))[0]

    def push(self, n: int, direction: Array) -> Array:
        """Load along a free direction, as large as what acts already, so that neither drowns the other."""
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
            # the component along a unit vector adds up errors of all components
            allowed = np.sqrt(len(eq.velocity)) * max(self.response_error(n, load) for load in loads) / size
            found.append(Mobility(P.T @ (eq.N.T @ responses), P.T @ eq.reduced_inverse @ P, allowed))
        return found


def _with_loads(mechanism: Mechanism, wrenches: Array) -> Mechanism:
    """Forces and torques about the origins of the bodies, shape (n_b, 6), world axes, as loads."""
    loads = []
    for body, wrench in zip(mechanism.bodies, wrenches, strict=True):
        loads.append(Load(f"force on {body.name} (identity)", "force", body.name, wrench[:3], "world"))
        loads.append(Load(f"torque on {body.name} (identity)", "torque", body.name, wrench[3:], "world"))
    return replace(mechanism, loads=(*mechanism.loads, *loads))
