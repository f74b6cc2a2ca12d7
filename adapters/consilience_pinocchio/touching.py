"""Contacts of a mechanism in Pinocchio's terms: gap, normal, material points and rows of each nearest point.

The nearest point is at ``x = c + rho`` from the centre c of a sphere, point or circle of the body: ``rho = -r n`` of a
sphere, on the rim of a disc along the steepest direction of its plane. The slip is the velocity of the body's material
point at x relative to the partner's, ``s = v_B(x) - v_P(x)``. Its normal part is the rate of the gap, because x is the
nearest point. Pinocchio's own `PointContactConstraintModel` has the same rows for points that are given to it; shapes
are the adapter's. A step evaluates them for each contact: products of small arrays are by `ndarray.dot`, in half of the
time that ``@`` takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array, DiscPlane, ElementaryContact, SphereSphere, cross, plain_cross
from consilience_pinocchio.translate import WORLD_AXES, Translation, as_matrix

_ZERO = np.zeros(3)
_AXES = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]


class Side:
    """Body of contacts at Pinocchio's kinematics of the last `update`, all in world axes.

    Attributes
    ----------
    link : int
        Link of the tree that carries the body; -1 is the ground.
    fixed : bool
        Whether the body is fixed in the world.
    R, p : ndarray, shape (3, 3) and (3,)
        R_WB and p_WB.
    J : ndarray, shape (6, nv)
        Rows of the velocity of the body's origin, then of its angular velocity.
    """

    def __init__(self, translation: Translation, body: str) -> None:
        index = translation.mechanism.body_index[body]
        self.link = -1 if index < 0 else translation.tree.carrier(index)
        self._model, self._data, self._seat = translation.model, translation.data, translation.body_seat(index)
        self._where = self._model, self._data, self._seat.joint, self._seat.placement, WORLD_AXES
        self.fixed = bool(self._seat.joint == 0)
        self.J = np.zeros((6, self._model.nv))
        self._read()

    def place(self) -> None:
        """Read the pose."""
        if not self.fixed:
            self._read()

    def _read(self) -> None:
        frame = self._data.oMi[self._seat.joint] * self._seat.placement
        self.R, self.p = np.array(frame.rotation), np.array(frame.translation)

    def update(self) -> None:
        """Read pose and Jacobian; the data must hold placements and joint Jacobians."""
        self.place()
        if not self.fixed:
            self.J = as_matrix(pin.getFrameJacobian(*self._where), self._model)

    def rates(self) -> tuple[Array, Array, Array, Array]:
        """Return velocity of the origin, angular velocity, and their rates for the accelerations in the data."""
        if self.fixed:
            return _ZERO, _ZERO, _ZERO, _ZERO
        twist, a = pin.getFrameVelocity(*self._where), pin.getFrameClassicalAcceleration(*self._where)
        return twist.linear, twist.angular, a.linear, a.angular

    def velocity_rows(self, axes: list[list[float]], arm: Array) -> Array:
        """Return the rows (3, nv) of the velocity along axes of the material point at an arm from the body's origin."""
        lever = arm.tolist()
        return np.asarray(np.array([along + plain_cross(lever, along) for along in axes]).dot(self.J))

    def wrench(self, point: Array, force: Array) -> Array:
        """Return a force at a point as a wrench (6,) in axes and about the origin of the body's joint."""
        joint = self._data.oMi[self._seat.joint]
        R = joint.rotation.T
        return np.hstack([R @ force, R @ cross(point - joint.translation, force)])


@dataclass(frozen=True, eq=False)
class Nearest:
    """Nearest points of a contact at a state, in world axes.

    Attributes
    ----------
    gap : float, m
        Negative where the shapes overlap.
    axes : ndarray, shape (3, 3)
        Rows: two tangents, then the normal from partner to body.
    point : ndarray, shape (3,), m
    J : ndarray, shape (3, nv)
        Rows of the slip along the axes.
    """

    gap: float
    axes: Array
    point: Array
    J: Array


def _with_tangents(normal: list[float]) -> list[list[float]]:
    """Return two tangents, then the normal."""
    sizes = [abs(part) for part in normal]
    first = plain_cross(normal, _AXES[sizes.index(min(sizes))])
    length = hypot(*first)
    first = [part / length for part in first]
    return [first, plain_cross(normal, first), normal]


