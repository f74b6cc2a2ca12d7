"""Accelerations and forces of a mechanism with contacts, stops and dry friction at single states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.engine import InstantAnswer
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    characteristic_length,
    kept_in_units,
    kinetic_energy,
    own_units,
    potential_energy,
    refuse_flat_discs,
    require_states,
    telling_si,
)
from consilience.reference.bodies.arrays import pack
from consilience.reference.bodies.canonical import at_origins, joint_wrenches
from consilience.reference.bodies.consistency import check_given
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.lasting import LastingContact, decide_lasting, require_unique, sliding_rates
from consilience.reference.contact.layout import layout_of
from consilience.reference.contact.response import Response
from consilience.reference.contact.row_modes import open_modes
from consilience.reference.contact.self_check import refuse_overlap
from consilience.reference.contact.speeds import fastest, speed_from_rest
from consilience.reference.contact.stepper import Stepper

CLOSED = 1e-10
"""Largest gap of a closed contact, over the length of the mechanism, and rate at rest, over its speeds."""


def contact_instant(mechanism: Mechanism, states: Sequence[State], t: float = 0.0) -> InstantAnswer:
    """Compute accelerations, joint reactions, contact forces and energies at consistent states.

    Closed contacts and stops neither approach nor part; friction slides with the velocities of the state, and sticks or
    starts to slide where there are none. Forces are those of least norm in their cones where they are undetermined.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
    t : float, s
        Time of drives and loads.

    Raises
    ------
    InvalidInput
        A state that is not consistent, shapes that overlap, or a disc that is parallel to its plane.
    NumericalFailure
        A closed contact approaches: an impact has no accelerations; or the laws of contact have no solution or several.
    """
    require_states(mechanism, states)
    layout = layout_of(mechanism)
    for state in states:
        check_given(layout.smooth, layout.model, np.array([t]), pack(layout.smooth, state))
        refuse_flat_discs(mechanism, state)
    units = own_units(mechanism)
    own, there = kept_in_units(mechanism, units), [units.convert(state) for state in states]
    equations = ContactEquations(layout_of(own))
    with telling_si(units):
        answers = [_at(equations, own, state, t, units.length) for state in there]
    a, alpha, reactions, forces = (np.array(part) for part in zip(*answers, strict=True))
    return units.inverse.convert(
        InstantAnswer(
            a_WB_W=a,
            alpha_WB_W=alpha,
            force_F=reactions[:, :, :3],
            torque_F=reactions[:, :, 3:],
            kinetic=np.array([kinetic_energy(own, state) for state in there]),
            potential=np.array([potential_energy(own, state) for state in there]),
            contact_force=forces,
        )
    )


def _at(
    equations: ContactEquations, mechanism: Mechanism, state: State, t: float, metre: float
) -> tuple[Array, Array, Array, Array]:
    """Return a_WB_W, alpha_WB_W, joint reactions (n_j, 6) and contact forces (n_c, 3).

    A metre has this many units of length, for messages.
    """
    layout = equations.layout
    stepper = Stepper(equations, state, t, 1e-12, open_modes(layout))
    refuse_overlap(equations, (t, stepper.y, stepper.turns), CLOSED * characteristic_length(mechanism), metre)
    equations.press(CLOSED * characteristic_length(mechanism))
    response = stepper.respond(t, stepper.y)
    found = _touching(equations, response, stepper.y, characteristic_length(mechanism), t)
    a = equations.accelerations_under(response, found.force)
    wrenches = joint_wrenches(layout.smooth, state, equations.multipliers(response, found.force))
    return (*at_origins(layout.smooth, stepper.y, a), wrenches, stepper.contact_forces(found.force))


def _touching(equations: ContactEquations, response: Response, y: Array, length: float, t: float) -> LastingContact:
    """Decide the modes of what touches at a state, whose rows are evaluated."""
    layout, rows = equations.layout, equations.rows
    at_rest = CLOSED * max(fastest(equations, y, length), speed_from_rest(equations, response, length))
    closed, rate = rows.gap[layout.gaps] <= CLOSED * length, rows.u[list(layout.normals)]
    approaches = np.flatnonzero(closed & (rate < -at_rest))
    if len(approaches):
        name = layout.names[layout.normals[approaches[0]]]
        raise NumericalFailure(f"{name} is closed and approaches: an impact has no accelerations")
    touching = closed & (rate <= at_rest)
    sliding = sliding_rates(equations, None, at_rest)
    return require_unique(decide_lasting(equations, response, touching, sliding), t)
