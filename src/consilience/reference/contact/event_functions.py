"""Event functions of the modes of a motion with contacts, at any state (`events` lists them)."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.events import ARMED, ROUNDING, Watch, friction_margin
from consilience.reference.contact.lasting import LastingContact, sliding_rates, widest_margin
from consilience.reference.contact.row_modes import RowModes
from consilience.reference.contact.stepper import Stepper

_LEAST_FORCE = 1e-3
"""Least scale of forces, over the weight of all bodies."""

CLEAR = 1e-2
"""Margin of undetermined forces, over the forces, from which it stands for the widest, whose sign it has."""

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

    def renew(self, found: LastingContact, stepper: Stepper, speed: float) -> None:
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
                watches.append(Watch("slip", j, speed))
                if layout.friction[j].facets and not len(mode.held):
                    watches.append(Watch("turn", j, speed))
        flying = {w.index for w, armed in zip(self.watches, self.armed, strict=True) if w.kind == "gap" and armed}
        self.watches = watches
        values, rates = self.at(stepper.t, stepper.y, stepper)
        self.armed = np.array([v > ARMED * w.scale for v, w in zip(values, watches, strict=True)], dtype=bool)
        noise = ROUNDING * ARMED * np.array([w.scale for w in watches])
        self.armed |= (np.nan_to_num(rates) > _RISING * speed) & (values >= -noise)
        self.armed |= np.array([w.kind == "gap" and w.index in flying for w in watches], dtype=bool) & (values > noise)

    def at(self, t: float, y: Array, stepper: Stepper) -> tuple[Array, Array]:
        """Return the event functions, and their rates where known (else NaN), at a packed state near the last one."""
        layout, equations = self._layout, self._equations
        p = np.zeros(0)
        if any(w.kind in ("normal", "margin", "group") for w in self.watches):
            p = equations.row_forces(t, y, stepper.turns)
        else:
            equations.move(t, y, stepper.turns)
        rows = equations.rows
        values, rates = np.empty(len(self.watches)), np.full(len(self.watches), np.nan)
        for w, watch in enumerate(self.watches):
            k = watch.index
            if watch.kind == "gap":
                values[w], rates[w] = rows.gap[layout.gaps[k]], rows.u[layout.normals[k]]
            elif watch.kind == "normal":
                values[w] = p[layout.normals[k]]
            elif watch.kind in ("touch", "spring"):
                values[w], rates[w] = self._of_spring(watch.kind, k)
            elif watch.kind == "group":
                values[w] = self._of_group(t, y, stepper, p, watch.scale)
            else:
                values[w] = self._of_friction(watch.kind, k, stepper, p)
        return values, rates

    def _of_spring(self, kind: str, s: int) -> tuple[float, float]:
        """Return the force of a compliant contact, or its gap; where shapes overlap, by how much it would pull."""
        part = self._layout.springs[s]
        law, rows = self._layout.parts[part].compliance, self._equations.rows
        gap, rate = float(rows.gap[part]), float(rows.u[3 * part])
        if kind == "spring":
            return self._equations.spring_force(s), np.nan if law.damping else -law.stiffness * rate
        return (gap, rate) if gap > 0.0 else (gap + law.damping / law.stiffness * rate, np.nan)

    def _of_group(self, t: float, y: Array, stepper: Stepper, p: Array, scale: float) -> float:
        """Return the margin of forces that are undetermined: the widest, where those that were chosen leave doubt."""
        least = self._least_margin(stepper.modes, p)
        if least > CLEAR * scale:
            return least
        response, sliding = stepper.respond(t, y), sliding_rates(self._equations, stepper.modes, 0.0)
        return widest_margin(self._equations, response, stepper.modes, sliding)[0]

    def _least_margin(self, modes: RowModes, p: Array) -> float:
        """Return the least margin of forces on all rows."""
        margins = [float(p[n]) for n, closed in zip(self._layout.normals, modes.closed, strict=True) if closed]
        for j, (one, mode) in enumerate(zip(self._layout.friction, modes.friction, strict=True)):
            if mode is not None and len(mode.held):
                margins.append(friction_margin(one, mode, p, float(self._equations.offsets[j])))
        return min(margins)

    def in_doubt(self, stepper: Stepper, clear: float) -> bool:
        """Return whether undetermined forces, as chosen, keep at most a margin, over the forces, now."""
        scales = [watch.scale for watch in self.watches if watch.kind == "group"]
        return bool(scales) and self._least_margin(stepper.modes, stepper.forces()) <= clear * scales[0]

    def _of_friction(self, kind: str, j: int, stepper: Stepper, p: Array) -> float:
        one, mode, heading = self._layout.friction[j], stepper.modes.friction[j], stepper.modes.heading[j]
        slip = self._equations.rows.u[list(one.rows)]
        assert mode is not None
        if kind == "margin":
            return friction_margin(one, mode, p, float(self._equations.offsets[j]))
        assert heading is not None
        if kind == "slip":
            return float(heading @ slip)
        vertices = one.vertices
        assert vertices is not None
        at = int(np.argmax(vertices @ mode.drag))
        beside = vertices[[at - 1, (at + 1) % len(vertices)]]
        return float(np.min((vertices[at] - beside) @ -slip))
