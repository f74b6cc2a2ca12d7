"""Motions of one freedom that change their law at events: stops, dry friction, belts, tables, edges.

Between events the law is that of a pendulum (`Pendulum`, elliptic functions), an oscillator or a parabola; each
function walks from event to event, whose times are roots of those forms.
"""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from oracles.closed_forms.pendulum import Pendulum


def first_root(function, end, parts=2000, start=1e-9):
    """First zero of a function of an array of times after `start`, or infinity."""
    t = np.linspace(start, end, parts)
    values = function(t)
    change = np.flatnonzero(values[:-1] * values[1:] <= 0)
    return brentq(function, t[change[0]], t[change[0] + 1], xtol=1e-15, rtol=1e-15) if len(change) else np.inf


def stopped_pendulum(frequency, angle, rate, stop, restitution, t):
    """Angle and rate of a pendulum with a stop on one side of its path: ``q'+ = -e q'-`` there.

    Bounces against a stop that gravity presses on accumulate; below 1e-7 rad/s the series is taken as geometric, with
    the acceleration at the stop, and the pendulum rests. The error is of the order of that speed squared.
    """
    now, side = 0.0, np.sign(angle - stop)
    while True:
        swing = Pendulum(frequency, angle, rate)

        def beyond(dt, swing=swing):
            return swing.solve(dt)[0] - stop

        pull = frequency**2 * np.sin(stop) * side  # acceleration into the stop
        if angle == stop and abs(rate) < 1e-7 and pull > 0:
            rest = now + 2 * abs(rate) / (pull * (1 - restitution))
            if t >= rest:
                return stop, 0.0
            raise ValueError("the time is within the last bounces")
        guess = 2 * abs(rate) / pull if angle == stop and pull > 0 else swing.period
        lasts = first_root(beyond, min(3 * guess, swing.period) * 1.01, start=1e-4 * guess)
        if now + lasts > t:
            q, v = swing.solve([t - now])
            return q[0], v[0]
        now, rate, angle = now + lasts, -restitution * swing.solve([lasts])[1][0], stop


def coasting_between_stops(start, rate, decay, lower, upper, restitution, t):
    """Coordinate and rate with a constant retardation by dry friction, and impacts at two stops."""
    q, v = start, rate
    while True:
        sense = np.sign(v)
        wall = upper if sense > 0 else lower
        way = abs(wall - q)
        reaches = v * v > 2 * decay * way
        lasts = (abs(v) - np.sqrt(v * v - 2 * decay * way)) / decay if reaches else abs(v) / decay
        if t <= lasts or not reaches:
            dt = min(t, lasts)
            return q + v * dt - sense * decay * dt * dt / 2, (v - sense * decay * dt) if t < lasts else 0.0
        t -= lasts
        q, v = wall, -restitution * (v - sense * decay * lasts)


def dry_oscillator(frequency, dead, start, t):
    """Coordinate and rate from rest: half-cycles about ``-+ dead``, rest within the dead band ``|x| <= dead``."""
    x, half = start, np.pi / frequency
    while abs(x) > dead:
        center = np.sign(x) * dead
        if t < half:
            c, s = np.cos(frequency * t), np.sin(frequency * t)
            return center + (x - center) * c, -(x - center) * frequency * s
        x, t = 2 * center - x, t - half
    return x, 0.0


def dry_pendulum(restoring, bound, inertia, start, t):
    """Angle and rate of ``I q'' = -P sin q - C sign q'`` from rest, by energy and quadrature.

    A half-swing from a to b has ``P (cos b - cos a) = C |a - b|``. Rest where ``P |sin q| <= C``.
    """
    a = start
    while restoring * abs(np.sin(a)) > bound:
        found, whole, b = _half_swing(restoring, bound, inertia, a, t)
        if t < whole:
            return found
        t, a = t - whole, b
    return a, 0.0


def _half_swing(restoring, bound, inertia, a, t):
    """Angle and rate at a time of a half-swing from a, its duration and its end.

    The time to q is the integral of ``dq/|q'|``, taken in the angle s of ``q = (a + b)/2 + (a - b)/2 cos s``, where it
    is smooth. The energy is counted from the nearer end, without cancellation.
    """
    lost = lambda q: restoring * (np.cos(q) - np.cos(a)) - bound * abs(q - a)  # noqa: E731
    b = brentq(lost, -a * 1.0001, np.arcsin(bound / restoring) * np.sign(a), xtol=1e-16, rtol=1e-15)
    half = (a - b) / 2

    def rate(s):
        end, work = (a, -bound) if np.cos(s) > 0 else (b, bound)
        d = 2 * half * (np.sin(s / 2) ** 2 if end == a else -(np.cos(s / 2) ** 2))  # end - q
        energy = 2 * restoring * np.sin(end - d / 2) * np.sin(d / 2) + work * abs(d)
        return np.sqrt(2 * energy / inertia)

    slowness = lambda s: abs(half) * np.sin(s) / rate(s)  # noqa: E731
    elapsed = lambda s: quad(slowness, 0.0, s, epsabs=1e-14, epsrel=1e-13, limit=200)[0]  # noqa: E731
    whole = elapsed(np.pi)
    if t >= whole:
        return (b, 0.0), whole, b
    s = brentq(lambda s: elapsed(s) - t, 0.0, np.pi, xtol=1e-14, rtol=1e-14)
    return (b + 2 * half * np.cos(s / 2) ** 2, -np.sign(a) * rate(s)), whole, b


