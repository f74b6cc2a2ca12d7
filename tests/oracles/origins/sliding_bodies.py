"""Origins of cases with contact whose sliding has no closed form, each by two sets of equations; a brake, and a rod.

Each function returns the observables at a time by name. Values without closed form are integrated twice: a body in
space with its normal forces from ``g'' = 0``, and equations of the single problem.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from oracles.integrate import integrate
from oracles.origins.impacts import _values

Z = np.array([0.0, 0.0, 1.0])


def _start(case):
    """Centre of mass, rotation, velocity of the centre of mass and spin of the body at the start."""
    start, body = case.initial_state, case.mechanism.bodies[0]
    R, w = start.R_WB[0], start.w_WB_W[0]
    return start.p_WB[0] + R @ body.com, R, start.v_WB_W[0] + np.cross(w, R @ body.com), w


def _centers(case):
    """Points or centres of spheres from the centre of mass in body axes, radii, normals and friction of contacts."""
    com = case.mechanism.bodies[0].com
    return [
        (getattr(c, "corner", getattr(c, "center", None)) - com, getattr(c, "radius", 0.0), c.normal, c.friction)
        for c in case.mechanism.contacts
    ]


# --- a body that slides on planes, in space ----------------------------------------------------------------------


def _sliding_rates(case):
    """Rates of (p, R, v, w) of a body all of whose contacts slide: forces ``N (n - mu u/|u|)``."""
    body, gravity, contacts = case.mechanism.bodies[0], case.mechanism.gravity, _centers(case)

    def rates(y):
        R, v, w = y[3:12].reshape(3, 3), y[12:15], y[15:]
        J = R @ body.inertia @ R.T
        free = np.concatenate([gravity, -np.linalg.solve(J, np.cross(w, J @ w))])
        rows, columns, known = [], [], []
        for center, radius, n, mu in contacts:
            c = R @ center
            s = c - radius * n
            u = v + np.cross(w, s)
            push = n - mu * u / np.linalg.norm(u)
            rows.append(np.concatenate([n, np.cross(c, n)]))
            known.append(n @ np.cross(w, np.cross(w, c)))
            columns.append(np.concatenate([push / body.mass, np.linalg.solve(J, np.cross(s, push))]))
        rows, columns = np.array(rows), np.array(columns)
        N = np.linalg.solve(rows @ columns.T, -(rows @ free + known))
        return np.concatenate([v, np.cross(w, R.T).T.ravel(), free + N @ columns])

    return rates


def _in_space(case, t):
    p, R, v, w = _start(case)
    y = integrate(_sliding_rates(case), np.concatenate([p, R.ravel(), v, w]), [t], longest=0.5 * case.sample)[-1]
    return {"p_WBcm": y[:3], "v_WBcm_W": y[12:15], "w_WB_W": y[15:]}


# --- a tripod, in the plane ----------------------------------------------------------------------------------------


def _tripod(case, t):
    """Three feet on a level floor: loads from the balances of force and of the moments about level axes."""
    body, (p, R, v, w) = case.mechanism.bodies[0], _start(case)
    feet, mu = np.array([R @ center for center, *_ in _centers(case)]), case.mechanism.contacts[0].friction
    moment, weight = Z @ R @ body.inertia @ R.T @ Z, -body.mass * case.mechanism.gravity[2]

    def rates(y):
        c, s = np.cos(y[2]), np.sin(y[2])
        arms = feet @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        u = y[3:5] + y[5] * np.stack([-arms[:, 1], arms[:, 0]], axis=1)
        pushes = np.column_stack([-mu * u / np.linalg.norm(u, axis=1)[:, None], np.ones(3)])
        moments = np.cross(arms, pushes)
        N = np.linalg.solve(np.stack([pushes[:, 2], moments[:, 0], moments[:, 1]]), [weight, 0.0, 0.0])
        return np.array([*y[3:], *(N @ pushes[:, :2] / body.mass), N @ moments[:, 2] / moment])

    y = integrate(rates, [*p[:2], 0.0, *v[:2], w[2]], [t])[-1]
    return {"p_WBcm": [*y[:2], p[2]], "v_WBcm_W": [*y[3:5], 0.0], "w_WB_W": [0.0, 0.0, y[5]]}


# --- a tippe top, by its axis and angular momentum -----------------------------------------------------------------


def _tippe_top(case, t):
    """Axis e and angular momentum L about the centre of mass: ``w = L/A + (1/C - 1/A) (L.e) e``, ``e' = w x e``."""
    body, (p, R, v, w) = case.mechanism.bodies[0], _start(case)
    ((center, radius, _, mu),) = _centers(case)
    above, g = np.linalg.norm(center), -case.mechanism.gravity[2]
    J, e = R @ body.inertia @ R.T, R @ center / above
    C = e @ J @ e
    A = (np.trace(J) - C) / 2.0

    def spin(L, e):
        return L / A + (1 / C - 1 / A) * (L @ e) * e

    def rates(y):
        e, L = y[2:5], y[5:8]
        w = spin(L, e)
        e_dot = np.cross(w, e)
        s = above * e - radius * Z
        # the height of the centre of mass over the floor is radius - above e_z
        u = np.array([*y[8:], -above * e_dot[2]]) + np.cross(w, s)
        push = Z - mu * u / np.linalg.norm(u)
        # -above e_z'' = N/m - g is linear in N: e'' from L' = N s x push
        moment = np.cross(s, push)

        def turning(N):
            w_dot = spin(N * moment, e) + (1 / C - 1 / A) * ((L @ e_dot) * e + (L @ e) * e_dot)
            return (np.cross(w_dot, e) + np.cross(w, e_dot))[2]

        still = turning(0.0)
        N = (g - above * still) / (1 / body.mass + above * (turning(1.0) - still))
        return np.array([*y[8:], *e_dot, *(N * moment), *(N * push[:2] / body.mass)])

    y = integrate(rates, [*p[:2], *e, *(J @ w), *v[:2]], [t], longest=0.5 * case.sample)[-1]
    e, w = y[2:5], spin(y[5:8], y[2:5])
    z = case.mechanism.contacts[0].point[2] + radius - above * e[2]
    return {"p_WBcm": [*y[:2], z], "v_WBcm_W": [*y[8:], -above * np.cross(w, e)[2]], "w_WB_W": w}


