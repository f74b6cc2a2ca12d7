"""Constraints for `constraintDynamics`: welds, drives and rolling bodies.

Frame 1 of a contact accelerates relative to frame 2 by ``contact_acceleration_desired`` of the constraint **data**,
zero by default; the field ``desired_contact_acceleration`` of the constraint model is not read.

- Drive: CONTACT_6D between the moving frame of the joint and the frame on its parent. Rows along which the joint does
  not move are zero; the proximal iteration does not change their multipliers.
- Rolling: CONTACT_3D at the material point in contact, which has an acceleration (`consilience_pinocchio.rows`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.translate import Translation, initialised, rigid_contact


def hold_all(translation: Translation) -> bool:
    """Whether contacts can hold all constraints: there are no couplings and no skates."""
    return not (translation.mechanism.couplings or translation.mechanism.skates)


class Contacts:
    """Constraints of a translation for `constraintDynamics`: welds, then drives, then rolling bodies.

    Attributes
    ----------
    translation : Translation
        The translation, its `constraints` extended by those of drives and rolling bodies.
    """

    def __init__(self, translation: Translation, elements: Elements) -> None:
        model, rows = translation.model, elements.rows
        self._drives, self._rolls = rows.drives, rows.rolls
        contacts = list(translation.constraints)
        for place, _ in self._drives:
            ends = place.joint, pin.SE3.Identity(), model.parents[place.joint], model.jointPlacements[place.joint]
            contacts.append(rigid_contact("CONTACT_6D", model, *ends))
        for rolls in self._rolls:
            ends = rolls.seat.joint, pin.SE3.Identity(), 0, pin.SE3.Identity()
            contacts.append(rigid_contact("CONTACT_3D", model, *ends))
        models, data = initialised(model, translation.data, contacts)
        self.translation = replace(translation, constraints=models, constraint_data=data)
        self._first = len(translation.welds)

    def update(self, q: Array, v: Array, t: float) -> None:
        """Set placements and desired accelerations of the contacts at the time t."""
        model, data = self.translation.model, self.translation.data
        contacts = self.translation.constraint_data
        for number, (place, law) in enumerate(self._drives, self._first):
            contacts[number].contact_acceleration_desired = pin.Motion(law.jet(t)[2] * place.subspace)
        if self._rolls:
            pin.forwardKinematics(model, data, q, v)
        for number, rolls in enumerate(self._rolls, self._first + len(self._drives)):
            point, acceleration = rolls.touch()
            # frame 2 stays at the world origin: the universe is at rest at any point
            self.translation.constraints[number].joint1_placement = rolls.placement_at(point)
            contacts[number].contact_acceleration_desired = pin.Motion(acceleration, np.zeros(3))

    def multipliers(self) -> Array:
        """Return the multipliers of the elements' rows after a solution; data must hold placements."""
        forces = [contact.contact_force for contact in self.translation.constraint_data][self._first :]
        driving, rolling = forces[: len(self._drives)], forces[len(self._drives) :]
        efforts = [place.subspace @ force.vector for (place, _), force in zip(self._drives, driving, strict=True)]
        pushes = [rolls.along(force.linear) for rolls, force in zip(self._rolls, rolling, strict=True)]
        return np.concatenate([np.array(efforts), *pushes])
