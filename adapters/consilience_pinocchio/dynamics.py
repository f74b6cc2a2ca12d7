"""Accelerations of a translated mechanism, by Pinocchio's solvers or by the harness's on Pinocchio's terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.harness import solve_constrained
from consilience.run import Method, Route
from consilience.spatial import Array
from consilience_pinocchio.forces import Forces
from consilience_pinocchio.translate import Translation

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

PROXIMAL: dict[str, Any] = {"absolute_accuracy": 1e-14, "mu": 1e-8, "max_iter": 20}
"""With the default mu = 0 and a single iteration, dependent constraint rows give NaN; with these values the
iteration converges to round-off, whatever the rank: nothing is left of mu, so the constraints have no softness."""

Accelerations = Callable[[Array, Array], Array]
WeldWrenches = list[tuple[Array, Array]]
"""For each weld the wrenches on original and copy, force then torque, in the axes and about the origins of their
joints."""


class Solution:
    """Accelerations at one state, and the forces that belong to them.

    Attributes
    ----------
    q, v, a : ndarray
        Configuration (nq,), velocity and acceleration (nv,).
    tau : ndarray, shape (nv,)
        Efforts of the joint springs.
    wrenches : ndarray, shape (n_links + 1, 6)
        Springs, loads and the constraint forces of the welds on the links, as in `Forces.wrenches`.
    """

    def __init__(self, q: Array, v: Array, a: Array, tau: Array, wrenches: Array) -> None:
        self.q, self.v, self.a, self.tau, self.wrenches = q, v, a, tau, wrenches


def _zero(model: Any) -> Array:
    return np.zeros(model.nv)


def articulated_body(translation: Translation, forces: Forces) -> Accelerations:
    """Forward dynamics of a tree by `pinocchio.aba`; springs and loads enter as external forces on the joints."""
    model, data = translation.model, translation.data
    zero = _zero(model)
    external = pin.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pin.Force.Zero())
    views = [(link, external[joint].vector) for link, joint in forces.loaded]

    def without_wrenches(q: Array, v: Array) -> Array:
        tau = forces.efforts(q, v) if forces.sprung else zero
        return np.asarray(pin.aba(model, data, q, v, tau))

    def with_wrenches(q: Array, v: Array) -> Array:
        """Accelerations under joint efforts and wrenches on the links."""
        tau = forces.efforts(q, v) if forces.sprung else zero
        pin.forwardKinematics(model, data, q, v)
        W = forces.wrenches()
        for _, view in views:
            view[:] = 0.0
        for link, view in views:  # several welded links may share a joint
            np.add(view, W[link], out=view)
        return np.asarray(pin.aba(model, data, q, v, tau, external))

    return with_wrenches if forces.active else without_wrenches


def _efforts(translation: Translation, forces: Forces) -> Accelerations:
    """All applied generalised forces: the loop solvers take no external wrenches, so the Jacobians carry them over."""
    model, data = translation.model, translation.data

    def efforts(q: Array, v: Array) -> Array:
        """Joint efforts, the wrenches on the links among them."""
        tau = forces.efforts(q, v) if forces.sprung else np.zeros(model.nv)
        if forces.active:
            pin.forwardKinematics(model, data, q, v)
            W = forces.wrenches()
            pin.computeJointJacobians(model, data)
            for link, joint in forces.loaded:
                tau = tau + pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).T @ W[link]
        return tau

    return efforts


def constraint_dynamics(translation: Translation, forces: Forces, proximal: Mapping[str, Any]) -> Accelerations:
    """Forward dynamics of loops by `pinocchio.constraintDynamics`, with these proximal settings away from default."""
    model, data = translation.model, translation.data
    constraints, constraint_data = translation.constraints, translation.constraint_data
    efforts = _efforts(translation, forces)
    settings = pin.ProximalSettings()
    if proximal:
        settings = pin.ProximalSettings(proximal["absolute_accuracy"], proximal["mu"], proximal["max_iter"])

    def accelerations(q: Array, v: Array) -> Array:
        tau = efforts(q, v)
        return np.array(pin.constraintDynamics(model, data, q, v, tau, constraints, constraint_data, settings))

    return accelerations


def weld_rows(translation: Translation, q: Array, v: Array) -> tuple[Array, Array]:
    """Jacobian (6 n_welds, nv) and right-hand side (6 n_welds,) of the accelerations that hold the welds.

    Rows of a weld: velocity of the copy's frame B relative to the original's, linear then angular, world axes.
    """
    model, data = translation.model, translation.data
    pin.forwardKinematics(model, data, q, v, _zero(model))
    pin.computeJointJacobians(model, data)
    rows, bias = [np.zeros((0, model.nv))], [np.zeros(0)]
    for original, copy in translation.welds:
        J = [pin.getFrameJacobian(model, data, s.joint, s.placement, WORLD_AXES) for s in (original, copy)]
        a = [pin.getFrameClassicalAcceleration(model, data, s.joint, s.placement, WORLD_AXES) for s in (original, copy)]
        rows.append(J[1] - J[0])
        bias.append(a[0].vector - a[1].vector)
    return np.vstack(rows), np.concatenate(bias)


def own_rows(translation: Translation, q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
    """Accelerations (nv,) and multipliers (6 n_welds,) of `weld_rows`, solved by the harness."""
    J, gamma = weld_rows(translation, q, v)
    M = np.array(pin.crba(translation.model, translation.data, q))
    bias = np.array(pin.nle(translation.model, translation.data, q, v))
    return solve_constrained(M, tau - bias, J, gamma)


def _contact_wrenches(translation: Translation) -> WeldWrenches:
    """Pinocchio gives the wrench on joint 1, at and in constraint frame 1; the copy has its opposite."""
    data, result = translation.data, []
    for (original, copy), contact in zip(translation.welds, translation.constraint_data, strict=True):
        frame_1 = data.oMi[original.joint] * original.placement
        frame_2 = data.oMi[copy.joint] * copy.placement
        on_copy = -frame_2.actInv(frame_1.act(contact.contact_force))
        result.append((original.placement.act(contact.contact_force).vector, copy.placement.act(on_copy).vector))
    return result


def _multiplier_wrenches(translation: Translation, lam: Array) -> WeldWrenches:
    """Multipliers of `weld_rows` push the copy at B, in world axes."""
    data, result = translation.data, []
    for n, seats in enumerate(translation.welds):
        sides = []
        for seat, sign in zip(seats, (-1.0, 1.0), strict=True):
            R = (data.oMi[seat.joint] * seat.placement).rotation
            push = sign * lam[6 * n : 6 * n + 6]
            sides.append(seat.placement.act(pin.Force(R.T @ push[:3], R.T @ push[3:])).vector)
        result.append((sides[0], sides[1]))
    return result


Way = Callable[[Translation, Forces, Method, Array, Array], tuple[Array, WeldWrenches]]


def _tree(translation: Translation, forces: Forces, _: Method, q: Array, v: Array) -> tuple[Array, WeldWrenches]:
    return articulated_body(translation, forces)(q, v), []


def _proximal(
    translation: Translation, forces: Forces, method: Method, q: Array, v: Array
) -> tuple[Array, WeldWrenches]:
    a = constraint_dynamics(translation, forces, method.settings)(q, v)
    pin.forwardKinematics(translation.model, translation.data, q)
    return a, _contact_wrenches(translation)


def _harness(translation: Translation, forces: Forces, _: Method, q: Array, v: Array) -> tuple[Array, WeldWrenches]:
    a, lam = own_rows(translation, q, v, _efforts(translation, forces)(q, v))
    return a, _multiplier_wrenches(translation, lam)


def _way(translation: Translation, method: Method) -> Way:
    if method.route is Route.HARNESS_SOLVE:
        return _harness
    return _proximal if translation.welds else _tree


def solve(translation: Translation, forces: Forces, method: Method, q: Array, v: Array) -> Solution:
    """Solve for accelerations by one of the methods, and collect the wrenches that act on the links with them."""
    a, weld_wrenches = _way(translation, method)(translation, forces, method, q, v)
    # the solvers leave other accelerations in `data` than those of the moving frames
    pin.forwardKinematics(translation.model, translation.data, q, v, a)
    W = forces.wrenches()
    for weld, (on_original, on_copy) in zip(translation.tree.welds, weld_wrenches, strict=True):
        W[weld.original] += on_original
        W[weld.copy] += on_copy
    return Solution(q, v, a, forces.efforts(q, v), W)
