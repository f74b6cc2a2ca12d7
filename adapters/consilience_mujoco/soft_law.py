"""MuJoCo's law of soft contacts, as documented, for the reference to solve.

A row of a contact obeys ``a + R f = aref``, ``aref = -b v - k r``, ``R = (1 - d)/d`` times `efc_diagApprox`, the sum of
`body_invweight0` of both bodies; d is the impedance of `solimp`, ``k = d/(dmax timeconst dampratio)^2``,
``b = 2/(dmax timeconst)`` (https://mujoco.readthedocs.io/en/stable/computation/index.html and modeling.html, "Solver
parameters"). The acceleration a of a contact is J v' alone, without J' v: of bodies that move freely that of the
velocities of their origins.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from consilience.engine import Method, Profile
from consilience.mechanism import GROUND, ContactLaw, Mechanism, Regularisation
from consilience_mujoco.contact_methods import pyramid
from consilience_mujoco.contacts import Touch, touches_of
from consilience_mujoco.rows import Equalities
from consilience_mujoco.translate import Translation


def has_soft_law(mechanism: Mechanism, equalities: Equalities) -> bool:
    """Whether all that is soft are contacts of bodies that move freely, with the same axes of all pyramids."""
    free = {joint.successor for joint in mechanism.joints if joint.kind == "free" and joint.predecessor == GROUND}
    touching = {name for contact in mechanism.contacts for name in (contact.body, contact.partner)} - {GROUND}
    rough = any(contact.friction > 0.0 for contact in mechanism.contacts)
    other = equalities.welds + equalities.joints + equalities.guides
    if not mechanism.contacts or mechanism.stops or mechanism.dry_frictions or other:
        return False
    return touching <= free and (not rough or pyramid(mechanism) is not None)


def with_soft_law(methods: tuple[Method, ...], translation: Translation) -> tuple[Method, ...]:
    """Return methods, those at MuJoCo's own settings with the law that they solve, as of a compiled model."""
    model, mechanism = translation.model, translation.mechanism
    rows = tuple(_row(model, touch) for touch in touches_of(model, mechanism))
    cone = pyramid(mechanism)
    law = replace(cone or ContactLaw(), regularisation=rows)
    return tuple(
        replace(one, soft_law=law) if one.profile is Profile.DEFAULT and "opt.cone" not in one.settings else one
        for one in methods
    )


def _row(model: Any, touch: Touch) -> Regularisation:
    """Return the law of a contact by `solref` and `solimp` of its pair."""
    least, most, width, midpoint, power = (float(x) for x in model.pair_solimp[touch.pair])
    time, ratio = (float(x) for x in model.pair_solref[touch.pair])
    return Regularisation(
        pull=1.0 / (most * time * ratio) ** 2,
        decay=2.0 / (most * time),
        least=least,
        most=most,
        width=width,
        midpoint=midpoint,
        power=power,
        inverse_mass=sum(float(model.body_invweight0[body][0]) for body in touch.carriers if body),
    )
