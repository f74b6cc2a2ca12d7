"""Modes of closed contacts in an impact: equations of given modes, search for admissible modes.

`consilience.reference.contact.impact` tabulates the modes and their admissibility. For given modes the impact is one
linear system in the unknown impulses x, with ``p = S x`` and required velocities ``E u+ = c``:

    E G S x = c - E u-,     G = K K^T.

Violated modes are exchanged one at a time; if a combination recurs, one is guessed by Lemke's method, and then all are
tried, where they are not too many.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import Array, cross, orthogonal_triad
from consilience.reference.contact.complementarity import solve_lcp
from consilience.reference.contact.mode_system import least_singular
from consilience.reference.contact.problem import in_words

_SLACK = 1e-9
"""Tolerance of the conditions of a mode, relative to the velocities or impulses."""

_FACETS = 16
"""Vertices of the pyramid that stands for the circle of what does not slide before, where modes are guessed."""

_TURNS = 4
"""Times that friction found along the slip is turned against it."""

_MOST = 5
"""Largest number of contacts for which all combinations of modes are tried (at most 5 modes each)."""


MOREAU = "; Moreau's law has a solution: give impact_law = 'moreau' if you mean it"
"""What a guess by that law shows."""


@dataclass(frozen=True, eq=False)
class ClosedContacts:
    """Closed contacts and their response to impulses.

    Attributes
    ----------
    names : tuple of str, length n_c
    normal : ndarray, shape (n_c, 3)
    friction : ndarray, shape (n_c,)
    target : ndarray, shape (n_c,), m/s
        Least normal velocity b after the impact.
    before : ndarray, shape (n_c, 3), m/s
        Relative velocities of the contact points.
    compliance : ndarray, shape (3 n_c, 3 n_c), 1/kg
        G: change of the relative velocities per impulse.
    free_compliance : float, 1/kg
        Largest entry of G without the joints.
    at_rest : float, m/s
        Smaller speeds count as zero.
    """

    names: tuple[str, ...]
    normal: Array
    friction: Array
    target: Array
    before: Array
    compliance: Array
    free_compliance: float
    at_rest: float


@dataclass(frozen=True, eq=False)
class _Solved:
    """Impulses and velocities after, each (n_c, 3), and whether they satisfy the equations of their modes."""

    p: Array
    after: Array
    consistent: bool


class _ModeTrial:
    """Closed contacts with tangential frames; solves for given modes."""

    def __init__(self, law: ClosedContacts) -> None:
        self.law = law
        n = law.normal
        self.vt_before = law.before - np.sum(law.before * n, axis=1)[:, None] * n
        speed = np.linalg.norm(self.vt_before, axis=1)
        self.slides = speed > law.at_rest
        self.vt_before[~self.slides] = 0.0
        # t1 opposes the sliding, or is any tangent
        self.t1 = np.array(
            [
                -vt / s if slides else _unit(orthogonal_triad(m)[0])
                for vt, s, slides, m in zip(self.vt_before, speed, self.slides, n, strict=True)
            ]
        ).reshape(-1, 3)
        self.t2 = np.array([cross(a, b) for a, b in zip(n, self.t1, strict=True)]).reshape(-1, 3)

    def choices(self, k: int) -> tuple[str, ...]:
        """Return the possible modes of contact k in the order of preference."""
        if self.law.friction[k] == 0.0:
            return ("frictionless", "released")
        if self.slides[k]:
            return ("sliding", "sticking", "halted", "unopposed", "released")
        return ("sticking", "starting", "released")

    def started(self, modes: tuple[str, ...]) -> tuple[str, ...]:
        """Return the modes in which what slides after the impact alone starts to."""
        return tuple(
            "starting" if mode == "sliding" and not slides else mode
            for mode, slides in zip(modes, self.slides, strict=True)
        )

    def solve(self, modes: tuple[str, ...]) -> _Solved:
        """Solve the equations of given modes."""
        starting = [k for k, mode in enumerate(modes) if mode == "starting"]
        if not starting:
            return self._linear(modes, self.t1)
        return self._with_new_sliding(modes, starting)

    def _linear(self, modes: tuple[str, ...], t: Array) -> _Solved:
        """Solve with friction directions t of the sliding contacts."""
        law, columns, rows, required = self.law, [], [], []
        for k, mode in enumerate(modes):
            n, b, zero = law.normal[k], law.target[k], 0.0
            along_t1, along_t2 = (self.t1[k], self.t1[k], zero), (self.t2[k], self.t2[k], zero)
            equations = {
                "released": (),
                "frictionless": ((n, n, b),),
                "unopposed": ((n, n, b),),
                "sliding": ((n + law.friction[k] * t[k], n, b),),
                "starting": ((n + law.friction[k] * t[k], n, b),),
                "halted": ((n, n, b), along_t1),
                "sticking": ((n, n, b), along_t1, along_t2),
            }[mode]
            for impulse, velocity, value in equations:
                columns.append(_at(impulse, k, len(modes)))
                rows.append(_at(velocity, k, len(modes)))
                required.append(value)
        if not rows:
            return _Solved(np.zeros_like(law.before), law.before, True)
        S, E = np.array(columns).T, np.array(rows)
        rest = np.array(required) - E @ law.before.ravel()
        system = E @ law.compliance @ S
        U, singular, Vt = np.linalg.svd(system)
        rank = int(np.sum(singular > least_singular(singular[0] / law.free_compliance) * law.free_compliance))
        inverse = Vt[:rank].T / singular[:rank] @ U[:, :rank].T
        x = inverse @ rest
        x += inverse @ (rest - system @ x)
        missed = float(np.max(np.abs(system @ x - rest)))
        p = S @ x
        after = law.before.ravel() + law.compliance @ p
        consistent = missed <= max(_SLACK * float(np.max(np.abs(rest))), law.at_rest)
        return _Solved(p.reshape(-1, 3), after.reshape(-1, 3), consistent)

    def _with_new_sliding(self, modes: tuple[str, ...], starting: list[int]) -> _Solved:
        """Solve for the friction directions of starting contacts, opposite to their sliding."""
        stuck = self._linear(tuple("sticking" if m == "starting" else m for m in modes), self.t1)

        def directions(angles: Array) -> Array:
            t = self.t1.copy()
            for k, angle in zip(starting, angles, strict=True):
                t[k] = np.cos(angle) * self.t1[k] + np.sin(angle) * self.t2[k]
            return t

        def across(angles: Array) -> Array:
            t = directions(angles)
            after = self._linear(modes, t).after
            return np.array([cross(self.law.normal[k], t[k]) @ after[k] for k in starting])

        guess = np.array([np.arctan2(self.t2[k] @ stuck.p[k], self.t1[k] @ stuck.p[k]) for k in starting])
        scale = max(float(np.max(np.abs(self.law.before))), self.law.at_rest)
        for _ in range(_TURNS):
            if np.max(np.abs(across(guess))) > 1e-15 * scale:
                guess = scipy.optimize.root(lambda angles: across(angles) / scale, guess, tol=1e-14).x
            t = directions(guess)
            solved = self._linear(modes, t)
            driven = [float(t[k] @ solved.after[k]) > _SLACK * scale for k in starting]
            if not any(driven):
                break
            guess = guess + np.pi * np.array(driven)
        parallel = float(np.max(np.abs(across(guess)))) <= _SLACK * scale
        return _Solved(solved.p, solved.after, solved.consistent and parallel)

    def conditions(self, k: int, mode: str, solved: _Solved) -> tuple[tuple[bool, str], ...]:
        """Return the conditions of a mode of contact k: violated or not, and the mode to try next.

        ``first``: the preferred mode of the contact; ``beyond``: the mode if the contact cannot stick.
        """
        law, n, p, after = self.law, self.law.normal[k], solved.p[k], solved.after[k]
        p_slack = _SLACK * float(np.max(np.abs(solved.p)))
        v_slack = _SLACK * max(float(np.max(np.abs(law.before))), float(np.max(np.abs(solved.after))))
        N, vn = float(n @ p), float(n @ after)
        pt, vt, cone = p - N * n, after - vn * n, float(law.friction[k]) * N
        along, beta = -float(self.t1[k] @ vt), float(self.t1[k] @ pt)
        least_power = p_slack * v_slack / _SLACK
        pulls = (-p_slack > N, "released")
        cannot_stick = float(np.linalg.norm(pt)) > cone + p_slack or float(pt @ self.vt_before[k]) > least_power
        return {
            "released": ((vn - law.target[k] < -v_slack, "first"),),
            "frictionless": (pulls,),
            "sliding": (pulls, (along < -v_slack, "sticking")),
            "sticking": (pulls, (cannot_stick, "beyond")),
            "halted": (pulls, (beta > cone + p_slack, "sliding"), (beta < -p_slack, "unopposed")),
            "unopposed": (pulls, (along > v_slack, "sliding")),
            "starting": (pulls, (float(pt @ vt) > least_power, "sticking")),
        }[mode]


def _unit(a: Array) -> Array:
    return a / np.linalg.norm(a)


def _at(vector: Array, k: int, count: int) -> Array:
    row = np.zeros(3 * count)
    row[3 * k : 3 * k + 3] = vector
    return row


def _exchanges(trial: _ModeTrial, modes: tuple[str, ...], solved: _Solved) -> Iterator[tuple[int, str]]:
    """Yield contacts with a violated mode and the mode to try next; normal conditions before tangential ones."""
    if not solved.consistent:
        yield _loosened(trial, modes, solved)
    for wanted in (("released",), ("released", "first"), None):
        for k, mode in enumerate(modes):
            for violated, following in trial.conditions(k, mode, solved):
                if violated and (wanted is None or following in wanted):
                    first, *_ = trial.choices(k)
                    beyond = "halted" if trial.slides[k] else "starting"
                    yield k, {"first": first, "beyond": beyond}.get(following, following)


def solve_modes(
    law: ClosedContacts, time: float, guesses: Iterable[tuple[str, ...]] = ()
) -> tuple[tuple[str, ...], Array, Array]:
    """Find admissible modes of closed contacts.

    Parameters
    ----------
    law : ClosedContacts
    time : float, s
        For messages.
    guesses : iterable of tuple of str
        Modes to begin with, where the preferred ones lead nowhere.

    Returns
    -------
    modes : tuple of str, length n_c
    p : ndarray, shape (n_c, 3), N s
        Impulses on the bodies, world axes.
    after : ndarray, shape (n_c, 3), m/s
        Relative velocities of the contact points.

    Raises
    ------
    NumericalFailure
        If no combination is admissible.
    """
    if not law.names:
        return (), np.zeros((0, 3)), np.zeros((0, 3))
    trial = _ModeTrial(law)
    preferred = tuple(trial.choices(k)[0] for k in range(len(law.names)))
    found = _by_exchange(trial, preferred) or _by_guess(trial) or _by_enumeration(trial)
    if found is not None:
        return found
    told = ""
    for guess in guesses:
        found = _by_exchange(trial, trial.started(guess))
        if found is not None:
            return found
        told = MOREAU
    tried = "is admissible" if len(law.names) <= _MOST else "that was tried is admissible"
    raise NumericalFailure(
        f"impact at t = {time:.12g} s: no combination of sliding, sticking and released contacts {tried} "
        f"for {in_words(law.names)}: the bodies are wedged, or driven together with nothing that gives way, and no "
        f"rigid motion goes on from here (with a compliance in one of the contacts it does), or restitution asks for "
        f"what the joints forbid{told}"
    )


def _loosened(trial: _ModeTrial, modes: tuple[str, ...], solved: _Solved) -> tuple[int, str]:
    """Choose the contact to loosen if the equations are inconsistent: friction first, then the largest gap rate."""
    for k, mode in enumerate(modes):
        if mode == "sticking":
            return k, "halted" if trial.slides[k] else "starting"
        if mode == "halted":
            return k, "unopposed"
    law, held = trial.law, [k for k, mode in enumerate(modes) if mode != "released"]
    return max(held, key=lambda k: float(law.normal[k] @ solved.after[k]) - law.target[k]), "released"


def _by_exchange(trial: _ModeTrial, modes: tuple[str, ...]) -> tuple[tuple[str, ...], Array, Array] | None:
    """Exchange violated modes until none is left; None if a combination recurs."""
    seen: set[tuple[str, ...]] = set()
    while modes not in seen:
        seen.add(modes)
        solved = trial.solve(modes)
        exchange = next(_exchanges(trial, modes, solved), None)
        if exchange is None:
            return modes, solved.p, solved.after
        k, mode = exchange
        modes = (*modes[:k], mode, *modes[k + 1 :])
    return None


def _by_guess(trial: _ModeTrial) -> tuple[tuple[str, ...], Array, Array] | None:
    """Exchange the modes guessed by Lemke's method until none is violated; None if it leads nowhere."""
    guess = _guessed(trial)
    return None if guess is None else _by_exchange(trial, guess)


