"""Routh's path of a single impact with friction, velocities as functions of the normal impulse (Keller 1986).

While the contact slides, u being the relative velocity and G the Delassus matrix of the contact,

    du/dN = G (n + T),     T = -mu u_t/|u_t|;

once it has stopped it sticks if the cone allows, or slides on in one direction. In Poisson's law the impulse of
restitution is e times that of compression, which ends where u_n = 0.

With the slip s and its heading phi, and ``dN = s dsigma``, nothing is stiff where s falls to zero:
``ds/dsigma = s a_s(phi)``, ``dphi/dsigma = a_phi(phi)``, with a the rate of u for that heading. Where a_phi is zero the
path is straight, and the slope there is ``a_phi' = -(a_s + mu G_cc)``, with G_cc of the direction across. So a heading
draws the slip in unless the slip falls fast, and near the least friction that sticks (a_s = 0) it does so while a slow
slip hardly changes until its end at ``sigma = N/s``, far away: from there on the path is followed as a straight line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.decision import decide
from consilience.reference.contact.problem import ContactProblem, FrictionSet

_STOPPED = 1e-15
"""Velocity at rounding level, relative to that before: rest; the impulse to come differs by as little."""

_STRAIGHT = 1e-13
"""Angle to a constant heading, rad, up to which the path is straight, as good as it is integrated."""

_NEAR = 1e-6
"""The same where the slip across that heading is at rounding level."""

_ROUNDING = 1e-15
"""Rates of the velocity at rounding level, relative to the largest entry of G."""

_WEDGED = 1e-11
"""Velocity along the normal and its rate, as above, of what joints and friction wedge: it ends with the slip."""

_MOST = 200_000
"""Evaluations of the rates along one path."""


@dataclass(frozen=True, eq=False)
class _Point:
    """Impulse (N, T) and velocity (n, t1, t2) on the path."""

    p: Array
    u: Array


@dataclass(frozen=True, eq=False)
class _Contact:
    """Delassus matrix, its largest entry being one, and friction; velocities are relative to that before."""

    G: Array
    mu: float
    name: str

    def direction(self, phi: float) -> Array:
        """Return impulses per normal impulse while it slides with a heading."""
        return np.array([1.0, -self.mu * np.cos(phi), -self.mu * np.sin(phi)])

    def turning(self, phi: float) -> tuple[float, float]:
        """Return a_phi and its slope."""
        along, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
        a = self.G[1:] @ self.direction(phi)
        return float(across @ a), -float(along @ a) - self.mu * float(across @ self.G[1:, 1:] @ across)

    def bend(self, slip: float, phi: float) -> float:
        """Return how far a_phi exceeds that of a straight path; not positive where the path is straight."""
        turn, slope = self.turning(phi)
        near = max(_STRAIGHT, min(_NEAR, _STOPPED / slip))
        return abs(turn) - max(near * abs(slope), _ROUNDING * (1.0 + self.mu))

    def constant(self, phi: float) -> float:
        """Return the constant heading next to one that is near it."""
        for _ in range(4):
            turn, slope = self.turning(phi)
            if _ROUNDING * (1.0 + self.mu) < abs(turn) < 2.0 * _NEAR * abs(slope):
                phi -= turn / slope
        return phi


def poisson_path(G: Array, before: Array, friction: FrictionSet, restitution: float) -> Array:
    """Return the impulse of an impact by Poisson's law.

    Parameters
    ----------
    G : ndarray, shape (3, 3)
        Delassus matrix of n, t1, t2.
    before : ndarray, shape (3,)
        Velocity before, ``before[0] < 0``.
    friction : FrictionSet
        Circle; its coefficient of sliding is used throughout.
    restitution : float

    Returns
    -------
    ndarray, shape (3,)
    """
    size, unit = float(np.max(np.diag(G))), float(np.linalg.norm(before))
    if size <= 0.0:
        raise NumericalFailure(f"{friction.name}: no impulse moves it, compression has no end")
    contact = _Contact(G / size, friction.kinetic, friction.name)
    point, direction = _follow(contact, _Point(np.zeros(3), before / unit), None)
    until = (1.0 + restitution) * float(point.p[0])
    if direction is None:
        point, _ = _follow(contact, point, until)
    else:
        point = _go(contact, point, direction, until)
    return point.p * (unit / size)


def _follow(contact: _Contact, point: _Point, until: float | None) -> tuple[_Point, Array | None]:
    """Follow the path to a normal impulse, or to the end of compression; where it has been at rest, its direction."""
    slip, phi = float(np.hypot(point.u[1], point.u[2])), float(np.arctan2(point.u[2], point.u[1]))
    if slip > _STOPPED and contact.bend(slip, phi) > 0.0:
        point = _slide(contact, point, until)
        slip, phi = float(np.hypot(point.u[1], point.u[2])), float(np.arctan2(point.u[2], point.u[1]))
    if slip > _STOPPED and not _ended(point, until):
        phi = contact.constant(phi)
        point = _go(contact, point, contact.direction(phi), until, slip * np.array([np.cos(phi), np.sin(phi)]))
    if _ended(point, until):
        return point, None
    direction = _from_rest(contact)
    wedged = until is None and abs(float(contact.G[0] @ direction)) <= _WEDGED and point.u[0] >= -_WEDGED
    return (point if wedged else _go(contact, point, direction, until)), direction


def _from_rest(contact: _Contact) -> Array:
    """Return the direction of the path from rest in the plane: it sticks, or slides in one direction, for good."""
    start = FrictionSet(contact.name, (0, 1), contact.mu, contact.mu, offset=1.0)
    G = contact.G
    force = decide(ContactProblem(G[1:, 1:], G[1:, 0], (contact.name,) * 2, (), (start,))).force
    return np.concatenate([[1.0], force])


def _ended(point: _Point, until: float | None) -> bool:
    """Return whether a point is the end of the path: rounding may leave it short of that."""
    return bool(point.u[0] >= -_STOPPED if until is None else point.p[0] >= until * (1.0 - _STOPPED))


def _go(contact: _Contact, point: _Point, direction: Array, until: float | None, slip: Array | None = None) -> _Point:
    """Follow a straight path to its end, or to where the slip, shape (2,), stops; without it from rest."""
    rate = contact.G @ direction
    if until is not None:
        length = until - float(point.p[0])
    else:
        length = -float(point.u[0] / rate[0]) if rate[0] > _ROUNDING else np.inf
    start = np.zeros(2) if slip is None else slip
    along, stops = float(start @ rate[1:]), False
    if along < 0.0 and float(start @ start) <= -along * length:
        length, stops = float(start @ start) / -along, True
    if not np.isfinite(length):
        raise NumericalFailure(f"{contact.name}: friction jams during the impact, compression has no end")
    u = point.u + length * rate
    u[1:] = 0.0 if stops else start + length * rate[1:]
    return _Point(point.p + length * direction, u)


def _slide(contact: _Contact, point: _Point, until: float | None) -> _Point:
    """Follow the path while it slides, to its end, to where the slip stops, or to where the rest is straight."""
    count = 0

    def rates(_: float, z: Array) -> Array:
        nonlocal count
        count += 1
        if count > _MOST:
            raise NumericalFailure(
                f"{contact.name}: Routh's path of the impact is not followed to its end; "
                f"the slip is {np.exp(z[0]):.3g} of the velocity before, and friction turns and changes it slowly"
            )
        s, phi = np.exp(z[0]), z[1]
        along, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
        direction = contact.direction(phi)
        a = contact.G @ direction
        return np.concatenate([[along @ a[1:], across @ a[1:], s * a[0]], s * direction])

    def arrives(_: float, z: Array) -> float:
        return float(z[2] if until is None else z[3] - until)

    def stops(_: float, z: Array) -> float:
        return float(z[0] - np.log(_STOPPED))

    def straightens(_: float, z: Array) -> float:
        return contact.bend(float(np.exp(z[0])), float(z[1]))

    for event, sense in ((arrives, 1.0), (stops, -1.0), (straightens, -1.0)):
        event.terminal, event.direction = True, sense  # type: ignore[attr-defined]
    slip, phi = np.hypot(point.u[1], point.u[2]), np.arctan2(point.u[2], point.u[1])
    z = np.concatenate([[np.log(slip), phi, point.u[0]], point.p])
    events = (arrives, stops, straightens)
    path = solve_ivp(rates, (0.0, 1.0 / _STOPPED**2), z, method="DOP853", events=events, rtol=1e-13, atol=1e-15)
    if path.status != 1:
        raise NumericalFailure(f"{contact.name}: Routh's path of the impact is not followed: {path.message}")
    z = path.y[:, -1]
    s = 0.0 if len(path.t_events[1]) else np.exp(z[0])
    u = np.array([z[2], s * np.cos(z[1]), s * np.sin(z[1])])
    if len(path.t_events[0]):  # the event is the end, whatever its rounding
        u[0], z[3] = (0.0, z[3]) if until is None else (u[0], until)
    return _Point(z[3:], u)
