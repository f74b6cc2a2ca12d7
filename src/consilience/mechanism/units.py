"""Units: a mechanism, its states and answers in other units, and with joint coordinates of the opposite sense.

Numbers depend on the units of length, mass and time, mechanics does not: tolerances, ranks and least displacements are
the same for a watch and for a crane where lengths are counted in the mechanism's `characteristic_length`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism.bodies import Body, Frame
from consilience.mechanism.contact_laws import Compliance
from consilience.mechanism.functions import Function, Table
from consilience.mechanism.model import GROUND, Mechanism
from consilience.mechanism.spatial import Array
from consilience.mechanism.stops import Stop

_T = TypeVar("_T")


class Units(NamedTuple):
    """How many of the new units make a metre, a kilogram, a second."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def inverse(self) -> Units:
        """Units that lead back."""
        return Units(*(1.0 / one for one in self))

    def convert(self, record: _T) -> _T:
        """Convert the fields of a record whose names are in the table of dimensions; None stays None."""
        known = {name: value for name, value in vars(record).items() if name in _DIMENSIONS and value is not None}
        return replace(record, **{n: x * float(np.prod(np.power(self, _DIMENSIONS[n]))) for n, x in known.items()})  # type: ignore[type-var]


_DIMENSIONS: dict[str, tuple[int, int, int]] = {
    "p_WB": (1, 0, 0),
    "v_WB_W": (1, 0, -1),
    "w_WB_W": (0, 0, -1),
    "a_WB_W": (1, 0, -2),
    "alpha_WB_W": (0, 0, -2),
    "force_F": (1, 1, -2),
    "torque_F": (2, 1, -2),
    "kinetic": (2, 1, -2),
    "potential": (2, 1, -2),
    "mass": (0, 1, 0),
    "com": (1, 0, 0),
    "inertia": (2, 1, 0),
    "time": (0, 0, 1),
    "contact_force": (1, 1, -2),
    "contact_gap": (1, 0, 0),
    "contact_impulse": (1, 1, -1),
    "contact_loss": (2, 1, -2),
    "event_time": (0, 0, 1),
    "stiffness": (0, 1, -2),
    "damping": (0, 1, -1),
    "rebound_threshold": (1, 0, -1),
    "pull": (0, 0, -2),
    "decay": (0, 0, -1),
    "width": (1, 0, 0),
    "inverse_mass": (0, -1, 0),
}
"""Powers of length, mass and time of the fields of states, answers, and laws of contact with their parts."""


_ROUNDING = 1e-12
"""Arms that count as zero, over the radius of gyration."""


@lru_cache(maxsize=64)  # needed in every step of an assembly
def characteristic_length(mechanism: Mechanism) -> float:
    """Return the longest rod, or arm from a body's origin to its centre of mass or a joint frame, m.

    If there is none but of rounding: the largest radius of gyration of a body about its centre of mass.
    """
    arms = [b.com for b in mechanism.bodies]
    arms += [j.F.p for j in mechanism.joints if j.predecessor != GROUND]
    arms += [j.M.p for j in mechanism.joints if j.successor != GROUND]
    lengths = [float(np.linalg.norm(a)) for a in arms] + [j.length for j in mechanism.joints]
    largest = np.linalg.norm([b.inertia for b in mechanism.bodies], 2, axis=(1, 2))
    gyration = float(np.sqrt(np.max(largest / [b.mass for b in mechanism.bodies])))
    return max(lengths) if max(lengths) > _ROUNDING * gyration else gyration


def own_units(mechanism: Mechanism, time: float = 1.0) -> Units:
    """Return the units nearest to characteristic length, total mass and a time, s, whose factors are powers of two.

    With these a conversion rounds nothing.
    """
    sizes = characteristic_length(mechanism), sum(b.mass for b in mechanism.bodies), time
    return Units(*(float(2.0 ** -np.round(np.log2(size))) for size in sizes))


