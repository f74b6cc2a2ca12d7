"""Linear couplings on trees by Pinocchio's `JointModelMimic`, which removes the coupled coordinate.

`aba`, `forwardDynamics` and `constraintDynamics` refuse such a model; accelerations are solved by the harness from
`crba` and `nle`. Where another joint hangs on the mimicking joint, `crba` adds to the mass matrix in its data, so that
a second call on the same data is wrong: each call gets fresh data. Where a joint of more than one degree of freedom
stands between the two joints, `crba` is wrong in the first call too: such trees are not offered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.engine import solve_constrained
from consilience.mechanism import Array, Coupling, Function
from consilience_pinocchio.efforts import axis
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.translate import Translation

MIMIC = {"couplings": "JointModelMimic"}
"""Settings of the method with mimicking joints."""


@dataclass(frozen=True)
class _Gear:
    """``q_slave = ratio q_master + offset`` between two joints of Pinocchio's, the slave behind the master."""

    master: int
    slave: int
    ratio: float
    offset: float


def _is_linear(law: Function) -> bool:
    return law.table is None and not len(law.harmonics) and len(law.polynomial) == 2 and law.polynomial[1] != 0.0


def _gear(translation: Translation, coupling: Coupling) -> _Gear:
    driven = axis(translation, coupling.joint, coupling.coordinate)
    driver = axis(translation, coupling.driver_joint, coupling.driver_coordinate)
    offset, ratio = (float(c) for c in coupling.law.polynomial)
    ratio, offset = driven.sign * driver.sign * ratio, driven.sign * offset
    if driver.joint < driven.joint:
        return _Gear(driver.joint, driven.joint, ratio, offset)
    return _Gear(driven.joint, driver.joint, 1.0 / ratio, -offset / ratio)


def _gears(translation: Translation) -> list[_Gear]:
    """Couplings as mimicking joints; empty if any constraint of the mechanism cannot be a mimicking joint."""
    mechanism, model = translation.mechanism, translation.model
    if model.nv != model.njoints - 1:
        return []
    if translation.welds or mechanism.drives or mechanism.rollings or mechanism.skates:
        return []
    if not all(_is_linear(coupling.law) for coupling in mechanism.couplings):
        return []
    gears = [_gear(translation, coupling) for coupling in mechanism.couplings]
    slaves = {gear.slave for gear in gears}
    if len(slaves) < len(gears) or slaves & {gear.master for gear in gears}:
        return []
    return gears


def has_mimic(translation: Translation) -> bool:
    """Whether `mimic_accelerations` applies: linear couplings alone, no slave of a slave, joints of one axis only."""
    return bool(_gears(translation))


def mimic_accelerations(
    translation: Translation, elements: Elements, q: Array, v: Array, tau: Array
) -> tuple[Array, Array]:
    """Compute accelerations of all joints (nv,), and multipliers of the couplings' rows by inverse dynamics.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    q, v : ndarray, shape (nq,) and (nv,)
    tau : ndarray, shape (nv,)
        All applied generalised forces.
    """
    model = translation.model
    G, geared = np.eye(model.nv), model
    gears = _gears(translation)
    for gear in gears:
        geared = pin.transformJointIntoMimic(geared, gear.master, gear.slave, gear.ratio, gear.offset)
        G[model.joints[gear.slave].idx_v] = gear.ratio * G[model.joints[gear.master].idx_v]
    slave_v = [model.joints[gear.slave].idx_v for gear in gears]
    slave_q = [model.joints[gear.slave].idx_q for gear in gears]
    G, own_q, own_v = np.delete(G, slave_v, axis=1), np.delete(q, slave_q), np.delete(v, slave_v)
    data: Any = geared.createData()
    M, bias = np.array(pin.crba(geared, data, own_q)), np.array(pin.nle(geared, data, own_q, own_v))
    own_a, _ = solve_constrained(M, G.T @ tau - bias, np.zeros((0, len(M))), np.zeros(0))
    a = G @ own_a
    unbalanced = pin.rnea(model, translation.data, q, v, a) - tau
    J, _ = elements.rows.at(q, v, 0.0)
    return a, np.linalg.lstsq(J.T, unbalanced, rcond=None)[0]
