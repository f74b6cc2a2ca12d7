"""`MujocoEngine`: answers of MuJoCo through the protocol `consilience.engine.Engine`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
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
    motion_of_halved,
    steps_per_sample,
    suited_rods,
    without_screws,
)
from consilience.mechanism import NO_LENGTH, Array, Mechanism, State, Tree, continuous_in_time, to_elementary_tree
from consilience_mujoco.callback import answering
from consilience_mujoco.charts import advance
from consilience_mujoco.contact_instant import ContactInstant
from consilience_mujoco.contact_methods import CONTACT_FEATURES, HALVINGS, REASONS, refused, unilateral_methods
from consilience_mujoco.contact_motion import ContactRecord, set_gains, soften_defaults
from consilience_mujoco.contacts import is_unilateral
from consilience_mujoco.evaluate import (
    accelerations,
    check_solved,
    constraint_rank,
    energies,
    evaluate_bodies,
    model_answer,
    reactions,
    solve_by_harness,
)
from consilience_mujoco.manifest import manifest
from consilience_mujoco.messages import warnings_raise
from consilience_mujoco.methods import STIFF, configured, evaluations, methods
from consilience_mujoco.rows import count_rows
from consilience_mujoco.soft_law import has_soft_law, with_soft_law
from consilience_mujoco.states import poses_and_velocities, set_state
from consilience_mujoco.translate import (
    Translation,
    drawn_length,
    polynomials_apart,
    principal_inertia,
    slides_behind_balls,
    springs_cancel,
    springs_on,
    translate,
)

FEATURES = feature_names(
    joints="revolute, prismatic, cylindrical, universal, spherical, planar, rigid, rod, free, screw, "
    "point_on_line, point_in_plane, parallel_axes",
    elements="spring, joint spring, nonlinear joint spring, actuator, load, load in time, friction, control, drive, "
    "coupling, rolling, skate, " + CONTACT_FEATURES,
)
"""Features of a mechanism that the adapter translates; features that are not listed are refused."""


def _tree(mechanism: Mechanism) -> Tree:
    return to_elementary_tree(without_screws(mechanism, "cylindrical"))


class MujocoEngine:
    """MuJoCo: minimal coordinates, loops and constraint elements by soft equalities."""

    def __init__(self) -> None:
        self._tree = lru_cache(maxsize=1)(_tree)
        self._compiled: Translation | None = None  # of the last mechanism, recognised by identity
        self._last: tuple[Method, Translation] | None = None

    def info(self) -> EngineInfo:
        """Return name and version of MuJoCo and its adapter."""
        return EngineInfo(
            "MuJoCo",
            mujoco.__version__,
            "consilience_mujoco",
            "minimal coordinates; loops and drives by soft equalities",
        )

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Return the features of the mechanism that MuJoCo cannot represent."""
        unknown = beyond(mechanism, FEATURES, "MuJoCo", REASONS) or tuple(refused(mechanism))
        if unknown:
            return unknown
        reason = f"MuJoCo takes no mass and no principal moment of {mujoco.mjMINVAL:g} or less (mjMINVAL)"
        tendons = [
            Unsupported(f"spring '{s.name}': free length {s.free_length} m", "a tendon has no negative rest length")
            for s in mechanism.springs
            if s.free_length < 0
        ]
        joints = [
            Unsupported(
                f"springs on joint '{mechanism.joints[link.joint].name}' whose stiffnesses cancel",
                "a MuJoCo joint has one stiffness and one rest: nothing is left of the constant effort",
            )
            for link in self._tree(mechanism).links
            if springs_cancel(springs_on(mechanism, link))
        ]
        joints += [
            Unsupported(
                f"springs on joint '{mechanism.joints[link.joint].name}', not all linear, of several rests",
                "a MuJoCo joint has one polynomial and one rest",
            )
            for link in self._tree(mechanism).links
            if polynomials_apart(springs_on(mechanism, link))
        ]
        joints += [
            Unsupported(f"body '{mechanism.bodies[link.body].name}': {least:g} kg or kg m^2", reason)
            for link in self._tree(mechanism).links
            if link.body >= 0 and (least := min(link.mass, principal_inertia(link.inertia)[0][0])) <= mujoco.mjMINVAL
        ]
        if question is Question.MODEL:
            return (*tendons, *joints)
        dampers = [
            Unsupported(
                f"spring '{s.name}': a damper whose ends coincide in the drawing",
                "a tendon of no length takes the x axis of the world for its direction, not that of the velocity",
            )
            for s in mechanism.springs
            if s.damping != 0.0 and drawn_length(mechanism, s) <= NO_LENGTH
        ]
        derivatives = [
            Unsupported(
                f"loop over the {mechanism.joints[k].kind} joint '{mechanism.joints[k].name}', from its point on",
                "MuJoCo's mj_jacDot is wrong where a slide follows a ball on a body, and so is the weld's acceleration",
            )
            for k in slides_behind_balls(self._tree(mechanism))
        ]
        return (*tendons, *dampers, *joints, *derivatives)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the methods that answer the question, the headline method first."""
        equalities = count_rows(mechanism, self._tree(mechanism))
        if is_unilateral(mechanism):
            found = unilateral_methods(mechanism, question, equalities)
            soft = question is Question.TRAJECTORY and has_soft_law(mechanism, equalities)
            return with_soft_law(found, self._compile(mechanism)) if soft else found
        return methods(question, equalities, self._stiff(mechanism))

    def _stiff(self, mechanism: Mechanism) -> bool:
        """Whether a joint's damper decays faster than `STIFF`, in the drawing."""
        if not (mechanism.joint_springs or mechanism.frictions):
            return False
        model = self._compile(mechanism).model
        return float(np.max(model.dof_damping * model.dof_invweight0, initial=0.0)) > STIFF

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Return the features that the translation keeps exact, and those that it approximates."""
        return manifest(mechanism, bool(self._tree(mechanism).welds))

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Return mass properties and freedom of the compiled model at a state."""
        translation = self._prepare(mechanism, state, method)
        with warnings_raise(), answering(translation):
            set_state(translation, state)
            mujoco.mj_forward(translation.model, translation.data)
        return model_answer(translation)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Return accelerations, joint reactions, energies and contact forces at consistent states."""
        rows: list[tuple[Any, ...]] = []
        forces = []
        for state in states:
            translation = self._prepare(mechanism, state, method)
            with warnings_raise():
                forces.append(self._evaluate(translation, state, method))
                if method.profile is Profile.MATCHED:
                    check_solved(translation)
                evaluate_bodies(translation)
                wrenches = reactions(mechanism, translation, state)
                rows.append((*accelerations(translation), *wrenches, *energies(translation)))
        contact_force = np.array(forces) if mechanism.contacts else None
        answer = InstantAnswer(*(np.array(column) for column in zip(*rows, strict=True)))
        return replace(answer, contact_force=contact_force)

    @staticmethod
    def _evaluate(translation: Translation, state: State, method: Method) -> Array:
        """Evaluate the data at a state, with the constraint forces of the method; return the forces of contacts."""
        set_state(translation, state)
        if is_unilateral(translation.mechanism):
            return ContactInstant(translation).solve(state)
        with answering(translation):
            mujoco.mj_forward(translation.model, translation.data)
        if method.route is Route.HARNESS_SOLVE:
            solve_by_harness(translation)
        return np.zeros((0, 3))

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate the motion from `state` by one of MuJoCo's integrators with a fixed step.

        Parameters
        ----------
        mechanism, state, times, method, step
            As in `consilience.engine.Engine.trajectory`.
        """
        if method.route is Route.EXTRAPOLATED:
            halved = [step / 2.0**n for n in range(HALVINGS)]
            return motion_of_halved([self._motion(mechanism, state, times, method, h) for h in halved])
        return self._motion(mechanism, state, times, method, step)

    def _motion(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Integrate with one step; parameters as those of `trajectory`."""
        translation = self._prepare(mechanism, state, method)
        steps = steps_per_sample(times, step)
        translation.model.opt.timestep = float(times[1] - times[0]) / steps
        checked = bool(translation.model.neq) and method.profile is Profile.MATCHED
        rank = self._cut(translation, state) if checked else None
        record = self._start(translation, state, float(times[1] - times[0]), method)
        samples = []
        set_state(translation, state)
        for n in range(len(times)):
            if n > 0:
                translation.data.time = times[n - 1]  # MuJoCo's clock sums up steps and their rounding errors
                translation = advance(translation, steps, rank, record.add_step if record else None)
            if checked or record:
                with warnings_raise(), answering(translation, rank):
                    mujoco.mj_forward(translation.model, translation.data)
                    if checked:
                        check_solved(translation)
            if record:
                record.add_sample(translation)
            samples.append(poses_and_velocities(translation))
        p, quat, v, w = (np.array(column) for column in zip(*samples, strict=True))
        total = steps * (len(times) - 1)
        counters: dict[str, int | float] = {"steps": total, "evaluations": total * evaluations(method)}
        answer = TrajectoryAnswer(np.array(times), p, continuous_in_time(quat), v, w, counters)
        return record.complete(mechanism, answer) if record else answer

    @staticmethod
    def _start(translation: Translation, state: State, interval: float, method: Method) -> ContactRecord | None:
        """Set the gains of contacts, stops and dry friction; return the record of contacts, None if there are none."""
        if is_unilateral(translation.mechanism):
            softness = 1.0 if method.softness is None else method.softness
            if method.profile is Profile.MATCHED:
                set_state(translation, state)
                set_gains(translation, state, interval, softness)
            else:
                soften_defaults(translation.model, softness)
        contacts = len(translation.mechanism.contacts)
        return ContactRecord(contacts) if contacts else None

    def _cut(self, translation: Translation, state: State) -> int | None:
        """Rank of the constraints at a state if rows are dependent, else None."""
        with warnings_raise(), answering(translation):
            set_state(translation, state)
            mujoco.mj_forward(translation.model, translation.data)
        rank, rows = constraint_rank(translation)
        return rank if rank < rows else None

    def _compile(self, mechanism: Mechanism) -> Translation:
        """Compiled model of a mechanism; the last one is kept."""
        if self._compiled is None or self._compiled.mechanism is not mechanism:
            self._compiled, self._last = translate(mechanism), None
        return self._compiled

    def _prepare(self, mechanism: Mechanism, state: State, method: Method) -> Translation:
        """Compiled model, with the settings of a method, whose rods are far from singular; the last one is kept."""
        compiled = self._compile(suited_rods(mechanism, state))
        if self._last is None or self._last[0] != method:
            self._last = method, configured(compiled, method)
        return self._last[1]