def motion_units(mechanism: Mechanism, times: Array) -> Units:
    """Return the own units of a mechanism with that of a motion with sample times, s.

    The unit of time is about twice the duration, so that a tolerance of velocities means the same in any units of a
    case; for an instant alone it is the second.
    """
    return own_units(mechanism, 2.0 * float(times[-1] - times[0]) or 1.0)


_SI = {
    "m/s^2": (1, 0, -2),
    "rad/s^2": (0, 0, -2),
    "m/s": (1, 0, -1),
    "rad/s": (0, 0, -1),
    "1/kg": (0, -1, 0),
    "kg": (0, 1, 0),
    "N m": (2, 1, -2),
    "N s": (1, 1, -1),
    "N": (1, 1, -2),
    "J": (2, 1, -2),
    "m": (1, 0, 0),
    "s": (0, 0, 1),
}
"""Units in messages of failures, the longer before those that they begin with, as powers of length, mass and time."""

_AMOUNT = re.compile(
    rf"'[^']*'|(?<![\w.])(-?\d[\d.]*(?:e[-+]?\d+)?) ({'|'.join(map(re.escape, _SI))})(?![\w/^]| [ms]\b)"
)
"""An amount with its unit in the message of a failure, or a name in quotes, which stays."""


def in_si(message: str, units: Units) -> str:
    """Return a message with its amounts in SI units, where they are in others; names in quotes stay."""

    def converted(amount: re.Match[str]) -> str:
        if amount[1] is None:
            return amount[0]
        digits = max(6, sum(map(str.isdigit, amount[1].partition("e")[0])))
        return f"{float(amount[1]) / float(np.prod(np.power(units, _SI[amount[2]]))):.{digits}g} {amount[2]}"

    return message if units == Units() else _AMOUNT.sub(converted, message)


@contextmanager
def telling_si(units: Units) -> Iterator[None]:
    """Tell the amounts in the message of an exception in SI units, where it has them in these; not of bad input."""
    try:
        yield
    except Exception as error:
        if not isinstance(error, InvalidInput) and len(error.args) == 1 and isinstance(error.args[0], str):
            error.args = (in_si(error.args[0], units),)
        raise


def rescaled(function: Function, value: float, argument: float) -> Function:
    """Return ``value f(x / argument)``; the factors may be negative."""
    powers = argument ** np.arange(len(function.polynomial))
    table = function.table
    if table is not None:
        step = 1 if argument > 0 else -1
        table = Table(argument * table.x[::step], value * table.y[::step], table.periodic)
    return Function(value * function.polynomial / powers, function.harmonics * [value, 1.0 / argument, 1.0], table)


_FACTORS: dict[str, dict[str, str]] = {
    "springs": {
        "point_predecessor": "length",
        "point_successor": "length",
        "stiffness": "force / length",
        "damping": "force time / length",
        "free_length": "length",
        "actuator": "force",
    },
    "joint_springs": {
        "stiffness": "stiffness",
        "damping": "damping",
        "rest": "coordinate",
        "actuator": "effort",
        "higher_stiffness": "stiffness / coordinate",
        "higher_damping": "damping / |coordinate| / time",
    },
    "loads": {"vector": "effort", "point": "length", "history": "one"},
    "frictions": {"viscous": "damping", "coulomb": "|effort|", "speed": "|coordinate| / time"},
    "controls": {
        "target": "coordinate",
        "proportional": "stiffness",
        "integral": "stiffness / time",
        "derivative": "damping",
    },
    "drives": {"motion": "coordinate"},
    "couplings": {"law": "coordinate"},
    "rollings": {"center": "length", "point": "length", "radius": "length", "rounding": "length"},
    "skates": {"point": "length"},
    "contacts": dict.fromkeys(
        (
            *("center", "corner", "start", "end", "half_sizes", "radius", "point", "partner_center", "partner_radius"),
            *("torsional", "rolling"),
        ),
        "length",
    )
    | {"compliance": "compliance", "rebound_threshold": "length / time"},
    "stops": {"lower": "coordinate", "upper": "coordinate"},
    "dry_frictions": {"bound": "|effort|", "radius": "length"},
}
"""Dimension of each number, vector or function of each kind of element; see `_factors`. Of a tuple of numbers: that of
the number before the first, and by what each is divided once more than the one before."""


