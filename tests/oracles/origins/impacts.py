"""Motions with impacts in closed form: parabolas, uniform motion, and a pendulum that rebounds from a stop."""

import numpy as np
from scipy.special import ellipj, ellipk

from consilience.case.published import owners
from consilience.mechanism import rotation_from_quaternion


def _bouncing(case, t):
    """Position and velocity of the centre of mass: parabolas along the normal, uniform motion tangentially."""
    (body,), (contact,) = case.mechanism.bodies, case.mechanism.contacts
    start = case.initial_state
    arm = rotation_from_quaternion(start.quat_WB[0]) @ body.com
    p, v = start.p_WB[0] + arm, start.v_WB_W[0] + np.cross(start.w_WB_W[0], arm)
    n, g = contact.normal, np.linalg.norm(case.mechanism.gravity)
    height, rise, since = (p - contact.point) @ n - contact.radius, v @ n, 0.0
    while True:
        lasts = (rise + np.sqrt(rise**2 + 2 * g * height)) / g
        if since + lasts > t:
            break
        rise, height, since = contact.restitution * (g * lasts - rise), 0.0, since + lasts
    dt = t - since
    h = height + rise * dt - g * dt**2 / 2
    across, speed = p - (p @ n) * n, v - (v @ n) * n
    level = contact.point @ n + contact.radius
    return {"p_WBcm": across + speed * t + (level + h) * n, "v_WBcm_W": speed + (rise - g * dt) * n}


def _colliding(case, t):
    """Origins and velocities of both spheres."""
    start, (contact,) = case.initial_state, case.mechanism.contacts
    m = np.array([b.mass for b in case.mechanism.bodies])
    p, v = start.p_WB.copy(), start.v_WB_W.copy()
    d, u = p[0] - p[1], v[0] - v[1]
    reach = contact.radius + contact.partner_radius
    a, b, c = u @ u, d @ u, d @ d - reach**2
    hit = (-b - np.sqrt(b**2 - a * c)) / a
    if t >= hit:
        n = (d + hit * u) / reach
        impulse = -(1 + contact.restitution) * (u @ n) * m[0] * m[1] / (m[0] + m[1])
        after = v + np.array([[1.0], [-1.0]]) * impulse / m[:, None] * n
        p, v = p + hit * v + (t - hit) * after, after
    else:
        p = p + t * v
    return {"p_WB": p, "v_WB_W": v}


def _swing(case, t):
    """Angle and rate of the links: a pendulum (sn) down to the stop, then upward at the speed after the impact."""
    left, _, coupler = case.mechanism.bodies
    g, l, (contact,) = 9.81, 0.6, case.mechanism.contacts
    inertia = 2 * (left.inertia[1, 1] + left.mass * (l / 2) ** 2) + coupler.mass * l**2
    w = np.sqrt((left.mass + coupler.mass) * g * l / inertia)
    start = float(case.initial.coordinates["A"]["angle"])
    k = np.sin(abs(start) / 2)
    hit = ellipk(k**2) / w
    if t < hit:
        _, cn, dn, _ = ellipj(w * t, k**2)
        s = np.sign(start) * k * cn / dn  # sin(q / 2) = k cd(w t)
        s_rate = -np.sign(start) * k * w * (1 - k**2) * ellipj(w * t, k**2)[0] / dn**2
    else:
        k *= contact.restitution
        sn, cn, dn, _ = ellipj(w * (t - hit), k**2)
        s, s_rate = np.sign(start) * k * sn, np.sign(start) * k * w * cn * dn
    rate = 2 * s_rate / np.sqrt(1 - s**2)
    return {"angle": 2 * np.arcsin(s), "angle_rate": rate}


def _values(motion):
    def values(case, published):
        found = []
        for known in published:
            value = np.asarray(motion(case, known.time)[known.observable])
            if value.ndim == 2:
                value = value[owners(case.mechanism, known.observable)[known.of]]
            found.append(value[known.component] if value.ndim else value)
        return np.array(found)

    return values


ORIGINS = {
    "bouncing_sphere": (_values(_bouncing),),
    "colliding_spheres": (_values(_colliding),),
    "linkage_at_a_stop": (_values(_swing),),
}
