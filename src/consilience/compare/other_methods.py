"""Comparisons of an engine's methods at an instant, in the light of one another.

A method misses its bar by the solver where the engine's own terms (mass matrix, bias forces, Jacobians), solved by the
harness, agree at the same states: then the equations are those of the case, and what is lost is lost in their
solution, or in an extrapolation that is not asymptotic. This is believed of few digits (`SOLVER`, `EXTRAPOLATION`),
since an iterative solver stops early and an ignored constraint shows in the first digits. Of ill-conditioned equations
it is believed of as many digits again as their condition takes: a normal matrix squares a condition number.

A bar that grows with the condition of the equations may let a tuned method pass that is worse than the engine's own
settings: such tuning is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from consilience.compare.instant import SOFTENED
from consilience.compare.instants import BARS, Bars
from consilience.compare.result import Comparison, Quantity, Verdict
from consilience.engine import Profile, Question, Route

SOLVER, EXTRAPOLATION = 1e2, 1e4
"""Largest ratio of a difference to its bar that a solver, or an extrapolation, explains: of 1e-11 and 1e-8 for
well-conditioned equations, so that nine and four digits have to be right."""

SOLVER_RULE, TUNING_RULE = "solver", "tuning"
"""Names of the rules (`rules.INSTANT_RULES`)."""

WORSE = 10.0
"""Smallest ratio of the difference of a tuned method to that of the engine's own settings that counts as worse."""


def reconsidered(found: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons with those of instants settled by the other methods of the same engine.

    Parameters
    ----------
    found : sequence of Comparison
        Comparisons of one case, of all engines and questions.
    """
    instants = [c for c in found if c.question is Question.INSTANT]
    return [_settled(c, [o for o in instants if o.engine == c.engine and o is not c]) for c in found]


def _settled(one: Comparison, others: Sequence[Comparison]) -> Comparison:
    """Return a comparison, unresolved where the solver or the tuning is to blame."""
    terms = [o for o in others if o.route is Route.HARNESS_SOLVE and o.verdict is Verdict.AGREES]
    if terms and one.question is Question.INSTANT and _by_the_solver(one):
        part = "its extrapolation" if one.route is Route.EXTRAPOLATED else "its solver"
        why = f"{one.why}; the engine's own terms ({terms[0].method}) agree to {terms[0].digits:.1f} digits: {part}"
        return replace(one, verdict=Verdict.UNRESOLVED, rule=SOLVER_RULE, why=why)
    own = [(a.difference, o.method) for o in others if o.profile is Profile.DEFAULT for a in _accelerations(o)]
    for mine in _accelerations(one):
        least, name = min(own, default=(float("inf"), ""))
        if one.verdict is Verdict.AGREES and one.profile is Profile.MATCHED and _worse(one, mine, least):
            why = f"{one.why}; by its own settings ({name}) the engine differs by {least:.2g}: tuning makes it worse"
            return replace(one, verdict=Verdict.UNRESOLVED, rule=TUNING_RULE, why=why)
    return one


def lost_by_solver(settled: Sequence[Comparison], engine: str, profile: Profile) -> float:
    """Return the largest difference of accelerations that an engine's solver loses at the states; zero if none.

    Within a bar that grows with the condition of the equations a solver loses what is beyond the bar of
    well-conditioned ones, where the engine's own terms have a digit more.

    Parameters
    ----------
    settled : sequence of Comparison
        Of all engines, after `reconsidered`.
    engine : str
    profile : Profile
        Of the settings: what is lost with others, or in an extrapolation, tells nothing about a motion with these.
    """
    right = [c for c in settled if c.engine == engine and c.verdict is Verdict.AGREES]
    terms = [q.difference for c in right if c.route is Route.HARNESS_SOLVE for q in _accelerations(c)]
    least = max(WORSE * min(terms, default=float("inf")), Bars().acceleration)
    own = [c for c in settled if (c.engine, c.profile) == (engine, profile) and c.route is not Route.EXTRAPOLATED]
    missed = [q.difference for c in own if c.rule == SOLVER_RULE for q in _accelerations(c)]
    agreeing = [c for c in own if c.verdict is Verdict.AGREES and c.route is not Route.HARNESS_SOLVE]
    within = [q.difference for c in agreeing for q in _accelerations(c) if q.difference > least]
    return max([*missed, *within], default=0.0)


def _by_the_solver(one: Comparison) -> bool:
    """Whether the quantities that miss their bars miss them by what a solver, or an extrapolation, explains."""
    missed = [q for q in one.quantities if not q.met]
    return one.verdict is Verdict.MODEL and all(
        q.name in SOFTENED and q.difference <= _explained(one, q) for q in missed
    )


def _explained(one: Comparison, quantity: Quantity) -> float:
    """Return the largest difference that a solver, or an extrapolation, explains."""
    if one.route is Route.EXTRAPOLATED:
        return EXTRAPOLATION * quantity.bar
    usual = Bars()
    condition = quantity.bar / (usual.acceleration if quantity.name == "accelerations" else usual.reaction)
    return max(SOLVER, condition) * quantity.bar


def _worse(one: Comparison, mine: Quantity, least: float) -> bool:
    """Whether a tuned method is worse than an untuned one, and beyond the bar of well-conditioned equations."""
    tuned = one.route in (Route.TUNED, Route.EXTRAPOLATED)
    bar = (BARS.get(one.route) if one.route else None) or Bars()
    return tuned and mine.difference > max(WORSE * least, bar.acceleration)


def _accelerations(one: Comparison) -> list[Quantity]:
    return [q for q in one.quantities if q.name == "accelerations"] if one.question is Question.INSTANT else []
