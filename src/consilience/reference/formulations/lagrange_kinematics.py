"""Joint coordinates of a spanning tree and the poses of all bodies as CasADi expressions, for `lagrange`.

A tree joint is a sequence of steps from F to M, one for each coordinate of the joint table, in its order:

============  =======================  ==================================================
step          coordinates              pose of the end in the start
============  =======================  ==================================================
angle         theta                    Rz(theta); angle2: Rx(theta)
distance, x,  d                        d along z, x or y
y
position      x, y, z                  (x, y, z)
orientation   alpha, beta, gamma       C Rx(alpha) Ry(beta) Rz(gamma)
direction     alpha, beta              at l C Rx(alpha) Ry(beta) e_z, not turned
============  =======================  ==================================================

A rod of length l is a direction, then an orientation. If the tree passes a joint from successor to predecessor, the
pose is inverted; coordinates are still those of M relative to F.

Orientations use **charts**: Bryant angles x-y-z [C4 (4.55)] relative to a constant rotation C, singular at a quarter
turn of beta. C is the orientation at which the chart is chosen, so that angles start at zero; a new chart is chosen at
beta = `CHART_LIMIT`. C enters the expressions as a parameter (Euler parameters), so that a change of chart needs no new
differentiation.

Rows of cut joints, with the pose (p, R) of M in F, in axes of F:
``(X, Y, Z) = p``, ``L = |p|``, ``D_kl = R_kl`` [MASS (9)-(12)].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from consilience.engine import Unsupported
from consilience.errors import InvalidInput
from consilience.mechanism import (
    BASIC_CONSTRAINTS,
    GROUND,
    JOINT_KINDS,
    Array,
    Frame,
    Mechanism,
    RelativeMotion,
    State,
    joint_coordinates,
    joint_rates,
    quaternion_from_rotation,
    relative_motion,
    rotation_with_z_axis,
    spanning_tree,
)

CHART_LIMIT = 0.25 * np.pi
"""Angle beta at which a new chart is chosen, rad; the condition 1 / cos(beta) of the rates is 1.4 there."""

Expression = Any
"""SX expression of CasADi, which has no type information."""


class _CasADi:
    """CasADi, an optional dependency, imported at its first use; raises `InvalidInput` if it is missing."""

    def __getattr__(self, name: str) -> Any:
        try:
            return getattr(import_module("casadi"), name)
        except ImportError as error:
            raise InvalidInput(
                "formulation 'lagrange'",
                "it differentiates with CasADi, which is not installed",
                "Install the extra: pip install 'consilience[lagrange]'.",
            ) from error


ca = _CasADi()


class Compiled:
    """Function of symbols to expressions, evaluated by CasADi's virtual machine in buffers shared with NumPy."""

    def __init__(self, name: str, arguments: list[Expression], values: list[Expression]) -> None:
        dense = [ca.densify(value) for value in values]
        function = ca.Function(name, [ca.veccat(*arguments)], [ca.veccat(*dense)])
        self._shapes = [value.shape for value in dense]
        self._ends = np.cumsum([value.numel() for value in dense])
        self._in, self._out = np.zeros(function.size1_in(0)), np.zeros(function.size1_out(0))
        self._buffer, self._run = function.buffer()
        self._buffer.set_arg(0, self._in.data)
        self._buffer.set_res(0, self._out.data)

    def __call__(self, *arguments: Array | float) -> list[Array]:
        """Evaluate; return matrices, vectors as single columns."""
        np.concatenate([np.ravel(argument, order="F") for argument in arguments], out=self._in)
        self._run()
        parts = np.split(self._out.copy(), self._ends[:-1])
        return [part.reshape(shape, order="F") for part, shape in zip(parts, self._shapes, strict=True)]


