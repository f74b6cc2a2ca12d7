"""What one engine answered to one question of one case at one setting, in canonical observables.

Arrays follow the body and joint order of the mechanism; the ground is not in them. Frames as everywhere:
world components, scalar-first quaternions, angular and linear parts apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from consilience.mechanism import Array, Mechanism, State


class Question(StrEnum):
    """What can be asked of an engine."""

    MODEL = "model"
    INSTANT = "instant"
    TRAJECTORY = "trajectory"


class Route(StrEnum):
    """How much of an answer is the engine's own. A route that borrows never passes for the engine's own."""

    NATIVE = "native"
    TUNED = "native, tuned"
    EXTRAPOLATED = "native, extrapolated"
    HARNESS_SOLVE = "engine terms with the harness's constraint solve"
    HARNESS_INTEGRATOR = "engine accelerations with the harness's integrator"
    REFERENCE = "reference"


class Profile(StrEnum):
    """Whose settings an engine runs with."""

    MATCHED = "matched"
    """Translated so that the engine means the same as the case."""

    DEFAULT = "default"
    """As the engine comes out of the box: what a user gets who sets nothing."""


class Status(StrEnum):
    """How a run ended."""

    ANSWERED = "answered"
    UNSUPPORTED = "unsupported"
    FAILED = "failed"


@dataclass(frozen=True)
class Unsupported:
    """One thing of a mechanism or question an engine cannot represent, and why."""

    feature: str
    reason: str


@dataclass(frozen=True)
class EngineInfo:
    """Name and version of an engine, and of whatever else decides its answers."""

    name: str
    version: str
    adapter: str
    remarks: str = ""


@dataclass(frozen=True)
class Manifest:
    """What a translation kept exact, what it approximated, and what the reader should know."""

    exact: tuple[str, ...] = ()
    approximated: tuple[str, ...] = ()


@dataclass(frozen=True)
class Method:
    """One way in which an engine answers a question.

    Attributes
    ----------
    name : str
        In the engine's own words, for example ``RK4`` or ``constraintDynamics``.
    route : Route
    order : int or None
        Declared order of a fixed-step integrator.
    substeps : tuple of int
        Trajectory at fixed steps: steps per sample interval on each level, coarse to fine.
    tolerances : tuple of float
        Trajectory at adaptive steps: tolerance on each level, coarse to fine.
    settings : dict
        Every knob that is not at the engine's default.
    profile : Profile
        A method of the profile ``default`` has its first level at the engine's own step, or near it.
    softness : float or None
        Scale of the engine's own regularisation of constraints: 1 for these settings, 2 for twice as soft, by the
        knob the engine has; None where its constraints are hard. The harness asks again with another scale to see
        whether a difference moves with it.
    """

    name: str
    route: Route
    order: int | None = None
    substeps: tuple[int, ...] = ()
    tolerances: tuple[float, ...] = field(default=(), kw_only=True)
    settings: dict[str, Any] = field(default_factory=dict, kw_only=True)
    profile: Profile = field(default=Profile.MATCHED, kw_only=True)
    softness: float | None = field(default=None, kw_only=True)


@dataclass(frozen=True, eq=False)
class ModelAnswer:
    """The engine's own account of the translated model.

    Attributes
    ----------
    mass : float, kg
    com : ndarray, shape (3,), m
        Centre of mass of the whole mechanism at the asked state, in the world.
    inertia : ndarray, shape (3, 3), kg m^2
        Of the whole mechanism about that point, in world axes.
    freedom : int
        Degrees of freedom, dependent constraints not counted twice.
    """

    mass: float
    com: Array
    inertia: Array
    freedom: int


@dataclass(frozen=True, eq=False)
class InstantAnswer:
    """Accelerations, reactions and energies at given states.

    Attributes
    ----------
    a_WB_W, alpha_WB_W : ndarray, shape (n_s, n_b, 3), m/s^2 and rad/s^2
        Acceleration of each body's origin (time derivative of ``v_WB_W``) and angular acceleration, world axes.
    force_F, torque_F : ndarray, shape (n_s, n_j, 3), N and N m, or None
        Reaction of each joint: on the successor, at the origin of M, in axes of F, constraint forces only
        (no joint springs). Zero for a free joint. None where the method gives no reactions.
    kinetic, potential : ndarray, shape (n_s,), J
        By the engine's own account; the potential energy of gravity is zero at the world origin.
    """

    a_WB_W: Array
    alpha_WB_W: Array
    force_F: Array | None
    torque_F: Array | None
    kinetic: Array
    potential: Array


@dataclass(frozen=True, eq=False)
class TrajectoryAnswer:
    """Motion on the asked time grid.

    Attributes
    ----------
    time : ndarray, shape (n_t,), s
    p_WB, v_WB_W, w_WB_W : ndarray, shape (n_t, n_b, 3)
    quat_WB : ndarray, shape (n_t, n_b, 4)
    counters : dict
        Work: steps, evaluations of the accelerations, whatever the engine counts.
    """

    time: Array
    p_WB: Array
    quat_WB: Array
    v_WB_W: Array
    w_WB_W: Array
    counters: dict[str, int | float] = field(default_factory=dict)

    def state(self, sample: int) -> State:
        """State of a sample."""
        return State(self.p_WB[sample], self.quat_WB[sample], self.v_WB_W[sample], self.w_WB_W[sample])


UNIT = 1e-9
"""How far the norm of a quaternion in an answer may be from one."""

Answer = ModelAnswer | InstantAnswer | TrajectoryAnswer


def defects(answer: object, question: Question, mechanism: Mechanism, count: int) -> list[str]:
    """What is wrong with the form of an answer: type, shapes, counts, values that are not finite.

    Parameters
    ----------
    count : int
        Number of states asked (`instant`) or of samples (`trajectory`).
    """
    n_b, n_j = len(mechanism.bodies), len(mechanism.joints)
    expected: dict[Question, tuple[type, dict[str, tuple[int, ...]]]] = {
        Question.MODEL: (ModelAnswer, {"mass": (), "com": (3,), "inertia": (3, 3), "freedom": ()}),
        Question.INSTANT: (
            InstantAnswer,
            {
                "a_WB_W": (count, n_b, 3),
                "alpha_WB_W": (count, n_b, 3),
                "force_F": (count, n_j, 3),
                "torque_F": (count, n_j, 3),
                "kinetic": (count,),
                "potential": (count,),
            },
        ),
        Question.TRAJECTORY: (
            TrajectoryAnswer,
            {
                "time": (count,),
                "p_WB": (count, n_b, 3),
                "quat_WB": (count, n_b, 4),
                "v_WB_W": (count, n_b, 3),
                "w_WB_W": (count, n_b, 3),
            },
        ),
    }
    kind, shapes = expected[question]
    if not isinstance(answer, kind):
        return [f"the answer is a {type(answer).__name__}, not a {kind.__name__}"]
    found = []
    for name, shape in shapes.items():
        value = getattr(answer, name)
        if value is None and name in ("force_F", "torque_F"):
            continue
        try:
            array = np.asarray(value)
        except ValueError as error:
            found.append(f"{name} is no array: {error}")
            continue
        if array.dtype.kind not in "fi":
            found.append(f"{name} holds {array.dtype}, not numbers")
        elif array.shape != shape:
            found.append(f"{name} has shape {array.shape}, not {shape}")
        elif not np.all(np.isfinite(array)):
            found.append(f"{name} has {int(np.sum(~np.isfinite(array)))} values that are not finite")
        elif name == "quat_WB" and np.max(np.abs(np.linalg.norm(array, axis=-1) - 1.0), initial=0.0) > UNIT:
            found.append(f"{name} holds quaternions that are not unit to {UNIT:g}")
    return found


@dataclass(frozen=True, eq=False)
class Run:
    """The record of one engine, question, method and level.

    Attributes
    ----------
    level : int
        Index into `Method.substeps` or `Method.tolerances`; 0 for the other questions.
    step : float or None
        Step size of a trajectory in s, or its tolerance where the method is adaptive.
    answer : Answer or None
        None unless `status` is ``answered``.
    reason : str
        Why it is unsupported or failed, with the evidence.
    cpu : float, s
        CPU time of the worker for the answer.
    log : str
        What the engine printed.
    """

    case: str
    engine: str
    question: Question
    method: Method | None
    level: int
    step: float | None
    status: Status
    answer: Answer | None = None
    reason: str = ""
    manifest: Manifest | None = None
    cpu: float = 0.0
    log: str = ""
