"""The adapter: methods, what they need, and the three questions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from consilience.engine import beyond
from consilience.mechanism import JOINT_KINDS, Mechanism, State
from consilience.run import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Question,
    Route,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.spatial import Array, continuous_in_time
from consilience.tree import lower
from consilience_mujoco.evaluate import (
    accelerations,
    check_solved,
    energies,
    evaluate_bodies,
    model_answer,
    reactions,
    solve_by_harness,
)
from consilience_mujoco.messages import warnings_raise
from consilience_mujoco.states import poses_and_velocities, set_state
from consilience_mujoco.translate import OPTIONS, WELD_SETTINGS, Translation, springs_cancel, springs_on, translate

_INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "Euler": mujoco.mjtIntegrator.mjINT_EULER}
_EVALUATIONS = {"RK4": 4, "Euler": 1}


def _tree_methods(question: Question) -> tuple[Method, ...]:
    if question is not Question.TRAJECTORY:
        return (Method("mj_forward", Route.NATIVE, settings=OPTIONS),)
    return (
        Method("RK4", Route.NATIVE, 4, (10, 20, 40, 80), settings=OPTIONS | {"opt.integrator": "RK4"}),
        Method("Euler", Route.NATIVE, 1, (200, 400, 800), settings=OPTIONS),
    )


FEATURES = frozenset(f"{kind} joint" for kind in JOINT_KINDS if kind != "screw") | {"spring", "joint spring", "load"}
"""What of `Mechanism.features` has a translation."""


class MujocoEngine:
    """MuJoCo behind the protocol `consilience.engine.Engine`."""

    def __init__(self) -> None:
        self._last: Translation | None = None

    def info(self) -> EngineInfo:
        """Name and version."""
        return EngineInfo(
            "MuJoCo", mujoco.__version__, "consilience_mujoco", "minimal coordinates; loops by soft welds"
        )

    def unsupported(self, mechanism: Mechanism, question: Question) -> tuple[Unsupported, ...]:
        """Everything of the mechanism MuJoCo cannot represent."""
        del question  # the same for all of them
        refused = beyond(mechanism, FEATURES, "MuJoCo")
        if refused:
            return refused
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
            for link in lower(mechanism).links
            if springs_cancel(springs_on(mechanism, link))
        ]
        return (*tendons, *joints)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Ways to answer, the headline first."""
        welds = len(lower(mechanism).welds)
        if not welds:
            return _tree_methods(question)
        settings = OPTIONS | WELD_SETTINGS
        if question is Question.TRAJECTORY:
            settings |= {"opt.iterations": 20 + 12 * welds, "opt.integrator": "RK4"}
            return (Method("RK4", Route.TUNED, 4, (10, 20, 40, 80), settings=settings),)
        forward = Method("mj_forward", Route.TUNED, settings=settings | {"opt.iterations": 500})
        borrowed = {"eq_solref": WELD_SETTINGS["eq_solref"]}  # nothing else of the welds enters their equations
        harness = Method("mj_fullM, efc_J", Route.HARNESS_SOLVE, settings=OPTIONS | borrowed)
        return (forward, harness) if question is Question.INSTANT else (forward,)

    def manifest(self, mechanism: Mechanism) -> Manifest:
        """Say what the translation keeps exact and what it approximates."""
        kinds = {joint.kind for joint in mechanism.joints}
        loops = bool(lower(mechanism).welds)
        exact = {
            "masses, centres of mass, inertia tensors (given by principal axes)": True,
            "cylindrical, universal, planar joints: several joints of one body": kinds
            & {"cylindrical", "universal", "planar"},
            "rod: massless link of two hinges and a ball (chart singular when the rod lies along x of F)": "rod"
            in kinds,
            "free joint: the body hangs from the world": "free" in kinds,
            "springs: spatial tendons": mechanism.springs,
            "joint springs: those of the MuJoCo joint": mechanism.joint_springs,
            "loads: actuators of constant force at sites": mechanism.loads,
        }
        approximated = (
            "loops: split bodies held by soft welds, regularisation about 2e-15 of the inverse inertia they see",
            "loops: no feedback on the drift of a trajectory",
        )
        return Manifest(tuple(text for text, present in exact.items() if present), approximated if loops else ())

    def model(self, mechanism: Mechanism, state: State, method: Method) -> ModelAnswer:
        """Mass properties and freedom of the compiled model at a state."""
        translation = self._prepare(mechanism, method)
        with warnings_raise():
            set_state(translation, state)
            mujoco.mj_forward(translation.model, translation.data)
        return model_answer(translation)

    def instant(self, mechanism: Mechanism, states: Sequence[State], method: Method) -> InstantAnswer:
        """Accelerations, joint reactions and energies at consistent states."""
        translation = self._prepare(mechanism, method)
        rows: list[tuple[Any, ...]] = []
        with warnings_raise():
            for state in states:
                set_state(translation, state)
                mujoco.mj_forward(translation.model, translation.data)
                if method.route is Route.HARNESS_SOLVE:
                    solve_by_harness(translation)
                check_solved(translation)
                evaluate_bodies(translation)
                rows.append((*accelerations(translation), *reactions(translation, state), *energies(translation)))
        return InstantAnswer(*(np.array(column) for column in zip(*rows, strict=True)))

    def trajectory(
        self, mechanism: Mechanism, state: State, times: Array, method: Method, step: float
    ) -> TrajectoryAnswer:
        """Motion from `state` at ``times[0]`` by one of MuJoCo's integrators with a fixed step."""
        translation = self._prepare(mechanism, method)
        model, data = translation.model, translation.data
        interval = float(times[1] - times[0])
        steps = round(interval / step)
        model.opt.integrator, model.opt.timestep = _INTEGRATORS[method.name], interval / steps
        samples = []
        set_state(translation, state)
        for n in range(len(times)):
            with warnings_raise():
                if n > 0:
                    mujoco.mj_step(model, data, steps)
                if translation.tree.welds:
                    mujoco.mj_forward(model, data)
                    check_solved(translation)
            samples.append(poses_and_velocities(translation))
        p, quat, v, w = (np.array(column) for column in zip(*samples, strict=True))
        total = steps * (len(times) - 1)
        counters: dict[str, int | float] = {"steps": total, "evaluations": total * _EVALUATIONS[method.name]}
        return TrajectoryAnswer(np.array(times), p, continuous_in_time(quat), v, w, counters)

    def _prepare(self, mechanism: Mechanism, method: Method) -> Translation:
        """Translate, unless it is the mechanism of last time, and set what the method sets on the model."""
        if self._last is None or self._last.mechanism is not mechanism:
            self._last = translate(mechanism)
        if "opt.iterations" in method.settings:
            self._last.model.opt.iterations = method.settings["opt.iterations"]
        return self._last