class PoseExpression(NamedTuple):
    """Pose of one frame in another as expressions: origin (3) and rotation matrix (3, 3)."""

    p: Expression
    R: Expression

    def then(self, next_pose: PoseExpression) -> PoseExpression:
        """Return the pose of a frame that is given in this one."""
        return PoseExpression(self.p + self.R @ next_pose.p, self.R @ next_pose.R)

    def inverse(self) -> PoseExpression:
        """Return the inverse pose."""
        return PoseExpression(-(self.R.T @ self.p), self.R.T)


# ---------------------------------------------------------------- steps


def turn(axis: int, angle: Expression) -> Expression:
    """Return the rotation matrix about coordinate axis 0, 1 or 2."""
    b, d = (axis + 1) % 3, (axis + 2) % 3
    R = ca.SX.eye(3)
    R[b, b] = R[d, d] = ca.cos(angle)
    R[b, d], R[d, b] = -ca.sin(angle), ca.sin(angle)
    return R


def _along(axis: int, distance: Expression) -> PoseExpression:
    p = ca.SX.zeros(3)
    p[axis] = distance
    return PoseExpression(p, ca.SX.eye(3))


def _about(axis: int, angle: Expression) -> PoseExpression:
    return PoseExpression(ca.SX.zeros(3), turn(axis, angle))


def _reference(chart: Expression) -> Expression:
    """Return C from its Euler parameters [MASS (2)]."""
    e0, e = chart[0], chart[1:]
    return (e0 * e0 - ca.dot(e, e)) * ca.SX.eye(3) + 2 * e @ e.T + 2 * e0 * ca.skew(e)


def _direction(x: Expression, chart: Expression, length: float) -> PoseExpression:
    return PoseExpression(length * _reference(chart) @ turn(0, x[0]) @ turn(1, x[1])[:, 2], ca.SX.eye(3))


def _orientation(x: Expression, chart: Expression, _length: float) -> PoseExpression:
    return PoseExpression(ca.SX.zeros(3), _reference(chart) @ turn(0, x[0]) @ turn(1, x[1]) @ turn(2, x[2]))


def _read_direction(motion: RelativeMotion) -> tuple[Array, Array, Array]:
    """Return angles, rates and C at alpha = beta = 0: ``d/dt (l C Rx Ry e_z) = l C (beta', -alpha', 0)``."""
    C = rotation_with_z_axis(motion.p)
    across = C.T @ motion.v / np.linalg.norm(motion.p)
    return np.zeros(2), np.array([-across[1], across[0]]), quaternion_from_rotation(C)


def _read_orientation(motion: RelativeMotion) -> tuple[Array, Array, Array]:
    """Return angles, rates and C at zero angles, where the rates are the angular velocity in axes of M."""
    return np.zeros(3), motion.R.T @ motion.w, quaternion_from_rotation(motion.R)


@dataclass(frozen=True)
class JointStep:
    """Step of a joint.

    Attributes
    ----------
    size : int
        Number of coordinates.
    pose : callable
        ``pose(x, chart, length)`` of the end in the start; chart: Euler parameters of C.
    read : callable, optional
        Coordinates, rates and chart at the centre of a new chart, from the motion of M relative to F.
    """

    size: int
    pose: Callable[[Expression, Expression, float], PoseExpression]
    read: Callable[[RelativeMotion], tuple[Array, Array, Array]] | None = None


STEPS: dict[str, JointStep] = {
    "angle": JointStep(1, lambda x, _c, _l: _about(2, x)),
    "angle1": JointStep(1, lambda x, _c, _l: _about(2, x)),
    "angle2": JointStep(1, lambda x, _c, _l: _about(0, x)),
    "distance": JointStep(1, lambda x, _c, _l: _along(2, x)),
    "x": JointStep(1, lambda x, _c, _l: _along(0, x)),
    "y": JointStep(1, lambda x, _c, _l: _along(1, x)),
    "position": JointStep(3, lambda x, _c, _l: PoseExpression(x, ca.SX.eye(3))),
    "orientation": JointStep(3, _orientation, _read_orientation),
    "direction": JointStep(2, _direction, _read_direction),
}
"""Steps by name of the joint coordinate."""

