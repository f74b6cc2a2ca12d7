"""Bounces that accumulate: infinitely many impacts of one contact, or of several together, in a finite time.

An impact is filed with those of the same normal beside the same other closed normals. What accumulates becomes a
scaled copy of itself: the speeds of a file and the times between its impacts fall by one ratio r. That of a lone
contact is its coefficient e, or ``e sqrt(down/up)`` where friction in a joint makes the pull differ between the way
down and up; that of a body that settles into a groove is the ratio of one impact in the corner, where a wall is closed,
to the next. The series ends ``f r/(1 - r)`` after an impact, f the time since the one before.

*Alone* is a normal without impacts of others, that answer to it, between its own. Where `_TIMES` ratios of its speeds
and flights agree to `_AGREE` and the flight is lower than `_HEIGHT` of the mechanism, its impact is the last, with
e = 0, unless one of the others would be struck before the end. All further impulses fall into it and into the force of
the closed contact. Where r is e, the end is ``2 e u/(|g''| (1 - e))`` later, u the speed of approach; else the one that
the ratios agreed best upon.

*Together* normals end where two impacts of one file and two of the same or another, between flights higher than
`_RESOLVED` of those, tell the same r and the same end; that one counts on which two agreed best. Once nothing flies
higher until then than `_TOGETHER` of those, all of them have e = 0 until the end, and while their flights are low.

A normal whose `_UNSETTLED` low impacts have found no ratio has e = 0 from there on, while they are low: what is left of
the impulses then falls into the force of the closed contact. Of several with friction it may fall into another one than
in the order that rounding would have made of their impacts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.lasting import LastingContact
from consilience.reference.contact.layout import RowLayout

_TIMES = 3
_HEIGHT = 1e-10
_TOGETHER = 30.0
_RESOLVED = 1e3
_AGREE = 1e-4  # times 1 - r
_LOOSE = 0.05  # after `_UNSETTLED` low impacts
_OF_LAW = 1e-6  # from where on r is e itself
_CLEAR = 1e6  # height, as those, from which flights of what has ended too early count again
_UNSETTLED = 8
_ENDLESS = 1000  # low impacts of one normal in a row
_COUPLED = 1e-12  # answer of a normal to another, over their own
_TOLD = 64

Rests = dict[int, float | None]
"""Times after which bounces of normals end, s; None where that is told already, or nothing tells it."""


class _Mark(NamedTuple):
    """One impact of a normal: its time, its speed of approach, and its number."""

    time: float
    speed: float
    number: int


class _Told(NamedTuple):
    """Ratio of a group and its end as two impacts tell them, and the time of the later one."""

    ratio: float
    end: float
    time: float
    group: frozenset[int]


class _Foreseen(NamedTuple):
    """End of the bounces of a group, s, with the difference of two that tell it."""

    error: float
    end: float
    group: frozenset[int]


class _Instant(NamedTuple):
    """Instant of impacts: gaps, rates and closed normals before them, shape (n_n,), and answers of all rows."""

    time: float
    gap: Array
    rate: Array
    closed: Array
    K: Array

    @property
    def others(self) -> frozenset[int]:
        """Closed normals."""
        return frozenset(np.flatnonzero(self.closed).tolist())


class Bounces:
    """Impacts of each normal."""

    def __init__(self, layout: RowLayout, length: float) -> None:
        self._layout, self._height = layout, _HEIGHT * length
        count = len(layout.normals)
        self._files: dict[tuple[int, frozenset[int]], list[_Mark]] = {}
        self._told: list[_Told] = []
        self._best: list[_Foreseen] = []
        self._latest = [_Mark(-np.inf, 0.0, -1)] * count
        self._number, self._low = 0, np.zeros(count, dtype=int)  # of impacts; of low ones of each normal in a row
        self._over = np.zeros(count, dtype=bool)  # whose low impacts have no rebound
        self._blurred = np.zeros(count, dtype=bool)  # whose bounces have come too low for those of others
        self._until = np.full(count, -np.inf)  # when the last bounces of each end
        self._pull = np.zeros(count)

    def note(self, found: LastingContact) -> None:
        """Note the accelerations that pull open normals back."""
        self._pull = -found.acceleration[self._layout.normal_rows]

    def add(self, time: float, strikes: Array, gaps: Array, rates: Array, closed: Array, K: Array) -> Rests:
        """Add the impacts of an instant; return the normals without rebound, and how long after it their bounces end.

        Parameters
        ----------
        time : float, s
        strikes : ndarray of bool, shape (n_n,)
            Normals that have an impact.
        gaps, rates : ndarray, shape (n_n,), m and m/s
        closed : ndarray of bool, shape (n_n,)
            Normals that were closed until then.
        K : ndarray, shape (m, n)
            Answers of all rows (`Response`).

        Returns
        -------
        dict of int to float or None, s
            None: nothing tells the end.

        Raises
        ------
        NumericalFailure
            Impacts go on without end.
        """
        now, rest = _Instant(time, gaps, rates, closed, K), Rests()
        restitution = self._layout.restitution
        struck = np.flatnonzero(strikes & (rates < 0.0) & (restitution > 0.0) & (restitution < 1.0)).tolist()
        for n in struck:
            self._file(n, now)
        for n in struck:
            found = None if self._over[n] and time <= self._until[n] else self._ends(n, now)
            if found is not None:
                end, group = found
                self._low[list(group)], self._until[list(group)] = 0, end
                self._over[list(group)] |= len(group) > 1
                rest.update({m: end - time for m in group if m in struck or not closed[m]})
        return {n: rest.get(n) for n in {*np.flatnonzero(self._over).tolist(), *rest}}

    def _file(self, n: int, now: _Instant) -> None:
        """File an impact of normal n."""
        speed, coupled = -float(now.rate[n]), self._coupled(n, now)
        self._blurred[n] |= bool(np.any(coupled & now.closed & (self._until > now.time)))
        self._count_low(n, now.time, speed)
        self._number += 1
        self._latest[n] = _Mark(now.time, speed, self._number)
        file = self._files.setdefault((n, now.others - {n}), [])
        if not file or now.time > file[-1].time:
            file.append(self._latest[n])
        del file[: -_TIMES - 1]
        if len(file) > 1:
            self._foresee(n, file[-2:], self._since(n, file[-2], now))

    def _foresee(self, n: int, marks: list[_Mark], group: set[int]) -> None:
        """Note when a group ends, as two impacts of a file tell it, if two others have told the same."""
        before, last = marks
        r, flight = last.speed / before.speed, last.time - before.time
        low = 0.25 * last.speed * flight < _RESOLVED * self._height
        if len(group) == 1 or r >= 1.0 or low or np.any(self._blurred[list(group)]):
            return
        new, bar = _Told(r, last.time + flight * r / (1.0 - r), last.time, frozenset(group)), _AGREE * (1.0 - r)
        for old in self._told:
            error = abs(old.end - new.end)
            apart = abs(old.ratio - r) > bar or error > bar * (new.end - new.time)
            if old.group & new.group and old.time < new.time and not apart:
                self._offer(_Foreseen(error, new.end, new.group), new.time)
        self._told = [*self._told[1 - _TOLD :], new]

    def _offer(self, new: _Foreseen, time: float) -> float:
        """Keep what foresees the end of a group best; return how long after a time that is."""
        alone = len(new.group) == 1
        for one in self._best:
            if one.group & new.group and alone == (len(one.group) == 1) and one.end > time:
                if one.error <= new.error:
                    return one.end - time
                self._best.remove(one)
                break
        self._best = [one for one in self._best if one.end > time or not one.group & new.group] + [new]
        return new.end - time

    def _count_low(self, n: int, time: float, speed: float) -> None:
        """Count an impact after a low flight, and refuse them if they do not end."""
        flight = time - self._latest[n].time
        if flight == 0.0:
            return
        low = 0.25 * speed * flight < self._height
        self._low[n] = self._low[n] + 1 if low else 0
        self._over[n] &= low or time <= self._until[n]
        self._blurred[n] &= 0.25 * speed * flight < _CLEAR * self._height
        if self._low[n] > _ENDLESS:
            name = self._layout.names[self._layout.normals[n]]
            raise NumericalFailure(
                f"{name}, t = {time:.12g} s: {_ENDLESS} impacts after flights too low to tell apart: they do not end"
            )

    def _ends(self, n: int, now: _Instant) -> tuple[float, set[int]] | None:
        """Return when the bounces end whose last impact normal n has now, and the normals that end with it."""
        file = self._files[n, now.others - {n}]
        together = next((one for one in self._best if n in one.group and len(one.group) > 1), None)
        if together is not None and self._is_low(together, n, now):
            return together.end, set(together.group)
        late = self._low[n] >= _UNSETTLED
        self._over[n] |= late
        if len(file) <= _TIMES:
            return None
        time, speed = np.array([mark[:2] for mark in file]).T
        flight = np.diff(time)
        ratios = np.concatenate([speed[1:] / speed[:-1], flight[1:] / flight[:-1]])
        r = float((speed[-1] / speed[0]) ** (1.0 / _TIMES))
        spread, group = float(np.max(np.abs(ratios - r))), self._since(n, file[-2], now)
        if r >= 1.0 or len(group) > 1 or spread > (_LOOSE if late else _AGREE * (1.0 - r)):
            return None
        e = float(self._layout.restitution[n])
        after = float((time[-1] - time[0]) / np.sum(speed[1:]) * speed[-1]) * r / (1.0 - r)
        lawful = abs(r - e) <= _OF_LAW * e and self._pull[n] > 0.0
        if lawful:
            after = 2.0 * e * float(speed[-1] / self._pull[n]) / (1.0 - e)
        else:
            after = self._offer(_Foreseen(spread * after / (1.0 - r), now.time + after, frozenset(group)), now.time)
        if (1.0 if lawful else r**2) * 0.25 * speed[-1] * flight[-1] >= self._height:
            return None
        if self._disturbed(n, after, now):
            if not late:
                return None
            self._blurred |= self._coupled(n, now)
        return now.time + after, group

    def _is_low(self, one: _Foreseen, n: int, now: _Instant) -> bool:
        """Return whether a group whose end is foreseen flies too low until then, or is low after it."""
        left = one.end - now.time
        if left <= 0.0:
            return self._low[n] > 0
        return 0.25 * float(np.max(np.abs(now.rate[list(one.group)]))) * left < _TOGETHER * self._height

    def _disturbed(self, n: int, after: float, now: _Instant) -> bool:
        """Return whether another normal that answers to n closes before its bounces end, if they go on."""
        own = now.K[self._layout.normal_rows]
        share = own @ own[n] / (own[n] @ own[n])
        rate = now.rate - share * now.rate[n]
        gap = now.gap + after * (rate - 0.5 * after * (self._pull - share * self._pull[n]))
        near = self._coupled(n, now) & ~now.closed & (gap <= 0.0)
        near[n] = False
        return bool(np.any(near))

    def _since(self, n: int, before: _Mark, now: _Instant) -> set[int]:
        """Return normal n and those that have had an impact since another one of it, and answer to it."""
        answers = self._coupled(n, now)
        return {n} | {m for m, mark in enumerate(self._latest) if mark.number > before.number and answers[m]}

    def _coupled(self, n: int, now: _Instant) -> Array:
        """Return which normals answer to normal n, shape (n_n,)."""
        own = now.K[self._layout.normal_rows]
        size = np.linalg.norm(own, axis=1)
        return np.asarray(np.abs(own @ own[n]) > _COUPLED * size * size[n])
