"""Evidence of a motion: the numbers by which the rules of the verdicts decide, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from consilience.compare.coprime_steps import CoprimeLimit
from consilience.compare.other_laws import COMPLIANCE
from consilience.compare.power import LARGEST
from consilience.compare.softness import EXPLAINED, Softness
from consilience.compare.uncertainty import CAUTIOUS, ROUNDING, SAFE

LINEAR = 0.25
"""Largest difference of the levels that show an order, as a share of the most that motions can differ: an eighth of a
turn, up to which a chord is in proportion to its angle within 3 %."""

SATURATED = 1.0
"""Largest difference in proportion to its cause, in sizes of the motion or rad; of a larger one softness has to explain
as much as of this."""

CLEAN = 0.05
"""Largest distance of the observed order from the declared one of levels that converge cleanly. Other levels need the
safety factor of doubtful ones to blame a model."""

RESOLVED = 1.0
"""Largest angle in rad by which the fastest mode may turn in a step: six steps in a period."""

LOST = 10.0
"""Largest ratio of the difference of a motion to that of accelerations which an engine's solver loses at the states of
`instant`: along a motion the equations may be worse conditioned by as much."""

CANCELLED = 4.0
"""Largest difference of the steps, over what is allowed, that twice or three times what passes may cancel."""

CHANCE = 1.5
"""Least difference of the limit, over what is allowed, of levels whose finest agrees by chance: the difference of the
steps cancels that of a model."""

OTHER_LAW = 0.05
"""Largest difference to the motion under another law of contact, over that to the motion under the case's law, that
leaves no doubt which law was solved."""


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
    lost : float
        Largest relative difference of accelerations at `instant` that the engine's solver loses, its own terms being
        right (`other_methods`); zero if it loses none.
    impacts : bool
        Whether bodies hit one another before the horizon: where in a step is a matter of chance.
    together : float, s
        Time of the first impact in which several contacts take part; infinite if there is none.
    envelope : float or None
        Largest error of the finest level if errors are below a multiple of the step, see `uncertainty.envelope`; None
        where the levels do not shrink with the step.
    settled : float
        Difference of the limit along which levels draw together (`uncertainty.off_where_closing`); infinite if unknown.
    uneven : float
        Last change of positions or of orientations that show another order than the declared one, where modes change.
    scatter : float
        The larger of envelope and band where the levels are too many to share a late impact by chance; infinite
        otherwise.
    phase : float
        Largest displacement by impacts that come up to a step early or late: twice the largest rate of the motion times
        the finest step and the number of impacts. Levels of halved steps share their grid, so that an envelope alone
        may be blind to the phase.
    jumps : float
        Largest displacement by jumps of the acceleration, where contacts or frictions change their mode, a step early
        or late, growing with the time since contacts opened or slips reversed; of an order that does not follow from
        levels of smooth motions.
    untried : bool
        Whether the engine has a softness that was not varied.
    law, law_cause : str
        Law of contact that the method solves in place of the case's, in words, and what it changes; empty if it is the
        case's, or the reference has no motion under it.
    off_law : float
        Difference of the finest level to the reference's motion under that law.
    law_apart : float
        Difference of the reference's motion under that law to the case's.
    off_hard : float
        Difference of the reference's motion under that law to the case's, its compliance far harder: what is soft leads
        to the case. Zero of laws without a compliance, infinite if unknown.
    touching : bool
        Whether the case has contacts.
    off_soft : float
        Difference of the finest level, or of the limit of the steps if smaller, to the reference's motion under the law
        of soft contacts that the method solves; infinite if the reference has none.
    coprime : CoprimeLimit or None
        Limit of motions at coprime steps; None where none were asked for.
    velocities : float
        Relative difference of the velocities: of the finest level, or of the limit at order one if smaller, because a
        method may have a lower order in velocities than in poses.
    effects : mapping of str to float
        Changes of the reference for an error of a parameter, over the error, by the parameter in words; empty if no
        parameter is known to act.
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
    lost: float = 0.0
    velocities: float = 0.0
    remains: float = math.inf
    saturation: float = 0.0
    spread: float = math.inf
    hard_limit: float = math.inf
    step: float = 0.0
    rate: float = 0.0
    turning: float = 0.0
    cut: str = ""
    effects: Mapping[str, float] = field(default_factory=dict)
    singular: bool = False
    impacts: bool = False
    together: float = math.inf
    envelope: float | None = None
    scatter: float = math.inf
    settled: float = math.inf
    uneven: float = 0.0
    phase: float = 0.0
    jumps: float = 0.0
    untried: bool = False
    law: str = ""
    law_cause: str = ""
    off_law: float = math.inf
    law_apart: float = 0.0
    off_hard: float = 0.0
    touching: bool = False
    off_soft: float = math.inf
    coprime: CoprimeLimit | None = None

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
        if self.impacts or not self.asymptotic or self.limit is None or self.band is None or self.saturation > LINEAR:
            return False
        return self.limit <= max(self.band + self.reference, self.allowed) and self.remains <= self.largest_limit

    @property
    def converges_elsewhere(self) -> bool:
        """Whether the limit of clean levels is beyond the band; of others, or if cut short, far beyond it.

        Levels that part further with smaller steps have no limit, and an order that positions or orientations alone
        show may be by chance.
        """
        if not self.asymptotic or self.limit is None or self.band is None or self.saturation > LINEAR:
            return False
        if min(self.limit, self.settled) <= CAUTIOUS * self.uneven:
            return False
        beyond = min(self.limit, self.settled) > self.band + self.jumps + self.allowed
        return beyond and ((self.clean and not self.cut) or not self.just_beyond)

    @property
    def just_beyond(self) -> bool:
        """Whether the limit is within the band of a doubtful ladder: bands miss, if seldom."""
        assert self.limit is not None
        doubtful = CAUTIOUS / SAFE * (self.band or 0.0) + self.jumps + self.allowed
        return min(self.limit, self.settled) <= doubtful

    @property
    def met_elsewhere(self) -> bool:
        """Whether levels without a clear order differ less from one another than by a third from the reference."""
        least = max(CAUTIOUS * self.spread + self.allowed, ROUNDING)
        return not self.asymptotic and min(self.finest, self.settled) > least

    @property
    def by_chance(self) -> bool:
        """Whether the finest level agrees while levels that converge lead to a motion that does not."""
        agrees = self.finest <= self.allowed and self.asymptotic and self.saturation <= LINEAR
        return agrees and not self.impacts and not self.jumps and CHANCE * self.allowed < self.remains < math.inf

    @property
    def clean(self) -> bool:
        """Whether the levels converge cleanly, with the declared order."""
        return self.order is not None and self.declared is not None and abs(self.order - self.declared) <= CLEAN

    @property
    def impact_bound(self) -> float:
        """Largest difference that impacts at any phase of a step can make."""
        return max(self.envelope or 0.0, self.phase)

    @property
    def within_phase(self) -> bool:
        """Whether impacts at any phase of a step explain the difference, by levels far from saturation.

        A method that solves a law of which the motion is as far from the case's does not lead there.
        """
        leads_closer = self.impacts and self.saturation <= LINEAR and 2.0 * self.law_apart <= self.finest
        return leads_closer and self.finest <= self.impact_bound + self.allowed

    @property
    def by_scatter(self) -> bool:
        """Whether the scatter of the levels explains the difference, and the bound of phases alone has no power.

        With one late step for each impact that bound hides gross errors where many impacts follow one another. Then no
        difference beyond the scatter is excused.
        """
        scatter, bound = self.scatter + self.allowed, self.impact_bound + self.allowed
        return self.within_phase and self.finest <= scatter < bound and self._hidden(bound) != ""

    @property
    def impact_passes(self) -> float:
        """Largest difference that impacts within steps excuse."""
        return (self.scatter if self.by_scatter else self.impact_bound) + self.allowed

    @property
    def within_jumps(self) -> bool:
        """Whether changes of mode at any phase of a step explain the difference, by levels far from saturation.

        Levels that converge cleanly to another motion show no phases.
        """
        elsewhere = self.clean and self.limit is not None and self.limit > (self.band or 0.0) + self.allowed
        within = 0.0 < self.finest - self.allowed <= self.jumps and self.saturation <= LINEAR
        return within and not self.impacts and not elsewhere

    @property
    def beyond_phase(self) -> bool:
        """Whether neither the phase of impacts in a step nor softness can explain the difference."""
        settled = self.impacts and self.envelope is not None and not self.untried
        return settled and self.finest > 2.0 * self.impact_bound + self.allowed

    @property
    def scatters_elsewhere(self) -> bool:
        """Whether motions at coprime steps lead elsewhere, far from saturation, and no other cause is open."""
        found, known = self.coprime, self.unresolved_rate == 0.0 and self.finest > LOST * self.lost
        return found is not None and found.elsewhere and found.saturation <= LINEAR and known and not self.untried

    @property
    def explained_by_law(self) -> bool:
        """Whether the motion is that of the law of contact which the method solves, and not that of the case's law.

        Where bodies hit, it may also be off the former by what impacts at any phase of a step make, and off the latter
        by more than twice that.
        """
        off, phase = self.off_law + self.off_hard, self.impact_bound + self.allowed
        met = off <= max(OTHER_LAW * self.finest, self.allowed)
        return bool(self.law_cause) and (met or (self.law_cause != COMPLIANCE and self.beyond_phase and off <= phase))

    @property
    def springs_explain(self) -> bool:
        """Whether the difference is that of springs in place of rigid shapes, and vanishes with their softness."""
        return self.law_cause == COMPLIANCE and self.explained_by_law

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
    def softness_proved(self) -> bool:
        """Whether the motion is that of the reference with the law of soft contacts that the method solves."""
        return self.off_soft <= max(OTHER_LAW * self.finest, self.allowed)

    @property
    def passes(self) -> float:
        """Largest difference of another model that would be passed over."""
        if self.finest <= self.allowed:
            return self.allowed
        if self.converges_here:
            near = self.finest <= CANCELLED * self.allowed  # another model's difference may cancel that of the steps
            return max(self.largest_limit, (self.finest + self.allowed) / 2.0 if near else 0.0)
        if self.within_phase:
            return self.impact_passes
        if self.springs_explain:  # an error parts the motions under the law, or leads it elsewhere
            return max(self.allowed, OTHER_LAW * self.finest)
        if self.within_jumps:
            return self.jumps + self.allowed
        share = OTHER_LAW if self.softness_proved else EXPLAINED
        return max(self.allowed, share * min(self.finest, SATURATED)) if self.softness_explains else self.allowed

    @property
    def unseen(self) -> str:
        """Parameter whose largest error would be passed over though the digits asked show it; empty if there is none.

        Where the digits asked show no parameter, the one that acts most.
        """
        passed = (
            self.finest <= self.allowed
            or self.converges_here
            or self.within_phase
            or self.springs_explain
            or self.within_jumps
            or (not self.earlier and self.softness_explains)
        )
        return self._hidden(self.passes) if passed else ""

    def _hidden(self, passes: float) -> str:
        """Return the parameter whose largest error stays below differences that pass; empty if none does."""
        if not self.effects:
            return ""
        shown = {of: effect for of, effect in self.effects.items() if effect * LARGEST > self.allowed}
        of, effect = min((shown or self.effects).items(), key=lambda item: item[1] if shown else -item[1])
        return of if effect * LARGEST <= passes else ""

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