_STEPS_OF_KIND = {"rod": ("direction", "orientation")}
"""Steps of joint kinds without coordinates in the joint table."""


def steps_of(kind: str) -> tuple[str, ...]:
    """Return the names of the steps of a joint kind from F to M."""
    return _STEPS_OF_KIND.get(kind, JOINT_KINDS[kind].coordinates)


# ---------------------------------------------------------------- layout


class Slot(NamedTuple):
    """Position of the coordinates of a step of a tree joint in y, and its chart (-1 for none)."""

    step: str
    joint: int
    first: int
    chart: int

    @property
    def columns(self) -> slice:
        """Columns of the coordinates in y."""
        return slice(self.first, self.first + STEPS[self.step].size)

    def beta(self, y: Array) -> float:
        """Return the angle beta of the chart, rad."""
        return float(y[self.first + 1])


@dataclass(frozen=True)
class Layout:
    """Arrangement of the joint coordinates y of a mechanism."""

    joints: tuple[tuple[int, bool], ...]  # tree joints from the ground outwards; passed from successor to predecessor
    cut: tuple[int, ...]  # joints that close loops
    slots: tuple[Slot, ...]  # all steps of the tree joints

    @property
    def size(self) -> int:
        """Number of joint coordinates n."""
        return sum(STEPS[slot.step].size for slot in self.slots)

    @property
    def charted(self) -> tuple[Slot, ...]:
        """Slots with a chart, in the order of the charts."""
        return tuple(slot for slot in self.slots if slot.chart >= 0)

    def column(self, joint: int, step: str) -> int:
        """Return the index in y of the first coordinate of a step of a tree joint."""
        return next(slot.first for slot in self.slots if (slot.joint, slot.step) == (joint, step))

    def read(self, mechanism: Mechanism, state: State) -> tuple[Array, Array, Array]:
        """Return y and y', shape (n,), and new charts, shape (4, n_c), of a state."""
        y, y_dot, charts = np.empty(self.size), np.empty(self.size), np.empty((4, len(self.charted)))
        for slot in self.slots:
            joint = mechanism.joints[slot.joint]
            motion = relative_motion(mechanism, state, joint)
            at, read = slot.columns, STEPS[slot.step].read
            if read is None:
                y[at] = joint_coordinates(joint, motion)[slot.step]
                y_dot[at] = joint_rates(joint, motion)[slot.step]
            else:
                y[at], y_dot[at], charts[:, slot.chart] = read(motion)
        return y, y_dot, charts


def layout(mechanism: Mechanism) -> Layout:
    """Choose a spanning tree and number its coordinates."""
    joints, cut = spanning_tree(mechanism)
    slots: list[Slot] = []
    first = charts = 0
    for k, _ in joints:
        for step in steps_of(mechanism.joints[k].kind):
            charted = STEPS[step].read is not None
            slots.append(Slot(step, k, first, charts if charted else -1))
            first += STEPS[step].size
            charts += charted
    return Layout(tuple(joints), tuple(cut), tuple(slots))


