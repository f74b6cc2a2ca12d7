"""Accelerations of a translated mechanism, by Pinocchio's solvers or by the harness's solver on Pinocchio's terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.engine import Method, Route, solve_constrained
from consilience.mechanism import Array
from consilience_pinocchio.contacts import Contacts
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.mimic import MIMIC, mimic_accelerations
from consilience_pinocchio.translate import WORLD_AXES, Translation, as_matrix

PROXIMAL: dict[str, Any] = {"absolute_accuracy": 1e-14, "mu": 1e-8, "max_iter": 20}
"""Settings with which the proximal iteration converges to rounding, whatever the rank of the constraint rows.

The result does not depend on mu: the constraints have no softness. With the default mu = 0 and one iteration, dependent
rows give NaN."""

STOCK: dict[str, Any] = {"absolute_accuracy": 1e-12, "mu": 0.0, "max_iter": 1}
"""Pinocchio's default settings."""

Accelerations = Callable[[Array, Array, float, Array], Array]
"""Joint accelerations (nv,) as a function of q, v, the time and the integrals of the controllers."""

WeldWrenches = list[tuple[Array, Array]]
"""For each weld the wrenches on original and copy: force, then torque, in the axes and about the origins of the joints
that carry them."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Accelerations at one state, with the forces that belong to them.

    Attributes
    ----------
    q, v, a : ndarray
        Configuration (nq,), velocity and acceleration (nv,).
    tau : ndarray, shape (nv,)
        Efforts in joint coordinates: springs, friction and control, and those of drives and couplings.
    wrenches : ndarray, shape (n_links + 1, 6)
        Springs, loads and the constraint forces of the welds and contacts on the links, as in `Forces.wrenches`.
    """

    q: Array
    v: Array
    a: Array
    tau: Array
    wrenches: Array


def articulated_body(translation: Translation, elements: Elements) -> Accelerations:
    """Return the forward dynamics of a tree by `pinocchio.aba`; springs and loads are external forces on the joints."""
    model, data = translation.model, translation.data
    forces, efforts = elements.forces, elements.efforts
    zero = np.zeros(model.nv)
    external = pin.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pin.Force.Zero())
    views = [(link, external[joint].vector) for link, joint in forces.loaded]

    def without_wrenches(q: Array, v: Array, t: float, integrals: Array) -> Array:
        tau = efforts.at(q, v, t, integrals) if efforts.active else zero
        return np.asarray(pin.aba(model, data, q, v, tau))

    def with_wrenches(q: Array, v: Array, t: float, integrals: Array) -> Array:
        """Accelerations under joint efforts and wrenches on the links."""
        tau = efforts.at(q, v, t, integrals) if efforts.active else zero
        pin.forwardKinematics(model, data, q, v)
        W = forces.wrenches(t)
        for _, view in views:
            view[:] = 0.0
        for link, view in views:  # several welded links may share a joint
            np.add(view, W[link], out=view)
        return np.asarray(pin.aba(model, data, q, v, tau, external))

    return with_wrenches if forces.active else without_wrenches


def _applied(translation: Translation, elements: Elements) -> Accelerations:
    """Return all applied generalised forces as a function.

    Wrenches on links are transformed by Jacobians, because Pinocchio's solvers for loops take no external wrenches.
    """
    model, data = translation.model, translation.data
    forces, efforts = elements.forces, elements.efforts

    def applied(q: Array, v: Array, t: float, integrals: Array) -> Array:
        tau = efforts.at(q, v, t, integrals) if efforts.active else np.zeros(model.nv)
        if forces.active:
            pin.forwardKinematics(model, data, q, v)
            W = forces.wrenches(t)
            pin.computeJointJacobians(model, data)
            for link, joint in forces.loaded:
                tau = tau + pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).T @ W[link]
        return tau

    return applied


