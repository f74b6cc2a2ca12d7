"""Origins of the group `mechanisms`: closed forms of each linkage; two independent sets of equations for the rest."""

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from consilience.mechanism import elementary_rotation
from oracles.benchmarks import iiwa
from oracles.origins import newton_euler
from oracles.origins.planar_newton import planar
from oracles.origins.relative import lagrange
from oracles.planar import drawn_frame


def closed(form, other):
    """Origin that combines closed forms (`form`) and computed values (`other`), as each value states."""

    def origin(case, published):
        exact = [form(case, known) for known in published if known.origin == "closed form"]
        asked = [known for known in published if known.origin == "computed"]
        rest = list(other(case, asked)) if asked else []
        return np.array([(exact if known.origin == "closed form" else rest).pop(0) for known in published])

    return origin


def axis_of(case, joint):
    """Point and direction of a joint's axis in the drawing."""
    at, axes = drawn_frame(case.mechanism, case.mechanism.joints[case.mechanism.joint_index[joint]])
    return at, axes[:, 2]


def turned(vector, axis, angle):
    return (
        vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle) + axis * (axis @ vector) * (1 - np.cos(angle))
    )


def moment_of_inertia(body, at, axis):
    R = body.drawing.R
    arm = np.cross(axis, body.drawing.p + R @ body.com - at)
    return axis @ R @ body.inertia @ R.T @ axis + body.mass * arm @ arm


# ---------------------------------------------------------------- Hooke's joint


class Hooke:
    """``tan(output) = c tan(input)``, angles from the drawing, c the cosine between the shafts."""

    def __init__(self, case):
        self.at, self.axis = axis_of(case, "output_bearing")
        self.c = axis_of(case, "input_bearing")[1] @ self.axis
        self.body = case.mechanism.bodies[case.mechanism.body_index["output_shaft"]]

    def output(self, angle):
        return np.arctan2(self.c * np.sin(angle), np.cos(angle))

    def ratio(self, angle):
        return self.c / (1 - (1 - self.c**2) * np.sin(angle) ** 2)

    def ratio_slope(self, angle):
        return self.ratio(angle) ** 2 / self.c * (1 - self.c**2) * np.sin(2 * angle)

    def value(self, known, angle, rate):
        """Value on the output shaft, or angle of the input, with the input at `angle` and at constant `rate`."""
        turn, spin = self.output(angle), self.ratio(angle) * rate * self.axis
        arm = self.body.drawing.p - self.at
        if known.of == "input_bearing":
            return {"angle": angle, "angle_rate": rate}[known.observable]
        vectors = {
            "p_WB": self.at + turned(arm, self.axis, turn),
            "v_WB_W": np.cross(spin, turned(arm, self.axis, turn)),
            "w_WB_W": spin,
            "alpha_WB_W": self.ratio_slope(angle) * rate**2 * self.axis,
            "angle": [turn],
            "angle_rate": [self.ratio(angle) * rate],
        }
        return vectors[known.observable][known.component]


def _hooke_driven(case, known):
    (drive,) = case.mechanism.drives
    angle, rate, _ = drive.motion.at(known.time)
    return Hooke(case).value(known, angle, rate)


def _hooke_free(case, known):
    """Kinetic energy is constant, ``(J1 + J2 r^2) rate^2``: time is a quadrature over the angle."""
    joint = Hooke(case)
    J = [
        moment_of_inertia(body, *axis_of(case, bearing))
        for body, bearing in zip(case.mechanism.bodies, ("input_bearing", "output_bearing"), strict=True)
    ]
    start = case.initial.coordinates["input_bearing"]["angle"]

    def root(angle):
        return np.sqrt(J[0] + J[1] * joint.ratio(angle) ** 2)

    speed = root(start) * case.initial.rates["input_bearing"]["angle"]

    def late(angle):
        return quad(root, start, angle, epsabs=1e-13, epsrel=1e-13, limit=200)[0] / speed - known.time

    angle = brentq(late, start, start + 10 * (known.time + 1), xtol=1e-15, rtol=1e-15)
    return joint.value(known, angle, speed / root(angle))


