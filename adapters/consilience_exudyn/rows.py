"""Constraint rows for which Exudyn has no object, as functions of the positions and Euler parameters of bodies.

Every row is ``J v = rate`` for the velocities (v_W, w_W) of the origins of its bodies, and ``value = 0`` if holonomic.
Angular velocities are ``w_W = 2 E(e) e'``, as in Exudyn's own joints: a change of the norm of e is no motion and does
not change a row. An integrator needs values, coefficients and rates; the right-hand sides `gamma` for accelerations at
a state are those of `consilience.mechanism.element_rows`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    Coupling,
    Drive,
    Joint,
    Mechanism,
    Rolling,
    Skate,
    State,
    cross,
    full_turns,
    holonomic_rows,
    joint_frames,
    linear,
    non_holonomic_rows,
    plane_axes,
    rolling_contact,
    row_gamma,
)

TURN = 2.0 * math.pi


class Pose(NamedTuple):
    """Position of the origin, and rotation matrix, of a body."""

    p: Array
    R: Array


_FIXED = Pose(np.zeros(3), np.eye(3))


class JointCoordinate:
    """Angle or distance of a joint with one axis, and coefficients of its rate.

    Parameters
    ----------
    mechanism : Mechanism
    joint, coordinate : str
    bodies : sequence of str
        Bodies of the row, in the order of poses and coefficients.
    """

    def __init__(self, mechanism: Mechanism, joint: str, coordinate: str, bodies: Sequence[str]) -> None:
        self._joint = mechanism.joints[mechanism.joint_index[joint]]
        self._angular = coordinate == "angle"
        self._i, self._j = (_place(bodies, name) for name in (self._joint.predecessor, self._joint.successor))
        self._F, self._M = self._joint.F, self._joint.M

    def value(self, poses: Sequence[Pose], near: float = 0.0) -> float:
        """Return the value; an angle is within half a turn of `near`, for a screw of the angle of its displacement."""
        if not self._angular:
            return self._distance(poses)
        if self._joint.pitch:
            near = TURN * self._distance(poses) / self._joint.pitch
        x_M = self._F.R.T @ (_at(poses, self._i).R.T @ (_at(poses, self._j).R @ self._M.R[:, 0]))
        if math.isnan(near):  # a function beyond its table, at which Newton's iteration must fail
            return near
        return full_turns(math.atan2(x_M[1], x_M[0]), near)

    def _distance(self, poses: Sequence[Pose]) -> float:
        u, _, _, d = self._along(poses)
        return float(u @ d)

    def _along(self, poses: Sequence[Pose]) -> tuple[Array, Array, Array, Array]:
        """Axis, arms to the origins of F and M from those of their bodies, and the vector from F to M; world axes."""
        here, there = _at(poses, self._i), _at(poses, self._j)
        s_i, s_j = here.R @ self._F.p, there.R @ self._M.p
        return here.R @ self._F.R[:, 2], s_i, s_j, there.p + s_j - here.p - s_i

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of the velocities of all bodies of the row, shape (6 n,)."""
        J = np.zeros(6 * len(poses))
        i, j = 6 * self._i, 6 * self._j
        if self._angular:
            u = _at(poses, self._i).R @ self._F.R[:, 2]
            if i >= 0:
                J[i + 3 : i + 6] -= u
            if j >= 0:
                J[j + 3 : j + 6] += u
            return J
        u, s_i, s_j, d = self._along(poses)
        if i >= 0:
            J[i : i + 3] -= u
            J[i + 3 : i + 6] -= cross(s_i + d, u)
        if j >= 0:
            J[j : j + 3] += u
            J[j + 3 : j + 6] += cross(s_j, u)
        return J


def _at(poses: Sequence[Pose], body: int) -> Pose:
    return poses[body] if body >= 0 else _FIXED


def _place(bodies: Sequence[str], name: str) -> int:
    return -1 if name == GROUND else list(bodies).index(name)


def _bodies_of(mechanism: Mechanism, *joints: str) -> tuple[str, ...]:
    """Bodies that joints connect, each once, without the ground."""
    found = [mechanism.joints[mechanism.joint_index[name]] for name in joints]
    ends = [end for joint in found for end in (joint.predecessor, joint.successor)]
    return tuple(name for name in dict.fromkeys(ends) if name != GROUND)


