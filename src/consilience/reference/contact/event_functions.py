"""Event functions of the modes of a motion with contacts, at any state (`events` lists them)."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.events import ARMED, CLEAR, Watch, friction_margin
from consilience.reference.contact.lasting import LastingContact, chosen_force, sliding_rates, widest_margin
from consilience.reference.contact.quiet_steps import ROUNDING
from consilience.reference.contact.response import ObservedRows
from consilience.reference.contact.row_modes import RowModes
from consilience.reference.contact.stepper import Stepper

_LEAST_FORCE = 1e-3
"""Least scale of forces, over the weight of all bodies."""

_RISING = 1e-11
"""Rate of a gap from which it counts, over the speeds of the mechanism."""


class EventFunctions:
    """Event functions of the present modes.

    Attributes
    ----------
    watches : list of Watch
    armed : ndarray of bool, shape (n_w,)
        Which have left zero.
    """

    def __init__(self, equations: ContactEquations, length: float) -> None:
        self._equations, self._layout, self._length = equations, equations.layout, length
        gravity = float(np.linalg.norm(equations.model.gravity))
        self._weight = float(np.sum(equations.model.mass)) * max(gravity, length)
        self.watches: list[Watch] = []
        self.armed = np.zeros(0, dtype=bool)

    def renew(self, found: LastingContact, stepper: Stepper, speed: float, slip: float) -> None:
        """List the event functions of modes that begin at the state of a stepper."""
        layout, modes = self._layout, found.modes
        scale = max(float(np.max(np.abs(found.force), initial=0.0)), _LEAST_FORCE * self._weight)
        watches = [Watch("gap", n, self._length) for n, closed in enumerate(modes.closed) if not closed]
        for s, pressed in enumerate(modes.pressed):
            watches.append(Watch("spring", s, scale) if pressed else Watch("touch", s, self._length))
        if found.undetermined:
            watches.append(Watch("group", -1, scale))
        else:
            watches += [Watch("normal", n, scale) for n, closed in enumerate(modes.closed) if closed]
        for j, mode in enumerate(modes.friction):
            if mode is None:
                continue
            if len(mode.held) and not found.undetermined:
                watches.append(Watch("margin", j, scale))
            if len(mode.held) < len(layout.friction[j].rows):
                watches.append(Watch("slip", j, slip))
                if layout.friction[j].facets and not len(mode.held):
                    watches.append(Watch("turn", j, slip))
        flying = {w.index for w, armed in zip(self.watches, self.armed, strict=True) if w.kind == "gap" and armed}
        self.watches = watches
        if found.undetermined and self.room(stepper) <= CLEAR:
            response = stepper.respond(stepper.t, stepper.y)
            stepper.choose(chosen_force(self._equations, response, stepper.modes))
        values, rates = (part[0] for part in self.at(np.array([stepper.t]), stepper.y[None], stepper))
        ready = ARMED * np.array([w.scale for w in watches])
        flies = np.array([w.kind == "gap" and w.index in flying for w in watches], dtype=bool)
        rises = (rates > _RISING * speed) & (values >= -ROUNDING * ready)
        self.armed = (values > ready) | rises | (flies & (values > ROUNDING * ready))

    def at(self, times: Array, states: Array, stepper: Stepper) -> tuple[Array, Array]:
        """Return the event functions, and their rates where known (else NaN), at packed states near the last one.

        Parameters
        ----------
        times : ndarray, shape (n,), s
        states : ndarray, shape (n, ...)
        stepper : Stepper

        Returns
        -------
        values, rates : ndarray, shape (n, n_w)
        """
        layout, seen = self._layout, self._equations.observe(times, states, stepper.turns)
        values, rates = np.empty((2, len(times), len(self.watches)))
        rates[...] = np.nan
        for w, watch in enumerate(self.watches):
            k = watch.index
            if watch.kind == "gap":
                values[:, w], rates[:, w] = seen.gap[:, layout.gaps[k]], seen.u[:, layout.normals[k]]
            elif watch.kind == "normal":
                values[:, w] = seen.force[:, layout.normals[k]]
            elif watch.kind in ("touch", "spring"):
                values[:, w], rates[:, w] = self._of_spring(watch.kind, k, seen)
            elif watch.kind == "group":
                values[:, w] = self._of_group(times, states, stepper, seen, watch.scale)
            else:
                values[:, w] = self._of_friction(watch.kind, k, stepper, seen)
        return values, rates

    def now(self, w: int, stepper: Stepper) -> float:
        """Return an event function at the end of the last step of a stepper."""
        return float(self.at(np.array([stepper.t]), stepper.y[None], stepper)[0][0, w])

    def _of_spring(self, kind: str, s: int, seen: ObservedRows) -> tuple[Array, Array]:
        """Return the force of a compliant contact, or its gap; where shapes part, by how much it would pull."""
        part = self._layout.springs[s]
        law, gap, rate = self._layout.parts[part].compliance, seen.gap[:, part], seen.u[:, 3 * part]
        if kind == "spring":
            force = -law.stiffness * gap - law.damping * rate
            return force, -law.stiffness * rate if law.damping == 0.0 else np.full(len(gap), np.nan)
        parts = (gap <= 0.0) & (rate > 0.0)  # what approaches is pressed: the function is continuous there
        return np.where(parts, gap + law.damping / law.stiffness * rate, gap), np.where(parts, np.nan, rate)

    def _of_group(self, times: Array, states: Array, stepper: Stepper, seen: ObservedRows, scale: float) -> Array:
        """Return the margin of forces that are undetermined: the widest, where those that were chosen leave doubt."""
        margin = self._least_margin(stepper.modes, seen.force)
        for k in np.flatnonzero(margin <= CLEAR * scale):
            response = stepper.respond(float(times[k]), states[k])
            sliding = sliding_rates(self._equations, stepper.modes, 0.0)
            margin[k] = widest_margin(self._equations, response, stepper.modes, sliding)[0]
        return margin

    def _least_margin(self, modes: RowModes, force: Array) -> Array:
        """Return the least margin of forces on all rows, shape (n, m), at each state."""
        margins = [force[:, n] for n, closed in zip(self._layout.normals, modes.closed, strict=True) if closed]
        for one, mode, offset in zip(self._layout.friction, modes.friction, self._equations.offsets, strict=True):
            if mode is not None and len(mode.held):
                margins.append(friction_margin(one, mode, force, np.full(len(force), offset)))
        return np.asarray(np.min(margins, axis=0))

    def room(self, stepper: Stepper) -> float:
        """Return the margin that undetermined forces, as chosen, keep now, over the forces; infinite without any."""
        scales = [watch.scale for watch in self.watches if watch.kind == "group"]
        return float(self._least_margin(stepper.modes, stepper.forces()[None])[0] / scales[0]) if scales else np.inf

    def _of_friction(self, kind: str, j: int, stepper: Stepper, seen: ObservedRows) -> Array:
        one, mode, heading = self._layout.friction[j], stepper.modes.friction[j], stepper.modes.heading[j]
        slip = seen.u[:, list(one.rows)]
        assert mode is not None
        if kind == "margin":
            return friction_margin(one, mode, seen.force, seen.offset[:, j])
        assert heading is not None
        if kind == "slip":
            return np.asarray(slip @ heading)
        vertices = one.vertices
        assert vertices is not None
        at = int(np.argmax(vertices @ mode.drag))
        beside = vertices[[at - 1, (at + 1) % len(vertices)]]
        return np.asarray(np.min(-slip @ (vertices[at] - beside).T, axis=1))
