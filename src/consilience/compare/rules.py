"""Rules of the verdicts on motions, in order: the first rule that holds decides.

The window of orders and the safety factors are in `uncertainty`, the share that softness must explain in `softness`,
the rounding error of the horizon in `horizon`; the case gives the digits asked. docs/verdicts.md repeats the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from consilience.compare.evidence import LOST, RESOLVED, Evidence
from consilience.compare.other_laws import COMPLIANCE, HARDER
from consilience.compare.power import LARGEST
from consilience.compare.result import Verdict

FASTER = 1e3
"""Largest ratio of the relative difference of velocities to that of poses: an oscillating error a thousand times faster
than the motion has this ratio."""

JUMP = 1e9
"""Angle in rad by which the direction of a spring turns in a step from which on it jumps."""

SCATTERS = "scatter elsewhere"
"""Name of the rule that motions whose levels scatter lead elsewhere."""

NO_POWER, BY_CHANCE, ELSEWHERE = "no power", "agreement by chance", "elsewhere"
"""Names of rules: a gross error would pass; errors of the steps and of the model cancel; another motion."""

WITHIN_PHASE = "impacts within steps"
"""Name of the rule that impacts at any phase of a step explain a difference."""

POWERLESS = f"an error of {100 * LARGEST:.0f} % in something that acts at the digits asked would pass"


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
        f"({e.softness.observed}): the engine's constraints are soft{_proof_text(e)}"
    )


def _proof_text(e: Evidence) -> str:
    """Say whether the reference with the law of soft contacts moves alike; nothing without contacts."""
    if not e.touching:
        return ""
    found = "" if math.isinf(e.off_soft) else f": {e.off_soft:.2g} from the reference with their law"
    return (
        f"; differs by {e.off_soft:.2g} from the reference's motion with their law"
        if e.softness_proved
        else f"; not proved by re-solving{found}"
    )


def _not_asymptotic_text(e: Evidence) -> str:
    if e.limit is None:
        return f"differs by {e.finest:.2g} at a single level{e.cut}"
    return f"observed order {e.observed}, declared {e.declared}: not asymptotic at these steps{e.cut}{_coprime_text(e)}"


def _coprime_text(e: Evidence) -> str:
    """Say where motions at coprime steps lead, and how far chance alone does; nothing without them."""
    if e.coprime is None:
        return ""
    found, limit = e.coprime, f"{e.coprime.limit:.2g} off with a standard error of {e.coprime.error:.2g}"
    other = ", steps or softness the rest" if found.limit > found.least and not found.elsewhere else ""
    return f"; {found.count} motions at coprime steps lead {limit}, chance by up to {found.least:.2g}{other}"


OTHER_LAWS = (
    ("cone shape", Verdict.MODEL, "the friction cone"),
    ("associated cone", Verdict.MODEL, "the convex law of friction"),
    (COMPLIANCE, Verdict.REGULARISATION, "the compliance"),
    ("impact law", Verdict.MODEL, "the law of impacts"),
    ("restitution threshold", Verdict.MODEL, "the threshold of rebounds"),
)
"""Causes of a motion under another law of contact (`engine.Method.law`): rule, verdict, and what differs."""


def _together_text(e: Evidence) -> str:
    """Return what the reference's motion depends on besides its law, if several contacts take part in one impact."""
    if e.together > e.judged:
        return ""
    return f" (several contacts take part in the impact at {e.together:.4g} s: after any gap another motion follows)"


def _hard_text(e: Evidence) -> str:
    """Say where the reference's motion with a compliance leads as it gets harder."""
    return f"; {HARDER:g} times as hard, that one differs by {e.off_hard:.2g} from the case's"