# --- a rod that falls ----------------------------------------------------------------------------------------------


def _in_phases(phases, y, t):
    """State at a time, by phases of rates and the function whose rising zero ends each."""
    start = 0.0
    for rates, end in phases:
        end.terminal, end.direction = True, 1.0
        ways = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "max_step": 0.0125}
        found = solve_ivp(lambda _, y, rates=rates: rates(y), (start, t), y, events=end, **ways)
        y, start = found.y[:, -1], found.t[-1]
        if not found.t_events[0].size:
            break
    return y


def _rod_data(case):
    """Length, mass, moment of inertia, gravity and friction of a rod; its angle from the vertical, and level axis."""
    body, (_, R, _, _) = case.mechanism.bodies[0], _start(case)
    tip, top = (R @ center for center, *_ in _centers(case))
    along = (top - tip) / np.linalg.norm(top - tip)
    level = along - along[2] * Z
    X = level / np.linalg.norm(level)
    J = np.cross(Z, X) @ R @ body.inertia @ R.T @ np.cross(Z, X)
    law = case.mechanism.contacts[0].friction, -case.mechanism.gravity[2]
    return np.linalg.norm(top - tip), body.mass, J, *law, np.arctan2(along @ X, along[2]), X


def _rod_observed(case, X, x, z, v, rate):
    p, _, _, _ = _start(case)
    floor = case.mechanism.contacts[0].point[2]
    return {"p_WBcm": p + (x - X @ p) * X + (z + floor - p[2]) * Z, "v_WBcm_W": v, "w_WB_W": rate * np.cross(Z, X)}


def _falling_rod(case, t):
    """Tip x and angle from the vertical: sticking, sliding backwards, then forwards."""
    L, m, J, mu, g, th0, X = _rod_data(case)
    h = L / 2

    def sticking(th, rate):
        a = m * g * h * np.sin(th) / (J + m * h * h)
        return (
            a,
            m * (g - h * (np.sin(th) * a + np.cos(th) * rate**2)),
            m * h * (np.cos(th) * a - np.sin(th) * rate**2),
        )

    def stick(y):
        return np.array([0.0, y[3], 0.0, sticking(y[1], y[3])[0]])

    def slide(sign):
        def rates(y):
            s, c, rate = np.sin(y[1]), np.cos(y[1]), y[3]
            T = -sign * mu  # over N
            a = m * (g - h * c * rate**2) * h * (s - T * c) / (J + m * h * h * s * (s - T * c))
            N = m * (g - h * (s * a + c * rate**2))
            return np.array([y[2], rate, T * N / m - h * (c * a - s * rate**2), a])

        return rates

    def breaks(_, y):
        _, N, T = sticking(y[1], y[3])
        return abs(T) - mu * N

    def returns(_, y):
        return y[2]

    p, *_ = _start(case)
    tip = X @ p - h * np.sin(th0)
    phases = [(stick, breaks), (slide(-1.0), returns), (slide(1.0), lambda _, y: -1.0)]
    x, th, u, rate = _in_phases(phases, [tip, th0, 0.0, 0.0], t)
    v = (u + h * np.cos(th) * rate) * X - h * np.sin(th) * rate * Z
    return _rod_observed(case, X, x + h * np.sin(th), h * np.cos(th), v, rate)


