"""Rules of the verdicts on motions, in order: the first rule that holds decides.

The window of orders and the safety factors are in `uncertainty`, the share that softness must explain in `softness`,
the rounding error of the horizon in `horizon`; the case gives the digits asked. docs/verdicts.md repeats the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from consilience.compare.power import LARGEST
from consilience.compare.result import Verdict
from consilience.compare.softness import EXPLAINED, Softness
from consilience.compare.uncertainty import CAUTIOUS, ROUNDING, SAFE

FASTER = 1e3
"""Largest ratio of the relative difference of velocities to that of poses: an oscillating error a thousand times faster
than the motion has this ratio."""

LINEAR = 0.25
"""Largest difference of the levels that show an order, as a share of the most that motions can differ: an eighth of a
turn, up to which a chord is in proportion to its angle within 3 %."""

SATURATED = 1.0
"""Largest difference in proportion to its cause, in sizes of the motion or rad; of a larger one softness has to explain
as much as of this."""

CLEAN = 0.05
"""Largest distance of the observed order from the declared one of levels that converge cleanly. Other levels need the
safety factor of doubtful ones to blame a model."""

JUMP = 1e9
"""Angle in rad by which the direction of a spring turns in a step from which on it jumps."""

RESOLVED = 1.0
"""Largest angle in rad by which the fastest mode may turn in a step: six steps in a period."""

NO_POWER = "no power"
"""Name of the rule for comparisons that would have passed anything."""

POWERLESS = f"an error of {100 * LARGEST:.0f} % in anything that acts would pass"


@dataclass(frozen=True)
class Evidence:
    """Numbers by which a motion is judged; differences are to the reference, up to the horizon.

    Attributes
    ----------
    asked : float
        ``10^-digits`` of the case.
    judged, duration : float, s
        Time up to the horizon, and duration of the motion.
    reference : float
        Uncertainty of the reference.
    dispute : str
        Published value that contradicts the reference beyond both uncertainties; empty if none does.
    finest : float
        Difference of the finest level.
    limit, band : float or None
        Difference of the Richardson limit, and the uncertainty of the finest level; None without a ladder.
    remains : float
        Difference of the limit at the declared or the observed order, whichever is nearer to the reference.
    saturation : float
        Largest difference of the levels that show the order, as a share of the most that motions can differ.
    spread : float
        Largest difference of consecutive levels among the finest three that follow a fourth, or of levels that differ
        by rounding; infinite otherwise.
    order : float or None
        Order observed among the levels.
    declared : int or None
    asymptotic : bool
        Whether the levels converge with the declared order.
    softness : Softness or None
        None if the engine's constraints are hard.
    hard_limit : float
        Difference of the limit without softness and without steps; infinite if unknown.
    step, rate, turning : float, s and rad/s
        Finest step, zero for tolerances; fastest rate of the case; fastest turning of a spring's direction.
    cut : str
        Why no finer level was asked, in words; empty if the number of levels ended the ladder.
    singular : bool
        Whether judging ends at a singular pose.
    earlier : str
        Difference of the same engine at `model` or `instant`, in words; empty if there is none.
    velocities : float
        Relative difference of the velocities: of the finest level, or of the limit at order one if smaller, because a
        method may have a lower order in velocities than in poses.
    effect : float or None
        Largest change of the reference for an error of a parameter, over the error; None if no parameter is known to
        act.
    """

    asked: float
    judged: float
    duration: float
    reference: float
    finest: float
    dispute: str = ""
    limit: float | None = None
    band: float | None = None
    order: float | None = None
    declared: int | None = None
    asymptotic: bool = False
    softness: Softness | None = None
    earlier: str = ""
    velocities: float = 0.0
    remains: float = math.inf
    saturation: float = 0.0
    spread: float = math.inf
    hard_limit: float = math.inf
    step: float = 0.0
    rate: float = 0.0
    turning: float = 0.0
    cut: str = ""
    effect: float | None = None
    singular: bool = False

    @property
    def allowed(self) -> float:
        """Largest difference that counts as agreement."""
        return self.asked + self.reference

    @property
    def largest_limit(self) -> float:
        """Largest difference of a limit that passes: within the band, and no more than a quarter of the difference."""
        assert self.band is not None
        return max(min(self.band + self.reference, EXPLAINED * self.finest), self.allowed)

    @property
    def converges_here(self) -> bool:
        """Whether levels far from saturation converge to the reference, and their limit explains the difference."""
        if not self.asymptotic or self.limit is None or self.band is None or self.saturation > LINEAR:
            return False
        return self.limit <= max(self.band + self.reference, self.allowed) and self.remains <= self.largest_limit

    @property
    def converges_elsewhere(self) -> bool:
        """Whether the limit of clean levels is beyond the band; of others, beyond the band of a doubtful ladder."""
        if not self.asymptotic or self.limit is None or self.band is None or self.saturation > LINEAR:
            return False
        clean = self.order is not None and self.declared is not None and abs(self.order - self.declared) <= CLEAN
        return self.limit > (1.0 if clean else CAUTIOUS / SAFE) * self.band + self.allowed

    @property
    def unresolved_rate(self) -> float:
        """Rate that the finest step does not resolve, rad/s; zero if all are resolved.

        Levels that converge with the declared order need not resolve a mode that has decayed; a spring whose direction
        jumps within a step spoils any order.
        """
        rate = max(self.turning, 0.0 if self.asymptotic else self.rate)
        return rate if self.step * rate > RESOLVED or self.damps(rate) else 0.0

    def damps(self, rate: float) -> bool:
        """Whether levels agree to rounding where errors ``(h w)^p`` a radian end a vibration within the motion."""
        within = self.declared is not None and self.spread <= ROUNDING
        return within and (self.step * rate) ** (self.declared or 1) * rate * self.judged > 1.0

    @property
    def softness_explains(self) -> bool:
        """Whether the difference goes away with the softness of the engine."""
        soft = self.softness
        if soft is None or not soft.matters(self.finest):
            return False
        return soft.explains(min(self.finest, SATURATED), self.allowed, self.hard_limit)

    @property
    def passes(self) -> float:
        """Largest difference of another model that would be passed over."""
        if self.finest <= self.allowed:
            return self.allowed
        if self.converges_here:
            return self.largest_limit
        return max(self.allowed, EXPLAINED * min(self.finest, SATURATED)) if self.softness_explains else self.allowed

    @property
    def powerless(self) -> bool:
        """Whether the largest error of any parameter that acts would be passed over."""
        passed = self.finest <= self.allowed or self.converges_here or (not self.earlier and self.softness_explains)
        return passed and self.effect is not None and self.effect * LARGEST <= self.passes

    @property
    def observed(self) -> str:
        """Observed order, in words."""
        return "hidden by rounding" if self.order is None else f"{self.order:.2f}"

    @property
    def until(self) -> str:
        """Horizon in words; empty if the motion is judged to its end."""
        return "" if self.judged >= self.duration else f" up to the horizon at {self.judged:.3g} s"

    @property
    def limit_text(self) -> str:
        """Limit, band and order, in words."""
        assert self.limit is not None
        assert self.band is not None
        return f"the limit differs by {self.limit:.2g}, band {self.band:.2g}, order {self.observed}"


@dataclass(frozen=True)
class Rule:
    """A rule: condition, verdict, and words for the reader.

    Attributes
    ----------
    name : str
    verdict : Verdict
    when : str
        Condition in words, as in docs/verdicts.md.
    holds : callable
    why : callable
        Function that describes the decision in numbers.
    final : bool
        Whether finer steps and other softness cannot change the verdict, so that none need be asked.
    """

    name: str
    verdict: Verdict
    when: str
    holds: Callable[[Evidence], bool]
    why: Callable[[Evidence], str]
    final: bool = False


def _softness_text(e: Evidence) -> str:
    assert e.softness is not None
    left = min(e.softness.limit, e.hard_limit)
    return (
        f"differs by {e.finest:.2g}, by {left:.2g} without softness{' and steps' if left < e.softness.limit else ''} "
        f"(order {e.softness.order:.2f} in it): the engine's constraints are soft"
    )


def _not_asymptotic_text(e: Evidence) -> str:
    if e.limit is None:
        return f"differs by {e.finest:.2g} at a single level{e.cut}"
    return f"observed order {e.observed}, declared {e.declared}: not asymptotic at these steps{e.cut}"


RULES: tuple[Rule, ...] = (
    Rule(
        "singular pose",
        Verdict.UNRESOLVED,
        "it differs, and the motion is at a singular pose before the second sample",
        lambda e: e.singular and e.judged <= 0.0,
        lambda e: "the motion starts at a singular pose, where the constraints do not determine how it goes on",
        final=True,
    ),
    Rule(
        "horizon",
        Verdict.UNRESOLVED,
        "one rounding error reaches the digits asked before the first sample",
        lambda e: e.judged <= 0.0,
        lambda e: f"one rounding error reaches {e.asked:.0e} before the first sample: nothing can be judged",
        final=True,
    ),
    Rule(
        "uncertain reference",
        Verdict.UNRESOLVED,
        "the uncertainty of the reference is above 10^-digits",
        lambda e: not e.reference <= e.asked,
        lambda e: f"the reference itself is only certain to {e.reference:.2g}, asked {e.asked:.0e}",
        final=True,
    ),
    Rule(
        "disputed reference",
        Verdict.UNRESOLVED,
        "a closed form or published value contradicts the reference beyond both uncertainties",
        lambda e: bool(e.dispute),
        lambda e: f"the reference is disputed: {e.dispute}",
        final=True,
    ),
    Rule(
        "velocities",
        Verdict.MODEL,
        "poses agree, and velocities differ by more than a thousand times what is allowed",
        lambda e: e.finest <= e.allowed and not e.velocities <= FASTER * e.allowed,
        lambda e: f"poses differ by {e.finest:.2g} and velocities by {e.velocities:.2g}: they are not of one motion",
    ),
    Rule(
        NO_POWER,
        Verdict.UNRESOLVED,
        POWERLESS,
        lambda e: e.powerless,
        lambda e: f"{POWERLESS}: differences up to {e.passes:.2g} do{e.until}",
    ),
    Rule(
        "agreement",
        Verdict.AGREES,
        "the finest level differs by no more than 10^-digits and the uncertainty of the reference",
        lambda e: e.finest <= e.allowed,
        lambda e: f"the finest level differs by {e.finest:.2g}, asked {e.asked:.0e}{e.until}",
        final=True,
    ),
    Rule(
        "steps",
        Verdict.DISCRETISATION,
        "the levels converge with the declared order, and their limit explains the difference within the band",
        lambda e: e.converges_here,
        lambda e: f"{e.limit_text}: smaller steps lead to the reference{e.until}",
        final=True,
    ),
    Rule(
        "earlier layer",
        Verdict.MODEL,
        "the engine already differs at `model` or `instant`, where nothing is integrated",
        lambda e: bool(e.earlier),
        lambda e: f"differs by {e.finest:.2g}, as the engine already does without integrating: {e.earlier}",
    ),
    Rule(
        "softness",
        Verdict.REGULARISATION,
        "the difference goes away with the engine's own softness",
        lambda e: e.softness_explains,
        _softness_text,
    ),
    Rule(
        "softness unclear",
        Verdict.UNRESOLVED,
        "softness moves the answer by as much, but not to a limit at the reference",
        lambda e: e.softness is not None and e.softness.matters(e.finest),
        lambda e: f"differs by {e.finest:.2g}, and softness moves it without settling: harder constraints are needed",
    ),
    Rule(
        "no ladder",
        Verdict.MODEL,
        "there is no ladder of steps or tolerances that could explain the difference",
        lambda e: e.limit is None and not e.cut,
        lambda e: f"the finest level differs by {e.finest:.2g}, asked {e.asked:.0e}; no order to read",
    ),
    Rule(
        "unresolved rate",
        Verdict.UNRESOLVED,
        "the finest step does not resolve the fastest rate or damps it away, or a spring passes its anchor",
        lambda e: e.unresolved_rate > 0.0,
        lambda e: f"differs by {e.finest:.2g}, and {rate_text(e.step, e.unresolved_rate)}",
    ),
    Rule(
        "converged elsewhere",
        Verdict.MODEL,
        "levels without a clear order differ by less from one another than by a third from the reference",
        lambda e: not e.asymptotic and e.finest > max(CAUTIOUS * e.spread + e.allowed, ROUNDING),
        lambda e: f"differs by {e.finest:.2g}, levels by {e.spread:.2g}, order {e.observed}: they have met elsewhere",
    ),
    Rule(
        "not asymptotic",
        Verdict.UNRESOLVED,
        "the observed order is more than 0.5 off the declared one",
        lambda e: not e.asymptotic,
        _not_asymptotic_text,
    ),
    Rule(
        "wide band",
        Verdict.UNRESOLVED,
        "the limit explains too little of the difference, or the levels differ by a quarter of what motions can",
        lambda e: not e.converges_elsewhere,
        lambda e: f"differs by {e.finest:.2g}, {e.limit_text}: too coarse to tell steps from model{e.cut}",
    ),
    Rule(
        "elsewhere",
        Verdict.MODEL,
        "anything else: the levels converge cleanly to another motion",
        lambda _: True,
        lambda e: f"{e.limit_text}: smaller steps lead elsewhere",
    ),
)


CONVERGENCE = frozenset({"no ladder", "converged elsewhere", "elsewhere"})
"""Rules that blame the model because neither steps nor softness explain a difference."""

INSTANT_RULES: dict[str, str] = {
    "solver": "the engine's own terms agree; its solver misses the bar by two digits at most, an extrapolation by four",
    "tuning": "a wide bar passes a tuned method that is ten times worse than the engine's own settings",
}
"""Condition in words of the rules by which an instant is unresolved (`other_methods`)."""


def rate_text(step: float, rate: float) -> str:
    """Say which step resolves a rate; nothing resolves a jump."""
    if step * rate > JUMP:
        return "a spring passes its anchor, where its force jumps: no step resolves that"
    if step * rate <= RESOLVED:
        return f"levels do not depend on the step: at {step:.2g} s a vibration of {rate:.2g} 1/s is damped away"
    return f"a step of {step:.2g} s does not resolve the rate of {rate:.2g} 1/s: {RESOLVED / rate:.1g} s or less would"


def decide(evidence: Evidence) -> tuple[Rule, str]:
    """Return the first rule that holds, and its decision in numbers."""
    rule = next(rule for rule in RULES if rule.holds(evidence))
    return rule, rule.why(evidence)
