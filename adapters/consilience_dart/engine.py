"""`DartEngine`: answers of DART through the protocol `consilience.engine.Engine`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial

import dartpy
import numpy as np

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
    steps_per_sample,
    suited_rods,
    without_screws,
)
from consilience.mechanism import Array, Mechanism, State, to_elementary_tree
from consilience_dart import methods as ways
from consilience_dart.contact_instant import settle
from consilience_dart.contact_methods import CONTACT_FEATURES, EXTRAPOLATED, INSTANT, REASONS, touches
from consilience_dart.contact_methods import refused as beyond_stepping
from consilience_dart.contact_motion import extrapolated, move
from consilience_dart.dynamics import (
    body_accelerations,
    constrained_dynamics,
    constraint_rank,
    forward_dynamics,
    impose,
    reactions,
)
from consilience_dart.efforts import nonlinear_energy
from consilience_dart.integration import rk4_trajectory
from consilience_dart.loads import Forces, spring_energy
from consilience_dart.state import from_state, send
from consilience_dart.stepping import (
    CONSTRAINT_FORCE_MIXING,
    ERROR_REDUCTION_DEFAULT,
    ERROR_REDUCTION_TRAJECTORY,
    Stepper,
    extrapolated_accelerations,
    native_trajectory,
    set_softness,
    stepper,
    zero_step_accelerations,
)
from consilience_dart.translation import Model, build

EXACT = {
    "cylindrical joint": "cylindrical: prismatic, then revolute joint, with a massless link between",
    "universal joint": "universal: two revolute joints, with a massless link between",
    "planar joint": "planar: two prismatic joints and a revolute joint, with massless links between",
    "rod joint": "rod: massless link of two revolutes and a ball (singular a right angle from the start)",
    "spherical joint": "spherical: BallJoint",
    "free joint": "free: FreeJoint with identity frames",
    "screw joint": "screw: ScrewJoint, its turns those of its displacement",
    "spring": "springs between points and their actuators: external forces by the adapter, at the start of each step",
    "joint spring": "joint springs: DART's own, implicit in its time step (which is zero outside World.step)",
    "load": "loads: external forces by the adapter, at the start of each step",
    "nonlinear joint spring": "joint springs: what is not linear as forces of DART's joints, and as its damper",
    "actuator": "actuators of joint springs: forces of DART's joints, at the start of each step",
    "friction": "friction: force of DART's joint, its slope with the rate as DART's damper, implicit in the time step",
    "control": "control: force of DART's joint, D as its damper; the integral by the adapter, with the motion's method",
    "drive": "drives: acceleration actuators (trees, World.step), rows of the harness's solve (loops)",
    "coupling": "couplings, rolling, skates: rows of the harness's solve beside DART's terms; not in World.step",
}
"""Translation of each feature of a mechanism (`Mechanism.features`), for the manifest."""
EXACT |= dict.fromkeys(("rolling", "skate"), EXACT["coupling"])

TOUCHING = {
    "contacts": "contacts: spheres and planes on massless nodes of their own, so that no other pair collides",
    "stops": "stops: limits of DART's joints, which do not bounce",
    "dry_frictions": "dry friction: Coulomb friction of DART's joints",
}
"""Translation of contacts, stops and dry friction, by group of a mechanism."""

EXPONENTIAL = "World.step: rotations by a truncated exponential map, error (w h)^3 / 6 a step"
APPROXIMATED = dict.fromkeys(("spherical joint", "free joint", "rod joint"), EXPONENTIAL) | {
    "drive": "World.step: drives at velocity level, half of the position error removed in a step"
}

FEATURES = feature_names(
    joints="revolute, prismatic, cylindrical, universal, spherical, planar, rigid, rod, free, screw, "
    "point_on_line, point_in_plane, parallel_axes",
    elements="spring, joint spring, nonlinear joint spring, actuator, load, load in time, friction, control, drive, "
    "coupling, rolling, skate, " + CONTACT_FEATURES,
)
"""Features of a mechanism that the adapter translates; features that are not listed are refused."""


class DartEngine:
    """DART: generalised coordinates, articulated bodies, loops closed by constraints at velocity level."""

    def __init__(self) -> None:
        self._translated = lru_cache(maxsize=1)(build)

    def info(self) -> EngineInfo:
        """Return name and version of DART and its adapter."""
        return EngineInfo("DART", dartpy.__version__, "consilience_dart")

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Return features without a translation, and linear joint springs and dampers below zero.

        For a trajectory also constraints that no integrator can keep in this mechanism.
        """
        refused = beyond(mechanism, FEATURES, "DART", REASONS)
        if question is Question.MODEL:
            return refused
        if question is Question.TRAJECTORY and not refused:
            refused = ways.unmovable(mechanism)
        if not refused:
            refused = beyond_stepping(mechanism)
        reason = "DART's joint springs and dampers cannot be negative: it sets them to zero"
        return refused + tuple(
            Unsupported(f"joint spring '{spring.name}' with a negative coefficient", reason)
            for spring in mechanism.joint_springs
            if spring.is_linear and min(spring.stiffness, spring.damping) < 0.0
        )

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods that answer the question, the headline method first."""
        return ways.methods(mechanism, question)

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Return the features that the translation keeps exact, and those that it approximates."""
        tree = to_elementary_tree(without_screws(mechanism, "revolute"))
        exact = ["bodies, revolute, prismatic and rigid joints, gravity"]
        exact += [text for group, text in TOUCHING.items() if getattr(mechanism, group)]
        exact += dict.fromkeys(EXACT[feature] for feature in mechanism.features if feature in EXACT)
        approximated = list(dict.fromkeys(APPROXIMATED[f] for f in mechanism.features if f in APPROXIMATED))
        if tree.welds:
            names = ", ".join(sorted({mechanism.bodies[tree.links[w.original].body].name for w in tree.welds}))
            exact.append(f"loops: split bodies ({names}) held together by welds")
            approximated.append(
                "World.step: welds hold at velocity level with force mixing 1e-9 (DART's default and least)"
            )
        return Manifest(tuple(exact), tuple(approximated))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return mass, centre of mass and inertia of the skeleton's nodes, and the freedom by its Jacobians."""
        model = self._translated(suited_rods(mechanism, state))
        send(model, from_state(model, state))
        com = np.asarray(model.skeleton.getCOM())
        inertia = np.zeros((3, 3))
        for node in model.nodes:
            R, c = node.getWorldTransform().rotation(), np.asarray(node.getCOM()) - com
            inertia += R @ node.getInertia().getMoment() @ R.T + node.getMass() * (c @ c * np.eye(3) - np.outer(c, c))
        freedom = model.skeleton.getNumDofs() - constraint_rank(model)
        return ModelAnswer(float(model.skeleton.getMass()), com, inertia, freedom)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return accelerations, joint reactions and energies at consistent states."""
        native = method.route is Route.EXTRAPOLATED
        forces_of_contacts = []
        stepping: Stepper | None = None
        model = None
        accelerations, wrenches, energies = [], [], []
        for state in states:
            suited = suited_rods(mechanism, state)
            fresh = partial(_stepper, suited, state, method)
            if model is None or model.mechanism is not suited or method.name == INSTANT:
                stepping = fresh() if native else None
                model = stepping.model if stepping else self._translated(suited)
                forces = Forces(model)
            c = from_state(model, state)
            send(model, c)
            if stepping and method.name == INSTANT:
                forces_of_contacts.append(settle(stepping, fresh, c, state))
            elif stepping and method.name == ways.EXTRAPOLATED_DEFAULT:
                ways.soften(method)
                zero_step_accelerations(stepping, c, state)
            elif stepping:
                extrapolated_accelerations(stepping, c, state)
            elif method.name == ways.ARTICULATED:
                forward_dynamics(model, forces)
            else:
                impose(model, *constrained_dynamics(model, forces))
            accelerations.append(body_accelerations(model))
            if not native:
                wrenches.append(reactions(mechanism, model, state))
            energies.append(_energies(model))
        a, alpha = (np.array(column) for column in zip(*accelerations, strict=True))
        kinetic, potential = np.array(energies).T
        force, torque = (np.array(c) for c in zip(*wrenches, strict=True)) if wrenches else (None, None)
        pressing = np.array(forces_of_contacts) if mechanism.contacts else None
        return InstantAnswer(a, alpha, force, torque, kinetic, potential, pressing)

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate the motion from `state`, sampled at `times`.

        Parameters
        ----------
        mechanism, state, times, method, step
            As in `consilience.engine.Engine.trajectory`.
        """
        mechanism, substeps = suited_rods(mechanism, state), steps_per_sample(times, step)
        if method.route is Route.HARNESS_INTEGRATOR:
            (p, quat, v, w), work = rk4_trajectory(mechanism, state, times, substeps)
            return TrajectoryAnswer(np.asarray(times), p, quat, v, w, {"evaluations": work})
        if touches(mechanism):
            return self._with_contacts(mechanism, state, np.asarray(times), method, substeps)
        ways.soften(method)
        (p, quat, v, w), work = native_trajectory(_stepper(mechanism, state, method), times, substeps)
        return TrajectoryAnswer(np.asarray(times), p, quat, v, w, {"steps": work})

    @staticmethod
    def _with_contacts(
        mechanism: Mechanism, state: State, times: Array, method: Method, substeps: int
    ) -> TrajectoryAnswer:
        """Integrate by `World.step` with contacts, stops or dry friction."""
        matched = method.profile is Profile.MATCHED
        set_softness(ERROR_REDUCTION_TRAJECTORY if matched else ERROR_REDUCTION_DEFAULT, CONSTRAINT_FORCE_MIXING)
        if method.name == EXTRAPOLATED:
            return extrapolated(lambda: _stepper(mechanism, state, method), times, substeps)
        return move(_stepper(mechanism, state, method), times, substeps)


def _stepper(mechanism: Mechanism, start: State, method: Method) -> Stepper:
    default = method.profile is Profile.DEFAULT
    return stepper(mechanism, start, sleeping=default, cones=not default)


def _energies(model: Model) -> tuple[float, float]:
    """Kinetic and potential energy by DART; the energy of springs that DART lacks is added."""
    potential = model.skeleton.computePotentialEnergy() + model.spring_offset
    return model.skeleton.computeKineticEnergy(), potential + spring_energy(model) + nonlinear_energy(model)
