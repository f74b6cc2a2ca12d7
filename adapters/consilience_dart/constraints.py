"""Constraint rows in DART's coordinates: welds of split bodies, drives, couplings, rolling contacts and skates.

Every row is ``J a = gamma`` in the skeleton's accelerations. Rows on bodies are made of DART's Jacobians and of the
bias, DART's accelerations of bodies at ``a = 0``. Rows of drives and couplings are on single coordinates and have no
bias. Coefficients of contacts and skates in the velocities of a body are from `consilience.mechanism.element_rows`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from consilience.mechanism import Array, ElementRow, State, non_holonomic_rows, rolling_rows
from consilience_dart.state import read
from consilience_dart.translation import Model

Rows = tuple[Array, Array]
"""J, shape (r, n), and gamma, shape (r,)."""


def weld_terms(model: Model) -> Rows:
    """Return the Jacobian (6 per weld, n) of the motion of copies relative to originals, and its bias.

    Rows of a weld: angular velocity, then velocity of the body's origin, world axes. The skeleton's accelerations must
    be zero.
    """
    links, nodes, skeleton = model.tree.links, model.nodes, model.skeleton
    jacobian = np.zeros((6 * len(model.tree.welds), skeleton.getNumDofs()))
    bias = np.zeros(len(jacobian))
    for n, weld in enumerate(model.tree.welds):
        rows = slice(6 * n, 6 * n + 6)
        for i, sign in ((weld.copy, 1.0), (weld.original, -1.0)):
            node, origin = nodes[i], links[i].body_frame.p
            # two calls: DART's Jacobian of six rows is in axes of its own choice
            jacobian[rows] += sign * np.vstack(
                [skeleton.getAngularJacobian(node), skeleton.getLinearJacobian(node, origin)]
            )
            bias[rows] += sign * np.concatenate([node.getAngularAcceleration(), node.getLinearAcceleration(origin)])
    return jacobian, bias


def _welds(model: Model, t: float) -> Rows:
    jacobian, bias = weld_terms(model)
    return jacobian, -bias


def _drives(model: Model, t: float) -> Rows:
    """``q'' = f''(t)``."""
    drives = model.mechanism.drives
    J, gamma = np.zeros((len(drives), model.skeleton.getNumDofs())), np.zeros(len(drives))
    for n, drive in enumerate(drives):
        axis = model.axes[drive.joint, drive.coordinate]
        J[n, axis.index] = axis.sign
        gamma[n] = drive.motion.at(t)[2]
    return J, gamma


def _couplings(model: Model, t: float) -> Rows:
    """``q'' - f' q_driver'' = f'' q_driver'^2``, with the driving angle over full turns."""
    couplings = model.mechanism.couplings
    J, gamma = np.zeros((len(couplings), model.skeleton.getNumDofs())), np.zeros(len(couplings))
    for n, coupling in enumerate(couplings):
        axis = model.axes[coupling.joint, coupling.coordinate]
        driver = model.axes[coupling.driver_joint, coupling.driver_coordinate]
        _, slope, bend = coupling.law.at(driver.value)
        J[n, axis.index] += axis.sign
        J[n, driver.index] -= slope * driver.sign
        gamma[n] = bend * driver.rate**2
    return J, gamma


def ground_rows(model: Model) -> list[ElementRow]:
    """Return the harness's rows of rolling bodies, then of skates, at the skeleton's state.

    Each rolling body has rows of contact and slip. All rows are in the velocities of all bodies.
    """
    mechanism = model.mechanism
    if not (mechanism.rollings or mechanism.skates):
        return []
    state = State(*read(model))
    found = [row for rolling in mechanism.rollings for row in rolling_rows(mechanism, state, rolling)]
    if mechanism.skates:
        found += non_holonomic_rows(mechanism, state)[2 * len(mechanism.rollings) :]
    return found


def _ground(model: Model, t: float) -> Rows:
    """Rows ``Q a = gamma`` of `ground_rows`, transformed to DART's coordinates."""
    rows = ground_rows(model)
    J, gamma = np.zeros((len(rows), model.skeleton.getNumDofs())), np.array([row.gamma for row in rows])
    held = {r.body for r in model.mechanism.rollings} | {s.body for s in model.mechanism.skates}
    for body in held if rows else ():
        b = model.mechanism.body_index[body]
        node, origin = model.nodes[model.carriers[b]], model.tree.links[model.carriers[b]].body_frame.p
        Q = np.array([row.Q[6 * b : 6 * b + 6] for row in rows])
        J += Q[:, :3] @ model.skeleton.getLinearJacobian(node, origin)
        J += Q[:, 3:] @ model.skeleton.getAngularJacobian(node)
        gamma -= Q[:, :3] @ node.getLinearAcceleration(origin) + Q[:, 3:] @ node.getAngularAcceleration()
    return J, gamma


_KINDS: tuple[Callable[[Model, float], Rows], ...] = (_welds, _drives, _couplings, _ground)


def rows(model: Model, t: float) -> Rows:
    """Return all rows at the skeleton's state and the time t, welds first. The accelerations must be zero."""
    J, gamma = zip(*(kind(model, t) for kind in _KINDS), strict=True)
    return np.vstack(J), np.concatenate(gamma)


def push(model: Model, multipliers: Array) -> None:
    """Add the wrenches of welds, contacts, slip and skates to the external forces.

    Efforts of drives and couplings are joint forces, which inverse dynamics computes.
    """
    for n, weld in enumerate(model.tree.welds):
        torque, force = multipliers[6 * n : 6 * n + 3], multipliers[6 * n + 3 : 6 * n + 6]
        for i, sign in ((weld.copy, 1.0), (weld.original, -1.0)):
            _push(model, i, sign * force, sign * torque)
    ground = ground_rows(model)
    if ground:
        wrenches = multipliers[-len(ground) :] @ np.array([row.Q for row in ground])
        for b, carrier in enumerate(model.carriers):
            _push(model, carrier, wrenches[6 * b : 6 * b + 3], wrenches[6 * b + 3 : 6 * b + 6])


def _push(model: Model, link: int, force: Array, torque: Array) -> None:
    model.nodes[link].addExtForce(force, model.tree.links[link].body_frame.p, False, True)
    model.nodes[link].addExtTorque(torque, False)
