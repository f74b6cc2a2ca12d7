"""Answers of engines in canonical observables, the table of questions, descriptions of engines and methods, runs.

Arrays follow the order of bodies and joints in the mechanism, without the ground. Vectors have world components,
quaternions are scalar-first, angular and linear parts are separate arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from consilience.engine.questions import Answer, Question
from consilience.errors import ConsilienceError
from consilience.mechanism import Array, ContactLaw, Perturbation, State


class Route(StrEnum):
    """Share of an answer that is the engine's own. An answer made with parts of the harness is never called native."""

    NATIVE = "native"
    TUNED = "native, tuned"
    EXTRAPOLATED = "native, extrapolated"
    HARNESS_SOLVE = "engine terms with the harness's constraint solve"
    HARNESS_INTEGRATOR = "engine accelerations with the harness's integrator"
    HARNESS_STEPPING = "engine's contact solver with the harness's stepping"
    REFERENCE = "reference"

    @property
    def is_own(self) -> bool:
        """Whether the engine's own solver or integrator answers."""
        return self in (Route.NATIVE, Route.TUNED, Route.EXTRAPOLATED)


class Profile(StrEnum):
    """Whose settings an engine runs with."""

    MATCHED = "matched"
    """Settings that give the case the same meaning in the engine."""

    DEFAULT = "default"
    """The engine's own settings, which a user gets who sets nothing."""


class Status(StrEnum):
    """How a run ended."""

    ANSWERED = "answered"
    UNSUPPORTED = "unsupported"
    FAILED = "failed"


@dataclass(frozen=True)
class Unsupported:
    """A feature of a mechanism, or a question, that an engine cannot represent, and why."""

    feature: str
    reason: str

    def __str__(self) -> str:
        return f"{self.feature}: {self.reason}".replace("; ", ", ")  # a record joins refusals by semicolons


class CannotRepresent(ConsilienceError):
    """State, or course of a motion, that an engine cannot represent; the run is unsupported.

    Parameters
    ----------
    feature : str
    reason : str
        As those of `Unsupported`.
    """

    def __init__(self, feature: str, reason: str) -> None:
        self.refusal = Unsupported(feature, reason)
        super().__init__(str(self.refusal))


@dataclass(frozen=True)
class EngineInfo:
    """Name and version of an engine and of its adapter; remarks name other software that decides its answers."""

    name: str
    version: str
    adapter: str
    remarks: str = ""


@dataclass(frozen=True)
class Manifest:
    """Features of a mechanism that a translation keeps exact, and those that it approximates."""

    exact: tuple[str, ...] = ()
    approximated: tuple[str, ...] = ()


@dataclass(frozen=True)
class Method:
    """A way in which an engine answers a question.

    Attributes
    ----------
    name : str
        Name of the engine's own algorithm, for example ``RK4`` or ``constraintDynamics``.
    route : Route
    order : int or None
        Declared order of a fixed-step integrator.
    substeps : tuple of int
        Trajectory at fixed steps: steps per sample interval on each level, coarse to fine.
    tolerances : tuple of float
        Trajectory at adaptive steps: tolerance on each level, coarse to fine.
    settings : dict
        Every setting that is not at the engine's default.
    profile : Profile
        A method of the profile ``default`` has its first level at the engine's own step, or near it.
    softness : float or None
        Scale of the engine's own regularisation of constraints: 1 for these settings, 2 for twice as soft; None where
        the constraints are hard. The harness asks again with another scale to see whether a difference to the
        reference depends on the regularisation.
    soft_at_rest : bool
        Whether the softness leads to the case's law only where nothing slides with friction and nothing hits, as of
        convex cones, which lift what slides however hard they are. Elsewhere no other softness is asked, but of a
        single ball of even inertia that slides on the ground.
    contact_law : str
        Which law of contact the method solves, in plain words: ``circle``, ``pyramid of 4 facets along ...``.
    law : ContactLaw or None
        That law, where it is not the case's: the reference can be asked with it.
    soft_law : ContactLaw or None
        The law with the softness 1 of its contacts, where that can be stated: the reference can be asked with it too.
    """

    name: str
    route: Route
    order: int | None = None
    substeps: tuple[int, ...] = ()
    tolerances: tuple[float, ...] = field(default=(), kw_only=True)
    settings: dict[str, Any] = field(default_factory=dict, kw_only=True)
    profile: Profile = field(default=Profile.MATCHED, kw_only=True)
    softness: float | None = field(default=None, kw_only=True)
    soft_at_rest: bool = field(default=False, kw_only=True)
    contact_law: str = field(default="", kw_only=True)
    law: ContactLaw | None = field(default=None, kw_only=True)
    soft_law: ContactLaw | None = field(default=None, kw_only=True)


