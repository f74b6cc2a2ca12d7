"""`PinocchioEngine`: answers of Pinocchio through the protocol `consilience.engine.Engine`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.engine import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Profile,
    Question,
    Route,
    TrajectoryAnswer,
    Unsupported,
    beyond,
    feature_names,
)
from consilience.mechanism import Array, ContactLaw, Mechanism, State
from consilience_pinocchio.charts import suited
from consilience_pinocchio.cones import REASONS, SETTINGS
from consilience_pinocchio.contacts import hold_all
from consilience_pinocchio.dynamics import PROXIMAL, solve
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.mimic import MIMIC, has_mimic
from consilience_pinocchio.moreau import extrapolated, move
from consilience_pinocchio.motion import integrate
from consilience_pinocchio.observe import accelerations, composite_inertia, energies, freedom
from consilience_pinocchio.reactions import reactions
from consilience_pinocchio.settling import settle
from consilience_pinocchio.translate import Translation, configuration, translate
from consilience_pinocchio.unilateral import touches


def _integrated(solver: str, settings: dict[str, Any]) -> Method:
    """Method by the accelerations of a solver and the harness's integrator."""
    name = f"{solver} + RK4 of the harness"
    return Method(name, Route.HARNESS_INTEGRATOR, order=4, substeps=(10, 20, 40), settings=settings)


def _constrained(model: Method, solver: str, harness: str) -> dict[Question, tuple[Method, ...]]:
    """Methods of a mechanism with constraints: Pinocchio's solver, tuned and at its defaults, and the harness's."""
    instant = (
        Method(solver, Route.TUNED, settings=dict(PROXIMAL)),
        Method(harness, Route.HARNESS_SOLVE),
        Method(f"{solver}, defaults", Route.NATIVE, profile=Profile.DEFAULT),
    )
    motion = _integrated(solver, dict(PROXIMAL))
    return {Question.MODEL: (model,), Question.INSTANT: instant, Question.TRAJECTORY: (motion,)}


_TREE_METHODS = {
    Question.MODEL: (Method("model inertias", Route.NATIVE),),
    Question.INSTANT: (Method("aba", Route.NATIVE), Method("crba and nle", Route.HARNESS_SOLVE)),
    Question.TRAJECTORY: (_integrated("aba", {}),),
}
_LOOP_METHODS = _constrained(
    Method("model inertias, getConstraintsJacobian", Route.NATIVE), "constraintDynamics", "crba, nle and own weld rows"
)
_ROW_METHODS = _constrained(
    Method("model inertias, rank of own rows", Route.HARNESS_SOLVE),
    "forwardDynamics on own rows",
    "crba, nle and own rows",
)
_CONTACT_METHODS = {
    Question.MODEL: _ROW_METHODS[Question.MODEL],
    Question.INSTANT: (_LOOP_METHODS[Question.INSTANT][0], *_ROW_METHODS[Question.INSTANT]),
    Question.TRAJECTORY: _LOOP_METHODS[Question.TRAJECTORY],
}
_MIMIC_METHOD = Method("crba and nle with JointModelMimic", Route.HARNESS_SOLVE, settings=dict(MIMIC))

_TOUCHING = "ADMMConstraintSolver on rows of the adapter"
_STEPPED = f"{_TOUCHING} + Moreau's stepping of the harness"
_EXTRAPOLATED = f"{_STEPPED}, extrapolated"


def _touching(mechanism: Mechanism) -> dict[Question, tuple[Method, ...]]:
    """Methods of a mechanism with contacts, stops or dry friction; what bounces has no order to extrapolate."""
    associated = any(contact.associated for contact in mechanism.contacts)
    settings = SETTINGS | {"solve_ncp": not associated}
    rebounds = any(contact.restitution > 0.0 for contact in mechanism.contacts)
    rubs = any(contact.friction > 0.0 for contact in mechanism.contacts)
    moreau = ContactLaw(impact_law="moreau") if rebounds or rubs else None
    law = ("circle, associated" if associated else "circle") if mechanism.contacts else ""
    law += "; Moreau's impacts" if moreau else ""
    stepped = Method(
        *(_STEPPED, Route.HARNESS_STEPPING, 1, (10, 20, 40)), settings=settings, contact_law=law, law=moreau
    )
    motions: tuple[Method, ...] = (stepped,)
    if not rebounds and not any(stop.restitution > 0.0 for stop in mechanism.stops):
        motions += (replace(stepped, name=_EXTRAPOLATED, order=3, substeps=(4, 8, 16)),)
    return {
        Question.INSTANT: (Method(_TOUCHING, Route.TUNED, settings=settings, contact_law=law),),
        Question.TRAJECTORY: motions,
    }


_KIND_REMARKS = {
    "rod": "rod: massless link of two revolutes and a ball, its axes turned away from their singular pose",
    "universal": "universal: massless link between two revolutes",
    "cylindrical": "cylindrical: massless link between a prismatic joint and a revolute",
    "planar": "planar: massless links between two prismatic joints and a revolute",
    "screw": "screw: native, a helical joint",
    "rigid": "rigid: merged into the body before it; its reaction by Newton-Euler on Pinocchio's motion",
}
_ELEMENT_REMARKS = {
    "springs": "springs: not native, wrenches by the adapter from Pinocchio's placements and velocities",
    "loads": "loads: not native, wrenches by the adapter",
    "joint_springs": "joint springs: not native, joint efforts by the adapter, taken out of the reactions",
    "frictions": "friction: not native, joint efforts by the adapter, taken out of the reactions",
    "controls": "control: not native, joint efforts by the adapter; the integrals are states of the integration",
    "drives": "drives: a 6D contact across the joint, its acceleration by the adapter; or rows of the adapter",
    "couplings": "couplings: not native, rows of the adapter in joint accelerations",
    "rollings": "rolling: a 3D contact at the material point, its acceleration by the adapter; or rows of the adapter",
    "skates": "skates: not native, rows of the adapter by Pinocchio's Jacobians",
    "contacts": "contacts: rows of the adapter at the nearest points, cones and solver of Pinocchio",
    "stops": "stops: rows of the adapter in single coordinates, intervals and solver of Pinocchio",
    "dry_frictions": "dry friction: rows of the adapter in single coordinates, intervals and solver of Pinocchio",
}

