"""What every formulation of the equations of motion offers, in whatever coordinates it is written."""

from __future__ import annotations

from typing import Protocol

from consilience.mechanism import Array, State


class Formulation(Protocol):
    """Equations of motion of one mechanism in coordinates u (positions and speeds) of their own.

    A class is constructed with a mechanism and refuses one it cannot represent with `InvalidInput`; the function
    ``unsupported(mechanism)`` beside it gives the reasons. A formulation whose coordinates have charts has an
    attribute ``chart`` that only `settle` changes.
    """

    @property
    def name(self) -> str:
        """Key in `consilience.reference.formulations.registry.FORMULATIONS`."""
        ...

    def coordinates(self, state: State) -> Array:
        """Coordinates u of a consistent state, shape (n_u,)."""
        ...

    def state(self, u: Array) -> State:
        """Canonical state of coordinates u."""
        ...

    def derivative(self, t: float, u: Array) -> Array:
        """``du/dt`` at the time t, shape (n_u,)."""
        ...

    def settle(self, t: float, u: Array) -> Array:
        """New array: u after an accepted step, brought back to the constraints or to another chart."""
        ...

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3)."""
        ...

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array] | None:
        """Joint reactions, on the successor, at the origin of M, axes of F, each shape (n_j, 3).

        Of least norm where dependent rows leave them open; None if the formulation eliminates them.
        """
        ...