@dataclass(frozen=True, eq=False)
class ModelAnswer:
    """Mass properties and degrees of freedom of the translated model, as the engine computes them.

    Attributes
    ----------
    mass : float, kg
    com : ndarray, shape (3,), m
        Centre of mass of the whole mechanism at the given state, in the world frame.
    inertia : ndarray, shape (3, 3), kg m^2
        Inertia of the whole mechanism about its centre of mass, in world axes.
    freedom : int
        Degrees of freedom: dependent constraints count once.
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
        Energies as the engine computes them; the potential energy of gravity is zero at the world origin.
    contact_force : ndarray, shape (n_s, n_c, 3), N, or None
        Force of each contact on its `body`, the sum over its parts, world axes. None where the method gives none.
        Where equilibrium leaves it open, beside other contacts, joints or drives, one choice: `determinate_forces`
        tells.
    """

    a_WB_W: Array
    alpha_WB_W: Array
    force_F: Array | None
    torque_F: Array | None
    kinetic: Array
    potential: Array
    contact_force: Array | None = None

    def __repr__(self) -> str:
        return f"InstantAnswer: accelerations of shape {np.shape(self.a_WB_W)}"


EVENT_KINDS = ("impact", "closes", "opens", "slips", "sticks", "bounces end")
"""Events of contacts, stops and dry friction; of a stop or a dry friction those that it can have. A slip that reverses
slips anew."""

CONTACT_MODES = ("separated", "sliding", "sticking")
"""Modes of a contact. Of several closed parts one that slides decides."""


@dataclass(frozen=True, eq=False)
class TrajectoryAnswer:
    """Motion of all bodies, sampled on the given time grid.

    Attributes
    ----------
    time : ndarray, shape (n_t,), s
    p_WB, v_WB_W, w_WB_W : ndarray, shape (n_t, n_b, 3)
    quat_WB : ndarray, shape (n_t, n_b, 4)
    counters : dict
        Work of the integration: steps, evaluations of the accelerations, and other counts of the engine.
    contact_gap : ndarray, shape (n_t, n_c), m, or None
        Smallest gap of the parts of each contact. This and the following fields are None where the method gives none.
    contact_impulse : ndarray, shape (n_t, n_c, 3), N s, or None
        Impulse of each contact on its `body` since the sample before, world axes; zero at the first sample. Where
        equilibrium leaves it open, beside other contacts, joints or drives, one choice: `determinate_impulses` tells.
    contact_mode : ndarray of int, shape (n_t, n_c), or None
        Index into `CONTACT_MODES`.
    contact_loss : ndarray, shape (n_t,), J, or None
        Energy lost in contacts, stops and dry friction since the first sample, which has the velocities after an impact
        of its instant: what is lost in that, like its impulse, is in no sample. Open where drives give what they take.
    event_time : ndarray, shape (n_e,), s, or None
        Times of the events, in order.
    event_contact, event_kind : ndarray of int, shape (n_e,), or None
        Where: an index into contacts, then stops, then dry frictions; what: an index into `EVENT_KINDS`.

    At the instant of an impact a sample has the velocities after it.
    """

    time: Array
    p_WB: Array
    quat_WB: Array
    v_WB_W: Array
    w_WB_W: Array
    counters: dict[str, int | float] = field(default_factory=dict)
    contact_gap: Array | None = None
    contact_impulse: Array | None = None
    contact_mode: Array | None = None
    contact_loss: Array | None = None
    event_time: Array | None = None
    event_contact: Array | None = None
    event_kind: Array | None = None

    def __repr__(self) -> str:
        return f"TrajectoryAnswer: positions of shape {np.shape(self.p_WB)}"

    def state(self, sample: int) -> State:
        """Return the state of all bodies at a sample."""
        return State(self.p_WB[sample], self.quat_WB[sample], self.v_WB_W[sample], self.w_WB_W[sample])


