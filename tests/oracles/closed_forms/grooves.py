"""Bounces of a point between two smooth walls until it rests at the bottom, in numbers of 60 digits.

Between impacts the point flies along a parabola; what it does beside one wall alone once its bounces there have ended,
is a slide with constant acceleration. The sums of the bounces on one wall are geometric. Nothing is shared with the
reference, which has to stop where rounding hides the bounces.
"""

import math
from decimal import Decimal, localcontext

_LAST = Decimal("1e-22")  # speed of a bounce, m/s, from which the rest of its series is summed
_REST = Decimal("1e-16")  # speed, and root of the height, m^0.5, of the point at rest


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


def _along(p, v, direction, acceleration, time):
    """Place and velocity after a slide from the place p with the speed of v along a direction."""
    u = _dot(direction, v)
    way = u * time + acceleration * time * time / 2
    return (
        tuple(a + way * d for a, d in zip(p, direction, strict=True)),
        tuple((u + acceleration * time) * d for d in direction),
    )


def _fall(p, v, normals, gravity):
    """Time to the next wall, and which it is."""
    times = []
    for n in normals:
        height, rate, pull = _dot(n, p), _dot(n, v), gravity * n[1]
        times.append((rate + max(rate * rate + 2 * pull * height, Decimal(0)).sqrt()) / pull)
    return min((time, wall) for wall, time in enumerate(times))


def end_in_groove(slopes, restitution, place, velocity, gravity):
    """Time at which a point rests at the bottom of a groove between walls that rise to the left and to the right.

    `slopes` are the angles of the wall on the left and of that on the right, rad; place and velocity are across the
    groove and up. The normals of the walls are less than a right angle apart, so that a wall which is struck throws
    the point off the other.
    """
    with localcontext(prec=60):
        normals = [
            (Decimal(side * math.sin(slope)), Decimal(math.cos(slope)))
            for side, slope in zip((1, -1), slopes, strict=True)
        ]
        e, g = Decimal(repr(restitution)), Decimal(repr(gravity))
        p, v = (tuple(Decimal(repr(float(x))) for x in vector) for vector in (place, velocity))
        now = Decimal(0)
        while _dot(v, v).sqrt() + sum(abs(_dot(n, p)) for n in normals).sqrt() > _REST:
            lasts, wall = _fall(p, v, normals, g)
            now += lasts
            n, other = normals[wall], normals[1 - wall]
            p = (p[0] + v[0] * lasts, p[1] + v[1] * lasts - g * lasts * lasts / 2)
            p = tuple(a - _dot(n, p) * b for a, b in zip(p, n, strict=True))
            v = (v[0], v[1] - g * lasts)
            rate = _dot(n, v)
            v = tuple(a - (1 + e) * rate * b for a, b in zip(v, n, strict=True))
            rest = -2 * e * rate / (g * n[1] * (1 - e))
            room = _dot(other, p) - 4 * (abs(_dot(other, v)) + abs(rate)) * rest - 4 * g * rest * rest
            if -e * rate < _LAST and room > 0:
                down = (-n[1], n[0])
                p, v = _along(p, v, down, -g * down[1], rest)
                height, u, pull = _dot(other, p), _dot(other, v), g * down[1] * _dot(other, down)
                slides = (u + (u * u + 2 * pull * height).sqrt()) / pull
                p, v = _along(p, v, down, -g * down[1], slides)
                now += rest + slides
                rate = _dot(other, v)
                v = tuple(a - (1 + e) * rate * b for a, b in zip(v, other, strict=True))
        return float(now)
