"""Elements of a mechanism other than bodies and joints: forces, drives, couplings, rolling bodies. Immutable data.

An element in a joint coordinate names the joint and one of `joints.AXIS_COORDINATES`: ``angle`` in rad about, or
``distance`` in m along, +z of F. Its effort, N m or N, acts on the successor, and the opposite on the predecessor. An
``angle`` is counted over full turns from the initial state, where the angle is within half a turn of zero; that of a
screw follows the displacement from there on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from consilience.errors import InvalidInput, require
from consilience.mechanism.functions import Function
from consilience.mechanism.spatial import Array, fixed_array


def _named(element: Any, field_name: str) -> str:
    """Kind and name of an element, and a field, as messages name them."""
    return f"{type(element).__name__.lower()} '{element.name}': {field_name}"


def _fix(element: Any, *names: str) -> None:
    for name in names:
        object.__setattr__(element, name, fixed_array(getattr(element, name), (3,), _named(element, name)))


def _law(element: Any, field_name: str) -> None:
    """Refuse a law that is no function."""
    remedy = "Give a Function: Function(polynomial=[1.0]) is a constant."
    require(getattr(element, field_name), Function, _named(element, field_name), remedy)


def _unit(element: object, where: str, name: str) -> None:
    """Make a direction a unit vector."""
    direction = fixed_array(getattr(element, name), (3,), f"{where}: {name}")
    norm = float(np.linalg.norm(direction))
    if norm == 0.0:
        raise InvalidInput(f"{where}: {name}", "the direction has no length", "Give a vector other than zero.")
    object.__setattr__(element, name, fixed_array(direction / norm, (3,)))


@dataclass(frozen=True, eq=False)
class Spring:
    """Spring-damper-actuator between two points.

    ``F = (k (L - L0) + c dL/dt - f(t)) e`` on the predecessor, e from predecessor to successor [MASS (30)-(32)]: a
    positive f pushes the points apart. Where the points meet, see `spring_force`.

    Attributes
    ----------
    point_predecessor, point_successor : ndarray, shape (3,), m
        From the origins of the bodies, in body axes.
    stiffness, damping : float, N/m and N s/m
        k and c.
    free_length : float, m
        L0.
    actuator : Function or None
        f in N over time in s.
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

    @property
    def law(self) -> tuple[float, float, float]:
        """Stiffness, damping and free length."""
        return self.stiffness, self.damping, self.free_length


NO_LENGTH = 1e-14
"""Distance in m of two points that coincide but for rounding: their line has no direction."""


def spring_force(law: tuple[float, float, float], push: float, d: Array, v: Array) -> Array:
    """Return the force in N of a spring-damper-actuator on its predecessor, shape (3,).

    Points that coincide have the limit of the law along their relative velocity, ``c v``; where free length or actuator
    leave a force without a direction, the result is not a number.

    Parameters
    ----------
    law : (k, c, L0)
        Stiffness in N/m, damping in N s/m, free length in m.
    push : float, N
        Force of the actuator, positive to push the points apart.
    d, v : ndarray, shape (3,), m and m/s
        From the point on the predecessor to that on the successor, and its rate, in world axes.
    """
    stiffness, damping, free_length = law
    length = math.sqrt(d @ d)
    if length > NO_LENGTH:
        e = d / length
        return (stiffness * (length - free_length) + damping * float(e @ v) - push) * e
    return damping * v if stiffness * free_length + push == 0.0 else np.full(3, math.nan)


def spring_damper_law(
    x: float, rate: float, stiffness: tuple[float, float, float], damping: tuple[float, float, float]
) -> tuple[float, float]:
    """Return the effort of a joint spring, ``-(k x + k1 x^2 + k2 x^3) - (c + c1 |v| + c2 v^2) v``, and its damping.

    The damping is minus the slope with the rate. Exported scripts contain the text of this function. The reference
    solver has the law in kernels of its own.

    Parameters
    ----------
    x, rate : float
        Coordinate less the rest, rad or m, and its rate v.
    stiffness, damping : (k, k1, k2) and (c, c1, c2)
        See `JointSpring`.
    """
    k, k1, k2 = stiffness
    c, c1, c2 = damping
    speed = abs(rate)
    effort = -(k + (k1 + k2 * x) * x) * x - (c + (c1 + c2 * speed) * speed) * rate
    return effort, c + (2.0 * c1 + 3.0 * c2 * speed) * speed