class Row:
    """Constraint rows of one element or screw.

    Attributes
    ----------
    name : str
    bodies : tuple of str
    axes : tuple of str
        Name of the motion that each row constrains.
    holonomic : bool
        False if the rows hold velocities only.
    joint : str or None
        Joint to which the constraint belongs; None for an element.
    """

    axes: tuple[str, ...] = ("motion",)
    holonomic = True
    joint: str | None = None

    def __init__(self, name: str, bodies: tuple[str, ...]) -> None:
        self.name, self.bodies = name, bodies

    def values(self, t: float, poses: Sequence[Pose]) -> list[float]:
        """Return the values that holonomic rows hold at zero."""
        raise NotImplementedError

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of ``(v_W, w_W)`` of the bodies, shape (rows, 6 n)."""
        raise NotImplementedError

    def rates(self, t: float) -> list[float]:
        """Return the rates that the rows hold."""
        return [0.0] * len(self.axes)

    def forget(self) -> None:
        """Count full turns from zero again."""


class DriveRow(Row):
    """``q = f(t)``."""

    def __init__(self, mechanism: Mechanism, drive: Drive) -> None:
        super().__init__(drive.name, _bodies_of(mechanism, drive.joint))
        self._q = JointCoordinate(mechanism, drive.joint, drive.coordinate, self.bodies)
        self._motion = drive.motion.jet

    def values(self, t: float, poses: Sequence[Pose]) -> list[float]:
        """Return ``q - f(t)``."""
        wanted = self._motion(t)[0]
        return [self._q.value(poses, wanted) - wanted]

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of ``q'``."""
        return self._q.coefficients(poses)[None]

    def rates(self, t: float) -> list[float]:
        """Return ``f'(t)``."""
        return [self._motion(t)[1]]


class CouplingRow(Row):
    """``q = f(x)``, with full turns of x counted from one evaluation to the next."""

    def __init__(self, mechanism: Mechanism, coupling: Coupling) -> None:
        super().__init__(coupling.name, _bodies_of(mechanism, coupling.driver_joint, coupling.joint))
        self._x = JointCoordinate(mechanism, coupling.driver_joint, coupling.driver_coordinate, self.bodies)
        self._q = JointCoordinate(mechanism, coupling.joint, coupling.coordinate, self.bodies)
        self._law = coupling.law.jet
        self._last = 0.0

    def _driver(self, poses: Sequence[Pose]) -> float:
        self._last = self._x.value(poses, self._last)
        return self._last

    def values(self, t: float, poses: Sequence[Pose]) -> list[float]:
        """Return ``q - f(x)``."""
        wanted = self._law(self._driver(poses))[0]
        return [self._q.value(poses, wanted) - wanted]

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of ``q' - f'(x) x'``."""
        slope = self._law(self._driver(poses))[1]
        return np.asarray(self._q.coefficients(poses) - slope * self._x.coefficients(poses))[None]

    def forget(self) -> None:
        """Count full turns of x from zero again."""
        self._last = 0.0


class ScrewRow(CouplingRow):
    """Thread ``Z = pitch angle / 2 pi`` of a screw, whose other rows are those of a cylindrical joint."""

    axes = ("thread",)

    def __init__(self, mechanism: Mechanism, joint: Joint) -> None:
        thread = Coupling(joint.name, joint.name, "angle", joint.name, "distance", linear(joint.pitch / TURN))
        super().__init__(mechanism, thread)
        self.joint = joint.name


class _RollingRow(Row):
    """Row of a rolling body."""

    def __init__(self, rolling: Rolling) -> None:
        super().__init__(rolling.name, (rolling.body,))
        self.rolling, self._plane = rolling, plane_axes(rolling)

    def _contact_velocity(self, directions: Array, pose: Pose) -> Array:
        """Coefficients of the velocity of the point of contact along directions, shape (rows, 6)."""
        return _point_velocity(directions, np.add(*lever(self.rolling, pose)))