def on_belt(frequency, kinetic, static, belt, x, v, t):
    """Position and velocity of an oscillator on a belt: springs are in lengths, ``kinetic = mu m g/k``.

    It starts slower than the belt, or at its speed and sticks. It slides back about the centre ``+ kinetic`` until it
    has the speed of the belt again, and sticks until the spring is as long as `static`.
    """
    sticks = abs(v - belt) <= 1e-12 * belt
    while True:
        if sticks:
            lasts = (static - x) / belt
            if t <= lasts:
                return x + belt * t, belt
            x, v, t = static, belt, t - lasts
        lasts, motion = _slides_back(frequency, kinetic, belt, x - kinetic, v / frequency)
        if t <= lasts:
            return motion(t)
        (x, _), v, t, sticks = motion(lasts), belt, t - lasts, True


def _slides_back(frequency, center, belt, a, b):
    """Time until an oscillator has the speed of the belt, and its motion ``center + a cos + b sin``."""

    def motion(t):
        c, s = np.cos(frequency * t), np.sin(frequency * t)
        return center + a * c + b * s, frequency * (b * c - a * s)

    return first_root(lambda s: motion(s)[1] - belt, 4 * np.pi / frequency, start=1e-6), motion


def on_shaken_table(amplitude, frequency, friction, t):
    """Position and velocity of a block on a table ``x = a sin w t``, which it starts with; ``friction = mu g``."""
    x, now = 0.0, 0.0
    while True:
        offset = x - amplitude * np.sin(frequency * now)
        slips = now
        if amplitude * frequency**2 * abs(np.sin(frequency * now)) <= friction:
            slips += _slips_after(amplitude * frequency**2, frequency, friction, now)
        if t <= slips:
            return amplitude * np.sin(frequency * t) + offset, amplitude * frequency * np.cos(frequency * t)
        sense = -np.sign(np.sin(frequency * (slips + 1e-9)))
        x, v = amplitude * np.sin(frequency * slips) + offset, amplitude * frequency * np.cos(frequency * slips)
        lasts = _caught_after(amplitude * frequency, frequency, sense * friction, v, slips)
        dt = min(lasts, t - slips)
        x, v = x + v * dt + sense * friction * dt**2 / 2, v + sense * friction * dt
        if dt < lasts:
            return x, v
        now = slips + lasts


def _slips_after(most, frequency, friction, now):
    """Time from `now` until the table accelerates by more than the friction."""
    return first_root(lambda s: most * abs(np.sin(frequency * (now + s))) - friction, 2 * np.pi / frequency)


def _caught_after(speed, frequency, a, v, since):
    """Time until a block of the velocity v and acceleration a has the velocity of the table."""
    gap = lambda s: v + a * s - speed * np.cos(frequency * (since + s))  # noqa: E731
    return first_root(gap, 4 * np.pi / frequency, start=1e-3 / frequency)


def on_bouncing_table(amplitude, frequency, gravity, t):
    """Height and velocity of a body on a table ``z = a sin w t`` that it leaves where the table falls faster; e = 0."""
    period = 2 * np.pi / frequency
    leaves = np.arcsin(gravity / (amplitude * frequency**2)) / frequency
    z, v = amplitude * np.sin(frequency * leaves), amplitude * frequency * np.cos(frequency * leaves)

    def gap(s):
        return z + v * s - gravity * s * s / 2 - amplitude * np.sin(frequency * (leaves + s))

    lands = leaves + first_root(gap, period, start=1e-3 * period)
    at = t if t < period + leaves else t % period  # from the second turn on it leaves with the table once a turn
    if leaves < at < lands:
        s = at - leaves
        return z + v * s - gravity * s * s / 2, v - gravity * s
    return amplitude * np.sin(frequency * at), amplitude * frequency * np.cos(frequency * at)


def rocking(half_width, half_height, gravity, tilt, t):
    """Tilt and rate of a homogeneous block that rocks about its edges without slip [Housner 1963].

    About an edge ``psi'' = p^2 sin psi``, ``p^2 = 3 g/(4 R)``, ``psi = alpha - tilt`` between edge and centre; an
    impact keeps ``1 - 3/2 sin^2 alpha`` of the rate. A tilt to the other side is negative.
    """
    alpha, R = np.arctan2(half_width, half_height), np.hypot(half_width, half_height)
    p, side = np.sqrt(0.75 * gravity / R), 1.0
    swing = Pendulum(p, np.pi - (alpha - tilt), 0.0)
    while True:
        lasts = _flat_after(swing, np.pi - alpha)
        if t <= lasts:
            angle, rate = swing.solve(t)
            return side * (alpha - np.pi + angle), side * rate
        rate = swing.solve(lasts)[1] * (1 - 1.5 * np.sin(alpha) ** 2)
        swing, t, side = Pendulum(p, np.pi - alpha, -rate), t - lasts, -side


