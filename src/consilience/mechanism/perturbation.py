"""Errors in the parameters of a mechanism: which parameters there are, and the mechanism with one of them off.

A size is relative, but for a joint: its place is off by a multiple of the characteristic length of a body, its axis by
an angle in rad. A joint is moved in both of its bodies at once, in the pose of a given state, so that this pose stays
assembled. Errors that move the pose (ratios of couplings, drives, radii) are followed by assembly with the least
displacement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from consilience.errors import CannotAssemble
from consilience.mechanism.assembly import assemble_positions, assemble_velocities
from consilience.mechanism.bodies import Frame
from consilience.mechanism.constraints import free_directions
from consilience.mechanism.functions import Function
from consilience.mechanism.model import GROUND, Joint, Mechanism, State
from consilience.mechanism.spatial import Array, quaternion_from_rotation_vector, rotation_from_quaternion
from consilience.mechanism.units import characteristic_length, rescaled

GRAVITY, MASS, INERTIA, PLACE, AXIS, COEFFICIENT = KINDS = (
    "gravity",
    "mass",
    "moment of inertia",
    "joint place",
    "joint axis",
    "coefficient",
)
"""Kinds of parameters."""

OBLIQUE = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
"""Direction of a displaced joint, along no axis of the world."""

_COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "springs": ("stiffness", "damping", "free_length", "actuator"),
    "joint_springs": ("stiffness", "damping", "rest", "actuator", "higher_stiffness", "higher_damping"),
    "loads": ("vector",),
    "frictions": ("viscous", "coulomb"),
    "controls": ("proportional", "integral", "derivative", "target"),
    "drives": ("motion",),
    "couplings": ("law",),
    "rollings": ("radius", "rounding"),
    "contacts": ("restitution", "friction", "static_friction", "torsional", "rolling"),
    "stops": ("restitution", "lower", "upper"),
    "dry_frictions": ("bound", "coefficient", "radius"),
}
"""Coefficients of each group of elements."""

_MOVING = ("drives", "couplings", "rollings")
"""Groups of elements whose coefficients change the pose."""


@dataclass(frozen=True)
class Perturbation:
    """A parameter that is off by a size; `of` names it: ``mass of body 'crank'``."""

    kind: str
    of: str
    size: float


@dataclass(frozen=True, eq=False)
class PhysicalParameter:
    """A parameter of a mechanism that may be wrong.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    of : str
        The parameter in words.
    part : int
        Number of the body, joint or element in its group.
    change : callable
        Function of a mechanism and a size that returns the mechanism with the parameter off.
    moves : bool
        Whether states of the mechanism violate the constraints of the changed one.
    """

    kind: str
    of: str
    part: int
    change: Callable[[Mechanism, float], Mechanism]
    moves: bool = False

    def perturbed(
        self, mechanism: Mechanism, states: Sequence[State], size: float
    ) -> tuple[Mechanism, list[State]] | None:
        """Return the mechanism with the parameter off, and its states nearest to the given ones.

        None if there is no such mechanism that moves as freely: an axis that is tilted locks a loop of parallel axes.
        """
        changed = self.change(mechanism, size)
        if not self.moves:
            return changed, list(states)
        try:
            moved = [_assembled(changed, state) for state in states]
        except CannotAssemble:
            return None
        freedom = free_directions(mechanism, states[0]).shape[1]
        return (changed, moved) if free_directions(changed, moved[0]).shape[1] == freedom else None


def _assembled(mechanism: Mechanism, state: State) -> State:
    return assemble_velocities(mechanism, assemble_positions(mechanism, state))


def physical_parameters(mechanism: Mechanism, start: State) -> Iterator[PhysicalParameter]:
    """List the parameters of a mechanism; joints are moved in the pose of the state `start`."""
    if np.any(mechanism.gravity):
        yield PhysicalParameter(GRAVITY, "gravity", 0, lambda m, size: replace(m, gravity=(1.0 + size) * m.gravity))
    for n, body in enumerate(mechanism.bodies):
        yield PhysicalParameter(MASS, f"mass of body '{body.name}'", n, _of("bodies", n, "mass"))
        yield PhysicalParameter(INERTIA, f"moments of inertia of body '{body.name}'", n, _of("bodies", n, "inertia"))
        yield PhysicalParameter(INERTIA, f"largest moment of inertia of body '{body.name}'", n, _largest_moment(n))
    for n, joint in enumerate(mechanism.joints):
        if joint.kind != "free":
            yield PhysicalParameter(PLACE, f"place of joint '{joint.name}'", n, _joint(n, start, _displaced), True)
            yield PhysicalParameter(AXIS, f"axis of joint '{joint.name}'", n, _joint(n, start, _tilted), True)
    for group, names in _COEFFICIENTS.items():
        for n, element in enumerate(getattr(mechanism, group)):
            for name in names:
                value, whose = getattr(element, name), f"{group.removesuffix('s').replace('_', ' ')} '{element.name}'"
                for entry in range(len(value)) if isinstance(value, tuple) else (None,):
                    if coefficient_acts(value if entry is None else value[entry]):
                        of = name.replace("_", " ") + ("" if entry is None else f"[{entry}]") + f" of {whose}"
                        yield PhysicalParameter(COEFFICIENT, of, n, _of(group, n, name, entry), group in _MOVING)


def coefficient_acts(value: Any) -> bool:
    """Whether a coefficient, several of them or a law is there and is not zero."""
    if isinstance(value, Function):
        return value.table is not None or bool(np.any(value.polynomial)) or bool(np.any(value.harmonics[:, 0]))
    return value is not None and bool(np.any(value))


def scaled_coefficient(value: Any, factor: float) -> Any:
    """Multiply a coefficient, several of them or a law by a factor; None stays None."""
    if isinstance(value, Function):
        return rescaled(value, factor, 1.0)
    if isinstance(value, tuple):
        return tuple(factor * one for one in value)
    return None if value is None else factor * value


def _of(group: str, n: int, name: str, entry: int | None = None) -> Callable[[Mechanism, float], Mechanism]:
    """Return the change of a field of the n-th part of a group; smaller, as a restitution of one cannot be larger.

    Of a field that is a tuple, one entry changes.
    """

    def change(mechanism: Mechanism, size: float) -> Mechanism:
        parts = list(getattr(mechanism, group))
        old, factor = getattr(parts[n], name), 1.0 - size
        new = (
            scaled_coefficient(old, factor)
            if entry is None
            else tuple(x * factor ** (k == entry) for k, x in enumerate(old))
        )
        parts[n] = replace(parts[n], **{name: new})
        return replace(mechanism, **{group: tuple(parts)})  # type: ignore[arg-type]

    return change


def _largest_moment(n: int) -> Callable[[Mechanism, float], Mechanism]:
    """Return the change of the largest principal moment of the n-th body, by a body that is shorter.

    Mass moves towards the plane across the longest principal axis: the moments about the other two axes become smaller
    by the same amount, and remain those of a body for errors up to 1/2.
    """

    def change(mechanism: Mechanism, size: float) -> Mechanism:
        bodies = list(mechanism.bodies)
        moments, axes = np.linalg.eigh(bodies[n].inertia)
        across = np.eye(3) - np.outer(axes[:, 0], axes[:, 0])
        bodies[n] = replace(bodies[n], inertia=bodies[n].inertia - size * moments[2] * across)
        return replace(mechanism, bodies=tuple(bodies))

    return change


Place = tuple[Array, Array]
"""Origin, m, and rotation matrix of a body in the world."""


def _joint(
    n: int, start: State, change_in: Callable[[Joint, Place, Place, float], Joint]
) -> Callable[[Mechanism, float], Mechanism]:
    """Return the change of the n-th joint, which moves in both bodies in the pose of the state."""

    def change(mechanism: Mechanism, size: float) -> Mechanism:
        joint = mechanism.joints[n]
        length = characteristic_length(mechanism) if change_in is _displaced else 1.0
        i, j = (_place(mechanism, start, name) for name in (joint.predecessor, joint.successor))
        joints = list(mechanism.joints)
        joints[n] = change_in(joint, i, j, size * length)
        return replace(mechanism, joints=tuple(joints))

    return change


def _place(mechanism: Mechanism, state: State, body: str) -> Place:
    if body == GROUND:
        return np.zeros(3), np.eye(3)
    k = mechanism.body_index[body]
    return state.p_WB[k], state.R_WB[k]


def _displaced(joint: Joint, i: Place, j: Place, distance: float) -> Joint:
    """Move both frames by a distance in m."""
    d = distance * OBLIQUE
    F, M = Frame(joint.F.p + i[1].T @ d, joint.F.R), Frame(joint.M.p + j[1].T @ d, joint.M.R)
    return replace(joint, F=F, M=M)


def _tilted(joint: Joint, i: Place, j: Place, angle: float) -> Joint:
    """Turn both frames about the origin of F by an angle in rad, across the axis of the joint."""
    F, M = i[1] @ joint.F.R, j[1] @ joint.M.R
    turn = rotation_from_quaternion(quaternion_from_rotation_vector(angle * (F[:, 0] + F[:, 1]) / np.sqrt(2.0)))
    origin = i[0] + i[1] @ joint.F.p
    arm = turn @ (j[0] + j[1] @ joint.M.p - origin)
    return replace(
        joint, F=Frame(joint.F.p, i[1].T @ turn @ F), M=Frame(j[1].T @ (origin + arm - j[0]), j[1].T @ turn @ M)
    )
