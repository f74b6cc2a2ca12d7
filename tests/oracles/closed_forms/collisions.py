"""Collisions and contacts whose motion is piecewise of constant acceleration, and steady motions on a plane."""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq


def rough_spheres(m, r, I, restitution, mu, v, w, n):
    """Velocities and spins, each (2, 3), after two spheres of isotropic inertia collide; n points to the first.

    The tangential inverse mass is ``1/m + r^2/I`` of both; the impulse grips if ``mu J_n`` allows it.
    """
    m, r, I, v, w = (np.array(x, dtype=float) for x in (m, r, I, v, w))
    arms = np.array([-r[0] * n, r[1] * n])
    u = v[0] + np.cross(w[0], arms[0]) - v[1] - np.cross(w[1], arms[1])
    normal = -(1 + restitution) * (u @ n) / np.sum(1 / m)
    slip = u - (u @ n) * n
    speed = np.linalg.norm(slip)
    grip = speed / np.sum(1 / m + r**2 / I)
    J = normal * n - min(mu * normal, grip) * slip / max(speed, 1e-300)
    signs = np.array([1.0, -1.0])[:, None]
    return v + signs * J / m[:, None], w + signs * np.cross(arms, J) / I[:, None]


def balls_in_line(masses, gaps, restitution, speed, t):
    """Displacements and velocities along the line: the first ball moves, collisions follow one another through gaps.

    Gaps of zero are closed together: one collision of the balls that touch, in which no impulse pulls. For equal balls
    the first has ``(1 - (n - 1) e)/n`` of its speed after it, the others ``(1 + e)/n``; for others the impulses solve
    ``v'_k+1 - v'_k = -e (v_k+1 - v_k)`` at every contact.
    """
    m = np.array(masses, dtype=float)
    x, v, gap = np.zeros(len(m)), np.eye(len(m))[0] * speed, np.array(gaps, dtype=float)
    now = 0.0
    while True:
        closing = v[:-1] - v[1:]
        left = gap + x[1:] - x[:-1]
        waits = np.where(closing > 1e-12, np.maximum(left, 0.0) / np.where(closing > 1e-12, closing, 1.0), np.inf)
        until = float(np.min(waits))
        if now + until >= t:
            return x + v * (t - now), v
        x, now = x + v * until, now + until
        touching = np.flatnonzero(gap + x[1:] - x[:-1] < 1e-12)
        D = np.zeros((len(touching), len(m)))
        for row, k in enumerate(touching):
            D[row, k : k + 2] = -1.0, 1.0
        impulses = np.linalg.solve(D / m @ D.T, -(1 + restitution) * np.minimum(D @ v, 0.0))
        v = v + D.T @ impulses / m


def pulled_boxes(masses, mu, gravity, growth, t):
    """Ways and velocities of a box on the floor that a growing force pulls, and of a box on it, from rest.

    Both stay until ``growth t`` reaches the friction of the floor, slide together until the upper one needs more than
    its friction, and then apart.
    """
    (m1, m2), (floor, between) = masses, mu
    drag, hold = floor * (m1 + m2) * gravity, between * gravity
    starts = drag / growth
    if t <= starts:
        return np.zeros(2), np.zeros(2)
    parts = starts + hold * (m1 + m2) / growth

    def ramp(s, mass, initial):
        """Velocity and way of the acceleration ``initial + growth s/mass``."""
        return np.array([initial * s + growth * s**2 / (2 * mass), initial * s**2 / 2 + growth * s**3 / (6 * mass)])

    v, x = ramp(min(t, parts) - starts, m1 + m2, 0.0)
    if t <= parts:
        return np.array([x, x]), np.array([v, v])
    s = t - parts
    dv, dx = ramp(s, m1, hold)
    return np.array([x + v * s + dx, x + v * s + hold * s**2 / 2]), np.array([v + dv, v + hold * s])


def push_that_grows(mass, mu, gravity, growth, t):
    """Way and velocity of a block at rest that a force ``growth t`` breaks away at ``t0 = mu m g/growth``."""
    s = max(0.0, t - mu * mass * gravity / growth)
    return growth * s**3 / (6 * mass), growth * s**2 / (2 * mass)


def spin_in_corner(mass, radius, gravity, mu, spin, t):
    """Turn and spin of a ball that presses itself against a wall: ``N = m g/(1 + mu^2)``, wall ``mu N``, both slide."""
    N = mass * gravity / (1 + mu**2)
    retardation = radius * mu * (1 + mu) * N / (0.4 * mass * radius**2)
    s = min(t, abs(spin) / retardation)
    return np.sign(spin) * (abs(spin) * s - retardation * s**2 / 2), np.sign(spin) * (abs(spin) - retardation * s)


def ball_in_trough(slope, half_angle, radius, gravity, mu):
    """Acceleration along a trough, and angular acceleration, of a homogeneous ball from rest; walls at +-half_angle.

    Each wall presses with ``N = m g cos(slope)/(2 cos(half_angle))``; the points of contact are ``r cos(half_angle)``
    from the axis that the ball turns about. Rolling: ``a = g sin/(1 + 0.4/cos^2)``.
    """
    c, drive = np.cos(half_angle), gravity * np.sin(slope)
    a = drive / (1 + 0.4 / c**2)
    needed = drive - a
    most = mu * gravity * np.cos(slope) / c
    if needed <= most:
        return a, a / (radius * c)
    return drive - most, most * c / (0.4 * radius)