def _flat_after(swing, flat):
    return first_root(lambda s: swing.solve(s)[0] - flat, 0.75 * swing.period, start=1e-6)


def ladder(half, gravity, start, t):
    """Angle from the floor, rate, and centre (x from the wall, height) of a ladder on smooth floor and wall.

    On the wall ``th'' = -3 g/(4 l) cos th``; it leaves it at ``sin th = 2/3 sin th0``, after which its centre keeps its
    horizontal velocity and ``(1/3 + cos^2 th) th'^2`` has the energy of the fall.
    """
    swing = Pendulum(np.sqrt(0.75 * gravity / half), start + np.pi / 2, 0.0)  # angle from hanging, at the corner
    left = np.arcsin(2 / 3 * np.sin(start))
    leaves = first_root(lambda s: swing.solve(s)[0] - np.pi / 2 - left, swing.period / 2)
    if t <= leaves:
        angle, rate = (x[0] for x in swing.solve([t]))
        th = angle - np.pi / 2
        return th, rate, half * np.cos(th), half * np.sin(th)
    rate = swing.solve([leaves])[1][0]
    drift = -half * np.sin(left) * rate
    energy = (1 / 3 + np.cos(left) ** 2) * rate**2 / 2 + gravity / half * np.sin(left)

    def speed(th):
        return np.sqrt(2 * (energy - gravity / half * np.sin(th)) / (1 / 3 + np.cos(th) ** 2))

    def elapsed(th):
        return quad(lambda x: 1 / speed(x), th, left, epsabs=1e-14, epsrel=1e-13)[0]

    th = brentq(lambda x: elapsed(x) - (t - leaves), -0.2, left, xtol=1e-15)
    return th, -speed(th), half * np.cos(left) + drift * (t - leaves), half * np.sin(th)


def ball_off_ball(fixed, radius, gravity, mu, start, t):
    """Angle and rate of the centre, and spin, of a ball that rolls off a fixed ball from rest; then it slips.

    Rolling ``th'' = 5/7 g/l sin th``, ``l = R + r``; it slips where ``2/7 sin th`` exceeds mu times the normal force
    over the weight, ``cos th - l th'^2/g = (17 cos th - 10 cos th0)/7``. Slipping, ``y = th'^2`` obeys the linear
    ``dy/dth = 2 (g/l) (sin th - mu cos th) + 2 mu y``, until the normal force vanishes and the ball flies.
    """
    l = fixed + radius
    rolling = Pendulum(np.sqrt(5 / 7 * gravity / l), np.pi - start, 0.0)

    def demand(th):
        return 2 / 7 * np.sin(th) - mu * (17 * np.cos(th) - 10 * np.cos(start)) / 7

    slips_at = brentq(demand, start, 1.2, xtol=1e-15)
    slips = first_root(lambda s: np.pi - rolling.solve(s)[0] - slips_at, rolling.period)
    if t <= slips:
        angle, rate = (x[0] for x in rolling.solve([t]))
        return np.pi - angle, -rate, -rate * l / radius
    y0 = rolling.solve([slips])[1][0] ** 2
    k, d = gravity / l, 1 + 4 * mu**2
    a, b = -2 * k * 3 * mu / d, 2 * k * (2 * mu**2 - 1) / d  # y = a sin + b cos is the forced part
    C = (y0 - a * np.sin(slips_at) - b * np.cos(slips_at)) * np.exp(-2 * mu * slips_at)

    def square(th):
        return C * np.exp(2 * mu * th) + a * np.sin(th) + b * np.cos(th)

    leaves_at = brentq(lambda th: np.cos(th) - square(th) / k, slips_at, np.pi / 2)

    def elapsed(th):
        return quad(lambda x: 1 / np.sqrt(square(x)), slips_at, th, epsabs=1e-15, epsrel=1e-14)[0]

    if t > slips + elapsed(leaves_at):
        raise ValueError("the ball flies")
    th = brentq(lambda x: elapsed(x) - (t - slips), slips_at, leaves_at, xtol=1e-15)
    press = lambda x: (np.cos(x) - square(x) / k) / np.sqrt(square(x))  # noqa: E731
    spun = 2.5 * mu * gravity / radius * quad(press, slips_at, th, epsabs=1e-15, epsrel=1e-14)[0]
    return th, np.sqrt(square(th)), np.sqrt(y0) * l / radius + spun


def bead_on_rod(turning, mu, start, rate, t):
    """Distance and rate of a bead on a rod that turns steadily, without gravity: ``r'' = W^2 r - 2 mu W |r'| sign r'``.

    The reaction across the rod is ``2 m W r'``: the friction is viscous in effect, and r a sum of two exponentials.
    """
    s = turning * np.array([-mu + np.sqrt(1 + mu**2), -mu - np.sqrt(1 + mu**2)])
    A = (rate - s[1] * start) / (s[0] - s[1])
    B = start - A
    e = np.exp(s * t)
    return A * e[0] + B * e[1], A * s[0] * e[0] + B * s[1] * e[1]
