"""Routh's path of a single impact with friction, velocities as functions of the normal impulse (Keller 1986).

While the contact slides, u being the relative velocity and G the Delassus matrix of the contact,

    du/dN = G (n + T),     T = -mu u_t/|u_t|;

once it has stopped it sticks if the cone allows, or slides on in one direction. In Poisson's law the impulse of
restitution is e times that of compression, which ends where u_n = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.decision import decide
from consilience.reference.contact.problem import ContactProblem, FrictionSet

_STOPPED = 1e-16
"""Slip, relative to the velocity before, at which sliding has come to rest; the impulse to come is as small."""


@dataclass(frozen=True, eq=False)
class _Point:
    """Impulse (N, T) and velocity (n, t1, t2) on the path."""

    p: Array
    u: Array


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
    point = _follow(G, _Point(np.zeros(3), before), friction, None)
    return _follow(G, point, friction, (1.0 + restitution) * float(point.p[0])).p


def _follow(G: Array, point: _Point, friction: FrictionSet, until: float | None) -> _Point:
    """Follow the path to a normal impulse, or to the end of compression."""
    unit = float(np.linalg.norm(point.u))
    if np.linalg.norm(point.u[1:]) > _STOPPED * unit:
        point, ended = _slide(G, point, friction.kinetic, until)
        if ended:
            return point
    # from rest in the plane the path is straight: it sticks, or slides in one direction
    start = FrictionSet(friction.name, (0, 1), friction.kinetic, friction.kinetic, offset=1.0)
    force = decide(ContactProblem(G[1:, 1:], G[1:, 0], (friction.name,) * 2, (), (start,))).force
    direction = np.concatenate([[1.0], force])
    rate = G @ direction
    length = -point.u[0] / rate[0] if until is None else until - point.p[0]
    if length < 0.0:
        raise NumericalFailure(f"contact {friction.name}: friction jams during the impact, compression has no end")
    return _Point(point.p + length * direction, point.u + length * rate)


def _slide(G: Array, point: _Point, mu: float, until: float | None) -> tuple[_Point, bool]:
    """Follow the path while it slides; whether its end was reached before the slip stopped.

    With the slip s and its heading phi, and ``dN = s dsigma``, nothing is stiff where s falls to zero:
    ``ds/dsigma = s a_s(phi)``, ``dphi/dsigma = a_phi(phi)``, with a the rate of u for that heading.
    """
    slip, unit = float(np.linalg.norm(point.u[1:])), float(np.linalg.norm(point.u))

    def rates(_: float, z: Array) -> Array:
        s, phi = np.exp(z[0]), z[1]
        along, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
        direction = np.concatenate([[1.0], -mu * along])
        a = G @ direction
        return np.concatenate([[along @ a[1:], across @ a[1:], s * a[0]], s * direction])

    def arrives(_: float, z: Array) -> float:
        return float(z[2] if until is None else z[3] - until)

    def stops(_: float, z: Array) -> float:
        return float(z[0] - np.log(_STOPPED * unit))

    arrives.terminal = stops.terminal = True  # type: ignore[attr-defined]
    arrives.direction = 1.0  # type: ignore[attr-defined]
    heading = float(np.arctan2(point.u[2], point.u[1]))
    z = np.concatenate([[np.log(slip), heading, point.u[0]], point.p])
    scale = 1e4 / float(np.max(np.diag(G)))
    path = solve_ivp(rates, (0.0, scale), z, method="DOP853", events=(arrives, stops), rtol=1e-13, atol=1e-15 * unit)
    if path.status != 1:
        raise NumericalFailure("an impact with friction does not end along Routh's path: friction jams")
    z = path.y[:, -1]
    s = 0.0 if len(path.t_events[1]) else float(np.exp(z[0]))
    u = np.array([z[2], s * np.cos(z[1]), s * np.sin(z[1])])
    return _Point(z[3:], u), not len(path.t_events[1])
