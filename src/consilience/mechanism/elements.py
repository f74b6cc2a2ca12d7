"""What acts on a mechanism beside its joints: forces, drives, couplings and rolling contacts. Immutable data.

Joint coordinates are those of `joints.AXIS_COORDINATES`. Where an element reads an ``angle``, it is counted
over full turns from the initial state, where it is within half a turn of zero; the angle of a screw follows its
displacement from there on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism.functions import Function
from consilience.mechanism.spatial import Array, fixed_array


def _fix(element: object, *names: str) -> None:
    for name in names:
        object.__setattr__(element, name, fixed_array(getattr(element, name), (3,)))


def _unit(element: object, where: str, name: str) -> None:
    """Normalise a direction."""
    direction = fixed_array(getattr(element, name), (3,))
    norm = float(np.linalg.norm(direction))
    if norm == 0.0:
        raise InvalidInput(f"{where}: {name}", "the direction has no length", "Give a vector other than zero.")
    object.__setattr__(element, name, fixed_array(direction / norm, (3,)))


@dataclass(frozen=True, eq=False)
class Spring:
    """Spring-damper-actuator between two points.

    ``F = (k (L - L0) + c dL/dt - f(t)) e`` on the predecessor, e from predecessor to successor [MASS (30)-(32)]: a
    positive f pushes the points apart. Points are in the axes of their bodies, from the bodies' origins, in m; k in
    N/m, c in N s/m, L0 in m, f in N.
    """

    name: str
    predecessor: str
    successor: str
    point_predecessor: Array
    point_successor: Array
    stiffness: float
    damping: float
    free_length: float
    actuator: Function | None = None

    def __post_init__(self) -> None:
        _fix(self, "point_predecessor", "point_successor")


@dataclass(frozen=True, eq=False)
class JointSpring:
    """Spring-damper-actuator about or along the axis of a joint: ``-(k (q - q0) + c dq/dt) + f(t)`` on the successor.

    [MASS (33)-(35)], k in N m/rad or N/m. `coordinate` is ``angle`` or ``distance``.
    """

    name: str
    joint: str
    coordinate: str
    stiffness: float
    damping: float
    rest: float
    actuator: Function | None = None


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction in a joint, ``-(d q' + F tanh(q' / v))`` on the successor: viscous, and **regularised** Coulomb.

    The Coulomb part is regularised: below the speed v it is a stiff damper, and a joint that ought to stick creeps.

    Attributes
    ----------
    viscous : float, N m s/rad or N s/m
    coulomb : float, N m or N
        Friction torque or force of sliding.
    speed : float, rad/s or m/s
        Speed v at which the friction has 76 % of its value.
    """

    name: str
    joint: str
    coordinate: str
    viscous: float
    coulomb: float
    speed: float

    def __post_init__(self) -> None:
        where = f"friction '{self.name}'"
        if not self.speed > 0:
            raise InvalidInput(f"{where}: speed", f"{self.speed} is not positive", "Give the speed that regularises.")
        if min(self.viscous, self.coulomb) < 0:
            raise InvalidInput(where, "a coefficient is negative", "Friction takes energy away: give positive ones.")


@dataclass(frozen=True, eq=False)
class Control:
    """PID control of a joint coordinate: ``P e + I int e dt + D e'`` on the successor, ``e = target(t) - q``.

    The integral is zero at the initial state.
    """

    name: str
    joint: str
    coordinate: str
    target: Function
    proportional: float
    integral: float = 0.0
    derivative: float = 0.0


@dataclass(frozen=True, eq=False)
class Load:
    """A force at a point of a body, or a torque on it, fixed in the world or following the body.

    Attributes
    ----------
    vector : ndarray, shape (3,), N or N m
    point : ndarray, shape (3,), m
        Point of application of a force in body axes from the body's origin; without meaning for a torque.
    frame : {"world", "body"}
        Axes in which `vector` is constant.
    history : Function or None
        Factor of `vector` as a function of time; None: constant.
    """

    name: str
    kind: Literal["force", "torque"]
    body: str
    vector: Array
    frame: Literal["world", "body"]
    point: Array = field(default_factory=lambda: np.zeros(3))
    history: Function | None = None

    def __post_init__(self) -> None:
        _fix(self, "vector", "point")


@dataclass(frozen=True, eq=False)
class Drive:
    """A joint coordinate as a function of time, ``q = f(t)``: a rheonomic constraint."""

    name: str
    joint: str
    coordinate: str
    motion: Function


@dataclass(frozen=True, eq=False)
class Coupling:
    """A joint coordinate as a function of another one, ``q = f(q_driver)``.

    Linear for a gear pair or a rack (distance) and pinion (angle), a profile for a cam and its follower.
    """

    name: str
    driver_joint: str
    driver_coordinate: str
    joint: str
    coordinate: str
    law: Function

    def __post_init__(self) -> None:
        if (self.driver_joint, self.driver_coordinate) == (self.joint, self.coordinate):
            what = f"it couples the {self.coordinate} of joint '{self.joint}' with itself"
            raise InvalidInput(f"coupling '{self.name}'", what, "Couple two coordinates.")


@dataclass(frozen=True, eq=False)
class Rolling:
    """A disc, torus or ball that rolls without slipping on a plane fixed to the ground.

    The body has a circle of radius R about `center`, in the plane across `axis`, thickened to a torus of tube radius
    r: a sharp-edged disc has r = 0, a ball R = 0. One holonomic row keeps it on the plane, two non-holonomic rows hold
    the velocity of the point of contact.

    Attributes
    ----------
    center, axis : ndarray, shape (3,), m
        In body axes, from the body's origin.
    point, normal : ndarray, shape (3,), m
        A point of the plane and its normal towards the body, in the world.
    radius, rounding : float, m
        R and r.
    """

    name: str
    body: str
    center: Array
    axis: Array
    radius: float
    point: Array
    normal: Array
    rounding: float = 0.0

    def __post_init__(self) -> None:
        where = f"rolling '{self.name}'"
        _fix(self, "center", "point")
        _unit(self, where, "axis")
        _unit(self, where, "normal")
        if min(self.radius, self.rounding) < 0 or self.radius + self.rounding == 0:
            raise InvalidInput(f"{where}: radius", "there is nothing to roll on", "Give a positive radius or rounding.")


@dataclass(frozen=True, eq=False)
class Skate:
    """A knife edge: a point of a body does not move along `lateral`, a direction fixed to the body. Non-holonomic."""

    name: str
    body: str
    point: Array
    lateral: Array

    def __post_init__(self) -> None:
        _fix(self, "point")
        _unit(self, f"skate '{self.name}'", "lateral")