def _law_rule(cause: str, verdict: Verdict, what: str) -> Rule:
    """Return the rule for a motion under another law of contact."""
    return Rule(
        cause,
        verdict,
        f"the motion is not that of the case's law of contact, but that of {what} which the method solves",
        lambda e: e.law_cause == cause and e.explained_by_law,
        lambda e: (
            f"differs by {e.finest:.2g}, and by {e.off_law:.2g} from the reference's motion with {e.law}"
            f"{_hard_text(e) if cause == COMPLIANCE else ''}"
        ),
    )


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
        lambda e: e.unseen != "",
        lambda e: (
            f"an error of {100 * LARGEST:.0f} % in {e.unseen} would pass: differences up to {e.passes:.2g} do{e.until}"
        ),
    ),
    Rule(
        BY_CHANCE,
        Verdict.UNRESOLVED,
        "the finest level agrees, but the levels converge to a motion that is off by half more than is allowed",
        lambda e: e.by_chance,
        lambda e: f"the finest level differs by {e.finest:.2g}, asked {e.asked:.0e}, but {e.limit_text}{e.cut}",
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
        WITHIN_PHASE,
        Verdict.DISCRETISATION,
        "bodies hit one another, and the difference is within what impacts at any phase of a step can make",
        lambda e: e.within_phase,
        lambda e: (
            f"differs by {e.finest:.2g}, impacts within steps by up to {e.impact_passes:.2g}: smaller ones lead closer"
        ),
    ),
    *(_law_rule(*law) for law in OTHER_LAWS),
    Rule(
        "modes within steps",
        Verdict.DISCRETISATION,
        "contacts or frictions change their mode, and the difference is within what that makes at any phase of a step",
        lambda e: e.within_jumps,
        lambda e: (
            f"differs by {e.finest:.2g}, changes of mode within steps by up to {e.jumps:.2g}: smaller ones lead closer"
        ),
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
        "impacts elsewhere",
        Verdict.MODEL,
        "bodies hit one another, and the difference is beyond twice what impacts at any phase of a step can make",
        lambda e: e.beyond_phase,
        lambda e: (
            f"differs by {e.finest:.2g}, impacts within steps by up to {e.impact_bound:.2g}: they lead elsewhere"
            f"{_together_text(e)}"
        ),
    ),
    Rule(
        SCATTERS,
        Verdict.MODEL,
        "levels in contact scatter, and neither chance nor a power of the step explains the limit of coprime steps",
        lambda e: e.scatters_elsewhere,
        lambda e: f"differs by {e.finest:.2g}, levels scatter{_coprime_text(e)}: elsewhere",
    ),
    Rule(
        "impacts unclear",
        Verdict.UNRESOLVED,
        "bodies hit one another, and the levels scatter, or end too near to what the phase of impacts can make",
        lambda e: e.impacts and not (e.limit is None and not e.cut),
        lambda e: (
            f"differs by {e.finest:.2g}; bodies hit one another at any phase of a step, and the levels differ too much"
            f"{_together_text(e)}{_coprime_text(e)}"
        ),
    ),
    Rule(
        "inexact solver",
        Verdict.UNRESOLVED,
        "the engine's own terms agree at `instant`, and its solver loses a tenth of the difference there or more",
        lambda e: e.finest <= LOST * e.lost,
        lambda e: f"differs by {e.finest:.2g}; at instants its solver loses {e.lost:.2g} and its terms agree",
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
        lambda e: e.met_elsewhere,
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
        lambda e: (
            f"differs by {e.finest:.2g}, {e.limit_text}: too coarse to tell steps from model{e.cut}{_coprime_text(e)}"
        ),
    ),
    Rule(
        ELSEWHERE,
        Verdict.MODEL,
        "anything else: the levels converge cleanly to another motion",
        lambda _: True,
        lambda e: f"{e.limit_text}: smaller steps lead elsewhere",
    ),
)


CONVERGENCE = frozenset({"no ladder", "converged elsewhere", "impacts elsewhere", SCATTERS, ELSEWHERE})
"""Rules that blame the model because neither steps nor softness explain a difference."""

INSTANT_RULES: dict[str, str] = {
    "contact solver": "a contact, stop or dry friction acts, and what is missed is within the bars of contacts "
    "that push",
    "solver": "the engine's own terms agree; its solver misses the bar by two digits or the condition's, "
    "an extrapolation by four",
    "tuning": "a wide bar passes a tuned method that is ten times worse than the engine's own settings",
}
"""Condition in words of the rules by which an instant is unresolved (`instant`, `other_methods`)."""


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
