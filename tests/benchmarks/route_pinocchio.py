"""Routes by Pinocchio, which has no integrator: its accelerations with integrators of high order."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pinocchio as pin
from routes import HIGH_ORDER, TOLERANCES, Integrator, Route

from consilience.case import Case
from consilience.engine import Question
from consilience.mechanism import Array
from consilience_pinocchio.charts import suited
from consilience_pinocchio.contacts import Contacts, hold_all
from consilience_pinocchio.dynamics import PROXIMAL, articulated_body, constraint_dynamics, forward_dynamics
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.engine import PinocchioEngine
from consilience_pinocchio.translate import Translation, configuration, translate

BAUMGARTE = pin.BaumgarteCorrectorParameters(100.0, 20.0)


def _accelerations(translation: Translation, elements: Elements):
    """Return Pinocchio's fastest function, without the adapter unless forces or rows must be added."""
    model, data = translation.model, translation.data
    held = bool(translation.welds or elements.rows.count)
    zero = np.zeros(model.nv)
    if elements.forces.active or elements.efforts.active or elements.rows.count:
        if not hold_all(translation):
            full = forward_dynamics(translation, elements, PROXIMAL)
        elif held:
            full = constraint_dynamics(Contacts(translation, elements), elements, PROXIMAL)
        else:
            full = articulated_body(translation, elements)
        nothing = np.zeros(0)
        return lambda t, q, v: full(q, v, t, nothing)
    if not held:
        return lambda t, q, v: pin.aba(model, data, q, v, zero)
    welds, welds_data = translation.constraints, translation.constraint_data
    for weld in welds:
        weld.setBaumgarteCorrectorParameters(BAUMGARTE)
    settings = pin.ProximalSettings(PROXIMAL["absolute_accuracy"], PROXIMAL["mu"], PROXIMAL["max_iter"])
    return lambda t, q, v: pin.constraintDynamics(model, data, q, v, zero, welds, welds_data, settings)


def routes(case: Case) -> Iterator[Route]:
    """Return the routes of a case; none for cases with controllers, whose integrals are not implemented here."""
    if PinocchioEngine().unsupported(case.mechanism, Question.TRAJECTORY) or case.mechanism.controls:
        return
    translation = suited(translate(case.mechanism), case.initial_state)
    elements = Elements(translation)
    model, data, nq = translation.model, translation.data, translation.model.nq
    accelerations = _accelerations(translation, elements)
    start = np.concatenate(configuration(translation, case.initial_state))
    rate = np.empty(nq + model.nv)

    def scalar(t: float, y: Array) -> Array:
        v = y[nq:]
        rate[:nq], rate[nq:] = v, accelerations(t, y[:nq], v)
        return rate

    def with_quaternions(t: float, y: Array) -> Array:
        q, v = pin.normalize(model, y[:nq]), y[nq:]
        rate[:nq], rate[nq:] = pin.tangentMap(model, q) @ v, accelerations(t, q, v)
        return rate

    derivative = scalar if nq == model.nv else with_quaternions
    seats = [translation.body_seat(b) for b in range(len(case.mechanism.bodies))]

    def positions(motion: Array) -> Array:
        found = []
        for y in motion:
            pin.forwardKinematics(model, data, pin.normalize(model, y[:nq]))
            found.append([(data.oMi[seat.joint] * seat.placement).translation for seat in seats])
        return np.array(found)

    name = "constraintDynamics" if translation.welds or elements.rows.count else "aba"

    def run(integrator: Integrator, tolerance: float) -> Array:
        return integrator(derivative, start, case.times, tolerance)

    for method, integrator in HIGH_ORDER.items():
        yield Route("Pinocchio", f"{name} + {method}", False, TOLERANCES, partial(run, integrator), positions)
