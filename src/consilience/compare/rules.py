"""Rules of the verdicts on motions, in order: the first rule that holds decides.

The window of orders and the safety factors are in `uncertainty`, the share that softness must explain in `softness`,
the rounding error of the horizon in `horizon`; the case gives the digits asked. docs/verdicts.md repeats the table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from consilience.compare.result import Verdict
from consilience.compare.softness import Softness
from consilience.compare.uncertainty import ROUNDING

FASTER = 1e3
"""Largest ratio of the relative difference of velocities to that of poses: an oscillating error a thousand times faster
than the motion has this ratio."""


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
    order : float or None
        Order observed among the levels.
    declared : int or None
    asymptotic : bool
        Whether the levels converge with the declared order.
    softness : Softness or None
        None if the engine's constraints are hard.
    earlier : str
        Difference of the same engine at `model` or `instant`, in words; empty if there is none.
    velocities : float
        Relative difference of the velocities: of the finest level, or of the limit at order one if smaller, because a
        method may have a lower order in velocities than in poses.
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

    @property
    def allowed(self) -> float:
        """Largest difference that counts as agreement."""
        return self.asked + self.reference

    @property
    def converges_here(self) -> bool:
        """Whether the levels converge to the reference within the band."""
        if self.limit is None or self.band is None:
            return False
        return self.asymptotic and self.limit <= self.band + self.reference

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


def _moves_with_softness(e: Evidence) -> bool:
    return e.softness is not None and e.softness.matters(e.finest) and e.softness.explains(e.finest, e.allowed)


def _softness_text(e: Evidence) -> str:
    assert e.softness is not None
    return (
        f"differs by {e.finest:.2g}, by {e.softness.limit:.2g} without softness "
        f"(order {e.softness.order:.2f} in it): the engine's constraints are soft"
    )


RULES: tuple[Rule, ...] = (
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
        "the levels converge with the declared order, to the reference within the band",
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
        _moves_with_softness,
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
        lambda e: e.limit is None,
        lambda e: f"the finest level differs by {e.finest:.2g}, asked {e.asked:.0e}; no order to read",
    ),
    Rule(
        "converged elsewhere",
        Verdict.MODEL,
        "levels without a clear order have come closer to one another than to the reference, threefold band and all",
        lambda e: not e.asymptotic and e.band is not None and e.finest > max(e.band + e.allowed, ROUNDING),
        lambda e: f"differs by {e.finest:.2g}, band {e.band:.2g}, order {e.observed}: the levels have met elsewhere",
    ),
    Rule(
        "not asymptotic",
        Verdict.UNRESOLVED,
        "the observed order is more than 0.5 off the declared one",
        lambda e: not e.asymptotic,
        lambda e: f"observed order {e.observed}, declared {e.declared}: not asymptotic at these steps",
    ),
    Rule(
        "elsewhere",
        Verdict.MODEL,
        "anything else: the levels converge cleanly to another motion",
        lambda _: True,
        lambda e: f"{e.limit_text}: smaller steps lead elsewhere",
    ),
)


def decide(evidence: Evidence) -> tuple[Rule, str]:
    """Return the first rule that holds, and its decision in numbers."""
    rule = next(rule for rule in RULES if rule.holds(evidence))
    return rule, rule.why(evidence)
