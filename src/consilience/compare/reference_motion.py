"""Reference motion of a case: the yardstick of motions, with its uncertainty, horizon, impacts and sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from consilience.compare.horizon import judged_samples
from consilience.compare.motion import state_at
from consilience.compare.power import MotionSensitivity
from consilience.engine import EVENT_KINDS, TrajectoryAnswer
from consilience.mechanism import GROUND, Array, Mechanism, SpherePlane, State, fastest_rate, first_singular

IMPACT, CLOSES, OPENS, SLIPS = (EVENT_KINDS.index(kind) for kind in ("impact", "closes", "opens", "slips"))

SLIDING = 1
"""Contact mode of a contact that slides (`TrajectoryAnswer.contact_mode`)."""

_EVEN = 1e-9
"""Relative difference of inertias, and distance of a centre, that count as none."""

_SHARE = 0.1
"""Share of the impulse of an impact from which another contact takes part in it."""

_SAMPLED = (
    *("time", "p_WB", "quat_WB", "v_WB_W", "w_WB_W"),
    *("contact_gap", "contact_impulse", "contact_mode", "contact_loss"),
)
"""Fields of a motion that have a row for each sample."""


def first_samples(answer: TrajectoryAnswer, count: int) -> TrajectoryAnswer:
    """Return the first samples of a motion."""
    rows = {name: getattr(answer, name) for name in _SAMPLED}
    return replace(answer, **{name: value[:count] for name, value in rows.items() if value is not None})


def up_to_shortest(answers: Sequence[TrajectoryAnswer]) -> list[TrajectoryAnswer]:
    """Return the samples that all motions have: an engine that fails at a singular pose has answered up to there."""
    count = min(len(answer.time) for answer in answers)
    return [first_samples(answer, count) for answer in answers]


def _is_even_ball(mechanism: Mechanism) -> bool:
    """Whether all is one free ball on fixed ground, of the same inertia about all axes through its centre.

    Then normal forces move the contact along the normal alone, and friction moves it alike along all tangents.
    """
    if any(len(part) > 1 for part in (mechanism.bodies, mechanism.joints, mechanism.contacts)):
        return False
    ball, body, held = mechanism.contacts[0], mechanism.bodies[0], mechanism.stops or mechanism.dry_frictions
    if not isinstance(ball, SpherePlane) or ball.partner != GROUND or mechanism.joints[0].kind != "free" or held:
        return False
    even = np.allclose(body.inertia, body.inertia[0, 0] * np.eye(3), rtol=_EVEN, atol=_EVEN * body.inertia[0, 0])
    return bool(even) and bool(np.linalg.norm(ball.center - body.com) <= _EVEN * ball.radius)


@dataclass(frozen=True, eq=False)
class OtherLaw:
    """Motion of the reference under a law of contact that is not the case's.

    Attributes
    ----------
    cause : str
        What the law changes, the name of a rule (`rules.OTHER_LAWS`).
    name : str
        The law in words.
    answer : TrajectoryAnswer
    hard : TrajectoryAnswer or None
        The motion with the compliance of the law far harder (`other_laws.hardened`); None of other laws.
    """

    cause: str
    name: str
    answer: TrajectoryAnswer
    hard: TrajectoryAnswer | None = None

    def up_to(self, count: int) -> OtherLaw:
        """Return the first samples alone."""
        hard = self.hard and first_samples(self.hard, count)
        return replace(self, answer=first_samples(self.answer, count), hard=hard)


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """Reference motion of a case with its uncertainty and horizon.

    Attributes
    ----------
    answer : TrajectoryAnswer
    spread : ndarray, shape (n_t,)
        Uncertainty up to each sample: the spread over formulations, integrators and tolerances.
    digits : int
        Digits the case asks.
    growth : ndarray, shape (n_t,), or None
        Growth of perturbations (`horizon.growth`); None if unknown: then there is no horizon.
    dispute : str
        Published value that contradicts the reference beyond both uncertainties; empty if none does.
    sensitivities : tuple of MotionSensitivity
        Of the parameters that act, one of each kind; none if unknown.
    singular : int or None
        First sample at or behind a singular pose, at which judging ends; None if the motion is judged behind as well.
    other_law : OtherLaw or None
        Motion under the law of contact that the method solves; None if the method solves that of the case.
    soft : TrajectoryAnswer or None
        Motion under the law of soft contacts that the method solves; None if it has none, or it was not solved.
    rates : dict
        Fastest rates by sample, rad/s, as far as they have been asked for.
    """

    answer: TrajectoryAnswer
    spread: Array
    digits: int
    growth: Array | None = field(default=None)
    dispute: str = ""
    sensitivities: tuple[MotionSensitivity, ...] = ()
    singular: int | None = None
    other_law: OtherLaw | None = None
    soft: TrajectoryAnswer | None = None
    rates: dict[int, float] = field(default_factory=dict)

    def fastest_rate(self, mechanism: Mechanism, sample: int) -> float:
        """Return the fastest rate of the mechanism at a sample, rad/s, computed once for all methods of all engines."""
        if sample not in self.rates:
            state, time = state_at(self.answer, sample), float(self.answer.time[sample])
            self.rates[sample] = fastest_rate(mechanism, state, time)
        return self.rates[sample]

    @property
    def impacts(self) -> Array:
        """Times at which bodies hit one another, s."""
        kinds, times = self.answer.event_kind, self.answer.event_time
        return (
            np.zeros(0) if kinds is None or times is None else np.unique(np.asarray(times)[np.asarray(kinds) == IMPACT])
        )

    @cached_property
    def joint_impact(self) -> float:
        """Time of the first impact of several contacts, s; infinite if there is none.

        Another contact hits or opens at that instant, or stays closed and bears a share of the impulse.
        """
        times, contacts = self.answer.event_time, self.answer.event_contact
        if times is None or contacts is None:
            return np.inf
        times, contacts = np.asarray(times), np.asarray(contacts)
        for t in self.impacts:
            hit = {int(n) for n in contacts[times == t]}
            if len(hit) > 1 or self._shared(min(hit), t):
                return float(t)
        return np.inf

    def _shared(self, hit: int, t: float) -> bool:
        """Whether the impulse of a contact without events jumps in the sample interval of an impact of another one."""
        impulses, time = self.answer.contact_impulse, self.answer.time
        i = int(np.searchsorted(time, t))
        near = i - 1 if i > 1 else i + 1  # an interval beside it, for what a contact that lasts bears anyway
        if impulses is None or hit >= impulses.shape[1] or not 0 < i < len(time) or near >= len(time):
            return False
        first, last = min(i, near) - 1, max(i, near)
        within = (np.asarray(self.answer.event_time) > time[first]) & (np.asarray(self.answer.event_time) <= time[last])
        lasting = np.setdiff1d(np.arange(impulses.shape[1]), np.asarray(self.answer.event_contact)[within])
        anyway = impulses[near] * (time[i] - time[i - 1]) / (time[near] - time[near - 1])
        jumps = np.linalg.norm(impulses[i] - anyway, axis=1)
        return bool(np.any(jumps[lasting] > _SHARE * jumps[hit]))

    @property
    def mode_changes(self) -> Array:
        """Times of the other events, s: the acceleration jumps where contacts or frictions change their mode."""
        kinds, times = self.answer.event_kind, self.answer.event_time
        return np.zeros(0) if kinds is None or times is None else np.asarray(times)[np.asarray(kinds) != IMPACT]

    def slides_or_hits(self, mechanism: Mechanism) -> bool:
        """Whether a contact slides with friction at a sample, slips between samples, or bodies hit one another.

        A ball that slides by `_is_even_ball` does not count: what a convex cone lifts there falls back, and steps that
        vanish leave it on the plane, pressed by its weight on average, with friction against its slip.
        """
        modes, kinds = self.answer.contact_mode, self.answer.event_kind
        rough = [contact.friction > 0.0 for contact in mechanism.contacts]
        sliding = modes is not None and bool(np.any(np.asarray(modes)[:, rough] == SLIDING))
        begins = kinds is not None and bool(np.any(np.isin(np.asarray(kinds), (IMPACT, SLIPS))))
        return begins or (sliding and not _is_even_ball(mechanism))

    def since_departures(self, end: float) -> float:
        """Return the sum of the times since contacts opened or slips on them reversed, s.

        Nothing brings back a speed that is off there: a body that flies is not held, and one that slides goes on.
        What swings with dry friction is brought back.
        """
        left = np.array([*self._openings(), *self._reversals()])
        return float(np.sum(np.maximum(end - left, 0.0)))

    def _openings(self) -> Array:
        kinds, times = self.answer.event_kind, self.answer.event_time
        return np.zeros(0) if kinds is None else np.asarray(times)[np.asarray(kinds) == OPENS]

    def _reversals(self) -> Iterator[float]:
        """Yield the times at which a contact that slides slips anew: friction, and so the acceleration, jumps."""
        answer = self.answer
        if answer.event_kind is None or answer.event_time is None or answer.event_contact is None:
            return
        if answer.contact_mode is None:
            return
        slides = np.asarray(answer.contact_mode)[0] == SLIDING
        for time, contact, kind in zip(answer.event_time, answer.event_contact, answer.event_kind, strict=True):
            if contact >= len(slides):  # a stop or dry friction
                continue
            if kind == SLIPS and slides[contact]:
                yield float(time)
            if kind != CLOSES:
                slides[contact] = kind == SLIPS

    def up_to(self, count: int) -> ReferenceMotion:
        """Return the first samples alone, for motions that end there."""
        law = self.other_law and self.other_law.up_to(count)
        soft = self.soft and first_samples(self.soft, count)
        growth = None if self.growth is None else self.growth[:count]
        answer = first_samples(self.answer, count)
        return replace(self, answer=answer, spread=self.spread[:count], growth=growth, other_law=law, soft=soft)

    def first_singular(self, mechanism: Mechanism) -> int | None:
        """Return the first sample at or behind a singular pose; None if there is none."""
        motion = self.answer
        states = [State(*at) for at in zip(motion.p_WB, motion.quat_WB, motion.v_WB_W, motion.w_WB_W, strict=True)]
        return first_singular(mechanism, states, motion.time)

    @property
    def judged(self) -> int:
        """Number of samples before the horizon, and before a singular pose."""
        most = len(self.answer.time) if self.singular is None else self.singular
        if self.growth is None:
            return most
        return min(most, judged_samples(self.growth, self.spread, self.digits))
