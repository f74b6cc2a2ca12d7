"""The spring and damper by which a contact rebounds, as a law for the reference to solve.

A hard contact has ``a = -b v - k r`` whatever the inverse inertia A (`contact_motion`): where other forces are small
beside it, it is a spring ``k / A`` and a damper ``b / A`` that may not pull. A is that of the drawing, where the
contact is closed there.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import (
    Compliance,
    ContactLaw,
    Mechanism,
    closing_rows,
    constraint_jacobian,
    drawing_state,
    elementary_contacts,
    mass_matrix,
    null_space,
)
from consilience_mujoco.contact_motion import BOUNCE, rebound_gains


def rebound_law(mechanism: Mechanism) -> ContactLaw | None:
    """Return the law of the one contact of a mechanism, which rebounds; None if there are others, or it is open."""
    parts = elementary_contacts(mechanism)
    if len(parts) != 1 or parts[0].restitution == 0.0 or mechanism.stops or mechanism.dry_frictions:
        return None
    state = drawing_state(mechanism)
    rows = closing_rows(mechanism, state)
    if not len(rows):
        return None
    N = null_space(constraint_jacobian(mechanism, state))
    row = rows[0] @ N
    inverse = float(row @ np.linalg.solve(N.T @ mass_matrix(mechanism, state) @ N, row))
    b, k = rebound_gains(parts[0].restitution, BOUNCE)
    return ContactLaw(compliance=Compliance(k / inverse, b / inverse))
