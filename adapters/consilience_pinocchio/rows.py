"""Rows ``J a = gamma`` of drives, couplings, rolling bodies and skates, which Pinocchio lacks, in its velocities.

- Drive ``q = f(t)``: ``a_q = f''``. Coupling ``q = f(p)``: ``a_q - f' a_p = f'' p'^2``. Both are rows in single joint
  coordinates.
- Rolling: the point of contact is at rho from the centre (`mechanism.rolling_contact`). The material point P in contact
  has no velocity at any time, so its acceleration is ``a_P = w x (w x rho - rho')``.
- Skate, at a point P of the body: ``l . a_P = -(w x l) . v_P``.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array, Function, Rolling, Skate, cross, plane_axes, rolling_contact
from consilience_pinocchio.efforts import Axis, axis
from consilience_pinocchio.translate import WORLD_AXES, Translation, as_matrix

_Contact = tuple[Any, Array, Array]
"""Rows ``directions @ a_P = gamma`` at a point P of a body: the `pinocchio.SE3` of P in the moving frame of the joint,
with the axes of the body; directions, shape (n, 3), in world axes; gamma, shape (n,)."""


class _Guided:
    """Body that rolls or skates, at Pinocchio's current placements and velocities."""

    def __init__(self, translation: Translation, body: str) -> None:
        index = translation.mechanism.body_index[body]
        self.link, self.seat = translation.tree.carrier(index), translation.body_seat(index)
        self._data = translation.data

    def motion(self) -> tuple[Array, Array, Array]:
        """Return R_WB, and velocity of the body's origin and angular velocity in body axes."""
        twist = self.seat.placement.actInv(self._data.v[self.seat.joint])
        return self._data.oMi[self.seat.joint].rotation @ self.seat.placement.rotation, twist.linear, twist.angular

    def placement_at(self, point: Array) -> Any:
        """Return the frame at a point given from the body's origin in body axes."""
        return self.seat.placement * pin.SE3(np.eye(3), np.array(point))


class Rolls(_Guided):
    """Rows of a rolling body at its point of contact: along the normal and two directions of the plane."""

    def __init__(self, translation: Translation, rolling: Rolling) -> None:
        super().__init__(translation, rolling.body)
        self._rolling = rolling
        self._directions = plane_axes(rolling)
        self.count = 3

    def touch(self) -> tuple[Array, Array]:
        """Return the point of contact from the body's origin, and the acceleration of the material point, body axes."""
        r = self._rolling
        R_WB, _, w_B = self.motion()
        w = R_WB @ w_B
        rho, rho_dot = rolling_contact(R_WB @ r.axis, r.normal, w, r.radius, r.rounding)
        return r.center + R_WB.T @ rho, R_WB.T @ cross(w, cross(w, rho) - rho_dot)

    def contact(self) -> _Contact:
        """Return the rows at the point of contact."""
        point, acceleration = self.touch()
        return self.placement_at(point), self._directions, self.along(acceleration)

    def along(self, vector: Array) -> Array:
        """Return the components along the normal and the two directions of a vector in body axes."""
        return np.asarray(self._directions @ (self.motion()[0] @ vector))


class _Skates(_Guided):
    """Row of a skate at its point, along the lateral direction, which turns with the body."""

    def __init__(self, translation: Translation, skate: Skate) -> None:
        super().__init__(translation, skate.body)
        self._skate = skate
        self._placement = self.placement_at(skate.point)
        self.count = 1

    def contact(self) -> _Contact:
        point, lateral = self._skate.point, self._skate.lateral
        R_WB, v, w = self.motion()
        gamma = -cross(w, lateral) @ (v + cross(w, point))
        return self._placement, (R_WB @ lateral)[None], np.array([gamma])


class Rows:
    """Rows of all drives, couplings, rolling bodies and skates of a mechanism, in this order.

    Attributes
    ----------
    count : int
    drives : list of (Axis, Function)
    rolls : list of Rolls
    """

    def __init__(self, translation: Translation) -> None:
        mechanism, at = translation.mechanism, partial(axis, translation)
        self._model, self._data = translation.model, translation.data
        self.drives = [(at(d.joint, d.coordinate), d.motion) for d in mechanism.drives]
        self._couplings: list[tuple[Axis, Axis, Function]] = [
            (at(c.joint, c.coordinate), at(c.driver_joint, c.driver_coordinate), c.law) for c in mechanism.couplings
        ]
        self.rolls = [Rolls(translation, rolling) for rolling in mechanism.rollings]
        self._guided: list[Rolls | _Skates] = [
            *self.rolls,
            *(_Skates(translation, skate) for skate in mechanism.skates),
        ]
        self._first_contact = len(self.drives) + len(self._couplings)
        self.count = self._first_contact + sum(guided.count for guided in self._guided)

    def at(self, q: Array, v: Array, t: float) -> tuple[Array, Array]:
        """Return the Jacobian J (count, nv) and gamma (count,).

        Pinocchio's data must hold placements, velocities, the accelerations of the frames at ``a = 0``
        (`pinocchio.forwardKinematics`) and the joint Jacobians.
        """
        J, gamma = np.zeros((self.count, self._model.nv)), np.zeros(self.count)
        for row, (place, law) in enumerate(self.drives):
            J[row, place.idx_v], gamma[row] = place.sign, law.jet(t)[2]
        for row, (driven, driver, law) in enumerate(self._couplings, len(self.drives)):
            _, slope, bend = law.jet(driver.sign * float(q[driver.idx_q]))
            J[row, driven.idx_v] += driven.sign
            J[row, driver.idx_v] -= slope * driver.sign
            gamma[row] = bend * v[driver.idx_v] ** 2
        row = self._first_contact
        for guided in self._guided:
            (placement, directions, wanted), rows = guided.contact(), slice(row, row + guided.count)
            where = self._model, self._data, guided.seat.joint, placement, WORLD_AXES
            J[rows] = directions @ as_matrix(pin.getFrameJacobian(*where), self._model)[:3]
            gamma[rows] = wanted - directions @ pin.getFrameClassicalAcceleration(*where).linear
            row += guided.count
        return J, gamma

    def efforts(self, q: Array, lam: Array) -> Array:
        """Return the generalised forces of drives and couplings, shape (nv,), for multipliers (count,)."""
        tau = np.zeros(self._model.nv)
        for row, (place, _) in enumerate(self.drives):
            tau[place.idx_v] += place.sign * lam[row]
        for row, (driven, driver, law) in enumerate(self._couplings, len(self.drives)):
            tau[driven.idx_v] += driven.sign * lam[row]
            tau[driver.idx_v] -= law.jet(driver.sign * float(q[driver.idx_q]))[1] * driver.sign * lam[row]
        return tau

    def wrenches(self, lam: Array) -> list[tuple[int, Array]]:
        """Return the wrenches of the contacts on links for multipliers (count,), at Pinocchio's current placements.

        A wrench, shape (6,), is in the axes and about the origin of the joint that carries the link.
        """
        result, row = [], self._first_contact
        for guided in self._guided:
            placement, directions, _ = guided.contact()
            force = guided.motion()[0].T @ (lam[row : row + guided.count] @ directions)
            result.append((guided.link, placement.act(pin.Force(force, np.zeros(3))).vector))
            row += guided.count
        return result
