"""`ExudynEngine`: answers of Exudyn through the protocol `consilience.engine.Engine`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

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
    motion_of_halved,
)
from consilience.mechanism import Array, Mechanism, State
from consilience_exudyn.contact_methods import HALVINGS, contact_methods, immovable
from consilience_exudyn.contact_motion import contact_motion, halved_motions
from consilience_exudyn.contacts import CONTACT_FEATURES, REASONS, is_unilateral
from consilience_exudyn.kinematic_tree import build_tree, is_one_axis_tree
from consilience_exudyn.library import POINTWISE, QUIET, SETTINGS, exu
from consilience_exudyn.maximal import build
from consilience_exudyn.pointwise import instant_answer, joined, model_answer, tree_instant_answer
from consilience_exudyn.redundancy import independent_axes, left_out
from consilience_exudyn.terms import Terms
from consilience_exudyn.trajectory import Integration, tree_answer, well_conditioned_answer

_TRAJECTORIES = {
    "TrapezoidalIndex2": (Integration("TrapezoidalIndex2", SETTINGS), Profile.MATCHED, (25, 50, 100)),
    "GeneralizedAlpha": (Integration("GeneralizedAlpha", SETTINGS), Profile.MATCHED, (20, 40, 80)),
    "GeneralizedAlpha, defaults": (Integration("GeneralizedAlpha", QUIET), Profile.DEFAULT, (5, 10, 20)),
}
"""Integrator, profile and substeps of each method for rigid bodies with constraints. Exudyn's default step is 0.01 s:
five steps for samples every 0.05 s."""

_ROUTES = {Profile.MATCHED: Route.TUNED, Profile.DEFAULT: Route.NATIVE}
_TREE = "ExplicitRungeKutta44 on KinematicTree"
_TREE_INSTANT = "initial accelerations on KinematicTree"
_EXPLICIT_SUBSTEPS = (20, 40, 80)
_TERMS = "ComputeMassMatrix, ComputeODE2RHS, ComputeJacobianAE"

FEATURES = feature_names(
    joints="revolute, prismatic, cylindrical, universal, spherical, planar, rigid, rod, free, screw, "
    "point_on_line, point_in_plane, parallel_axes",
    elements="spring, joint spring, nonlinear joint spring, actuator, load, load in time, friction, control, drive, "
    "coupling, rolling, skate, " + CONTACT_FEATURES,
)
"""Features of a mechanism that the adapter translates; features that are not listed are refused."""

_USER_FUNCTIONS = "Exudyn integrates and solves, the law is a user function of the adapter"
_USER_ROW = "equation and Jacobian are a user function of ObjectConnectorCoordinateVector, by the adapter"

_ELEMENTS = {
    "spring": "springs: ObjectConnectorSpringDamper",
    "joint spring": "joint springs: ObjectConnectorTorsionalSpringDamper, ObjectConnectorLinearSpringDamper",
    "nonlinear joint spring": f"joint springs: what is not linear by connectors; {_USER_FUNCTIONS}",
    "load": "loads: LoadForceVector, LoadTorqueVector",
    "load in time": f"loads in time: {_USER_FUNCTIONS}",
    "actuator": f"actuators: connectors; {_USER_FUNCTIONS}",
    "friction": f"friction: connectors; {_USER_FUNCTIONS}",
    "control": f"control: connectors; {_USER_FUNCTIONS}; integrals are rates of coordinates of an ObjectGenericODE2",
    "screw joint": f"screws: cylindrical ObjectJointGeneric, and the thread: {_USER_ROW}",
    "drive": f"drives: {_USER_ROW}",
    "coupling": f"couplings: {_USER_ROW}",
    "skate": f"skates: {_USER_ROW}",
    "stop": "stops at an instant: rows of the harness's solve",
    "dry friction": "dry friction at an instant: effort or row of the harness's solve",
}
_ROLLING = {
    False: "sharp-edged discs: ObjectJointRollingDisc, which holds the contact at velocity level",
    True: f"rounded discs and balls: contact and slip: {_USER_ROW}",
}

_MANY = 24
"""Number of bodies above which a tree is integrated as a kinematic tree alone: redundant coordinates are too slow."""

_LARGE = 6
"""Number of bodies above which a sparse solver of the equations in redundant coordinates is faster, to the same digits.
The profile ``default`` keeps Exudyn's dense solver."""

_SPARSE = {"linearSolver.solverType": "EigenSparse"}


def _integration(mechanism: Mechanism, name: str) -> Integration:
    """Integrator of a method, with its settings for a mechanism."""
    integration, profile, _ = _TRAJECTORIES[name]
    if profile is Profile.DEFAULT or len(mechanism.bodies) <= _LARGE:
        return integration
    return replace(integration, settings={**integration.settings, **_SPARSE})


