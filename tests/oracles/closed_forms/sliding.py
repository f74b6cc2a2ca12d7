"""Points and balls that slide on a plane under Coulomb's law, by the hodograph of the sliding velocity.

In components along the plane, with a constant drive A and friction B (accelerations of the contact point):

    u' = A - B u/|u|.

For a block B = mu g_n and u is its velocity. For a homogeneous ball (``I = 2/5 m r^2``) the contact point has the
inverse mass ``1/m + r^2/I = 3.5/m``, so that B = 3.5 mu g_n.

With A along x, heading th from x and ``kappa = B/A``: ``d|u|/dth = |u| (kappa - cos th)/sin th``, so that
``|u| = K w^(kappa-1) (1 + w^2)`` with ``w = tan(th/2)``, and ``dt = -|u| dth/(A sin th)`` makes time and way sums of
powers of w. The friction turns the velocity towards the drive, w falls to 0.
"""

import numpy as np
from scipy.optimize import brentq


def coulomb_slide(A, B, start, t):
    """Velocity u(t), way ``int_0^t u`` and time of the stop (infinity without one) of ``u' = A - B u/|u|``.

    A and start are vectors of the plane, (2,); after a stop with ``B >= |A|`` the point stays.
    """
    A, start = np.asarray(A, dtype=float), np.asarray(start, dtype=float)
    drive, speed = np.linalg.norm(A), np.linalg.norm(start)
    if speed == 0.0:
        a = A * max(0.0, 1.0 - B / drive) if drive else A
        return a * t, a * t * t / 2, 0.0 if drive <= B else np.inf
    if drive <= 1e-13 * B:  # a level plane, but for rounding
        return _on_a_line(0.0 * A, B, start / speed, speed, t)
    across = start[0] * A[1] - start[1] * A[0]
    if abs(across) <= 1e-12 * speed * drive:
        return _on_a_line(A, B, start / speed, speed, t)
    x = A / drive
    y = np.array([-x[1], x[0]]) * -np.sign(across)  # the velocity is on the side of y
    kappa, th = B / drive, np.arctan2(start @ y, start @ x)
    w0 = np.tan(th / 2)
    K = speed * np.sin(th) / (2 * w0**kappa)

    def since(w, *terms):
        """Sum of coefficient times ``int_w^w0 s^power ds``."""
        return sum(
            c * (np.log(w0 / w) if abs(p + 1) < 1e-12 else (w0 ** (p + 1) - w ** (p + 1)) / (p + 1)) for c, p in terms
        )

    def elapsed(w):
        return K / drive * since(w, (1, kappa - 2), (1, kappa))

    stop = elapsed(0.0) if kappa > 1 else np.inf
    if t >= stop:
        w = 0.0
    else:
        low = w0
        while elapsed(low) < t:
            low /= 2
        w = brentq(lambda w: elapsed(w) - t, low, w0, xtol=1e-300, rtol=1e-15) if low < w0 else w0
    way_x = K**2 / drive * since(w, (1, 2 * kappa - 3), (-1, 2 * kappa + 1))
    way_y = 2 * K**2 / drive * since(w, (1, 2 * kappa - 2), (1, 2 * kappa))
    u = K * w ** (kappa - 1) * ((1 - w**2) * x + 2 * w * y) if w else np.zeros(2)
    return u, way_x * x + way_y * y, stop


def _on_a_line(A, B, along, speed, t):
    """The slide along the drive or against it, or without one."""
    a = A @ along - B
    stop = speed / -a if a < 0 else np.inf
    if t <= stop:
        return (speed + a * t) * along, (speed * t + a * t * t / 2) * along, stop
    way = speed * stop / 2 * along
    u, more, _ = coulomb_slide(A, B, np.zeros(2), t - stop)
    return u, way + more, stop


def polygon_slide(vertices, B, start, t):
    """Velocity, way and time of the stop under ``u' = B T``, T in a polygon, of greatest dissipation ``-T . u``.

    T is the vertex furthest along -u, until u is normal to an edge of that vertex; from there on u keeps that
    direction, and T is the point of the edge along it: every other would turn u into the normal cone of a vertex, which
    turns it back.
    """
    vertices, u, way, left, stop = np.asarray(vertices), np.array(start, dtype=float), np.zeros(2), t, 0.0
    velocity = u
    while np.any(u):
        a, lasts = _phase(vertices, B, u)
        dt = min(max(left, 0.0), lasts)
        way = way + u * dt + a * dt * dt / 2
        velocity = velocity if left <= 0.0 else u + a * dt
        ends = np.linalg.norm(u + a * lasts) < 1e-12 * np.linalg.norm(start)
        u = np.zeros(2) if ends else u + a * lasts
        left, stop = left - lasts, stop + lasts
    return (np.zeros(2) if left >= 0.0 else velocity), way, stop


