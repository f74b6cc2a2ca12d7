"""The rules of the verdicts on motions, in the order in which they are asked: the first that holds decides.

One table, and the numbers it rests on in one place each: the window of orders and the safety factors in `uncertainty`,
what softness must explain in `softness`, the rounding error of the horizon in `horizon`; the digits asked are the
case's. docs/verdicts.md repeats the table for readers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from consilience.compare.result import Verdict
from consilience.compare.softness import Softness
from consilience.compare.uncertainty import ROUNDING

FASTER = 1e3
"""How much larger the relative difference of velocities may be than that of poses: an error that swings a thousand
times faster than the motion would show so."""


@dataclass(frozen=True)
class Evidence:
    """What is known when a motion is judged; differences are to the reference, up to the horizon.

    Attributes
    ----------
    asked : float
        ``10^-digits`` of the case.
    judged, duration : float, s
        Time up to the horizon, and of the motion.
    reference : float
        Uncertainty of the reference.
    dispute : str
        What contradicts the reference beyond both uncertainties, empty if nothing does.
    finest : float
        Difference of the finest level.
    limit, band : float or None
        Difference of the Richardson limit, and the uncertainty of the finest level; None without a ladder.
    order : float or None
        Observed among the levels.
    declared : int or None
    asymptotic : bool
        Whether the levels converge with the declared order.
    softness : Softness or None
        None where the engine's constraints are hard.
    earlier : str
        What the same engine already differs in at `model` or `instant`, empty if nothing.
    velocities : float
        Difference of the velocities, relative to the largest: of the finest level, or of their limit at order one, as a
        method may be of lower order in them than in poses.
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
        """Difference that is as good as none."""
        return self.asked + self.reference

    @property
    def converges_here(self) -> bool:
        """Whether smaller steps lead to the reference, as far as the band can tell."""
        if self.limit is None or self.band is None:
            return False
        return self.asymptotic and self.limit <= self.band + self.reference

    @property
    def observed(self) -> str:
        """The observed order in words."""
        return "hidden by rounding" if self.order is None else f"{self.order:.2f}"

    @property
    def until(self) -> str:
        """Up to when, where that is not the end."""
        return "" if self.judged >= self.duration else f" up to the horizon at {self.judged:.3g} s"

    @property
    def limit_text(self) -> str:
        """Limit, band and order in words."""
        assert self.limit is not None
        assert self.band is not None
        return f"the limit differs by {self.limit:.2g}, band {self.band:.2g}, order {self.observed}"


@dataclass(frozen=True)
class Rule:
    """One row of the table.

    Attributes
    ----------
    name : str
    verdict : Verdict
    when : str
        The condition in words, as in docs/verdicts.md.
    holds : callable
    why : callable
        The decision in numbers.
    final : bool
        Whether it holds whatever else the engine is asked: no finer step and no other softness would be heard.
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
    """First rule that holds, and the decision in numbers."""
    rule = next(rule for rule in RULES if rule.holds(evidence))
    return rule, rule.why(evidence)