def unsupported_joints(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """List tree joints that are not a sequence of steps, and cut joints with rows that are not basic constraints."""
    found = []
    joints, cut = spanning_tree(mechanism)
    for k in [*(k for k, _ in joints), *cut]:
        joint = mechanism.joints[k]
        kind, steps = JOINT_KINDS[joint.kind], steps_of(joint.kind)
        basic = set(kind.rows) <= set(BASIC_CONSTRAINTS)
        complete = set(steps) <= set(STEPS) and sum(STEPS[s].size for s in steps) == kind.freedom
        if not basic or (k not in cut and not complete):
            reason = "this kind has a row that is none of the basic constraints, or a coordinate without a step"
            found.append(Unsupported(f"joint '{joint.name}': {joint.kind}", reason))
    return tuple(found)


# ---------------------------------------------------------------- expressions


def _frame(frame: Frame) -> PoseExpression:
    return PoseExpression(ca.SX(ca.DM(frame.p)), ca.SX(ca.DM(frame.R)))


class Poses:
    """Symbols of the coordinates, and poses of bodies and joints as expressions.

    Parameters
    ----------
    mechanism : Mechanism
    layout : Layout
    released : bool
        Add six virtual displacements z of M relative to F for every joint, along and about the axes of F at the origin
        of M, valid to first order at z = 0.

    Attributes
    ----------
    t : symbol
        Time, s.
    x, x_dot : symbol, shape (n,), or (n + 6 n_j,) if released
        Joint coordinates y, then z, and their rates.
    charts : symbol, shape (4, n_c)
    bodies : list of PoseExpression
        Poses of the bodies in the world.
    """

    def __init__(self, mechanism: Mechanism, layout: Layout, released: bool = False) -> None:
        SX = ca.SX
        self._mechanism, self._layout, self._released = mechanism, layout, released
        size = layout.size + (6 * len(mechanism.joints) if released else 0)
        self.t, self.x, self.x_dot = SX.sym("t"), SX.sym("x", size), SX.sym("x_dot", size)
        self.charts = SX.sym("c", 4, len(layout.charted))
        self._ground = PoseExpression(SX.zeros(3), SX.eye(3))
        found: dict[str, PoseExpression] = {GROUND: self._ground}
        for k, backward in layout.joints:
            joint = mechanism.joints[k]
            F, M, across = _frame(joint.F), _frame(joint.M), self._across(k)
            if backward:
                found[joint.predecessor] = found[joint.successor].then(M).then(across.inverse()).then(F.inverse())
            else:
                found[joint.successor] = found[joint.predecessor].then(F).then(across).then(M.inverse())
        self.bodies = [found[body.name] for body in mechanism.bodies]

    def body(self, name: str) -> PoseExpression:
        """Return the pose of a body, or of the ground, in the world."""
        return self._ground if name == GROUND else self.bodies[self._mechanism.body_index[name]]

    def _across(self, joint: int) -> PoseExpression:
        """Return the pose of M in F of a tree joint."""
        pose = self._ground
        for slot in self._layout.slots:
            if slot.joint == joint:
                chart = self.charts[:, slot.chart] if slot.chart >= 0 else None
                length = self._mechanism.joints[joint].length
                pose = pose.then(STEPS[slot.step].pose(self.x[slot.columns], chart, length))
        return self._release(joint, pose)

    def _release(self, joint: int, pose: PoseExpression) -> PoseExpression:
        """Displace M by the z of the joint."""
        if not self._released:
            return pose
        first = self._layout.size + 6 * joint
        shift, tilt = self.x[first : first + 3], self.x[first + 3 : first + 6]
        return PoseExpression(pose.p + shift, (ca.SX.eye(3) + ca.skew(tilt)) @ pose.R)

    def relative(self, joint: int) -> PoseExpression:
        """Return the pose of M in F of any joint, from the poses of its bodies."""
        j = self._mechanism.joints[joint]
        F = self.body(j.predecessor).then(_frame(j.F))
        return F.inverse().then(self.body(j.successor).then(_frame(j.M)))

    @cached_property
    def closure(self) -> Expression:
        """Residual ``g(y)`` of all rows of cut joints, shape (q,)."""
        rows = []
        for k in self._layout.cut:
            joint = self._mechanism.joints[k]
            p, R = self._release(k, self.relative(k))
            for row in joint.rows:
                if row == "L":
                    rows.append(ca.norm_2(p) - joint.length)
                elif row[0] == "D":
                    rows.append(R[int(row[1]) - 1, int(row[2]) - 1])
                else:
                    rows.append(p["XYZ".index(row)])
        return ca.vertcat(*rows) if rows else ca.SX.zeros(0, 1)

    def rate(self, expression: Expression) -> Expression:
        """Return the total time derivative of a function of t and x."""
        return ca.jtimes(expression, ca.vertcat(self.t, self.x), ca.vertcat(1, self.x_dot))