def _factors(length: float, force: float, time: float, coordinate: float, effort: float) -> dict[str, float]:
    """Return the factors from old numbers to new numbers by dimension, for one element.

    Parameters
    ----------
    length, force, time : float
        New units in a metre, a newton, a second.
    coordinate, effort : float
        Factors of the joint coordinate of the element, sign included, and of the effort in that coordinate. The effort
        of a load is its force or torque.
    """
    return {
        "one": 1.0,
        "length": length,
        "length / time": length / time,
        "force": force,
        "force / length": force / length,
        "force time / length": force * time / length,
        "coordinate": coordinate,
        "|coordinate| / time": abs(coordinate) / time,
        "effort": effort,
        "|effort|": abs(effort),
        "stiffness": effort / coordinate,
        "stiffness / time": effort / coordinate / time,
        "damping": effort / coordinate * time,
    }


def in_units(
    mechanism: Mechanism,
    length: float = 1.0,
    mass: float = 1.0,
    time: float = 1.0,
    sign: Mapping[str, float] | None = None,
) -> Mechanism:
    """Convert every number of a mechanism to other units.

    Parameters
    ----------
    mechanism : Mechanism
    length, mass, time : float
        New units in a metre, a kilogram, a second.
    sign : mapping of joint name to float, optional
        -1 for joints whose coordinates have the opposite sense; the frames of these joints stay as they are.
    """
    force, signs = mass * length / time**2, sign or {}

    def frame(old: Frame) -> Frame:
        return Frame(length * old.p, old.R)

    def coordinate(joint: str, name: str) -> float:
        return signs.get(joint, 1.0) * (length if name == "distance" else 1.0)

    def convert(element: Any, dimensions: Mapping[str, str]) -> Any:
        """Convert one element; None stays None."""
        own = coordinate(element.joint, element.coordinate) if hasattr(element, "coordinate") else 1.0
        effort = force if getattr(element, "kind", "") == "force" else force * length / own
        is_coupling = hasattr(element, "driver_joint")
        argument = coordinate(element.driver_joint, element.driver_coordinate) if is_coupling else time
        factors = _factors(length, force, time, own, effort)
        new: dict[str, Any] = {}
        for name, dimension in dimensions.items():
            old = vars(element).get(name)
            if isinstance(old, Function):
                new[name] = rescaled(old, factors[dimension], argument)
            elif isinstance(old, tuple):
                first, _, by = dimension.partition(" / ")
                new[name] = tuple(x * factors[first] / factors[by] ** n for n, x in enumerate(old, start=1))
            elif isinstance(old, Compliance):
                new[name] = Units(length, mass, time).convert(old)
            elif old is not None:
                new[name] = old * factors[dimension]
        if isinstance(element, Stop) and own < 0.0:
            new["lower"], new["upper"] = new.get("upper"), new.get("lower")
        return replace(element, **new)

    elements: dict[str, Any] = {
        group: tuple(convert(x, factors) for x in getattr(mechanism, group)) for group, factors in _FACTORS.items()
    }
    return replace(
        mechanism,
        gravity=mechanism.gravity * length / time**2,
        bodies=tuple(
            Body(b.name, mass * b.mass, length * b.com, mass * length**2 * b.inertia, frame(b.drawing))
            for b in mechanism.bodies
        ),
        joints=tuple(
            replace(j, F=frame(j.F), M=frame(j.M), length=length * j.length, pitch=length * j.pitch)
            for j in mechanism.joints
        ),
        **elements,
    )


@lru_cache(maxsize=8)
def kept_in_units(mechanism: Mechanism, units: Units) -> Mechanism:
    """Return a mechanism in other units, and keep it: so is what has been prepared for it."""
    return in_units(mechanism, *units)