@dataclass(frozen=True, eq=False)
class JointSpring:
    """Spring-damper-actuator in a joint coordinate q [MASS (33)-(35)], linear or with polynomials of degree three.

    ``-(k x + k1 x^2 + k2 x^3) - (c + c1 |v| + c2 v^2) v + f(t)``, ``x = q - q0``, ``v = dq/dt``: the part of k1 is
    even in x, all parts of the damper are odd in v. Springs that soften have a negative k1 or k2.

    Attributes
    ----------
    stiffness : float, N m/rad or N/m
        k.
    damping : float, N m s/rad or N s/m
        c.
    rest : float, rad or m
        q0.
    actuator : Function or None
        f in N m or N over time in s.
    higher_stiffness : tuple of up to two floats, N m/rad^2 and N m/rad^3, or N/m^2 and N/m^3
        k1 and k2; what is left out is zero.
    higher_damping : tuple of up to two floats, N m s^2/rad^2 and N m s^3/rad^3, or N s^2/m^2 and N s^3/m^3
        c1 and c2; what is left out is zero.
    """

    name: str
    joint: str
    coordinate: str
    stiffness: float
    damping: float
    rest: float
    actuator: Function | None = None
    higher_stiffness: tuple[float, ...] = ()
    higher_damping: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            higher = f"higher_{name}"
            object.__setattr__(self, higher, _higher(getattr(self, higher), f"joint spring '{self.name}': {higher}"))

    @property
    def laws(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Coefficients (k, k1, k2) of the spring and (c, c1, c2) of the damper."""
        (k1, k2), (c1, c2) = ((*given, 0.0, 0.0)[:2] for given in (self.higher_stiffness, self.higher_damping))
        return (self.stiffness, k1, k2), (self.damping, c1, c2)

    @property
    def higher(self) -> tuple[float, float, float, float]:
        """Coefficients (k1, k2, c1, c2)."""
        spring, damper = self.laws
        return (*spring[1:], *damper[1:])

    @property
    def is_linear(self) -> bool:
        """Whether the effort is linear in coordinate and rate."""
        return not any(self.higher)

    def potential(self, q: Any) -> Any:
        """Return the potential energy ``k x^2 / 2 + k1 x^3 / 3 + k2 x^4 / 4``, J, of one coordinate or an array."""
        (k, k1, k2), x = self.laws[0], q - self.rest
        return (0.5 * k + (k1 / 3.0 + 0.25 * k2 * x) * x) * x**2


def _higher(given: Any, where: str) -> tuple[float, ...]:
    """Return coefficients of the square and of the cube as floats, what is left out left out."""
    remedy = "Give up to two finite numbers: the coefficients of the square and of the cube."
    try:
        found = tuple(float(x) for x in given)
    except (TypeError, ValueError):
        raise InvalidInput(where, f"{given!r} is no sequence of numbers", remedy) from None
    if len(found) > 2:
        raise InvalidInput(where, f"there are {len(found)} coefficients", remedy)
    if not all(math.isfinite(x) for x in found):
        raise InvalidInput(where, f"{found} is not finite", remedy)
    return found


def friction_law(rate: float, viscous: float, coulomb: float, speed: float) -> tuple[float, float]:
    """Return the effort of regularised friction, ``-(d q' + F tanh(q' / v))``, and its damping, minus the slope.

    Exported scripts contain the text of this function. The reference solver has the law in kernels of its own.
    """
    part = math.tanh(rate / speed)
    return -(viscous * rate + coulomb * part), viscous + coulomb / speed * (1.0 - part**2)


@dataclass(frozen=True, eq=False)
class Friction:
    """Viscous and **regularised** Coulomb friction in a joint coordinate (`friction_law`).

    Below the speed v the Coulomb part is a stiff damper: a joint that ought to stick creeps.

    Attributes
    ----------
    viscous : float, N m s/rad or N s/m
        d.
    coulomb : float, N m or N
        F, torque or force of sliding.
    speed : float, rad/s or m/s
        v, at which the Coulomb part is 76 % of F.
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
    """PID control of a joint coordinate: ``P e + I int e dt + D e'``, ``e = target(t) - q``.

    The integral is zero at the initial state. P is in N m/rad or N/m, I and D in these units per s and times s.
    """

    name: str
    joint: str
    coordinate: str
    target: Function
    proportional: float
    integral: float = 0.0
    derivative: float = 0.0

    def __post_init__(self) -> None:
        _law(self, "target")


@dataclass(frozen=True, eq=False)
class Load:
    """A force at a point of a body, or a torque on the body, fixed in the world or in the body.

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
    """Rheonomic constraint: a joint coordinate as a function of time, ``q = f(t)``, in rad or m, t in s."""

    name: str
    joint: str
    coordinate: str
    motion: Function

    def __post_init__(self) -> None:
        _law(self, "motion")


@dataclass(frozen=True, eq=False)
class Coupling:
    """Constraint between two joint coordinates, ``q = f(q_driver)``.

    Linear for a gear pair or a rack (distance) and pinion (angle), a profile for a cam and its follower.
    """

    name: str
    driver_joint: str
    driver_coordinate: str
    joint: str
    coordinate: str
    law: Function

    def __post_init__(self) -> None:
        _law(self, "law")
        if (self.driver_joint, self.driver_coordinate) == (self.joint, self.coordinate):
            what = f"it couples the {self.coordinate} of joint '{self.joint}' with itself"
            raise InvalidInput(f"coupling '{self.name}'", what, "Couple two coordinates.")


@dataclass(frozen=True, eq=False)
class Rolling:
    """A disc, torus or ball that rolls without slipping on a plane fixed to the ground.

    The body has a circle of radius R about `center`, in the plane across `axis`, thickened to a torus of tube radius
    r: a sharp-edged disc has r = 0, a ball R = 0. One holonomic row keeps the body on the plane, two non-holonomic rows
    hold the velocity of the point of contact (`element_rows`).

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
    """Knife edge: a point of a body has no velocity along `lateral`, a direction fixed to the body. Non-holonomic.

    Point (m, from the body's origin) and direction are in body axes.
    """

    name: str
    body: str
    point: Array
    lateral: Array

    def __post_init__(self) -> None:
        _fix(self, "point")
        _unit(self, f"skate '{self.name}'", "lateral")