class ExudynEngine:
    """Exudyn with rigid bodies in redundant coordinates, and kinematic trees where a mechanism is one."""

    def __init__(self) -> None:
        self._terms: tuple[Mechanism, Terms] | None = None  # of the last mechanism, recognised by identity
        # looked up at each call, because mutants replace `independent_axes`
        self._independent = lru_cache(maxsize=1)(lambda mechanism: independent_axes(mechanism))  # noqa: PLW0108

    def info(self) -> EngineInfo:
        """Return name and version of Exudyn and its adapter."""
        return EngineInfo(
            name="Exudyn",
            version=exu.__version__,
            adapter="consilience_exudyn",
            remarks="redundant coordinates with Euler parameters; dependent constraint equations left out",
        )

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Return the features without a translation."""
        unknown = beyond(mechanism, FEATURES, "Exudyn", REASONS)
        if unknown or question is not Question.TRAJECTORY or not is_unilateral(mechanism):
            return unknown
        reason = "Exudyn's explicit integrators take no constraints, implicit ones fail at fixed steps as sliding stops"
        beside = immovable(mechanism)
        return (Unsupported(f"contacts, stops or dry friction beside {beside}", reason),) if beside else ()

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods that answer the question, the headline method first."""
        tree = is_one_axis_tree(mechanism)
        if question is Question.MODEL:
            return (Method("ComputeMassMatrix, ComputeJacobianAE", Route.NATIVE, settings=POINTWISE),)
        if question is Question.TRAJECTORY and is_unilateral(mechanism):
            return contact_methods(mechanism)
        if question is Question.INSTANT:
            terms = Method(_TERMS, Route.HARNESS_SOLVE, settings=POINTWISE)
            tree = tree and not is_unilateral(mechanism)
            return (terms, Method(_TREE_INSTANT, Route.NATIVE, settings=QUIET)) if tree else (terms,)
        sampled = {"solution.sensors.writePeriod": "the sample interval"}
        dropped = left_out(mechanism, self._independent(mechanism))
        rows = {"constraint equations left out": dropped} if dropped else {}
        methods = [
            Method(
                name,
                _ROUTES[profile],
                order=2,
                substeps=substeps,
                settings={**_integration(mechanism, name).settings, **sampled, **rows},
                profile=profile,
            )
            for name, (_, profile, substeps) in _TRAJECTORIES.items()
        ]
        if tree:
            settings = {**SETTINGS, **sampled}
            minimal = Method(_TREE, Route.NATIVE, order=4, substeps=_EXPLICIT_SUBSTEPS, settings=settings)
            if len(mechanism.bodies) > _MANY:
                return (minimal,)
            methods.insert(2, minimal)
        return tuple(methods)

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Return the features that the translation keeps exact, and those that motions approximate."""
        exact = [
            "bodies: ObjectRigidBody, inertia moved to the body's origin",
            "joints: constraints without compliance",
        ]
        exact += [words for feature, words in _ELEMENTS.items() if feature in mechanism.features]
        rounded = {bool(rolling.rounding) for rolling in mechanism.rollings}
        exact += [words for kind, words in _ROLLING.items() if kind in rounded]
        dropped = left_out(mechanism, self._independent(mechanism))
        exact += [f"'{name}': dependent {axes} left out in trajectories" for name, axes in dropped.items()]
        if mechanism.contacts:
            exact.append("contacts at an instant: Exudyn's friction where they slide, rows of the harness's solve else")
        approximated = [
            f"{what} in a motion: penalty forces, rigid and without creep in the limit of small steps"
            for what, elements in (
                ("contacts", mechanism.contacts),
                ("stops", mechanism.stops),
                ("dry friction", mechanism.dry_frictions),
            )
            if elements
        ]
        return Manifest(exact=tuple(exact), approximated=tuple(approximated))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return mass properties and freedom by Exudyn's mass matrix and constraint Jacobian."""
        return model_answer(self._terms_of(mechanism, state), state)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return accelerations, reactions and energies at consistent states."""
        if method.name == _TREE_INSTANT:
            return tree_instant_answer(mechanism, states)
        if mechanism.contacts:  # spheres in place of points are those of one state
            return joined([instant_answer(self._terms_of(mechanism, state), [state]) for state in states])
        return instant_answer(self._terms_of(mechanism, states[0]), states)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate the motion from `state` by one of Exudyn's integrators.

        Parameters
        ----------
        mechanism, state, times, method, step
            As in `consilience.engine.Engine.trajectory`.
        """
        if is_unilateral(mechanism):
            if method.route is Route.EXTRAPOLATED:
                return motion_of_halved(halved_motions(mechanism, state, times, step, HALVINGS))
            return contact_motion(mechanism, state, times, step, method.softness or 1.0)
        if method.name == _TREE:
            return tree_answer(build_tree(mechanism, state), times, step)
        held = self._independent(mechanism)
        integration = _integration(mechanism, method.name)
        return well_conditioned_answer(mechanism, state, held, integration, times, step)

    def _terms_of(self, mechanism: Mechanism, state: State) -> Terms:
        if self._terms is None or self._terms[0] is not mechanism or mechanism.contacts:
            self._terms = (mechanism, Terms(build(mechanism, state)))
        return self._terms[1]