def constraint_dynamics(contacts: Contacts, elements: Elements, proximal: Mapping[str, Any]) -> Accelerations:
    """Return the forward dynamics of loops by `pinocchio.constraintDynamics`; without settings, at its defaults."""
    translation = contacts.translation
    model, data = translation.model, translation.data
    constraints, constraint_data = translation.constraints, translation.constraint_data
    applied = _applied(translation, elements)
    settings = pin.ProximalSettings()
    if proximal:
        settings = pin.ProximalSettings(proximal["absolute_accuracy"], proximal["mu"], proximal["max_iter"])

    def accelerations(q: Array, v: Array, t: float, integrals: Array) -> Array:
        tau = applied(q, v, t, integrals)
        contacts.update(q, v, t)
        return np.array(pin.constraintDynamics(model, data, q, v, tau, constraints, constraint_data, settings))

    return accelerations


def forward_dynamics(translation: Translation, elements: Elements, proximal: Mapping[str, Any]) -> Accelerations:
    """Return the forward dynamics under rows of the adapter by `pinocchio.forwardDynamics`.

    The function of Pinocchio regularises once, ``(J M^-1 J^T + mu) lam = ...``. Repeated with the last multipliers on
    the right-hand side, this is the proximal iteration of `constraintDynamics`, which removes the error of mu. The
    multipliers stay in ``data.lambda_c``.
    """
    model, data = translation.model, translation.data
    applied = _applied(translation, elements)
    settings = STOCK | dict(proximal)
    mu, accuracy = settings["mu"], settings["absolute_accuracy"]

    def accelerations(q: Array, v: Array, t: float, integrals: Array) -> Array:
        """Iterate until the multipliers change by less than the accuracy, or ``max_iter`` times."""
        tau = applied(q, v, t, integrals)
        pin.computeAllTerms(model, data, q, v)
        J, gamma = all_rows(translation, elements, q, v, t)
        lam = np.zeros(len(gamma))
        for _ in range(settings["max_iter"]):
            a = pin.forwardDynamics(model, data, tau, J, -gamma - mu * lam, mu)
            change = mu * np.max(np.abs(data.lambda_c - lam))
            lam = np.array(data.lambda_c)
            if change < accuracy:
                break
        return np.array(a)

    return accelerations


def weld_rows(translation: Translation, q: Array, v: Array) -> tuple[Array, Array]:
    """Return the Jacobian (6 n_welds, nv) and the right-hand side (6 n_welds,) of the welds in joint accelerations.

    Rows of a weld: velocity of frame B of the copy relative to the original, linear then angular, world axes.
    """
    model, data = translation.model, translation.data
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data)
    rows, bias = np.zeros((6 * len(translation.welds), model.nv)), np.zeros(6 * len(translation.welds))
    for n, (original, copy) in enumerate(translation.welds):
        J = [pin.getFrameJacobian(model, data, s.joint, s.placement, WORLD_AXES) for s in (original, copy)]
        a = [pin.getFrameClassicalAcceleration(model, data, s.joint, s.placement, WORLD_AXES) for s in (original, copy)]
        rows[6 * n : 6 * n + 6] = as_matrix(J[1] - J[0], model)
        bias[6 * n : 6 * n + 6] = a[0].vector - a[1].vector
    return rows, bias


def all_rows(translation: Translation, elements: Elements, q: Array, v: Array, t: float) -> tuple[Array, Array]:
    """Return J (n, nv) and gamma (n,) of the welds, then of the elements.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    q, v : ndarray, shape (nq,) and (nv,)
    t : float, s
    """
    welds = weld_rows(translation, q, v)
    if not elements.rows.count:
        return welds
    rows = elements.rows.at(q, v, t)
    return np.vstack([welds[0], rows[0]]), np.concatenate([welds[1], rows[1]])


def own_rows(
    translation: Translation, elements: Elements, q: Array, v: Array, t: float, tau: Array
) -> tuple[Array, Array]:
    """Solve for accelerations (nv,) and multipliers of `all_rows` by the harness's solver.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    q, v : ndarray, shape (nq,) and (nv,)
    t : float, s
    tau : ndarray, shape (nv,)
        All applied generalised forces.
    """
    J, gamma = all_rows(translation, elements, q, v, t)
    M = np.array(pin.crba(translation.model, translation.data, q))
    bias = np.array(pin.nle(translation.model, translation.data, q, v))
    return solve_constrained(M, tau - bias, J, gamma)


