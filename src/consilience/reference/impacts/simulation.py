"""Motion with impacts: integration, location of the closing instants, impacts.

Between impacts contacts have no effect. In each step the first instant is sought at which a gap falls through zero:
gaps and rates are evaluated on the interpolant at equidistant times and at the turning points between them, which also
finds short dips; the root is then refined by Newton's method on steps that *end* at the instant, with the error of the
integrator instead of that of the interpolant.

- All contacts closed at the instant, within `TOUCHING` lengths of the mechanism, enter one simultaneous impact.
  Contacts that approach afterwards enter another impact at the same instant.
- A gap that touches zero, or overlaps less than `GRAZING`, is no impact.
- Lasting contact and accumulation points of impacts raise `NumericalFailure` with contact and time. An accumulation
  point is declared when the last `_SHRINKING` intervals between impacts of a contact decrease and the approach speeds
  are below `_ZENO` of its largest one.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import scipy

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array, Contact, Mechanism, State, characteristic_length, continuous_in_time
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.impacts.geometry import ContactMotion, check_contacts, contact_motion
from consilience.reference.impacts.impact import AT_REST, Impact, solve_impact, velocity_scale
from consilience.reference.impacts.stepper import Stepper

TOUCHING = 1e-10
"""Largest gap of a closed contact, over the length of the mechanism."""

GRAZING = 1e-13
"""Largest overlap without impact, over the length of the mechanism."""

_PARTS = 8
_STILL = 1e-12  # rate of a gap that counts as zero, over the speed of the fastest body
_CHAIN = 1000  # impacts at one instant
_ZENO = 1e-6
_SHRINKING = 3


def simulate_with_impacts(
    mechanism: Mechanism, state: State, times: Array, contacts: tuple[Contact, ...], tolerance: float = 1e-12
) -> tuple[TrajectoryAnswer, tuple[Impact, ...]]:
    """Integrate the motion of a mechanism whose bodies may hit one another or the ground.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state at ``times[0]``, no contact overlapping.
    times : ndarray, shape (n_t,), s
        Increasing sample times; at the instant of an impact the sample has the velocities after it.
    contacts : tuple of contacts
        Pairs of shapes that may touch.
    tolerance : float
        Bound on the scaled local error of a step, 1e-13 to 1e-3.

    Returns
    -------
    TrajectoryAnswer
        With the counters ``steps``, ``evaluations`` and ``impacts``.
    tuple of Impact
        In order of time.

    Raises
    ------
    InvalidInput
        Tolerance out of range, times that do not increase, unknown bodies, a contact that overlaps at the start.
    NumericalFailure
        A contact comes to rest, bodies are wedged at an impact, or the integration fails.
    """
    if not 1e-13 <= tolerance <= 1e-3:
        raise InvalidInput("tolerance", f"{tolerance} is out of range", "Choose 1e-13 to 1e-3.")
    times = sample_times(times)
    check_contacts(mechanism, contacts)
    run = _ImpactSimulation(mechanism, contacts, Stepper(mechanism, state, float(times[0]), tolerance))
    run.refuse_overlap()
    samples = []
    for sample in times:
        run.go_to(float(sample))
        samples.append(run.stepper.state())
    arrays = [np.array([getattr(s, name) for s in samples]) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")]
    counters: dict[str, int | float] = {**run.stepper.counters, "impacts": len(run.impacts)}
    answer = TrajectoryAnswer(times, arrays[0], continuous_in_time(arrays[1]), arrays[2], arrays[3], counters)
    return answer, tuple(run.impacts)


class _ImpactSimulation:
    """One simulation with impacts."""

    def __init__(self, mechanism: Mechanism, contacts: tuple[Contact, ...], stepper: Stepper) -> None:
        self.mechanism = mechanism
        self.contacts = contacts
        self.stepper = stepper
        self.impacts: list[Impact] = []
        self._length = max([characteristic_length(mechanism), *(c.radius for c in contacts if hasattr(c, "radius"))])
        self._history: dict[str, list[tuple[float, float]]] = {c.name: [] for c in contacts}

    def refuse_overlap(self) -> None:
        """Refuse overlapping shapes in the initial state."""
        state = self.stepper.state()
        for contact in self.contacts:
            gap = contact_motion(self.mechanism, state, contact).gap
            if gap < -TOUCHING * self._length:
                raise InvalidInput(
                    f"contact '{contact.name}'",
                    f"'{contact.body}' and '{contact.partner}' overlap by {-gap:.6g} m at the start",
                    "Start with the shapes apart, or just touching.",
                )

    def go_to(self, sample: float) -> None:
        """Integrate to a sample time, impacts included."""
        self._hit()
        while self.stepper.t < sample:
            self.stepper.advance(sample)
            closing = self._first_closing()
            if closing is not None:
                contact, t = closing
                started = self.stepper.started
                self._end_at(contact, t)
                if not self._hit() and self.stepper.t <= started + 1e-14 * max(1.0, abs(started)):
                    self._rests(contact, started)
            else:
                self._hit()

    def _first_closing(self) -> tuple[Contact, float] | None:
        """Return the first contact and instant of the last step at which a gap falls through zero."""
        nodes = np.linspace(self.stepper.started, self.stepper.t, _PARTS + 1)
        states = [self.stepper.between(t) for t in nodes[:-1]] + [self.stepper.state()]
        found: tuple[Contact, float] | None = None
        for contact in self.contacts:
            t = self._closing(contact, nodes, states)
            if t is not None and (found is None or t < found[1]):
                found = contact, t
        return found

    def _closing(self, contact: Contact, nodes: Array, states: list[State]) -> float | None:
        """Return the first instant of the last step at which the gap of a contact falls through zero."""

        def motion(t: float) -> ContactMotion:
            return contact_motion(self.mechanism, self.stepper.between(t), contact)

        motions = [contact_motion(self.mechanism, s, contact) for s in states]
        points = [(float(t), m.gap, m.rate) for t, m in zip(nodes, motions, strict=True)]
        for a, b in pairwise(_with_turning_points(points, motion)):
            falls_through = b[1] < -GRAZING * self._length or (b[1] <= 0.0 and b[2] < 0.0)
            if a[1] > 0.0 and falls_through:
                return _root(lambda t: motion(t).gap, a[0], b[0]) if motion(b[0]).gap < 0.0 else b[0]
            if a[1] <= 0.0 and b[1] < -TOUCHING * self._length:
                self._rests(contact, a[0])
        return None

    def _end_at(self, contact: Contact, t: float) -> None:
        """End the last step at the instant near t at which the gap closes."""
        start, end = self.stepper.started, self.stepper.t
        for _ in range(4):
            self.stepper.go_back_to(t)
            m = contact_motion(self.mechanism, self.stepper.state(), contact)
            if abs(m.gap) <= 1e-15 * self._length or m.rate >= 0.0:
                break
            better = min(max(t - m.gap / m.rate, start), end)
            if abs(better - t) <= 4e-16 * max(1.0, abs(t)):
                break
            t = better

    def _hit(self) -> bool:
        """Apply impacts at this instant until no closed contact approaches; return whether there was an impact."""
        first = len(self.impacts)
        for _ in range(_CHAIN):
            state = self.stepper.state()
            still = _STILL * velocity_scale(self.mechanism, state)
            motions = [contact_motion(self.mechanism, state, c) for c in self.contacts]
            approaching = [m for m in motions if m.rate < -still]
            if not any(m.gap <= GRAZING * self._length for m in approaching):
                return len(self.impacts) > first
            closed = tuple(c for c, m in zip(self.contacts, motions, strict=True) if m.gap <= TOUCHING * self._length)
            record = solve_impact(self.mechanism, state, closed, self.stepper.t, self.stepper.turns)
            self.impacts.append(record)
            self._watch(record)
            self.stepper.place(record.after, self.stepper.t)
        raise NumericalFailure(
            f"{_CHAIN} impacts at the instant t = {self.stepper.t:.12g} s, the last of "
            f"{', '.join(self.impacts[-1].contacts)}: velocities do not settle"
        )

    def _watch(self, record: Impact) -> None:
        """Refuse accumulating impacts of a contact."""
        speeds = -np.sum(record.velocity_before * record.directions, axis=1)
        for name, speed in zip(record.contacts, speeds, strict=True):
            history = self._history[name]
            at_once = bool(history) and record.time - history[-1][0] <= 1e-14 * max(1.0, abs(record.time))
            if at_once or speed <= AT_REST * velocity_scale(self.mechanism, record.before):
                continue
            history.append((record.time, float(speed)))
            intervals = np.diff([t for t, _ in history[-_SHRINKING - 2 :]])
            shrinking = len(intervals) > _SHRINKING and bool(np.all(np.diff(intervals) < 0.0))
            if shrinking and max(v for _, v in history[-_SHRINKING:]) < _ZENO * max(v for _, v in history):
                self._rests(next(c for c in self.contacts if c.name == name), record.time)

    def _rests(self, contact: Contact, t: float) -> None:
        """Raise the failure of a contact that comes to rest."""
        raise NumericalFailure(
            f"contact '{contact.name}' of '{contact.body}' and '{contact.partner}' comes to rest at t = {t:.12g} s: "
            "contact that lasts is outside what simulation with impacts covers; end the simulation before"
        )


def _root(function: Callable[[float], float], start: float, end: float) -> float:
    """Return the zero of a function between two times at which its signs differ."""
    return float(scipy.optimize.brentq(function, start, end, xtol=1e-15, rtol=1e-15))


def _with_turning_points(
    points: list[tuple[float, float, float]], motion: Callable[[float], ContactMotion]
) -> list[tuple[float, float, float]]:
    """Insert the points (t, gap, rate) at which the rate changes sign, its value there exactly zero."""
    found = [points[0]]
    for a, b in pairwise(points):
        if a[2] * b[2] < 0.0 and motion(a[0]).rate * motion(b[0]).rate < 0.0:
            t = _root(lambda t: motion(t).rate, a[0], b[0])
            found.append((t, motion(t).gap, 0.0))
        found.append(b)
    return found
