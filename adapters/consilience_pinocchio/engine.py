"""The questions of the harness, answered by Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
import pinocchio as pin

from consilience.engine import beyond
from consilience.mechanism import JOINT_KINDS, Mechanism, State
from consilience.run import (
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
)
from consilience.spatial import Array
from consilience_pinocchio.charts import suited
from consilience_pinocchio.dynamics import PROXIMAL, solve
from consilience_pinocchio.forces import Forces
from consilience_pinocchio.motion import integrate
from consilience_pinocchio.observe import accelerations, composite_inertia, energies, freedom
from consilience_pinocchio.reactions import reactions
from consilience_pinocchio.translate import Translation, configuration, translate

_SUBSTEPS = (10, 20, 40, 80)

_TREE_METHODS = {
    Question.MODEL: (Method("model inertias", Route.NATIVE),),
    Question.INSTANT: (Method("aba", Route.NATIVE), Method("crba and nle", Route.HARNESS_SOLVE)),
    Question.TRAJECTORY: (Method("aba + RK4 of the harness", Route.HARNESS_INTEGRATOR, order=4, substeps=_SUBSTEPS),),
}
_LOOP_METHODS = {
    Question.MODEL: (Method("model inertias, getConstraintsJacobian", Route.NATIVE),),
    Question.INSTANT: (
        Method("constraintDynamics", Route.TUNED, settings=dict(PROXIMAL)),
        Method("crba, nle and own weld rows", Route.HARNESS_SOLVE),
        Method("constraintDynamics, defaults", Route.NATIVE, profile=Profile.DEFAULT),
    ),
    Question.TRAJECTORY: (
        Method(
            "constraintDynamics + RK4 of the harness",
            Route.HARNESS_INTEGRATOR,
            order=4,
            substeps=_SUBSTEPS,
            settings=dict(PROXIMAL),
        ),
    ),
}

_KIND_REMARKS = {
    "rod": "rod: massless link of two revolutes and a ball, its axes turned away from their singular pose",
    "universal": "universal: massless link between two revolutes",
    "cylindrical": "cylindrical: massless link between a prismatic joint and a revolute",
    "planar": "planar: massless links between two prismatic joints and a revolute",
    "rigid": "rigid: merged into the body before it; its reaction by Newton-Euler on Pinocchio's motion",
}
_FORCE_REMARKS = {
    "springs": "springs: not native, wrenches by the adapter from Pinocchio's placements and velocities",
    "joint_springs": "joint springs: not native, joint efforts by the adapter, taken out of the reactions",
    "loads": "loads: not native, wrenches by the adapter",
}

FEATURES = frozenset(f"{kind} joint" for kind in JOINT_KINDS if kind != "screw") | {"spring", "joint spring", "load"}
"""What of `Mechanism.features` has a translation."""


class PinocchioEngine:
    """Pinocchio: minimal coordinates, `aba` for trees, `constraintDynamics` on split bodies for loops."""

    def __init__(self) -> None:
        self._built: tuple[Translation, Forces] | None = None

    def _translated(self, mechanism: Mechanism) -> tuple[Translation, Forces]:
        if self._built is None or self._built[0].mechanism is not mechanism:
            translation = translate(mechanism)
            self._built = translation, Forces(translation)
        return self._built

    def _suited(self, mechanism: Mechanism, state: State) -> tuple[Translation, Forces]:
        """Choose the translation for a state: the common one unless a rod stands badly in it."""
        common, forces = self._translated(mechanism)
        translation = suited(common, state)
        return translation, forces if translation is common else Forces(translation)

    def info(self) -> EngineInfo:
        """Name and version."""
        return EngineInfo("pinocchio", pin.__version__, f"consilience_pinocchio {version('consilience')}")

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Features without a translation: screws, and elements beyond constant forces."""
        return beyond(mechanism, FEATURES, "Pinocchio")

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Ways to answer the question, the headline first; which ones depends on whether there are loops."""
        translation, _ = self._translated(mechanism)
        return (_LOOP_METHODS if translation.welds else _TREE_METHODS)[question]

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Say what the translation keeps exact; it approximates nothing."""
        translation, _ = self._translated(mechanism)
        kinds = {joint.kind for joint in mechanism.joints}
        exact = [text for kind, text in _KIND_REMARKS.items() if kind in kinds]
        if translation.welds:
            exact.append("loops: a body split in equal halves, held together by CONTACT_6D, no Baumgarte correction")
        exact += [text for name, text in _FORCE_REMARKS.items() if getattr(mechanism, name)]
        return Manifest(exact=tuple(exact))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Mass, centre of mass and inertia from Pinocchio's inertias, freedom from its constraint Jacobian."""
        translation, _ = self._suited(mechanism, state)
        q, _ = configuration(translation, state)
        total = composite_inertia(translation, q)
        return ModelAnswer(total.mass, np.array(total.lever), np.array(total.inertia), freedom(translation, q))

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Accelerations, joint reactions and energies at consistent states."""
        n_b, n_j, n_s = len(mechanism.bodies), len(mechanism.joints), len(states)
        a, alpha = np.zeros((2, n_s, n_b, 3))
        force, torque = np.zeros((2, n_s, n_j, 3))
        kinetic, potential = np.zeros((2, n_s))
        for n, state in enumerate(states):
            translation, forces = self._suited(mechanism, state)
            q, v = configuration(translation, state)
            solution = solve(translation, forces, method, q, v)
            a[n], alpha[n] = accelerations(translation)
            force[n], torque[n] = reactions(mechanism, translation, forces, solution, state, method.profile)
            kinetic[n], potential[n] = energies(translation, q, v)
            potential[n] += forces.potential(q)
        return InstantAnswer(a, alpha, force, torque, kinetic, potential)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Motion from `state` at ``times[0]`` on the uniform grid `times`, which `step` divides."""
        translation, forces = self._suited(mechanism, state)
        q, v = configuration(translation, state)
        return integrate(translation, forces, q, v, times, step)
