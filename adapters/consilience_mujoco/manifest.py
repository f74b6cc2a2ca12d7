"""Manifest of a translation: features that are exact, and features that are approximated."""

from __future__ import annotations

from typing import Any

from consilience.engine import Manifest
from consilience.mechanism import Mechanism

_EXACT = {
    "joint springs, viscous friction: those of the MuJoCo joint": ("joint spring", "friction"),
    "springs: spatial tendons": ("spring",),
    "loads: actuators at sites": ("load",),
    "actuators, histories, Coulomb friction: controls of actuators, from a callback at every stage of a step": (
        "actuator",
        "load in time",
        "friction",
    ),
    "control: affine bias of an actuator, and one with an integrator": ("control",),
    "cylindrical, universal, planar joints: several joints of one body": (
        "cylindrical joint",
        "universal joint",
        "planar joint",
    ),
    "rod: massless link of two hinges and a ball (their frames turned away from the singular pose)": ("rod joint",),
    "free joint: the body hangs from the world": ("free joint",),
}
"""Texts of the manifest, with the features of a mechanism to which they apply."""

_UNILATERAL = (
    ("contacts", "contacts: a pair for each sphere, corner or end; circular cone in the limit of small steps"),
    ("stops", "stops: limits of MuJoCo's joints, a spring and damper that is hard in the limit of small steps"),
    ("dry_frictions", "dry friction: frictionloss; it creeps at a speed proportional to the step"),
)
"""Groups of a mechanism whose translation is exact at an instant, and approximated in a motion."""

_SOFT = (
    ("screws", ("screw joint",), "joint equalities"),
    ("drives", ("drive",), "joint equalities, their right-hand side from a callback"),
    ("couplings", ("coupling",), "joint equalities, velocity term (and Jacobian, unless polynomial) from a callback"),
    ("rolling, skates", ("rolling", "skate"), "rows that a callback writes from MuJoCo's Jacobians"),
)


def manifest(mechanism: Mechanism, loops: bool) -> Manifest:
    """Return the manifest of a mechanism with or without loops."""
    features: Any = mechanism.features.keys()
    exact = ["masses, centres of mass, inertia tensors (given by principal axes)"]
    exact += [text for text, about in _EXACT.items() if features & set(about)]
    soft = [("loops", "split bodies held by welds")] if loops else []
    soft += [(what, how) for what, about, how in _SOFT if features & set(about)]
    approximated = [
        text
        for what, how in soft
        for text in (
            f"{what}, matched: soft {how}; regularisation 2e-15 of the inverse inertia they see",
            f"{what}, matched: no feedback on the drift of a trajectory",
            f"{what}, defaults: the same with MuJoCo's softness, regularisation about a tenth",
        )
    ]
    approximated += [text for group, text in _UNILATERAL if getattr(mechanism, group)]
    return Manifest(tuple(exact), tuple(approximated))
