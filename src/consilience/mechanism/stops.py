"""Stops and dry friction in joint coordinates: unilateral and set-valued elements. Immutable data.

Both act along the coordinate of a joint, as `consilience.mechanism.elements` defines it; the effort acts on the
successor, and the opposite on the predecessor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from consilience.errors import InvalidInput


def _finite(where: str, value: float | None) -> None:
    if value is not None and not np.isfinite(value):
        raise InvalidInput(where, f"{value} is no finite number", "Give a finite number, or leave it out.")


@dataclass(frozen=True, eq=False)
class Stop:
    """Limits of a joint coordinate: ``lower <= q <= upper``.

    A limit that is reached pushes with an effort of at least zero into the range; at an impact ``q'+ = -e q'-``.

    Attributes
    ----------
    name, joint, coordinate : str
    lower, upper : float or None, rad or m
        None: no limit on this side; at least one is given.
    restitution : float
        Coefficient e, 0 to 1.
    """

    name: str
    joint: str
    coordinate: str
    lower: float | None = None
    upper: float | None = None
    restitution: float = 0.0

    def __post_init__(self) -> None:
        where = f"stop '{self.name}'"
        for name in ("lower", "upper"):
            _finite(f"{where}: {name}", getattr(self, name))
        if self.lower is None and self.upper is None:
            raise InvalidInput(where, "it has no limit", "Give lower, upper, or both.")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            what = f"lower {self.lower:g} is not below upper {self.upper:g}"
            raise InvalidInput(where, what, "Give lower < upper.")
        if not 0.0 <= self.restitution <= 1.0:
            raise InvalidInput(f"{where}: restitution", f"{self.restitution} is out of range", "Choose 0 to 1.")

    @property
    def features(self) -> Iterator[str]:
        """Features that an engine must represent, in the names of `Mechanism.features`."""
        yield "stop"
        if self.restitution > 0.0:
            yield "stop restitution"


@dataclass(frozen=True, eq=False)
class DryFriction:
    """Coulomb's friction in a joint coordinate, which sticks: ``tau = -b sign(q')``, and ``|tau| <= b`` at rest.

    The bound b is either a constant, or the coefficient times the reaction force of the joint across its axis, times
    the radius of the pin if the coordinate is an angle.

    Attributes
    ----------
    name, joint, coordinate : str
    bound : float or None, N m or N
    coefficient : float or None
        Coefficient of friction; given if and only if the bound is not.
    radius : float or None, m
        Radius of the pin; given for an angle with a coefficient, and only there.
    """

    name: str
    joint: str
    coordinate: str
    bound: float | None = None
    coefficient: float | None = None
    radius: float | None = None

    def __post_init__(self) -> None:
        where = f"dry friction '{self.name}'"
        for name in ("bound", "coefficient", "radius"):
            value = getattr(self, name)
            _finite(f"{where}: {name}", value)
            if value is not None and value < 0.0:
                raise InvalidInput(f"{where}: {name}", f"{value:g} is negative", "Give a number of at least 0.")
        if (self.bound is None) == (self.coefficient is None):
            count = "none" if self.bound is None else "both"
            remedy = "Give a bound of the effort, or a coefficient of the reaction."
            raise InvalidInput(where, f"{count} of bound and coefficient given", remedy)
        pin = self.coefficient is not None and self.coordinate == "angle"
        if pin != (self.radius is not None):
            what = "the radius of the pin is missing" if pin else "it has no pin: only a coefficient about an axis has"
            raise InvalidInput(f"{where}: radius", what, "Give it." if pin else "Leave it out.")

    @property
    def features(self) -> Iterator[str]:
        """Features that an engine must represent, in the names of `Mechanism.features`."""
        yield "dry friction" if self.coefficient is None else "dry friction of a reaction"
