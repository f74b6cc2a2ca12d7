"""Motion with contacts, friction and stops, from event to event.

Between events the modes of all contacts are fixed, and the motion is smooth (`stepper`). A kernel takes the steps in
which nothing happens (`march`). In any other the first zero of an event function is sought (`events`); the root is then
refined by steps that *end* at the instant, with the error of the integrator instead of that of the interpolant. There:

- what approaches with a closed gap has an impact (`impact`), together with all that touches then, until nothing
  approaches any more;
- the modes of all that touches are decided anew (`lasting`). The event itself has a consequence: a contact whose force
  vanished opens, one at the boundary of its cone starts to slide against its force, one whose slip vanished has none.

Bounces that accumulate end by the rule of `bounces`, alone or together; contacts that accumulate in another way close
below `_CRAWL` of the speeds.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import NumericalFailure, in_range
from consilience.mechanism import Array, Mechanism, State, characteristic_length
from consilience.reference.contact.bounces import Bounces
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.event_functions import EventFunctions
from consilience.reference.contact.events import CLEAR, Watch, first_zero, nodes_of, start_of_slip
from consilience.reference.contact.hops import rows_at_rest, what_lifts
from consilience.reference.contact.impact import AppliedImpact, apply_impact
from consilience.reference.contact.jams import ends_before_jam, step
from consilience.reference.contact.lasting import (
    LastingContact,
    binding_bounds,
    chosen_force,
    decide_opening,
    require_unique,
    sliding_rates,
    telling_time,
)
from consilience.reference.contact.layout import layout_of
from consilience.reference.contact.quiet_steps import STILL
from consilience.reference.contact.response import Response, SampledRows
from consilience.reference.contact.rims import Rims
from consilience.reference.contact.row_modes import RowModes, open_modes
from consilience.reference.contact.samples import Samples
from consilience.reference.contact.search import JammedFriction
from consilience.reference.contact.self_check import EventsAtOnce, UncheckedSamples, refuse_overlap
from consilience.reference.contact.slip_headings import STOPPED, SlipHeadings
from consilience.reference.contact.small_steps import SmallSteps
from consilience.reference.contact.speeds import fastest, speed_from_rest
from consilience.reference.contact.stepper import SlipTurns, Stepper
from consilience.reference.contact.tables import ends_of_steps

TOUCHING = 1e-10
"""Largest gap of a closed contact, over the length of the mechanism."""

GRAZING = 1e-13
"""Largest overlap without impact, over the length of the mechanism."""

_SINKS = 1e-8  # acceleration into a plane that counts as zero, over that of falling
_STEPS = 4  # least number of steps of a motion
_CHAIN = 1000  # impacts at one instant
_AT_MOST = 100  # samples that are taken together
_CRAWL = 1e-8
_RESOLVED = 4e12  # spacings of the time within which what stops by the forces is to be resolved, times `STOPPED`


class ContactSimulation:
    """One simulation with contacts."""

    def __init__(
        self, mechanism: Mechanism, state: State, times: Array, tolerance: float, impacts: str = "newton"
    ) -> None:
        in_range("tolerance", tolerance, 1e-13, 1e-3, "Choose 1e-13 to 1e-3.")
        self.times, self.law = times, impacts
        self.layout = layout_of(mechanism)
        self.equations = ContactEquations(self.layout)
        start, self.span = float(self.times[0]), float(np.ptp(self.times))
        self.stepper = Stepper(
            self.equations, state, start, tolerance, open_modes(self.layout), self.span / _STEPS or np.inf
        )
        self.samples, self.recorded = Samples(self.layout, self.equations.sums), 0
        self.unchecked = UncheckedSamples(self.equations)
        self.impacts: list[AppliedImpact] = []
        radii = [part.radius for part in self.layout.parts if hasattr(part, "radius")]
        self.length = max([characteristic_length(mechanism), *radii])
        response = self.stepper.respond(start, self.stepper.y)
        self.speed = max(speed_from_rest(self.equations, response, self.length), 1e-6 * self.length)
        self.equations.count_sums_by(max(self._speeds(), self.length))
        self.bounces = Bounces(self.layout, self.length)
        self.slips = SlipHeadings(self.equations)
        self.functions = EventFunctions(self.equations, self.length)
        self.rims = Rims(self.layout, self.span, tolerance)
        self.quiet = self.stepper.quiet_steps(self.times, self.length, self.span, self.rims.least)
        self.at_once, self.pull = EventsAtOnce(), 0.0
        self.small = SmallSteps(self.equations, self.stepper, self.span, self.length)

    def integrate(self, metre: float = 1.0) -> TrajectoryAnswer:
        """Integrate step by step; samples are taken within steps. A metre has this many units of length."""
        start = self.stepper.t, self.stepper.y, self.stepper.turns
        refuse_overlap(self.equations, start, TOUCHING * self.length, metre)
        self.equations.press(TOUCHING * self.length)
        self.equations.carry_tangents(*start)
        self._settle(frozenset(), {}, frozenset(), first=True)
        ends = ends_of_steps(self.layout.mechanism, self.stepper.t, float(self.times[-1]))
        try:
            self._record(self.stepper.t)
            while self.stepper.t < ends[-1]:
                end = float(ends[np.searchsorted(ends, self.stepper.t, side="right")])
                self._march(end)
                if self.stepper.t < end:
                    self._advance_or_turn(end)
                    self._record(self.stepper.t)
        finally:  # a sample that violates a law is told before what fails behind it
            self.unchecked.check()
        counters: dict[str, int | float] = {**self.stepper.counters, "impacts": len(self.impacts)}
        return self.samples.answer(self.times, counters)

    def _record(self, until: float) -> None:
        """Record the samples that the last step has reached, if no disc came flat in it."""
        self.rims.refuse_flat(self.stepper)
        reached = int(np.searchsorted(self.times, until, side="right"))
        while self.recorded < reached:
            self._keep(*self.stepper.sample(self.times[self.recorded : min(reached, self.recorded + _AT_MOST)]))

    def _keep(self, rows: SampledRows, sums: Array) -> None:
        """Keep samples, with impulses and losses."""
        self.samples.record(self.stepper.modes, rows, sums)
        self.unchecked.add(self.stepper.modes, rows, self.speed)
        self.recorded += len(rows.times)

    def _record_before(self) -> None:
        """Record the samples before an event at the end of the last step, and check all of the modes until then."""
        self._record(float(np.nextafter(self.stepper.t, -np.inf)))
        self.unchecked.check()

    # ------------------------------------------------------------------------------------------------------- steps

    def _march(self, bound: float) -> None:
        """Take the steps in which nothing happens."""
        if self.quiet.able and not (self.stepper.drifts or self.slips.leaving):
            self.quiet.arm(self.functions.armed)
            self.speed = self.stepper.march(self.quiet, bound, self.speed, self.recorded)
            if self.quiet.now["recorded"][0] > self.recorded:
                self._keep(*self.quiet.sampled())

    def _advance_or_turn(self, bound: float) -> None:
        """Take one step, a small one where a slip turns within what others resolve."""
        try:
            self._advance(bound)
        except SlipTurns:
            slow = self.slips.slow(self.stepper, self.speed)
            if not (slow and self.slips.several(self.stepper)) or self.equations.reacting:
                raise
            self._settle(frozenset(), {}, frozenset(slow), together=True)

    def _advance(self, bound: float) -> None:
        """Take one step, to its first event if there is one."""
        stepper = self.stepper
        self.equations.carry_tangents(stepper.t, stepper.y, stepper.turns)
        self.slips.turn(stepper, self.speed, self._slip_speed())
        room = self.functions.room(stepper)
        if stepper.drifts or room <= CLEAR:
            stepper.choose(chosen_force(self.equations, stepper.respond(stepper.t, stepper.y), stepper.modes))
            room = self.functions.room(stepper)
        step(self.equations, stepper, bound)
        self.rims.keep_clear(stepper)
        while (back := self.slips.leaves_line(stepper, self._slip_speed())) is not None:
            stepper.shorten(back, self._ends_early)
        self.speed = self._speeds()
        nodes, armed = nodes_of(stepper.started, stepper.t, self.span), self.functions.armed.copy()
        found = first_zero(self._values, nodes, self.functions.armed, self.functions.watches)
        if ends_before_jam(self.equations, stepper, stepper.t if found is None else found[0], self._ends_early):
            self.functions.armed = armed
            self._settle_halted()
            return
        if found is None:
            if room > 0.0 and self.functions.room(stepper) <= -(CLEAR**4):
                stepper.choose_along(chosen_force(self.equations, stepper.respond(stepper.t, stepper.y), stepper.modes))
            self._settle_halted()
            return
        t, w = found
        watch = self.functions.watches[w]
        if watch.kind == "slip" and not self._stops(t, watch):
            stepper.shorten(0.5 * (stepper.started + t), self._ends_early)
            while self.functions.now(w, stepper) <= 0.0:  # it had passed zero there
                stepper.shorten(0.5 * (stepper.started + stepper.t), self._ends_early)
            self.functions.armed = armed
            self._settle_halted()
        elif self._end_at(t, w):
            self._record_before()
            self._happens(watch)
        else:
            self.functions.armed = armed
            self._settle_halted()
        self.at_once.add(stepper.t)

    def _ends_early(self) -> bool:
        """Return whether a step that is repeated has to end: slip has come to a halt, or turned from its heading."""
        least = self._slip_speed()
        return self.slips.halted(self.stepper, least) is not None or self.slips.turned(self.stepper, least)

    def _settle_halted(self) -> None:
        """Settle where a slip has come to a halt, if one has."""
        halted = self.slips.halted(self.stepper, self._slip_speed())
        if halted is not None:
            self._record_before()
            self._settle(frozenset(), {}, frozenset([halted]))

    def _stops(self, t: float, watch: Watch) -> bool:
        """Return whether the slip of a friction set vanishes at t, rather than turns away from its heading."""
        self.equations.move(t, self.stepper.between(np.array([t]))[0], self.stepper.turns)
        slip = self.equations.rows.u[list(self.layout.friction[watch.index].rows)]
        return len(slip) == 1 or bool(np.linalg.norm(slip) <= STOPPED * 1.001 * max(watch.scale, self._slip_speed()))

    def _end_at(self, t: float, w: int) -> bool:
        """End the last step at the zero of an event function near t, or before it where a slip comes to a halt."""
        start, end = self.stepper.started, self.stepper.t
        delta = 1e-4 * (end - start)
        ahead, behind = min(t + delta, end), max(t - delta, start)
        values, rates = self._values(np.array([behind, t, ahead]))
        rate = float(rates[1, w])
        if not np.isfinite(rate):
            rate = float((values[2, w] - values[0, w]) / (ahead - behind)) if ahead > behind else 0.0
        before, least = t, np.inf
        for _ in range(4):
            if not self.stepper.go_back_to(t, self._ends_early):
                return False
            value = self.functions.now(w, self.stepper)
            if self.functions.watches[w].kind == "gap" and abs(value) > 2.0 * least:  # as where the gap turns
                return self.stepper.go_back_to(before, self._ends_early)
            if rate >= 0.0 or abs(value) <= 1e-16 * self.functions.watches[w].scale:
                break
            better = t - value / rate
            near = abs(better - t) <= 4e-16 * max(1.0, abs(t))
            if near or not behind <= better <= ahead or better == start:
                break  # found, or where the function turns or begins, without having risen by more than rounding
            before, least, t = t, abs(value), better
        return True

    # ------------------------------------------------------------------------------------------------------ events

    def _values(self, times: Array) -> tuple[Array, Array]:
        """Return the event functions and their rates at times within the last step, each (n_t, n_w)."""
        return self.functions.at(times, self.stepper.between(times), self.stepper)

    def _happens(self, watch: Watch) -> None:
        """Draw the consequence of an event, and settle."""
        modes, opened, stopped, closing = self.stepper.modes, set[int](), set[int](), set[int]()
        started: dict[int, Array] = {}
        if watch.kind == "slip" or (watch.kind == "turn" and self._stops(self.stepper.t, watch)):
            stopped.add(watch.index)
        elif watch.kind == "gap":
            closing.add(watch.index)
        elif watch.kind in ("touch", "spring"):
            self.equations.pressed[watch.index] = watch.kind == "touch"
        else:
            response = self.stepper.respond(self.stepper.t, self.stepper.y)
            force = self.stepper.forces()
            normals = [watch.index] if watch.kind == "normal" else []
            sets = [watch.index] if watch.kind == "margin" else []
            if watch.kind == "group":
                normals, sets, force = binding_bounds(self.equations, response, modes, watch.scale)
            opened.update(normals)
            begins = {j: start_of_slip(self.layout.friction[j], modes.friction[j], force) for j in sets}
            started = {j: heading for j, heading in begins.items() if np.any(heading)}  # no force, no direction
        self._settle(frozenset(opened), started, frozenset(stopped), frozenset(closing))

    def _settle(
        self,
        opened: frozenset[int],
        started: dict[int, Array],
        stopped: frozenset[int],
        closing: frozenset[int] = frozenset(),
        first: bool = False,
        together: bool = False,
    ) -> None:
        """Apply impacts, decide the modes of all that touches, and continue in them.

        `opened` and `closing` are normals whose force, or whose gap, has just fallen to zero, `started` the directions
        in which friction sets begin to slide, `stopped` those whose slip has just fallen to zero; `first` tells that
        the motion begins, `together` that slips stop or turn together.
        """
        before = self.stepper.modes
        hit, response = self._hit(closing)
        if hit and self.layout.springs:  # forces of dampers have jumped
            self.equations.press(TOUCHING * self.length)
            response = self.stepper.respond(self.stepper.t, self.stepper.y)
        rows = self.equations.rows
        still = STILL * self._speeds()
        near = rows.gap[self.layout.gaps] <= TOUCHING * self.length
        near[list(closing)] = True
        touching = near & (np.abs(rows.u[self.layout.normal_rows]) <= still)
        if not hit:
            touching |= before.closed
        still = min(still, STILL * self._slip_speed())
        sliding = sliding_rates(self.equations, None if hit or first else before, still)
        for j in started:  # from rest
            at = list(self.layout.friction[j].rows)
            sliding[at] *= float(np.linalg.norm(rows.u[at])) > still
        if started and not self.equations.reacting:
            together |= self.slips.starting(self.stepper, self._slip_speed()) or self.at_once.repeated(self.stepper.t)
        speeds = self._slip_speed(), self._speeds()
        alone = self.small.halt(stopped, sliding, touching, speeds) if stopped and not together else ([], response)
        found, previous = None, None if hit or first else before
        if not together and alone is not None:
            halted, response = alone
            found = self._decide(response, touching, sliding, previous, opened, started)
        if found is not None:
            rests = [not np.any(sliding[list(one.rows)]) for one in self.layout.friction]
            lines = [j for j, heading in enumerate(found.modes.heading) if heading is not None and rests[j]]
        else:
            found, lines = self.small.take(touching, speeds[0], float(self.times[-1]))
            halted = []
        self.pull = float(np.max(np.abs(response.free), initial=0.0))
        self.slips.begin(lines, self._slip_speed())
        self.stepper.change_modes(found.modes, halted)
        self.samples.change_modes(self.stepper.t, found.modes, hit, stopped)
        self.functions.renew(found, self.stepper, self.speed, self._slip_speed())
        self.quiet.watch(self.functions.watches, found.modes)
        self.bounces.note(found)

    def _decide(
        self,
        response: Response,
        touching: Array,
        sliding: Array,
        previous: RowModes | None,
        opened: frozenset[int],
        started: dict[int, Array],
    ) -> LastingContact | None:
        """Decide the modes (`decide_opening`); None where slips under compliance are too small to tell."""
        fall = _SINKS * max(float(np.linalg.norm(self.equations.model.gravity)), self.length)
        with telling_time(self.stepper.t):
            try:
                found = decide_opening(self.equations, response, touching, sliding, previous, opened, started, fall)
            except NumericalFailure as failure:
                small = len(self.layout.springs) and self.slips.several(self.stepper) and not self.equations.reacting
                if isinstance(failure, JammedFriction) or not small:
                    raise
                return None
        return require_unique(found, self.stepper.t)

    def _speeds(self) -> float:
        """Return the speed of the fastest body, or that of motion from rest."""
        return max(self.speed, fastest(self.equations, self.stepper.y, self.length))

    def _slip_speed(self) -> float:
        """Return the speed beside which slips are small: of several contacts that now, if the time resolves them."""
        if not self.slips.several(self.stepper):
            return self.speed
        resolved = _RESOLVED * float(np.spacing(self.stepper.t)) * self.pull
        return min(self.speed, max(fastest(self.equations, self.stepper.y, self.length), resolved))

    # ----------------------------------------------------------------------------------------------------- impacts

    def _hit(self, closing: frozenset[int]) -> tuple[set[int], Response]:
        """Apply impacts at this instant until nothing approaches; return the normals that had one, and the response.

        A gap whose zero has just been found is closed, whatever rounding has left of it.
        """
        stepper, hit = self.stepper, set[int]()
        for _ in range(_CHAIN):
            response = stepper.respond(stepper.t, stepper.y)
            rows, still = self.equations.rows, STILL * self._speeds()
            gap, rate = rows.gap[self.layout.gaps], rows.u[self.layout.normal_rows]
            closed = np.zeros(len(gap), dtype=bool)
            closed[list(closing)] = True
            touching = closed | (gap <= TOUCHING * self.length)
            lifts = what_lifts(self.equations, rate, STOPPED * self.speed)
            strikes = touching & ((rate < -still) | lifts) & (closed | (gap <= GRAZING * self.length))
            if not np.any(strikes):
                return hit, response
            hit |= set(np.flatnonzero(strikes).tolist())
            resting = rows_at_rest(self.equations, strikes, touching, _CRAWL * self.speed)
            if resting:
                stepper.halt(resting)
                continue
            taking = touching & ((rate <= still) | lifts)
            restitution = self._restitution(rate, strikes, response)
            with telling_time(self.stepper.t):
                impact = apply_impact(self.equations, response, stepper, taking, restitution, still, self.law)
            self.impacts.append(impact)
            lost = sum(impact.losses(self.layout))  # drives, too, change the energy
            stepper.place(impact.after, stepper.contact_forces(impact.force), lost)
        raise NumericalFailure(f"{_CHAIN} impacts at the instant t = {stepper.t:.12g} s: velocities do not settle")

    def _restitution(self, rate: Array, strikes: Array, response: Response) -> Array:
        """Return the restitution of each normal at its rate (n_n,): zero at its last impact.

        By Poisson's law what rests rebounds, too, from what strikes elsewhere; not where all strike for the last time.
        """
        found, stepper, gap = self.layout.rebounds(-rate), self.stepper, self.equations.rows.gap[self.layout.gaps]
        ends = self.bounces.add(stepper.t, strikes, gap, rate, stepper.modes.closed, response.K)
        for n, after in ends.items():
            if after is not None:
                self.samples.add(stepper.t + after, "bounces end", int(self.layout.site[self.layout.normals[n]]))
        last = strikes & (-rate < _CRAWL * self.speed)
        last[[n for n in ends if strikes[n]]] = True  # what rests has its share of expansion, though its bounces ended
        found[last | np.all(last[strikes])] = 0.0
        return found