# ---------------------------------------------------------------- the table of questions

Question.MODEL = Question.add(
    "model",
    description="mass, centre of mass, inertia and freedom, read back from the translated model (relative)",
    arguments=("state", "method"),
    answer=ModelAnswer,
    shapes={"mass": (), "com": (3,), "inertia": (3, 3), "freedom": ()},
    judge="consilience.compare.judges:ModelJudge",
    facts="consilience.report.facts:model_facts",
)

Question.INSTANT = Question.add(
    "instant",
    description="accelerations, joint reactions and energies at given states; relative to the largest component",
    arguments=("states", "method"),
    answer=InstantAnswer,
    shapes={
        **dict.fromkeys(("a_WB_W", "alpha_WB_W"), ("count", "bodies", 3)),
        **dict.fromkeys(("force_F", "torque_F"), ("count", "joints", 3)),
        **dict.fromkeys(("kinetic", "potential"), ("count",)),
        "contact_force": ("count", "contacts", 3),
    },
    judge="consilience.compare.judges:InstantJudge",
    facts="consilience.report.facts:instant_facts",
)

Question.TRAJECTORY = Question.add(
    "trajectory",
    description="the motion over time, at several step sizes",
    arguments=("state", "times", "method", "step"),
    answer=TrajectoryAnswer,
    shapes={
        "time": ("count",),
        "p_WB": ("count", "bodies", 3),
        "quat_WB": ("count", "bodies", 4),
        "v_WB_W": ("count", "bodies", 3),
        "w_WB_W": ("count", "bodies", 3),
        "contact_gap": ("count", "contacts"),
        "contact_impulse": ("count", "contacts", 3),
        "contact_mode": ("count", "contacts"),
        "contact_loss": ("count",),
        **dict.fromkeys(("event_time", "event_contact", "event_kind"), ("events",)),
    },
    judge="consilience.compare.judges:TrajectoryJudge",
    facts="consilience.report.facts:trajectory_facts",
)

STANDARD = tuple(Question)
"""Questions that every process knows; others are added at run time."""


@dataclass(frozen=True, eq=False)
class Run:
    """Answer of one engine to one question by one method at one level, or why there is none.

    Attributes
    ----------
    level : int
        Index into `Method.substeps` or `Method.tolerances`; 0 for questions without levels. Below 0: a longer step,
        whose motion is not judged.
    step : float or None
        Step size of a trajectory in s, or its tolerance where the method is adaptive.
    answer : Answer or None
        None unless `status` is ``answered``.
    reason : str
        Why the question is unsupported or the run failed, with the evidence.
    cpu : float, s
        CPU time of the worker for the answer.
    log : str
        Output of the engine.
    perturbation : Perturbation or None
        Error in the mechanism that the engine, here the reference, was given on purpose.
    coprime : bool
        Whether the step is no level but one of those of which the motions that scatter have a limit.
    """

    case: str
    engine: str
    question: Question
    method: Method | None
    level: int
    step: float | None
    status: Status
    answer: Answer = None
    reason: str = ""
    manifest: Manifest | None = None
    cpu: float = 0.0
    log: str = ""
    perturbation: Perturbation | None = None
    coprime: bool = False

    def __repr__(self) -> str:
        method = "" if self.method is None else f", {self.method.name}, level {self.level}"
        return f"Run: {self.engine} on {self.case}, {self.question}{method}: {self.status}"