def _phase(vertices, B, u):
    """Acceleration, and how long it lasts, of a velocity in the normal cone of a vertex, or along an edge's normal."""
    force = vertices[np.argmax(-vertices @ u)]
    edges = [e / np.linalg.norm(e) for e in vertices - force if np.any(e)]
    normals = [np.array([e[1], -e[0]]) * np.sign(e[1] * force[0] - e[0] * force[1]) for e in edges]
    own = [n for n in normals if np.all(vertices @ n <= force @ n + 1e-12)]  # of the two edges at the vertex
    speed = np.linalg.norm(u)
    facing = [n for n in own if -u @ n >= speed * (1 - 1e-13)]
    if facing:
        a = B * (force @ facing[0])
        return a * facing[0], speed / a
    # the component of u across the normal of an edge vanishes
    across = [np.array([-n[1], n[0]]) for n in own]
    times = [-(u @ e) / (B * (force @ e)) for e in across if abs(force @ e) > 1e-15]
    return B * force, min(dt for dt in times if dt > 0)


def ball_slide(drive, friction, radius, velocity, spin, t):
    """Centre (3,), velocity and spin of a homogeneous ball on a plane with the normal z, and the time it rolls from.

    Parameters
    ----------
    drive : ndarray, shape (2,), m/s^2
        Gravity along the plane.
    friction : float, m/s^2
        ``mu g_n``.
    velocity, spin : ndarray, shape (3,)
        Of the centre (its z is zero), rad/s.

    The impulse of friction per mass is ``J = (u - u0 - A t)/3.5``; ``v = v0 + A t + J``, ``w = w0 - 5/(2 r) n x J``.
    Rolling, the acceleration is 5/7 of the drive, ``w = n x v/r`` and the spin about n stays.
    """
    A, n = np.asarray(drive, dtype=float), np.array([0.0, 0.0, 1.0])
    v0, w0 = np.asarray(velocity, dtype=float), np.asarray(spin, dtype=float)
    u0 = (v0 + np.cross(w0, -radius * n))[:2]
    rolls = 0.0 if np.linalg.norm(u0) < 1e-13 * max(np.linalg.norm(v0), 1e-300) else None
    if rolls is None:
        _, _, rolls = coulomb_slide(A, 3.5 * friction, u0, 0.0)
    elif 2 / 7 * np.linalg.norm(A) > friction:
        rolls = np.inf  # from rest, too steep to roll
    slid = min(t, rolls)
    u, way, _ = coulomb_slide(A, 3.5 * friction, u0, slid)
    J = (u - u0 - A * slid) / 3.5
    v = v0[:2] + A * slid + J
    p = v0[:2] * slid + A * slid**2 / 2 + (way - u0 * slid - A * slid**2 / 2) / 3.5
    w = w0 + 2.5 / radius * np.cross(-n, [*J, 0.0])
    if t > slid:
        dt = t - slid
        p = p + v * dt + 5 / 14 * A * dt**2
        v = v + 5 / 7 * A * dt
        w = np.array([0.0, 0.0, w0[2]]) + np.cross(n, [*v, 0.0]) / radius
    return np.array([*p, 0.0]), np.array([*v, 0.0]), w, rolls


def bouncing_ball(gravity, radius, restitution, mu, height, velocity, spin, t):
    """Lowest point over its start (3,), velocity and spin of a homogeneous ball that bounces on a level plane.

    Each impact has the normal impulse ``(1 + e) u_n`` per mass; the tangential one is mu times as large against the
    slip, and at most ``2/7`` of the slip, which then ends. With e < 1 the bounces end at ``t_1 + 2 u_1 e/(g (1 - e))``;
    what is left is `ball_slide`.
    """
    n, p = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, height])
    v, w = np.array(velocity, dtype=float), np.array(spin, dtype=float)
    now, down = 0.0, np.inf
    while True:
        lasts = (v[2] + np.sqrt(v[2] ** 2 + 2 * gravity * p[2])) / gravity
        if now + lasts > t:
            dt = t - now
            return p + v * dt - gravity * dt**2 / 2 * n, v - gravity * dt * n, w
        p = p + v * lasts - gravity * lasts**2 / 2 * n
        p[2], now = 0.0, now + lasts
        down = gravity * lasts - v[2]
        v, w = _impact(v - gravity * lasts * n, w, radius, restitution, mu)
        if down < 1e-9 and restitution < 1:  # all later bounces at once: a geometric series
            rest = 2 * down * restitution / (gravity * (1 - restitution))
            impulse = (1 + restitution) * down * restitution / (1 - restitution)
            p = p + np.array([v[0], v[1], 0.0]) * min(rest, t - now)
            v, w = _friction(np.array([v[0], v[1], 0.0]), w, radius, mu * impulse)
            if now + rest >= t:
                return p, v, w
            moved, v, w, _ = ball_slide([0.0, 0.0], mu * gravity, radius, v, w, t - now - rest)
            return p + moved, v, w


def _impact(v, w, radius, restitution, mu):
    return _friction(np.array([v[0], v[1], -restitution * v[2]]), w, radius, mu * (1 + restitution) * -v[2])


def _friction(v, w, radius, most):
    """Velocities after a tangential impulse per mass against the slip, at most `most`, at most what ends the slip."""
    n = np.array([0.0, 0.0, 1.0])
    slip = v + np.cross(w, -radius * n)
    slip[2] = 0.0
    speed = np.linalg.norm(slip)
    if speed == 0.0:
        return v, w
    J = -slip / speed * min(most, speed / 3.5)
    return v + J, w + 2.5 / radius * np.cross(-n, J)