def disc_at_rest(radius, gravity, tilt):
    """Rate of precession about the vertical, and spin about the axis of the disc, with the centre and contact at rest.

    A thin uniform disc (``C = 2 A = m r^2/2``): the moment of the normal force ``m g r cos th`` turns the angular
    momentum, ``A Omega^2 sin th cos th``; no slip needs the spin ``-Omega cos th`` relative to the precession.
    """
    precession = np.sqrt(4 * gravity / (radius * np.sin(tilt)))
    return precession, -precession * np.cos(tilt)


def slider_crank_with_stop(crank, rod, masses, inertias, start, rate, stop, restitution, t):
    """Angle and rate of the crank of a slider-crank in line that meets one stop of the slider, without forces.

    The energy ``J(q) q'^2/2`` is constant between impacts; at the stop the slider, and with it q', is reversed by -e.
    Both crank and rod have their centres in the middle.
    """

    def effective(q):
        sine = crank / rod * np.sin(q)
        cosine = np.sqrt(1 - sine**2)
        b_q = -crank / rod * np.cos(q) / cosine  # angle of the rod per angle of the crank
        slider = -crank * np.sin(q) + rod * sine * b_q
        x, y = -crank * np.sin(q) + rod / 2 * sine * b_q, crank / 2 * np.cos(q)
        own = masses[0] * crank**2 / 4 + inertias[0]
        return own + masses[1] * (x**2 + y**2) + inertias[1] * b_q**2 + masses[2] * slider**2

    def place(q):
        return crank * np.cos(q) + np.sqrt(rod**2 - (crank * np.sin(q)) ** 2)

    sense, momentum = np.sign(rate), np.sqrt(effective(start)) * abs(rate)
    hit = brentq(lambda q: place(q) - stop, start, 1e-3)

    def elapsed(a, b):
        return quad(lambda q: np.sqrt(effective(q)), min(a, b), max(a, b), epsabs=1e-14, epsrel=1e-13)[0] / momentum

    until = elapsed(start, hit)
    first, left = start, t
    if t > until:
        sense, momentum, first, left = -sense, restitution * momentum, hit, t - until
    far = first + sense * 6.0 if t > until else hit
    q = brentq(lambda q: elapsed(first, q) - left, first, far, xtol=1e-15)
    return q, sense * momentum / np.sqrt(effective(q))


def rod_impact(half, mass, angle, mu, restitution, u, law):
    """Impulses (tangential, normal) on the tip of a slender rod that hits a floor, without spin before.

    The centre is left of the tip, `angle` above it; u is the velocity of both. The tip has the inverse masses
    ``Gtt = (1 + 3 sin^2)/m``, ``Gnn = (1 + 3 cos^2)/m``, ``Gtn = 3 sin cos/m``. The slip is forward after every impact
    here, the friction too weak to hold it. Newton with the friction of the end: forward throughout ``F = -mu N``; of a
    slip that the normal impulse alone turns round F = 0. Poisson along Routh's path: F turns its sign where the slip
    does, and the impulse is ``1 + e`` times that of the compression.
    """
    s, c = np.sin(angle), np.cos(angle)
    Gtt, Gnn, Gtn = (1 + 3 * s * s) / mass, (1 + 3 * c * c) / mass, 3 * s * c / mass
    assert Gtn > mu * Gtt
    turned = u[0] < 0
    if law == "newton":
        F = 0.0 if turned else -mu
        N = -(1 + restitution) * u[1] / (Gnn + F * Gtn)
        assert u[0] + (Gtt * F + Gtn) * N > 0
        return F * N, N
    first = -u[0] / (Gtt * mu + Gtn) if turned else 0.0
    compressed = first + (-u[1] - (Gnn + mu * Gtn) * first) / (Gnn - mu * Gtn)
    N = (1 + restitution) * compressed
    return mu * first - mu * (N - first), N


def ball_on_spring(mass, gravity, stiffness, height, t):
    """Height of the lowest point of a ball over a soft floor, and its velocity, released at rest: it bounces for ever.

    Below 0 it is an oscillator about ``-m g/k``; the time below is symmetric about the lowest point.
    """
    fall, w = np.sqrt(2 * height / gravity), np.sqrt(stiffness / mass)
    sink, speed = mass * gravity / stiffness, gravity * fall
    under = 2 * (np.pi - np.arctan2(speed / w, sink)) / w
    t = t % (2 * fall + under)
    if t <= fall or t >= fall + under:
        s = t if t <= fall else t - 2 * fall - under
        return height - gravity * s * s / 2, -gravity * s
    s = w * (t - fall)
    return sink * (np.cos(s) - 1) - speed / w * np.sin(s), -sink * w * np.sin(s) - speed * np.cos(s)