# ---------------------------------------------------------------- Peaucellier's linkage


def _straight_line(case, known):
    """The pen moves on a line perpendicular to OC, at (L^2 - l^2) / (2 OC) from O."""
    O, _ = axis_of(case, "O_a")
    C, P, A = (axis_of(case, name)[0] for name in ("crank_pivot", "P_a", "A_inner"))
    distance = ((A - O) @ (A - O) - (P - A) @ (P - A)) / (2 * np.linalg.norm(C - O))
    assert known.observable == "p_WB"
    assert known.component in (0, 1)
    return (O + distance * (C - O) / np.linalg.norm(C - O))[known.component]


# ---------------------------------------------------------------- parallelogram


def _parallelogram(case, known):
    """The coupler translates only: equation of a compound pendulum; time is a quadrature over its angle."""
    m = case.mechanism
    A, normal = axis_of(case, "crank_pivot")
    pins = {"crank": A, "coupler": axis_of(case, "crank_pin")[0], "follower": axis_of(case, "follower_pivot")[0]}
    arm = pins["coupler"] - A
    J, pull = 0.0, np.zeros(3)
    for body in m.bodies:
        turning = body.name != "coupler"
        out = body.drawing.p + body.drawing.R @ body.com - pins[body.name] if turning else arm
        out = out - normal * (normal @ out)
        J += moment_of_inertia(body, pins[body.name], normal) if turning else body.mass * arm @ arm
        pull += body.mass * out
    work = m.gravity @ pull, m.gravity @ np.cross(normal, pull)  # work of gravity up to the angle q, minus a constant
    start = case.initial.rates["crank_pivot"]["angle"]

    def speed(q):
        return np.sqrt(start**2 + 2 / J * (work[0] * (np.cos(q) - 1) + work[1] * np.sin(q)))

    q = angle_after(known.time, lambda q: 1 / speed(q))
    w = speed(q) * normal
    body = m.bodies[m.body_index[known.of]]
    if known.of == "coupler":
        value = {
            "p_WB": body.drawing.p + turned(arm, normal, q) - arm,
            "v_WB_W": np.cross(w, turned(arm, normal, q)),
            "w_WB_W": np.zeros(3),
            "x_axis": body.drawing.R[:, 0],
        }
    else:
        value = {"w_WB_W": w, "x_axis": turned(body.drawing.R[:, 0], normal, q)}
    return value[known.observable][known.component]


def angle_after(time, slowness):
    """Angle at which the integral of `slowness`, the inverse speed, equals the time."""
    if time == 0:
        return 0.0

    def late(q):
        return quad(slowness, 0, q, epsabs=1e-13, epsrel=1e-13, limit=400)[0] - time

    high = 1.0
    while late(high) < 0:
        high *= 1.5
    return brentq(late, 0, high, xtol=1e-14, rtol=1e-14)


# ---------------------------------------------------------------- scissor lift


def _scissor_lift(case, known):
    """The foot is ``d = l cos(a)`` long; each stage is ``l sin(a)`` high."""
    at = {name: axis_of(case, name)[0] for name in ("foot_1", "foot_2", "head_4", "pin_right")}
    base = at["foot_2"] - at["foot_1"]
    drawn = np.linalg.norm(base)
    length = np.linalg.norm(at["pin_right"] - at["foot_1"])
    along, up = base / drawn, np.array([0.0, 0.0, 1.0])
    shift, rate, _ = case.mechanism.drives[0].motion.at(known.time)
    d = drawn + shift
    high = 2 * np.sqrt(length**2 - d**2)
    body = case.mechanism.bodies[case.mechanism.body_index[known.of]]
    turn = np.arccos(d / length) - np.arccos(drawn / length)
    turning = -rate / np.sqrt(length**2 - d**2) * np.cross(along, up)
    # cross(along, up) is the normal: a positive rotation about it moves `along` toward `up`
    value = {
        ("platform", "p_WB"): at["foot_1"] + high * up,
        ("platform", "v_WB_W"): -4 * d * rate / high * up,
        ("upper_block", "p_WB"): at["foot_1"] + high * up + d * along,
        ("bar_1", "w_WB_W"): turning,
        ("bar_1", "x_axis"): turned(body.drawing.R[:, 0], np.cross(along, up), turn),
        ("bar_4", "w_WB_W"): -turning,
    }
    return value[known.of, known.observable][known.component]


