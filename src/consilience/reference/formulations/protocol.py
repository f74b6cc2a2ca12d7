"""Protocol of all formulations of the equations of motion."""

from __future__ import annotations

from typing import Protocol

from consilience.mechanism import Array, State


class Formulation(Protocol):
    """Equations of motion of one mechanism in the formulation's own coordinates u (positions, speeds, further states).

    Construction raises `InvalidInput` for a mechanism that the formulation cannot represent; the module's function
    ``unsupported(mechanism)`` gives the reasons. If the coordinates have charts, an attribute ``chart`` tells the
    current one; only `settle` changes it.
    """

    @property
    def name(self) -> str:
        """Key in `consilience.reference.formulations.registry.FORMULATIONS`."""
        ...

    def coordinates(self, state: State) -> Array:
        """Return the coordinates u of a consistent state, shape (n_u,)."""
        ...

    def state(self, u: Array) -> State:
        """Return the canonical state of coordinates u."""
        ...

    def derivative(self, t: float, u: Array) -> Array:
        """Return ``du/dt`` at the time t, shape (n_u,)."""
        ...

    def settle(self, t: float, u: Array) -> Array:
        """Return u after an accepted step as a new array: projected, full turns counted, charts changed where due."""
        ...

    def accelerations(self, state: State, t: float = 0.0) -> tuple[Array, Array]:
        """Return a_WB_W of the body origins (m/s^2) and alpha_WB_W (rad/s^2), world axes, each shape (n_b, 3)."""
        ...

    def reactions(self, state: State, t: float = 0.0) -> tuple[Array, Array] | None:
        """Return joint reactions on the successor, at the origin of M, axes of F, each shape (n_j, 3).

        Where dependent rows leave reactions undetermined, those of least norm; None if the formulation eliminates them.
        """
        ...