FEATURES = feature_names(
    joints="revolute, prismatic, cylindrical, universal, spherical, planar, rigid, rod, free, screw, "
    "point_on_line, point_in_plane, parallel_axes",
    elements="spring, joint spring, nonlinear joint spring, actuator, load, load in time, friction, control, drive, "
    "coupling, rolling, skate, "
    "sphere on plane contact, point on plane contact, sphere on sphere contact, box on plane contact, "
    "capsule on plane contact, disc on plane contact, moving plane contact, contact restitution, contact friction, "
    "static friction, associated cone, Moreau impact, stop, stop restitution, dry friction",
)
"""Features of a mechanism that the adapter translates; features that are not listed are refused."""


def _translated(mechanism: Mechanism) -> tuple[Translation, Elements]:
    translation = translate(mechanism)
    return translation, Elements(translation)


class PinocchioEngine:
    """Pinocchio: minimal coordinates, `aba` for trees, `constraintDynamics` on split bodies for loops."""

    def __init__(self) -> None:
        self._translated = lru_cache(maxsize=1)(_translated)

    def _suited(self, mechanism: Mechanism, state: State) -> tuple[Translation, Elements]:
        """Return the translation of a mechanism whose rods are far from singular at a state, with its elements."""
        common, elements = self._translated(mechanism)
        translation = suited(common, state)
        return translation, elements if translation is common else Elements(translation)

    def info(self) -> EngineInfo:
        """Return name and version of Pinocchio and its adapter."""
        return EngineInfo("Pinocchio", pin.__version__, "consilience_pinocchio")

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Return the features without a translation."""
        refused = beyond(mechanism, FEATURES, "Pinocchio", REASONS)
        if len({contact.associated for contact in mechanism.contacts if contact.friction}) > 1:
            refused += (Unsupported("associated cones beside others", "Pinocchio's solver has one setting for all"),)
        if question is Question.TRAJECTORY and touches(mechanism) and any(j.kind == "rod" for j in mechanism.joints):
            reason = "a rod changes its coordinates under way, which the stepping of contacts does not"
            refused += (Unsupported("rod joint beside contacts", reason),)
        return refused

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods that answer the question, the headline method first, by the kinds of constraints."""
        translation, elements = self._translated(mechanism)
        if question is not Question.MODEL and touches(mechanism):
            return _touching(mechanism)[question]
        if elements.rows.count:
            more = question is Question.INSTANT and has_mimic(translation)
            methods = _CONTACT_METHODS if hold_all(translation) else _ROW_METHODS
            return (*methods[question], *([_MIMIC_METHOD] if more else []))
        return (_LOOP_METHODS if translation.welds else _TREE_METHODS)[question]

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Return the features that the translation keeps exact; nothing is approximated."""
        translation, _ = self._translated(mechanism)
        kinds = {joint.kind for joint in mechanism.joints}
        exact = [text for kind, text in _KIND_REMARKS.items() if kind in kinds]
        if translation.welds:
            exact.append("loops: a body split in equal halves, held together by CONTACT_6D, no Baumgarte correction")
        exact += [text for name, text in _ELEMENT_REMARKS.items() if getattr(mechanism, name)]
        return Manifest(exact=tuple(exact))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return mass, centre of mass and inertia by Pinocchio's inertias, freedom by its constraint Jacobian."""
        translation, elements = self._suited(mechanism, state)
        q, v = configuration(translation, state)
        total = composite_inertia(translation, q)
        return ModelAnswer(
            total.mass, np.array(total.lever), np.array(total.inertia), freedom(translation, elements, q, v)
        )

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return accelerations, joint reactions and energies at consistent states."""
        n_b, n_j, n_s = len(mechanism.bodies), len(mechanism.joints), len(states)
        a, alpha = np.zeros((2, n_s, n_b, 3))
        force, torque = np.zeros((2, n_s, n_j, 3))
        kinetic, potential = np.zeros((2, n_s))
        pressing = np.zeros((n_s, len(mechanism.contacts), 3))
        for n, state in enumerate(states):
            translation, elements = self._suited(mechanism, state)
            q, v = configuration(translation, state)
            if method.name == _TOUCHING:
                solution, pressing[n] = settle(translation, elements, q, v)
            else:
                solution = solve(translation, elements, method, q, v)
            a[n], alpha[n] = accelerations(translation)
            force[n], torque[n] = reactions(mechanism, translation, elements, solution, state, method.profile)
            kinetic[n], potential[n] = energies(translation, q, v)
            potential[n] += elements.forces.potential() + elements.efforts.potential(q)
        return InstantAnswer(a, alpha, force, torque, kinetic, potential, pressing if mechanism.contacts else None)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate the motion from `state` by Pinocchio's accelerations and the harness's integrator.

        Parameters
        ----------
        mechanism, state, times, method, step
            As in `consilience.engine.Engine.trajectory`.
        """
        translation, elements = self._suited(mechanism, state)
        q, v = configuration(translation, state)
        if method.route is Route.HARNESS_STEPPING:
            return (extrapolated if method.name == _EXTRAPOLATED else move)(translation, q, v, np.asarray(times), step)
        return integrate(translation, elements, q, v, times, step)