class ContactRow(_RollingRow):
    """Contact of a rolling body with its plane: ``n . (c - point) = R |n - (n.a) a| + r``, centre c, axis a."""

    axes = ("contact",)

    def values(self, t: float, poses: Sequence[Pose]) -> list[float]:
        """Return the height of the point of contact over the plane."""
        s, rho = lever(self.rolling, poses[0])
        return [float(self.rolling.normal @ (poses[0].p + s + rho - self.rolling.point))]

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of the velocity of the point of contact along the normal."""
        return self._contact_velocity(self._plane[:1], poses[0])


class SlipRow(_RollingRow):
    """Velocity zero of the point of contact along two directions of the plane."""

    axes = ("slip", "slip across it")
    holonomic = False

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of the velocity of the point of contact along the plane."""
        return self._contact_velocity(self._plane[1:], poses[0])


class DiscRow(_RollingRow):
    """Sharp-edged disc, held by a joint of Exudyn's at the velocity of the point of contact."""

    axes = ("lateral slip", "longitudinal slip", "contact")
    holonomic = False


class SkateRow(Row):
    """Velocity zero of a point of a body along a direction of the body."""

    axes = ("lateral motion",)
    holonomic = False

    def __init__(self, skate: Skate) -> None:
        super().__init__(skate.name, (skate.body,))
        self._skate = skate

    def coefficients(self, poses: Sequence[Pose]) -> Array:
        """Return the coefficients of the velocity of the point along the direction."""
        R = poses[0].R
        return _point_velocity((R @ self._skate.lateral)[None], R @ self._skate.point)


def lever(rolling: Rolling, pose: Pose) -> tuple[Array, Array]:
    """Return the arm of the centre from the body's origin, and of the point of contact from the centre, world axes."""
    rho, _ = rolling_contact(pose.R @ rolling.axis, rolling.normal, np.zeros(3), rolling.radius, rolling.rounding)
    return pose.R @ rolling.center, rho


def _point_velocity(directions: Array, arm: Array) -> Array:
    return np.array([np.concatenate([u, cross(arm, u)]) for u in directions])


def rows_of(mechanism: Mechanism) -> tuple[Row, ...]:
    """Return the rows of screws, drives, couplings, rolling bodies and skates, in this order."""
    return (
        *(ScrewRow(mechanism, joint) for joint in mechanism.joints if joint.kind == "screw"),
        *(DriveRow(mechanism, drive) for drive in mechanism.drives),
        *(CouplingRow(mechanism, coupling) for coupling in mechanism.couplings),
        *(row for rolling in mechanism.rollings for row in _rolling(rolling)),
        *(SkateRow(skate) for skate in mechanism.skates),
    )


def _rolling(rolling: Rolling) -> tuple[Row, ...]:
    return (ContactRow(rolling), SlipRow(rolling)) if rolling.rounding else (DiscRow(rolling),)


def gammas(mechanism: Mechanism, state: State) -> list[Array]:
    """Return gamma of ``J a = gamma`` of each row of `rows_of`, at time zero and angles within half a turn.

    For a disc, whose rows are along axes of Exudyn's choice, the acceleration of the point of contact in world axes,
    shape (3,).
    """
    screws = [joint for joint in mechanism.joints if joint.kind == "screw"]
    found = [np.array([row_gamma(joint_frames(mechanism, state, joint), "H")]) for joint in screws]
    holonomic = [np.array([row.gamma]) for row in holonomic_rows(mechanism, state, 0.0, {})]
    free = [row.gamma for row in non_holonomic_rows(mechanism, state)]
    first = len(mechanism.drives) + len(mechanism.couplings)
    found += holonomic[:first]
    for n, rolling in enumerate(mechanism.rollings):
        contact, slip = holonomic[first + n], np.array(free[2 * n : 2 * n + 2])
        found += [contact, slip] if rolling.rounding else [plane_axes(rolling).T @ np.append(contact, slip)]
    return found + [np.array([value]) for value in free[2 * len(mechanism.rollings) :]]


def displacement_turns(mechanism: Mechanism, state: State, name: str) -> float:
    """Return the angle in rad about which turns are counted at a state: that of a screw's displacement, else zero."""
    joint = mechanism.joints[mechanism.joint_index[name]]
    if not joint.pitch:
        return 0.0
    frames = joint_frames(mechanism, state, joint)
    return TURN * float(frames.U[:, 2] @ frames.d) / joint.pitch