class Touch:
    """One contact with one nearest point, between two sides that others may share."""

    def __init__(self, contact: ElementaryContact, body: Side, partner: Side) -> None:
        self.law, self.body, self.partner = contact, body, partner

    def _geometry(self) -> tuple[float, Array, Array]:
        """Return the gap, the normal, and x from the origin of the body."""
        law, side, other = self.law, self.body, self.partner
        arm = side.R.dot(law.center)
        if isinstance(law, SphereSphere):
            apart = side.p + arm - other.p - other.R.dot(law.partner_center)
            distance = float(np.linalg.norm(apart))
            normal = apart / distance
            return distance - law.radius - law.partner_radius, normal, arm - law.radius * normal
        normal = other.R.dot(law.normal)
        height = float(normal.dot(side.p + arm - other.p - other.R.dot(law.point)))
        if isinstance(law, DiscPlane):
            steepest, steepness = self._steepest(normal)
            return height - law.radius * steepness, normal, arm + law.radius * steepest
        return height - law.radius, normal, arm - law.radius * normal

    def _steepest(self, normal: Array) -> tuple[Array, float]:
        """Return the direction in the plane of a disc that goes down most, and how steep it is."""
        axis = self.body.R @ self.law.axis  # type: ignore[union-attr]
        down = (normal @ axis) * axis - normal
        steepness = float(np.linalg.norm(down))
        return down / steepness, steepness

    def gap(self) -> float:
        """Return the gap in m."""
        return self._geometry()[0]

    def nearest(self) -> Nearest:
        """Return the nearest points and their rows."""
        gap, normal, arm = self._geometry()
        point, axes = self.body.p + arm, _with_tangents(normal.tolist())
        J = self.body.velocity_rows(axes, arm)
        if not self.partner.fixed:
            J = J - self.partner.velocity_rows(axes, point - self.partner.p)
        return Nearest(gap, np.array(axes), point, J)

    def bias(self, nearest: Nearest) -> Array:
        """Return the rates of the slip along the axes (3,) at zero joint accelerations, which the data must hold.

        ``ds/dt = a_B(c) + alpha_B x rho + w_B x rho' - [a_P + alpha_P x d + w_P x d']``, d from the origin of the
        partner to x; the normal part is the second derivative of the gap, ``n . ds/dt + n' . s``.
        """
        (v, w, a, alpha), (v_P, w_P, a_P, alpha_P) = self.body.rates(), self.partner.rates()
        normal, arm = nearest.axes[2], self.body.R @ self.law.center
        center_rate = v + cross(w, arm)
        normal_rate = cross(w_P, normal)
        if isinstance(self.law, SphereSphere):
            apart = center_rate - v_P - cross(w_P, self.partner.R @ self.law.partner_center)
            distance = nearest.gap + self.law.radius + self.law.partner_radius
            normal_rate = (apart - normal * (normal @ apart)) / distance
        rho, d = nearest.point - self.body.p - arm, nearest.point - self.partner.p
        rho_rate = self._rho_rate(normal, normal_rate, w)
        of_body = a + cross(alpha, arm) + cross(w, cross(w, arm)) + cross(alpha, rho) + cross(w, rho_rate)
        of_partner = a_P + cross(alpha_P, d) + cross(w_P, center_rate + rho_rate - v_P)
        slip = center_rate + cross(w, rho) - v_P - cross(w_P, d)
        return np.asarray(nearest.axes @ (of_body - of_partner) + np.array([0.0, 0.0, normal_rate @ slip]))

    def _rho_rate(self, normal: Array, normal_rate: Array, w: Array) -> Array:
        if not isinstance(self.law, DiscPlane):
            return np.asarray(-self.law.radius * normal_rate)
        axis = self.body.R @ self.law.axis
        turning = cross(w, axis)
        steepest, steepness = self._steepest(normal)
        rate = (normal_rate @ axis + normal @ turning) * axis + (normal @ axis) * turning - normal_rate
        return np.asarray(self.law.radius / steepness * (rate - steepest * (steepest @ rate)))