def _contact_wrenches(translation: Translation) -> WeldWrenches:
    """Wrenches of the welds by `constraintDynamics`, given on joint 1 at and in constraint frame 1."""
    data, result = translation.data, []
    for (original, copy), contact in zip(translation.welds, translation.constraint_data, strict=False):
        frame_1 = data.oMi[original.joint] * original.placement
        frame_2 = data.oMi[copy.joint] * copy.placement
        on_copy = -frame_2.actInv(frame_1.act(contact.contact_force))
        result.append((original.placement.act(contact.contact_force).vector, copy.placement.act(on_copy).vector))
    return result


def multiplier_wrenches(translation: Translation, lam: Array) -> WeldWrenches:
    """Return wrenches of the welds from multipliers of `weld_rows`: wrenches on the copy at B, world axes."""
    data, result = translation.data, []
    for n, seats in enumerate(translation.welds):
        sides = []
        for seat, sign in zip(seats, (-1.0, 1.0), strict=True):
            R = (data.oMi[seat.joint] * seat.placement).rotation
            push = sign * lam[6 * n : 6 * n + 6]
            sides.append(seat.placement.act(pin.Force(R.T @ push[:3], R.T @ push[3:])).vector)
        result.append((sides[0], sides[1]))
    return result


def _solved(
    translation: Translation, elements: Elements, method: Method, q: Array, v: Array
) -> tuple[Array, WeldWrenches, Array]:
    """Accelerations, wrenches of the welds, and multipliers of the elements' rows at time zero, by a method.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    method : Method
    q, v : ndarray, shape (nq,) and (nv,)
    """
    start = q, v, 0.0, np.zeros(elements.efforts.control_count)
    if method.settings == MIMIC:
        a, lam = mimic_accelerations(translation, elements, q, v, _applied(translation, elements)(*start))
        return a, [], lam
    if method.route is Route.HARNESS_SOLVE:
        a, lam = own_rows(translation, elements, q, v, 0.0, _applied(translation, elements)(*start))
    elif method.name.startswith("forwardDynamics"):
        a = forward_dynamics(translation, elements, method.settings)(*start)
        lam = np.array(translation.data.lambda_c)
    elif translation.welds or elements.rows.count:
        contacts = Contacts(translation, elements)
        a = constraint_dynamics(contacts, elements, method.settings)(*start)
        pin.forwardKinematics(translation.model, translation.data, q)
        return a, _contact_wrenches(contacts.translation), contacts.multipliers()
    else:
        return articulated_body(translation, elements)(*start), [], np.zeros(0)
    return a, multiplier_wrenches(translation, lam), lam[6 * len(translation.welds) :]


def solve(translation: Translation, elements: Elements, method: Method, q: Array, v: Array) -> Solution:
    """Solve for accelerations at time zero by a method, and collect the forces that belong to them.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    method : Method
    q, v : ndarray, shape (nq,) and (nv,)
    """
    a, weld_wrenches, lam = _solved(translation, elements, method, q, v)
    return collected(translation, elements, (q, v, a), weld_wrenches, lam)


def collected(
    translation: Translation,
    elements: Elements,
    motion: tuple[Array, Array, Array],
    weld_wrenches: WeldWrenches,
    lam: Array,
) -> Solution:
    """Collect the forces of springs, loads, efforts, welds and rows at time zero; they leave the motion in the data.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    motion : tuple of ndarray
        q (nq,), v and a (nv,).
    weld_wrenches : list
    lam : ndarray
        Multipliers of the elements' rows.
    """
    q, v, a = motion
    # the solvers leave other accelerations in `data` than those of the moving frames
    pin.forwardKinematics(translation.model, translation.data, q, v, a)
    W = elements.forces.wrenches()
    for weld, (on_original, on_copy) in zip(translation.tree.welds, weld_wrenches, strict=True):
        W[weld.original] += on_original
        W[weld.copy] += on_copy
    tau = elements.efforts.at(q, v, 0.0, np.zeros(elements.efforts.control_count))
    if elements.rows.count:
        tau = tau + elements.rows.efforts(q, lam)
        for link, wrench in elements.rows.wrenches(lam):
            W[link] += wrench
    return Solution(q, v, a, tau, W)
