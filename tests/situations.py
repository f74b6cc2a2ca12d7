"""Synthetic motions with errors of known size, order and softness, and the verdict that each must get.

The true motion: a body runs on the unit circle and rotates. The error of the engine is a displacement along z, a
function of the step h, the softness s and the time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from consilience.compare import Comparison, ReferenceMotion, Verdict, compare_trajectory
from consilience.compare.coprime_steps import coprime_substeps
from consilience.compare.motion import size_of_motion
from consilience.compare.power import MotionSensitivity
from consilience.compare.reference_motion import OtherLaw
from consilience.compare.softness import SCALES
from consilience.engine import (
    CONTACT_MODES,
    EVENT_KINDS,
    Method,
    Profile,
    Question,
    Route,
    Run,
    Status,
    TrajectoryAnswer,
)
from consilience.mechanism import quaternion_from_rotation_vector
from mechanisms import chain

MECHANISM = chain("free", seed=1)
TIMES = np.linspace(0.0, 2.0, 41)
SHAPE = np.sin(3 * TIMES) * TIMES / 1.46
"""Errors over time: largest 1.0 at 1.7 s, zero at the start."""

STEPS = (0.02, 0.01, 0.005)
FIVE = (0.02, 0.01, 0.005, 0.0025, 0.00125)
EIGHT = tuple(0.02 / 2**n for n in range(8))


def motion(displacement: object = 0.0) -> TrajectoryAnswer:
    """The true motion, displaced along z; the displacement is relative to the size of the motion."""
    t = TIMES
    p = np.column_stack([np.cos(t), np.sin(t), displacement * np.ones_like(t)])[:, None]
    quat = np.array([quaternion_from_rotation_vector([0, 0, x]) for x in t])[:, None]
    v = np.column_stack([-np.sin(t), np.cos(t), np.gradient(p[:, 0, 2], t)])[:, None]
    w = np.column_stack([0 * t, 0 * t, 1 + 0 * t])[:, None]
    return TrajectoryAnswer(t, p, quat, v, w, {"steps": 400})


TRUE = motion()
SIZE = size_of_motion(MECHANISM, TRUE)
Error = Callable[[float, float], object]
"""Displacement of a step h and a softness s: a number, over `SHAPE`, or an array over time."""


@dataclass(frozen=True)
class Situation:
    """One error with its known cause and the right verdict."""

    name: str
    error: Error
    verdict: Verdict
    rule: str
    order: int | None = 2
    soft: bool = False
    profile: Profile = Profile.MATCHED
    steps: tuple[float, ...] = STEPS
    tolerances: bool = False
    digits: int = 8
    spread: float = 0.0
    growth: np.ndarray | None = field(default=None)
    dispute: str = ""
    earlier: str = ""
    lost: float = 0.0
    effect: float | None = None
    mass_effect: float | None = None
    singular: int | None = None
    event: str = ""
    contacts: int = 1
    times: int = 1
    other: str = ""
    hard: float | None = None
    velocity: float = 1.0
    velocity_slope: float = 0.0
    coprime: bool = False
    soft_at_rest: bool = False

    def judge(self) -> Comparison:
        """Verdict of the rules on this error."""
        substeps = tuple(10 * 2**n for n in range(len(self.steps)))
        levels = {"tolerances": self.steps} if self.tolerances else {"substeps": substeps}
        method = Method(
            *("m", Route.NATIVE, self.order),
            **levels,
            profile=self.profile,
            softness=1.0 if self.soft else None,
            soft_at_rest=self.soft_at_rest,
        )
        runs = [self._run(method, n, h, 1.0) for n, h in enumerate(self.steps)]
        softer = [
            self._run(replace(method, softness=s), len(runs) - 1, self.steps[-1], s)
            for s in (SCALES[self.profile] if self.soft else ())
        ]
        acting = tuple(
            MotionSensitivity(of, of, np.full(len(TIMES), effect))
            for of, effect in (("gravity", self.effect), ("mass", self.mass_effect))
            if effect is not None
        )
        spread = np.full(len(TIMES), self.spread)
        true = self._with_events()
        hard = None if self.hard is None else motion(SIZE * self.hard * SHAPE)
        law = OtherLaw(self.other, "another law", motion(SIZE * OTHER * SHAPE), hard) if self.other else None
        yard = ReferenceMotion(true, spread, self.digits, self.growth, self.dispute, acting, self.singular, law)
        between = list(self._between(method)) if self.coprime else []
        return compare_trajectory(MECHANISM, [*runs, *between], yard, softer, self.earlier, self.lost)

    def _between(self, method: Method) -> Iterator[Run]:
        """Motions at coprime steps, and at another softness if there is one."""
        most, other = max(SCALES[self.profile]), self.soft or self.soft_at_rest
        for one, s in ((method, 1.0), *([(replace(method, softness=most), most)] if other else [])):
            for n, substeps in enumerate(coprime_substeps(TIMES[1] / self.steps[-1])):
                yield replace(self._run(one, n, TIMES[1] / substeps, s), coprime=True)

    def _with_events(self) -> TrajectoryAnswer:
        """The true motion, with an event of some contacts, or more of them; what reverses slides from the start."""
        if not self.event:
            return TRUE
        kind = EVENT_KINDS.index("slips" if self.event == "reverses" else self.event)
        events = {
            "event_time": np.repeat(HIT * np.arange(1, self.times + 1) / self.times, self.contacts),
            "event_kind": np.full(self.times * self.contacts, kind),
            "event_contact": np.tile(np.arange(self.contacts), self.times),
        }
        modes = np.full((len(TIMES), self.contacts), CONTACT_MODES.index("sliding"))
        return replace(TRUE, **events, **({"contact_mode": modes} if self.event == "reverses" else {}))

    def _run(self, method: Method, level: int, h: float, s: float) -> Run:
        error = self.error(h, s)
        displacement = SIZE * (SHAPE * error if np.ndim(error) == 0 else error)
        answer = motion(displacement)
        answer = replace(answer, v_WB_W=(self.velocity + self.velocity_slope * h) * answer.v_WB_W)
        return Run("c", "e", Question.TRAJECTORY, method, level, h, Status.ANSWERED, answer)


def late(onset: float, order: int) -> Error:
    """An error that appears after `onset` and is proportional to a power of the step."""
    return lambda h, _: np.where(onset < TIMES, 1e-2 * (h / 0.005) ** order, 1e-12) * SHAPE


def saturated(h: float, s: float) -> np.ndarray:
    """Error in proportion to the step, and one at the end that has hardly begun to fall with it."""
    return np.where(TIMES > 1.9, 0.08 - 0.02 * np.exp(-h / 0.005), 3.0 * h * SHAPE)


def noise(size: float) -> Error:
    """Rounding error: different at every step size."""
    return lambda h, s: size * np.random.default_rng(int(1e6 * h + s)).normal(size=len(TIMES))


EXPONENTIAL = np.exp(10.0 * TIMES)
"""Growth of a chaotic motion: 4.9e8 at the end."""

A, D, R = Verdict.AGREES, Verdict.DISCRETISATION, Verdict.REGULARISATION
U, M = Verdict.UNRESOLVED, Verdict.MODEL
DEFAULT = Profile.DEFAULT

HIT = np.array([0.5])
"""Time of an event, s."""

OTHER = 0.01
"""Difference of the motion under another law of contact, over `SHAPE`."""


def springs(h: float, s: float) -> float:
    """Error of springs whose motion the reference has with their law, up to 1e-5."""
    return OTHER + 1e-5


def phase(size: float) -> Error:
    """Error of an impact: random, within a multiple of the step."""
    return lambda h, _: size * h * np.random.default_rng(round(1e6 * h)).uniform(0.3, 1.0)


def hops(size: float, power: float = 0.0) -> Error:
    """Error of what hops: random, in proportion to a power of the step."""
    return lambda h, _: size * (h / 0.02) ** power * np.random.default_rng(round(1e9 * h)).uniform(-1.0, 1.0)


SCATTERED = {"order": 1, "steps": EIGHT, "coprime": True, "event": "slips", "profile": DEFAULT}
"""Levels that hop, and motions at coprime steps."""

SITUATIONS = (
    # ---------------------------------------------------------------- agreement
    Situation("exact", lambda h, s: 0.0, A, "agreement"),
    Situation("order 1, fine enough", lambda h, s: 1e-6 * h, A, "agreement", order=1),
    Situation("order 2, fine enough", lambda h, s: 1e-4 * h**2, A, "agreement"),
    Situation("order 4, fine enough", lambda h, s: 2.0 * h**4, A, "agreement", order=4),
    Situation("rounding alone", noise(1e-13), A, "agreement", order=4),
    Situation("soft, below the digits asked", lambda h, s: 1e-9 * s, A, "agreement", soft=True),
    Situation("a plateau below the digits asked", lambda h, s: 4e-9 + 1e-6 * h**2, A, "agreement"),
    Situation("no ladder, right", lambda h, s: 1e-9, A, "agreement", order=None),
    Situation(
        "tolerances, fine enough",
        lambda h, s: 0.3 * h,
        A,
        "agreement",
        order=None,
        tolerances=True,
        steps=(1e-9, 1e-10, 1e-11),
    ),
    Situation("within the uncertainty of the reference", lambda h, s: 1.5e-8, A, "agreement", spread=0.9e-8),
    Situation(
        "wrong only past the horizon",
        lambda h, s: 1e-17 * EXPONENTIAL * np.linspace(0, 20, 41),
        A,
        "agreement",
        growth=EXPONENTIAL,
        digits=8,
    ),
    # ---------------------------------------------------------------- discretisation
    Situation("semi-implicit, order 1", lambda h, s: 3.0 * h, D, "steps", order=1),
    Situation("order 1 with a second term", lambda h, s: 1.0 * h + 10.0 * h**2, D, "steps", order=1),
    Situation("order 2", lambda h, s: 5.0 * h**2, D, "steps"),
    Situation("order 2, a band that shows gravity", lambda h, s: 5.0 * h**2, D, "steps", effect=1e-2),
    Situation("order 2 with a third power", lambda h, s: 5.0 * h**2 + 50.0 * h**3, D, "steps"),
    Situation("order 2 with a fourth power", lambda h, s: -2.0 * h**2 + 300.0 * h**4, D, "steps"),
    Situation("order 4", lambda h, s: 1e3 * h**4, D, "steps", order=4),
    Situation("order 4 with a fifth power", lambda h, s: 1e3 * h**4 - 2e4 * h**5, D, "steps", order=4),
    Situation("order 2, soft far below", lambda h, s: 5.0 * h**2 + 1e-9 * s, D, "steps", soft=True),
    Situation("order 2, an error that appears late", late(1.2, 2), D, "steps"),
    Situation(
        "order 2, over tolerances",
        lambda h, s: 2e3 * h,
        D,
        "steps",
        order=None,
        tolerances=True,
        steps=(1e-6, 1e-7, 1e-8),
    ),
    Situation("two levels, order against the reference", lambda h, s: 5.0 * h**2, D, "steps", steps=(0.02, 0.01)),
    Situation("order 1 at the defaults", lambda h, s: 3.0 * h, D, "steps", order=1, profile=DEFAULT),
    Situation(
        "a plateau that the steps cancel at the finest level",
        lambda h, s: 2e-8 * (h / 0.005) ** 2 - 2.5e-8,
        U,
        "agreement by chance",
    ),
    Situation("a plateau of what is allowed", lambda h, s: 1e-8 * (h / 0.005) ** 2 - 1.2e-8, A, "agreement"),
    # ---------------------------------------------------------------- contact
    Situation("impacts at random phases", phase(0.2), D, "impacts within steps", order=1, event="impact"),
    Situation("impacts, order by chance", lambda h, s: 0.3 * h, D, "impacts within steps", order=1, event="impact"),
    Situation("impacts late on every grid", lambda h, s: 1e-3, D, "impacts within steps", order=1, event="impact"),
    Situation(
        "impacts, another restitution", lambda h, s: 0.05 + phase(0.2)(h, s), M, "impacts elsewhere", event="impact"
    ),
    Situation(
        "impacts on the grid, another restitution",
        lambda h, s: 0.05 + 1e-12 / h,
        M,
        "impacts elsewhere",
        event="impact",
    ),
    Situation(
        "many impacts, whose bound hides gravity, and levels that do not",
        phase(0.2),
        D,
        "impacts within steps",
        order=1,
        steps=FIVE,
        event="impact",
        times=40,
        effect=0.05,
    ),
    Situation(
        "many impacts, whose bound hides gravity, at three levels",
        phase(0.2),
        U,
        "no power",
        order=1,
        event="impact",
        times=40,
        effect=0.05,
    ),
    Situation(
        "many impacts, whose bound hides what the levels do not show",
        lambda h, s: 0.02 + phase(0.2)(h, s),
        U,
        "no power",
        order=1,
        steps=FIVE,
        event="impact",
        times=40,
        effect=0.05,
    ),
    Situation(
        "a stop within a step, extrapolated", lambda h, s: 0.3 * h**2, D, "modes within steps", order=4, event="sticks"
    ),
    Situation("a stop within a step, too far", lambda h, s: 1e-3 + 0.3 * h**4, M, "elsewhere", order=4, event="sticks"),
    Situation(
        "a contact that opens a step late, extrapolated",
        lambda h, s: 0.05 * h,
        D,
        "modes within steps",
        order=4,
        event="opens",
    ),
    Situation(
        "a slip that reverses a step late, extrapolated",
        lambda h, s: 0.05 * h,
        D,
        "modes within steps",
        order=4,
        event="reverses",
    ),
    Situation(
        "soft friction that reverses, far within the bound",
        lambda h, s: 5e-3 * s + 0.05 * h,
        R,
        "softness",
        order=1,
        soft=True,
        profile=DEFAULT,
        event="reverses",
    ),
    Situation("a contact that opens, too far", lambda h, s: 0.1 + 0.3 * h**4, M, "elsewhere", order=4, event="opens"),
    Situation("impacts that scatter", noise(0.05), U, "impacts unclear", order=1, event="impact"),
    Situation("hops about another motion", lambda h, s: 0.02 + hops(0.01)(h, s), M, "scatter elsewhere", **SCATTERED),
    Situation(
        "hops about another motion, less at smaller steps",
        lambda h, s: 0.02 + hops(0.02, 0.25)(h, s),
        M,
        "scatter elsewhere",
        **SCATTERED,
    ),
    Situation(
        "hops about another motion, whatever the softness",
        lambda h, s: 0.02 + hops(0.01)(h, s),
        M,
        "scatter elsewhere",
        soft_at_rest=True,
        **SCATTERED,
    ),
    Situation(
        "hops about a motion that softness moves",
        lambda h, s: 0.02 * s**0.5 + hops(0.01)(h, s),
        U,
        "not asymptotic",
        soft_at_rest=True,
        **SCATTERED,
    ),
    Situation("hops about the motion", hops(0.01), U, "not asymptotic", **SCATTERED),
    Situation(
        "hops about the motion, with a root of the step",
        lambda h, s: 0.3 * h**0.5 + hops(0.01)(h, s),
        U,
        "wide band",
        **SCATTERED,
    ),
    Situation(
        "hops about the motion, with the square of the step",
        lambda h, s: 500.0 * h**2 + hops(0.01)(h, s),
        U,
        "not asymptotic",
        **SCATTERED,
    ),
    Situation(
        "hops about the motion, with a fourth root of the step",
        lambda h, s: 0.05 * h**0.25 + hops(0.01)(h, s),
        U,
        "not asymptotic",
        **SCATTERED,
    ),
    Situation(
        "hops about another motion, saturated", lambda h, s: 1.0 + hops(0.5)(h, s), U, "not asymptotic", **SCATTERED
    ),
    Situation("a pyramid for the cone", lambda h, s: OTHER + 0.02 * h, M, "cone shape", order=1, other="cone shape"),
    Situation(
        "a pyramid, different at an instant already",
        lambda h, s: OTHER + 0.02 * h,
        M,
        "cone shape",
        order=1,
        other="cone shape",
        earlier="instant: accelerations",
    ),
    Situation("a convex law", lambda h, s: OTHER + 1e-5, M, "associated cone", order=None, other="associated cone"),
    Situation("springs for rigid shapes", springs, R, "compliance", order=None, other="compliance", hard=1e-4),
    Situation("springs that lead elsewhere", springs, M, "no ladder", order=None, other="compliance", hard=8e-4),
    Situation("springs of unknown limit", springs, M, "no ladder", order=None, other="compliance"),
    Situation(
        "springs, without power", springs, U, "no power", order=None, other="compliance", hard=1e-4, effect=0.004
    ),
    Situation("other impacts", lambda h, s: OTHER + 1e-5, M, "impact law", order=None, other="impact law"),
    Situation(
        "other impacts, at random phases",
        lambda h, s: OTHER + phase(2.0)(h, s),
        M,
        "impact law",
        order=1,
        event="impact",
        steps=(2.5e-3, 1.25e-3, 6.25e-4),
        other="impact law",
    ),
    Situation(
        "other impacts, within what their phases make",
        lambda h, s: 0.3 * OTHER + phase(0.2)(h, s),
        U,
        "impacts unclear",
        order=1,
        event="impact",
        other="impact law",
    ),
    Situation(
        "slow rebounds that are none",
        lambda h, s: OTHER + 1e-5,
        M,
        "restitution threshold",
        order=None,
        other="restitution threshold",
    ),
    Situation("neither law", lambda h, s: 2.0 * OTHER + h**2, M, "elsewhere", other="cone shape"),
    # ---------------------------------------------------------------- regularisation
    Situation("soft in proportion", lambda h, s: 1e-4 * s, R, "softness", soft=True),
    Situation("soft in proportion, with steps", lambda h, s: 1e-4 * s + 0.1 * h**2, R, "softness", soft=True),
    Situation("soft with the square", lambda h, s: 1e-5 * s**2, R, "softness", soft=True),
    Situation("soft with the root", lambda h, s: 1e-4 * s**0.6, R, "softness", soft=True),
    Situation("soft, saturating", lambda h, s: 1e-3 * s / (1 + 0.05 * s), R, "softness", soft=True),
    Situation("soft over time", lambda h, s: 1e-4 * s * np.cumsum(SHAPE), R, "softness", soft=True),
    Situation("soft defaults", lambda h, s: 2e-2 * s, R, "softness", soft=True, profile=DEFAULT),
    Situation(
        "soft defaults, order 1", lambda h, s: 5e-2 * s + 0.05 * h, R, "softness", order=1, soft=True, profile=DEFAULT
    ),
    Situation(
        "soft defaults, hard answers that scatter",
        lambda h, s: 1e-2 * s * (s > 0.1) + {0.01: 3e-5, 0.005: -2e-5, 0.0025: 4e-5}.get(s, 0.0),
        R,
        "softness",
        soft=True,
        profile=DEFAULT,
    ),
    Situation("soft, half of the steps", lambda h, s: 0.5 * h + 1.25e-3 * s, R, "softness", order=1, soft=True),
    Situation(
        "soft, not asymptotic in the step", lambda h, s: 1e-3 * s + 1e-3 * np.sin(1 / h) * h, R, "softness", soft=True
    ),
    # ---------------------------------------------------------------- model
    Situation("a plateau of 1e-6", lambda h, s: 1e-6 + 1e-3 * h**2, M, "elsewhere"),
    Situation("a plateau of 1e-3", lambda h, s: 1e-3 + 2.0 * h**2, M, "elsewhere"),
    Situation("a plateau of 1", lambda h, s: 1.0 + 2.0 * h**2, M, "elsewhere"),
    Situation("a plateau, order 4", lambda h, s: 1e-5 + 1e3 * h**4, M, "elsewhere", order=4),
    Situation("a plateau, order 1", lambda h, s: -1e-2 + 1.0 * h, M, "elsewhere", order=1),
    Situation("gravity off: grows with t^2", lambda h, s: 1e-5 * TIMES**2 + h**2 * SHAPE, M, "elsewhere"),
    Situation("another branch", lambda h, s: 0.5 + 0.0 * TIMES + h**2 * SHAPE, M, "elsewhere"),
    Situation("a plateau that softness does not move", lambda h, s: 1e-3 + 1e-9 * s + h**2, M, "elsewhere", soft=True),
    Situation("a plateau that softness moves a little", lambda h, s: 1e-3 + 1e-4 * s + h**2, M, "elsewhere", soft=True),
    Situation(
        "a plateau about which hard answers scatter, an order of a tenth by chance",
        lambda h, s: 1e-2 + h**2 + {0.01: 3.0e-4, 0.005: -4e-5, 0.0025: 2.8e-4}.get(s, 0.0),
        M,
        "elsewhere",
        soft=True,
        profile=DEFAULT,
    ),
    Situation(
        "wrong at an instant already",
        lambda h, s: 1e-4 * s,
        M,
        "earlier layer",
        soft=True,
        earlier="instant: accelerations",
    ),
    Situation(
        "wrong in its masses, steps too coarse",
        lambda h, s: 1e-3 + 1e-3 * h,
        M,
        "earlier layer",
        order=2,
        earlier="model: total mass",
    ),
    Situation(
        "a plateau ten times above what the solver loses", lambda h, s: 1e-5 + h**4, M, "elsewhere", order=4, lost=9e-7
    ),
    Situation("no ladder, wrong", lambda h, s: 1e-6, M, "no ladder", order=None),
    Situation("wrong where gravity hardly acts", lambda h, s: 1e-3 + h**2, M, "elsewhere", effect=1e-9),
    Situation(
        "tolerances to another motion",
        lambda h, s: 1e-4 + 1e3 * h,
        M,
        "elsewhere",
        order=None,
        tolerances=True,
        steps=(1e-6, 1e-7, 1e-8),
    ),
    Situation(
        "order one, declared four, to another motion",
        lambda h, s: 0.1 + h,
        M,
        "earlier layer",
        order=4,
        earlier="instant: accelerations",
    ),
    Situation("velocities of another sign", lambda h, s: 1e-5 * h**2, M, "velocities", velocity=-1.0),
    Situation("velocities a little off", lambda h, s: 1e-5 * h**2, M, "velocities", velocity=1.0 + 1e-4),
    Situation("velocities off by no more than they may", lambda h, s: 1e-5 * h**2, A, "agreement", velocity=1.0 + 1e-6),
    Situation("velocities of order one", lambda h, s: 1e-5 * h**2, A, "agreement", velocity_slope=0.05),
    Situation(
        "velocities of order one, to a wrong limit",
        lambda h, s: 1e-5 * h**2,
        M,
        "velocities",
        velocity=1.0 + 1e-4,
        velocity_slope=0.05,
    ),
    Situation("levels met elsewhere", lambda h, s: 1e-3 + noise(1e-13)(h, s), M, "converged elsewhere", order=4),
    Situation(
        "levels met elsewhere, a little",
        lambda h, s: 1e-6 + 1e-5 * h**3,
        M,
        "converged elsewhere",
        order=1,
        steps=(0.02, 0.01, 0.005, 0.0025),
    ),
    # ---------------------------------------------------------------- unresolved
    Situation(
        "a plateau of what the solver loses", lambda h, s: 1e-5 + h**4, U, "inexact solver", order=4, lost=1.1e-6
    ),
    Situation("order one where four is declared", lambda h, s: 0.1 * h, U, "not asymptotic", order=4),
    Situation("order two where one is declared", lambda h, s: 5.0 * h**2, U, "not asymptotic", order=1),
    Situation("erratic steps", lambda h, s: 1e-2 * np.sin(1 / h), U, "not asymptotic"),
    Situation("steps far too coarse", lambda h, s: np.tanh(3e3 * h**2) * 0.5, U, "not asymptotic"),
    Situation("steps far too coarse, order by chance", lambda h, s: 30.0 * h, U, "wide band", order=1),
    Situation("an error that saturates late, beside one of the steps", saturated, U, "wide band", order=1),
    Situation("a model error of half the error of the steps", lambda h, s: 2.0 * h**2 + 2.5e-5, U, "wide band"),
    Situation("levels that agree, steps of a radian", lambda h, s: 1e-3, U, "unresolved rate", steps=(1.6, 0.8, 0.4)),
    Situation("agreement within what gravity changes", lambda h, s: 1e-9, U, "no power", effect=9e-8, digits=8),
    Situation("a band as wide as a tenth of gravity", lambda h, s: 5.0 * h**2, U, "no power", effect=1e-4),
    Situation(
        "a band that shows gravity and hides mass",
        lambda h, s: 5.0 * h**2,
        U,
        "no power",
        effect=1e-2,
        mass_effect=1e-5,
    ),
    Situation("mass acts below the digits asked", lambda h, s: 5.0 * h**2, D, "steps", effect=1e-2, mass_effect=9e-8),
    Situation("soft by more than gravity changes", lambda h, s: 0.1 * s, U, "no power", soft=True, effect=0.1),
    Situation(
        "an order not quite clean, a limit just beyond the band",
        lambda h, s: (h / 0.005) ** 2.07 * 1e-5 + 1.5e-5,
        U,
        "wide band",
    ),
    Situation("an uncertain reference", lambda h, s: 0.0, U, "uncertain reference", spread=1e-7),
    Situation("a disputed reference", lambda h, s: 1e-4, U, "disputed reference", dispute="published value"),
    Situation("another branch from a singular pose", lambda h, s: 1e-1, U, "singular pose", singular=0),
    Situation("wrong behind a singular pose alone", late(1.0, 0), A, "agreement", singular=20),
    Situation("wrong before a singular pose", lambda h, s: 1e-3 + 5 * h**2, M, "elsewhere", singular=40),
    Situation("chaotic from the start", lambda h, s: 1e-3, U, "horizon", growth=np.full(41, 1e9)),
    Situation(
        "soft and saturated, a fifth remains",
        lambda h, s: 0.4 + 2.0 * np.tanh(20.0 * s) * (s > 0.1) + s * (s < 0.1),
        U,
        "softness unclear",
        soft=True,
        profile=DEFAULT,
    ),
    Situation("soft without order", lambda h, s: 1e-3 * np.sin(9 * s) + h**2, U, "softness unclear", soft=True),
)
