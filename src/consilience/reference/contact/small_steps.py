"""Slips that stop: alone at once, or together with what acts on them in a small step at velocity level.

A slip that stops is set to zero, and the modes are decided by accelerations: that is right where no other slip takes
notice. Near rest it may. Slips of several contacts of one body vanish together, or in an order that lasts 1e-9 s; and
rows of contacts that nearly depend on one another, as under compliance, turn small slips into large velocities when
they are held. There the impulses p of a step of length h are those of Moreau (1988), with free the rates at its end
without them,

    u+ = free + G p,     0 <= p_n _|_ u_n+ >= 0,     p_t in (p_n + h offset) mu D maximises -p_t . u_t+ :

which slips stop, and which go on and where to, is one problem. Where normal forces are given it is convex (the least of
``1/2 p . G p + free . p`` in the cones), and has one answer. No impulse is more than the laws allow in the time h. The
step changes no rate by more than `SMALL` of the speeds; its error is of the order of its square.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.decision import decide
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.events import friction_margin
from consilience.reference.contact.joint_friction import with_offsets
from consilience.reference.contact.lasting import LastingContact, all_modes, telling_time
from consilience.reference.contact.problem import ContactProblem, Modes, in_words
from consilience.reference.contact.projections import PATIENT_SWEEPS, SWEEPS, friction_table, project_impulses
from consilience.reference.contact.quiet_steps import STARTING, STILL
from consilience.reference.contact.response import Response
from consilience.reference.contact.slip_headings import STOPPED
from consilience.reference.contact.speeds import fastest
from consilience.reference.contact.stepper import Stepper

SMALL = 1e-9
"""Change of the rates of friction in a small step, over the speeds."""

_LONGEST = 16.0
"""Length of small steps that follow one another, over that of the first."""

_NEAR, _MOST = 1e-6, 1000
"""Time, over the motion, within which slips may change by so many small steps."""

_LEVER, _TURNED = 10.0, 1e-4
"""Changes of velocities over what stops, and of other slips over these, with which a halt disturbs others."""

_AT_BOUND = 1e-9
"""Margin of friction at its bound, over the friction."""


class SmallSteps:
    """Halts and small steps of one motion."""

    def __init__(self, equations: ContactEquations, stepper: Stepper, span: float, length: float) -> None:
        self._equations, self._stepper, self._near = equations, stepper, _NEAR * span
        self._length = length
        self._first, self._last, self._count, self._longer = -np.inf, -np.inf, 0, 1.0

    def take(self, touching: Array, speed: float, bound: float) -> tuple[LastingContact, list[int]]:
        """Take a small step, at most to the time `bound`; return its modes, and the friction sets that start from rest.

        Parameters
        ----------
        touching : ndarray of bool, shape (n_n,)
            Closed normals.
        speed : float, m/s
            Beside which slips are small.
        bound : float, s
        """
        equations, stepper = self._equations, self._stepper
        response, forces = stepper.respond(stepper.t, stepper.y), stepper.forces()
        friction, u = equations.layout.friction, equations.rows.u.copy()
        _, rows, sets = equations.problem(response, touching, u)
        at = [row for j in sets for row in friction[j].rows]
        most = max(float(np.max(np.abs(a[at]))) for a in (response.free, response.accelerations(forces)))
        self._count_one([friction[j].name for j in sets])
        h = min(self._longer * SMALL * speed / most, bound - stepper.t)
        free = replace(response, free=u + h * response.free, pull=float(np.sqrt(2.0 * equations.energy(stepper.y))))
        problem, _, _ = equations.problem(free, touching, np.zeros(len(u)))
        problem = with_offsets(problem, {k: h * float(equations.offsets[j]) for k, j in enumerate(sets)})
        with telling_time(stepper.t):
            p, decided, several = _impulses(problem)
        impulse = h * response.given
        impulse[rows] += p
        stepper.step_by(h, impulse, response)
        self._last = stepper.t
        u[rows] = problem.acceleration(p)
        modes = all_modes(equations, decided, np.flatnonzero(touching), sets, u)
        slow = [float(np.linalg.norm(u[list(one.rows)])) <= STARTING * speed for one in friction]
        lines = [j for j, heading in enumerate(modes.heading) if heading is not None and slow[j]]
        return LastingContact(modes, impulse / h, response.accelerations(impulse / h), None, several), lines

    def halt(
        self, stopped: frozenset[int], sliding: Array, touching: Array, speeds: tuple[float, float]
    ) -> tuple[list[int], Response] | None:
        """Halt friction sets, in `sliding` too, with those that move no more then; return their rows, and the response.

        None, and nothing is halted, where that disturbs others.

        What moves as one stops as one: what is nearly at rest, and what is without those. What does not touch has no
        part in it: a point that is slow while it flies would be held.
        """
        stepper, still = self._stepper, STOPPED * speeds[0]
        layout, pressed = self._equations.layout, self._equations.pressed
        apart = {row for row, touches in zip(layout.normals, touching, strict=True) if not touches}
        apart |= {3 * k for k, carries in zip(layout.springs, pressed, strict=True) if not carries}
        sets = {j: list(one.rows) for j, one in enumerate(layout.friction) if one.load not in apart}
        at_rest = {j for j, at in sets.items() if j in stopped or float(np.linalg.norm(sliding[at])) <= still}
        y, before = stepper.y.copy(), self._equations.rows.u.copy()
        stepper.halt([row for j in at_rest for row in sets[j]])
        response = stepper.respond(stepper.t, stepper.y)
        u = self._equations.rows.u  # without them
        at_rest |= {j for j, at in sets.items() if float(np.linalg.norm(u[at])) <= STILL * speeds[1]}
        others = [at for j, at in sets.items() if j not in at_rest and np.any(sliding[at])]
        turned = [np.linalg.norm(u[at] - before[at]) > _TURNED * np.linalg.norm(sliding[at]) for at in others]
        moved = fastest(self._equations, stepper.y - y, self._length) > _LEVER * still
        if (moved or any(turned)) and not self._equations.reacting:
            stepper.place(y, np.zeros((len(layout.mechanism.contacts), 3)), 0.0)
            return None
        halted = [row for j in sorted(at_rest) for row in sets[j]]
        sliding[halted] = 0.0
        return halted, response

    def _count_one(self, names: list[str]) -> None:
        """Count a step, and let steps that follow one another grow; refuse slips that go on so without end.

        Raises
        ------
        NumericalFailure
        """
        t = self._stepper.t
        self._longer = min(2.0 * self._longer, _LONGEST) if t == self._last else 1.0
        if t > self._first + self._near:
            self._first, self._count = t, 0
        self._count += 1
        if self._count > _MOST:
            raise NumericalFailure(
                f"{in_words(names)}, t = {t:.12g} s: slips stop, start and turn {_MOST} times in "
                f"{_NEAR:.0e} of the motion, as where contacts of one body come to rest under compliance; end the "
                "motion before, or let fewer of them have friction"
            )


def _impulses(problem: ContactProblem) -> tuple[Array, Modes, bool]:
    """Return the impulses of a step, their modes, and whether they are undetermined.

    Successive projections guess modes that a search begins with; where it ends nowhere, as where rows nearly depend on
    one another, they go on.

    Raises
    ------
    NumericalFailure
        If they do not converge either.
    """
    law = friction_table(problem.friction, problem.normals)
    offsets, closed = np.array([one.offset for one in problem.friction]), np.zeros(len(problem.free), dtype=np.bool_)
    closed[list(problem.normals)] = True
    p = np.zeros(len(problem.free))
    project_impulses(problem.delassus, problem.free, law, offsets, closed, SWEEPS, p)
    try:
        found = decide(problem, _modes_of(problem, p))
    except NumericalFailure:
        if not project_impulses(problem.delassus, problem.free, law, offsets, closed, PATIENT_SWEEPS, p):
            raise
        return p, _modes_of(problem, p), False
    return found.force, found.modes, bool(found.undetermined.shape[1])


def _modes_of(problem: ContactProblem, p: Array) -> Modes:
    """Return the modes of impulses: what is within its bound sticks."""
    modes = problem.natural_modes()
    for i, n in enumerate(problem.normals):
        modes = modes if p[n] > 0.0 else modes.opened(i)
    for k, one in enumerate(problem.friction):
        T = p[list(one.rows)]
        margin = float(friction_margin(one, modes.friction[k], p[None], np.array([one.offset]))[0])
        if np.any(T) and margin <= _AT_BOUND * float(np.linalg.norm(T)):
            modes = modes.with_friction(k, one.sliding(-T))
    return modes