def _rod_in_multipliers(case, t):
    """Centre of mass and angle, with the forces at the tip as multipliers of its accelerations."""
    L, m, J, mu, g, th0, X = _rod_data(case)
    h = L / 2

    def forces(y, sign):
        s, c, rate = np.sin(y[2]), np.cos(y[2]), y[5]
        rows = np.array([[1.0, 0.0, -h * c], [0.0, 1.0, h * s]])  # of the tip's x and z
        bias = h * rate**2 * np.array([s, c])
        W = np.diag([1 / m, 1 / m, 1 / J])
        needed = -(rows @ [0.0, -g, 0.0] + bias)
        if sign:
            push = np.array([-sign * mu, 1.0])
            f = push * needed[1] / (rows[1] @ W @ rows.T @ push)
        else:
            f = np.linalg.solve(rows @ W @ rows.T, needed)
        return f, np.array([0.0, -g, 0.0]) + W @ rows.T @ f

    def phase(sign):
        return lambda y: np.concatenate([y[3:], forces(y, sign)[1]])

    def breaks(_, y):
        f, _ = forces(y, 0.0)
        return abs(f[0]) - mu * f[1]

    def returns(_, y):
        return y[3] - h * np.cos(y[2]) * y[5]

    p, *_ = _start(case)
    phases = [(phase(0.0), breaks), (phase(-1.0), returns), (phase(1.0), lambda _, y: -1.0)]
    y = _in_phases(phases, [X @ p, h * np.cos(th0), th0, 0.0, 0.0, 0.0], t)
    return _rod_observed(case, X, y[0], y[1], y[3] * X + y[4] * Z, y[5])


def _pressed_rod(case, t):
    """Accelerations of a rod that slides ahead of its centre: ``N = g/A``, A little above Painleve's zero."""
    assert t == 0.0
    L, m, J, mu, g, th, X = _rod_data(case)
    _, _, v, _ = _start(case)
    h, s, c = L / 2, np.sin(th), np.cos(th)
    forward = np.sign(v @ X)
    N = g / (1 / m + h * h * s * (s + forward * mu * c) / J)
    alpha = N * h * (s + forward * mu * c) / J
    force = N * (Z - forward * mu * X)
    # the origin of the body is its centre of mass
    return {
        "a_WB_W": force / m - g * Z,
        "alpha_WB_W": alpha * np.cross(Z, X),
        "contact_force": np.array([force, 0.0 * Z]),
    }


# --- a braked wheel ------------------------------------------------------------------------------------------------


def _braked(case, t):
    """A wheel rolls under a brake whose torque grows, slips, locks, and slides to rest."""
    road, pad = case.mechanism.contacts
    start, index, bodies = case.initial_state, case.mechanism.body_index, case.mechanism.bodies
    load, wheel, block = case.mechanism.loads[0], index["wheel"], index["pad"]
    spin = start.R_WB[wheel] @ pad.normal
    arm = start.p_WB[block] + start.R_WB[block] @ pad.corner - start.p_WB[wheel]
    grip = pad.friction * np.linalg.norm(arm - (arm @ spin) * spin) * np.linalg.norm(load.vector)
    first, growth = grip * np.array(load.history.polynomial)
    total, r = sum(body.mass for body in bodies), road.radius
    own = start.R_WB[wheel].T @ spin
    moment = own @ bodies[wheel].inertia @ own
    carried = sum(bodies[index[name]].mass for name in ("carrier", "wheel", "pad"))
    N = carried * np.linalg.norm(case.mechanism.gravity)
    v0 = abs(case.initial.rates["rail"]["distance"])

    def torque(t, order=0):
        """Integral of the torque of the brake, of an order."""
        return [first + growth * t, first * t + growth * t**2 / 2, first * t**2 / 2 + growth * t**3 / 6][order]

    slips = (road.friction * N * (r + moment / (total * r)) - first) / growth
    braking = r / (total * r * r + moment)
    if t <= slips:
        v = v0 - braking * torque(t, 1)
        return {"distance": v0 * t - braking * torque(t, 2), "distance_rate": v, "angle_rate": v / r}
    v, x, a = v0 - braking * torque(slips, 1), v0 * slips - braking * torque(slips, 2), road.friction * N / total
    push = road.friction * N * r
    locks = brentq(lambda t: _spin(v / r, push, t - slips, torque(t, 1) - torque(slips, 1), moment), slips, slips + 9)
    w = 0.0 if t >= locks else _spin(v / r, push, t - slips, torque(t, 1) - torque(slips, 1), moment)
    dt = min(t - slips, v / a)
    return {"distance": x + v * dt - a * dt**2 / 2, "distance_rate": v - a * dt, "angle_rate": w}


def _spin(first, push, since, braked, moment):
    return first + (push * since - braked) / moment


ORIGINS = {
    "tripod": (_values(_in_space), _values(_tripod)),
    "tippe_top": (_values(_in_space), _values(_tippe_top)),
    "falling_rod": (_values(_falling_rod), _values(_rod_in_multipliers)),
    "pressed_rod": (_values(_pressed_rod),),
    "braked_wheel": (_values(_braked),),
}