# ---------------------------------------------------------------- cart-pole


def _cart_pole(case, known):
    """Florian's equations (21) and (22) without friction; the angle counts from upright, positive toward the push."""
    cart, pole = case.mechanism.bodies
    (push,) = case.mechanism.loads
    force, mass, length = np.linalg.norm(push.vector), cart.mass + pole.mass, pole.com[2]
    g = np.linalg.norm(case.mechanism.gravity)
    angle, rate = case.initial.coordinates["pin"]["angle"], case.initial.rates["pin"]["angle"]
    s, c = np.sin(angle), np.cos(angle)
    alpha = (g * s - c * (force + pole.mass * length * rate**2 * s) / mass) / (
        length * (4 / 3 - pole.mass * c**2 / mass)
    )
    a = (force + pole.mass * length * (rate**2 * s - alpha * c)) / mass
    along, pin = push.vector / force, axis_of(case, "pin")[1]
    return {"a_WB_W": a * along, "alpha_WB_W": alpha * pin}[known.observable][known.component]


# ---------------------------------------------------------------- crane


def _crane(case, published):
    """D'Alembert's principle in x, y, the two angles of the hook, and the integrals of the controllers.

    The load turns by a about y, then by b about the turned x axis u; r is its centre of mass from the hook.
    """
    m = case.mechanism
    bridge, trolley, load = m.bodies
    hook, ex, ey = axis_of(case, "hook")[0], *np.eye(3)[:2]
    r0, I0 = load.drawing.p + load.drawing.R @ load.com - hook, load.drawing.R @ load.inertia @ load.drawing.R.T
    mass = np.array([bridge.mass + trolley.mass, trolley.mass])
    viscous = np.array([f.viscous for f in m.frictions])

    def rotation(a, b):
        return np.column_stack([turned(turned(e, ex, b), ey, a) for e in np.eye(3)])

    def derivative(t, y):
        (q, v, s), c = (y[:4], y[4:8], y[8:]), m.controls
        R, u = rotation(q[2], q[3]), turned(ex, ey, q[2])
        r, I = R @ r0, R @ I0 @ R.T
        axes, w = np.array([ey, u]), v[2] * ey + v[3] * u
        along = np.array([ex, ey, np.cross(ey, r), np.cross(u, r)])  # velocity of the centre of mass for unit rates
        spins = np.array([np.zeros(3), np.zeros(3), *axes])
        alpha = v[2] * v[3] * np.cross(ey, u)  # the part of the angular acceleration without second derivatives
        a = np.cross(alpha, r) + np.cross(w, np.cross(w, r))
        M = load.mass * along @ along.T + spins @ I @ spins.T
        M[[0, 1], [0, 1]] += mass
        f = load.mass * along @ (m.gravity - a) - spins @ (I @ alpha + np.cross(w, I @ w))
        target = np.array([k.target.at(t) for k in c])
        error = target[:, 0] - q[:2]
        f[:2] -= viscous * v[:2]
        f[:2] += [k.proportional * e + k.integral * i for k, e, i in zip(c, error, s, strict=True)]
        f[:2] += [k.derivative * (rate - x) for k, rate, x in zip(c, target[:, 1], v, strict=False)]
        return np.concatenate([v, np.linalg.solve(M, f), error])

    held = case.initial.coordinates["hook"]
    start = np.array([0, 0, held["angle1"], held["angle2"], *np.zeros(6)])
    times = sorted({known.time for known in published})
    rows = solve_ivp(derivative, (0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-12, atol=1e-12, max_step=0.02)
    found = []
    for known in published:
        y = rows.y[:, times.index(known.time)]
        carried = np.array([y[0], y[1], 0.0])
        R, w = rotation(y[2], y[3]), y[6] * ey + y[7] * turned(ex, ey, y[2])
        values = {
            ("bridge_rail", "distance"): [y[0]],
            ("trolley_rail", "distance_rate"): [y[5]],
            ("load", "p_WBcm"): hook + carried + R @ r0,
            ("load", "w_WB_W"): w,
        }
        found.append(values[known.of, known.observable][known.component])
    return np.array(found)


# ---------------------------------------------------------------- seven-axis arm


def _arm(case, published):
    """Initial accelerations by inverse dynamics, because the torques are linear in the accelerations."""
    q, v = (
        np.array([by[f"j{n}"]["angle"] for n in range(1, 8)]) for by in (case.initial.coordinates, case.initial.rates)
    )
    applied = np.array([s.actuator.at(0.0)[0] for s in case.mechanism.joint_springs])
    g = np.linalg.norm(case.mechanism.gravity)
    rest = iiwa.torques(q, v, np.zeros(7), g)
    M = np.array([iiwa.torques(q, v, e, g) - rest for e in np.eye(7)]).T
    a = np.linalg.solve(M, applied - rest)
    R, w, alpha, found = np.eye(3), np.zeros(3), np.zeros(3), {}
    for n, body in enumerate(case.mechanism.bodies):
        before = case.mechanism.bodies[n - 1].drawing.R if n else np.eye(3)
        R = R @ before.T @ body.drawing.R @ elementary_rotation(2, q[n])
        alpha = alpha + a[n] * R[:, 2] + v[n] * np.cross(w, R[:, 2])
        w = w + v[n] * R[:, 2]
        found[body.name] = alpha
    return np.array([{"alpha_WB_W": found[k.of]}[k.observable][k.component] for k in published])


def _spinning_end(case, known):
    """Angular acceleration of the last joint: torque over moment of inertia; nothing else moves."""
    last = case.mechanism.bodies[-1]
    alpha = case.mechanism.joint_springs[-1].actuator.at(0.0)[0] / last.inertia[2, 2]
    turn = alpha * known.time**2 / 2
    value = {
        "x_axis": np.array([np.cos(turn), np.sin(turn), 0.0]),
        "w_WB_W": np.array([0.0, 0.0, alpha * known.time]),
        "p_WB": np.array([0.0, 0.0, 1.261]),
    }
    assert np.allclose(last.drawing.R, np.eye(3), rtol=0, atol=1e-12)
    return value[known.observable][known.component]


NEWTON_EULER = newton_euler.values
_pen = ("P_a", "P_b", "pen")

ORIGINS = {
    "hookes_joint_driven": (closed(_hooke_driven, None),),
    "hookes_joint_free": (closed(_hooke_free, None),),
    "rssr_four_bar": (lagrange("rocker_ball"), NEWTON_EULER),
    "rsur_four_bar": (lagrange("crank_ball"), NEWTON_EULER),
    "peaucellier_linkage": (closed(_straight_line, lagrange(*_pen)), closed(_straight_line, planar("O_a"))),
    "parallelogram": (closed(_parallelogram, None),),
    "scissor_lift": (closed(_scissor_lift, None),),
    "toggle_clamp": (lagrange("arm_pin"), planar("handle_pivot")),
    "cart_pole": (closed(_cart_pole, lagrange()), closed(_cart_pole, planar("pin"))),
    "acrobot": (lagrange(), planar("shoulder")),
    "furuta_pendulum": (lagrange(), NEWTON_EULER),
    "stewart_platform": (lagrange("ball_2", "ball_3", "ball_4", "ball_5", "ball_6"), NEWTON_EULER),
    "rotary_stewart_platform": (lagrange(), NEWTON_EULER),
    "gantry_crane": (lagrange(), _crane),
    "double_wishbone": (lagrange("upper_ball"), NEWTON_EULER),
    "seven_axis_arm": (lagrange(), _arm),
    "seven_axis_arm_upright": (closed(_spinning_end, None),),
    "quadruped": (lagrange(), NEWTON_EULER),
}
