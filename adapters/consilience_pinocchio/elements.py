"""Force elements and constraints of a mechanism, which the adapter evaluates from Pinocchio's kinematics."""

from __future__ import annotations

from consilience_pinocchio.efforts import Efforts
from consilience_pinocchio.forces import Forces
from consilience_pinocchio.rows import Rows
from consilience_pinocchio.translate import Translation


class Elements:
    """Elements of a translated mechanism.

    Attributes
    ----------
    forces : Forces
        Springs and loads: wrenches on links.
    efforts : Efforts
        Springs, actuators, friction and control of joints: efforts in joint coordinates.
    rows : Rows
        Drives, couplings, rolling bodies, skates: constraints.
    """

    def __init__(self, translation: Translation) -> None:
        self.forces, self.efforts, self.rows = Forces(translation), Efforts(translation), Rows(translation)