def _guessed(trial: _ModeTrial) -> tuple[str, ...] | None:
    """Guess modes from the linear complementarity problem of Stewart and Trinkle (1996).

    Friction of what slides before opposes that slip alone; the circles of all else are pyramids.
    """
    law, n = trial.law, len(trial.law.names)
    rough = np.flatnonzero(law.friction > 0.0).tolist()
    turns = 2.0 * np.pi / _FACETS * np.arange(_FACETS)
    around = [turns[:1] if trial.slides[k] else turns for k in rough]
    owner = np.repeat(np.arange(len(rough)), [len(one) for one in around])
    normals = [_at(law.normal[k], k, n) for k in range(n)]
    tangents = [
        _at(np.cos(angle) * trial.t1[k] + np.sin(angle) * trial.t2[k], k, n)
        for k, angles in zip(rough, around, strict=True)
        for angle in angles
    ]
    F, forces = np.array(normals + tangents), n + len(owner)
    M, q = np.zeros((forces + len(rough),) * 2), np.zeros(forces + len(rough))
    M[:forces, :forces] = F @ law.compliance @ F.T / law.free_compliance
    M[np.arange(n, forces), forces + owner], M[forces + owner, np.arange(n, forces)] = 1.0, -1.0
    M[forces + np.arange(len(rough)), rough] = law.friction[rough]
    q[:forces] = F @ law.before.ravel()
    q[:n] -= law.target
    z = solve_lcp(M, q / (float(np.max(np.abs(q))) or 1.0), np.ones(len(q)))
    if z is None:
        return None
    least = _SLACK * float(np.max(z[:forces]))
    modes = np.where(z[:n] > least, "frictionless", "released").tolist()
    for c, k in enumerate(rough):
        if modes[k] == "released":
            continue
        if z[forces + c] > _SLACK:  # the slip after
            modes[k] = "sliding" if trial.slides[k] else "starting"
        elif trial.slides[k]:
            modes[k] = "halted" if np.any(z[n:forces][owner == c] > least) else "unopposed"
        else:
            modes[k] = "sticking"
    return tuple(modes)


def _by_enumeration(trial: _ModeTrial) -> tuple[tuple[str, ...], Array, Array] | None:
    """Try all combinations of modes."""
    if len(trial.law.names) > _MOST:
        return None
    for modes in product(*(trial.choices(k) for k in range(len(trial.law.names)))):
        solved = trial.solve(modes)
        if next(_exchanges(trial, modes, solved), None) is None:
            return modes, solved.p, solved.after
    return None
