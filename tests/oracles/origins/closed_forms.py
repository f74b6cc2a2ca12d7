"""Origins in closed form: centre of mass and rotation of each body are known functions of time.

Every formula is checked against its own differential equation in `oracles.test_closed_forms`, or stated in place. Only
the data that a formula needs are read from the case: masses, drawing, initial values.
"""

import numpy as np
from scipy.linalg import eigh

from consilience.mechanism import rotation_from_quaternion
from oracles.closed_forms.free_body import Asymmetric, symmetric
from oracles.closed_forms.nonlinear_springs import coasting, cubic, quadratic
from oracles.closed_forms.oscillator import oscillator
from oracles.closed_forms.pendulum import Pendulum
from oracles.origins import tops
from oracles.origins.moving import about, about_hinge, drawn_com, drawn_inertia, hinged, joint_of, origin, sliding
from oracles.planar import drawn_frame, held

# --- pendulums ------------------------------------------------------------------------------------------------------


def physical_pendulum(case):
    """Only the components of gravity and of the arm perpendicular to the hinge axis have an effect."""
    (body,) = case.mechanism.bodies
    u, J, arm = about_hinge(case, "hinge")
    pull = case.mechanism.gravity - (case.mechanism.gravity @ u) * u
    drawn = np.arctan2(u @ np.cross(pull, arm), pull @ arm)  # angle from hanging
    angle, rate = held(case, "hinge")
    frequency = np.sqrt(body.mass * np.linalg.norm(pull) * np.linalg.norm(arm) / J)
    pendulum = Pendulum(frequency, drawn + angle, rate)

    def at(t):
        phi, phi_dot = (x[0] for x in pendulum.solve([t]))
        return phi - drawn, phi_dot

    return [hinged(case, "hinge", at)]


def spherical_pendulum(case):
    """The centre of mass moves as that of a symmetric top without axial momentum; about it the body rotates freely."""
    (body,) = case.mechanism.bodies
    rod = case.mechanism.joints[0]
    assert not np.any(body.com)
    assert not np.any(rod.M.p)
    pivot = drawn_frame(case.mechanism, rod)[0]
    v, w = (np.asarray(x) for x in case.initial.velocities[body.name])
    swing = tops.spherical(body.drawing.p - pivot, v, np.linalg.norm(case.mechanism.gravity))
    tumble = _tumbling(body, w)

    def at(t):
        arm, arm_dot = swing(t)
        return (pivot + arm, arm_dot, *tumble(t))

    return [at]


def conical_pendulum(case):
    """Steady rotation about the vertical; the moment of the weight about the ball joint equals ``w x I w``."""
    (body,) = case.mechanism.bodies
    g = -case.mechanism.gravity[2]
    pivot = drawn_frame(case.mechanism, joint_of(case, "ball"))[0]
    w = np.asarray(case.initial.rates["ball"]["orientation"])
    c, I = drawn_com(body) - pivot, drawn_inertia(body)
    about_ball = I + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
    moment = np.cross(c, np.array([0.0, 0.0, -body.mass * g]))
    assert np.max(np.abs(np.cross(w, about_ball @ w) - moment)) < 1e-13

    def at(t):
        turn = about([0.0, 0.0, 1.0], w[2] * t)
        return pivot + turn @ c, np.cross(w, turn @ c), turn, w

    return [at]


# --- free bodies and tops -------------------------------------------------------------------------------------------


def _tumbling(body, w):
    """Rotation and angular velocity of a torque-free body that starts in the drawing with angular velocity `w`."""
    moments, V = np.linalg.eigh(body.inertia)
    V = V * np.array([1.0, 1.0, np.linalg.det(V)])
    A = body.drawing.R @ V  # principal axes in the drawing
    start = A.T @ w
    if moments[1] - moments[0] > 1e-9 * moments[2] and moments[2] - moments[1] > 1e-9 * moments[2]:
        free = Asymmetric(moments, start)

        def turned(t):
            R = A @ free.orientations([t])[0]
            return R @ A.T, R @ free.rates([t])[0]

        return turned
    # axis of symmetry last
    order = [0, 1, 2] if moments[1] - moments[0] <= 1e-9 * moments[2] else [1, 2, 0]
    A, moments, start = A[:, order], moments[order], start[order]

    def spun(t):
        quats, rates = symmetric(moments[0], moments[2], start, [t])
        R = A @ rotation_from_quaternion(quats)[0]
        return R @ A.T, R @ rates[0]

    return spun


def thrown(case):
    """A free body: the centre of mass moves on a parabola, the body rotates without torque."""
    (body,) = case.mechanism.bodies
    v, w = (np.asarray(x, dtype=float) for x in case.initial.velocities[body.name])
    c, g = drawn_com(body), case.mechanism.gravity
    c_dot = v + np.cross(w, body.drawing.R @ body.com)
    tumble = _tumbling(body, w)
    return [lambda t: (c + c_dot * t + g * t * t / 2, c_dot + g * t, *tumble(t))]


def steady_precession(case):
    """A symmetric top that precesses steadily at a constant tilt."""
    (body,) = case.mechanism.bodies
    g, pivot = -case.mechanism.gravity[2], drawn_frame(case.mechanism, joint_of(case, "tip"))[0]
    w = np.asarray(case.initial.rates["tip"]["orientation"])
    c = drawn_com(body) - pivot
    l = np.linalg.norm(c)
    e, up = c / l, np.array([0.0, 0.0, 1.0])
    I = drawn_inertia(body)
    axial = e @ I @ e
    transverse = (np.trace(I) - axial) / 2 + body.mass * l**2
    # w = precession up + spin e
    spin, precession = np.linalg.lstsq(np.column_stack([e, up]), w, rcond=None)[0]
    tilt = np.arccos(e @ up)
    expected = body.mass * g * l / (axial * precession) + (transverse - axial) / axial * precession * np.cos(tilt)
    assert abs(spin - expected) < 1e-12 * abs(spin)

    def at(t):
        carried = about(up, precession * t)
        turn = carried @ about(e, spin * t)
        now = carried @ w
        return pivot + turn @ c, np.cross(now, turn @ c), turn, now

    return [at]


def heavy_top(case):
    """A heavy top, released with its axis horizontal."""
    (body,) = case.mechanism.bodies
    pivot = drawn_frame(case.mechanism, joint_of(case, "ball"))[0]
    w = np.asarray(case.initial.rates["ball"]["orientation"])
    c = drawn_com(body) - pivot
    turn_of = tops.heavy(body.mass, drawn_inertia(body), c, w, -case.mechanism.gravity[2])

    def at(t):
        turn, now = turn_of(t)
        return pivot + turn @ c, np.cross(now, turn @ c), turn, now

    return [at]


# --- slides, springs, gears -----------------------------------------------------------------------------------------


def nonlinear_springs(case):
    """A spring that hardens, one with an even part on a slide passed backwards, a rotor that coasts down."""
    m = case.mechanism
    hard, even, brake = m.joint_springs
    masses = {b.name: b.mass for b in m.bodies}
    _, J, _ = about_hinge(case, "pin")

    def start(spring):
        return case.initial.coordinates[spring.joint]["distance"] - spring.rest

    def hardening(t):
        x, v = cubic(masses["hard"], hard.stiffness, hard.higher_stiffness[1], start(hard), [t])
        return hard.rest + x[0], v[0]

    u = drawn_frame(m, joint_of(case, "even_slide"))[1][:, 2]
    drawn = drawn_com(m.bodies[m.body_index["even"]])

    def backwards(t):
        x, v = quadratic(masses["even"], even.stiffness, even.higher_stiffness[0], start(even), [t])
        return drawn - (even.rest + x[0]) * u, -v[0] * u, np.eye(3), np.zeros(3)

    def coast(t):
        return coasting(J, (brake.damping, *brake.higher_damping), case.initial.rates["pin"]["angle"], t)

    return [sliding(case, "hard_slide", hardening), backwards, hinged(case, "pin", coast)]


def spring_chain(case):
    """Masses on a line with springs and dampers between neighbours; modes, as damping is proportional to stiffness."""
    m = case.mechanism
    u = drawn_frame(m, m.joints[0])[1][:, 2]
    n = len(m.bodies)
    stretch = np.eye(n) - np.eye(n, k=-1)  # elongation of each spring from the displacements
    k = np.array([s.stiffness for s in m.springs])
    beta = m.springs[0].damping / k[0]
    assert np.allclose([s.damping for s in m.springs], beta * k, rtol=1e-15)
    drawn = np.diff(
        [0.0, *(u @ (b.drawing.p + b.drawing.R @ s.point_successor) for b, s in zip(m.bodies, m.springs, strict=True))]
    )
    slack = drawn - [s.free_length for s in m.springs]
    mass = np.array([b.mass for b in m.bodies])
    K = stretch.T @ np.diag(k) @ stretch
    rest = np.linalg.solve(K, mass * (m.gravity @ u) - stretch.T @ (k * slack))
    squares, modes = eigh(K, np.diag(mass))
    x0, v0 = (
        np.array([float(values[j.name]["distance"]) for j in m.joints])
        for values in (case.initial.coordinates, case.initial.rates)
    )
    a0, b0 = modes.T @ (mass * (x0 - rest)), modes.T @ (mass * v0)

    def displacement(t):
        pairs = [oscillator(1.0, beta * s, s, a, b, t) for s, a, b in zip(squares, a0, b0, strict=True)]
        x, v = (np.array(y) for y in zip(*pairs, strict=True))
        return rest + modes @ x, modes @ v

    def slider(i):
        return sliding(case, m.joints[i].name, lambda t: tuple(y[i] for y in displacement(t)))

    return [slider(i) for i in range(n)]


def _polynomial_turn(coefficients, angle, rate):
    """Angle and angular velocity; the angular acceleration is a polynomial in time."""
    speed = np.polynomial.Polynomial(coefficients).integ(1, k=[rate])
    return lambda t: (speed.integ(1, k=[angle])(t), speed(t))


def gears(case):
    """Two shafts with gear ratio r, a torque on the first: ``(J1 + r^2 J2) q'' = tau(t)``."""
    m = case.mechanism
    (coupling,), (load,) = m.couplings, m.loads
    ratio = coupling.law.at(1.0)[0] - coupling.law.at(0.0)[0]
    (u, J1, arm), (_, J2, other) = (about_hinge(case, name) for name in (coupling.driver_joint, coupling.joint))
    weightless = not np.any(m.gravity) or max(np.max(np.abs(arm)), np.max(np.abs(other))) < 1e-12
    assert weightless
    torque = u @ m.bodies[m.body_index[load.body]].drawing.R @ load.vector
    history = load.history.polynomial if load.history else np.ones(1)
    turn = _polynomial_turn(torque * history / (J1 + ratio**2 * J2), *held(case, coupling.driver_joint))
    return [
        hinged(case, coupling.driver_joint, turn),
        hinged(case, coupling.joint, lambda t: tuple(ratio * x for x in turn(t))),
    ]


def rack_and_pinion(case):
    """Constant torque and weight against viscous friction: the rate decays exponentially to its steady value."""
    m = case.mechanism
    (coupling,), (load,), (friction,) = m.couplings, m.loads, m.frictions
    radius = coupling.law.at(1.0)[0] - coupling.law.at(0.0)[0]
    u, J, arm = about_hinge(case, "shaft")
    assert np.max(np.abs(arm)) < 1e-12
    rack = m.bodies[m.body_index["rack"]]
    along = drawn_frame(m, joint_of(case, "slide"))[1][:, 2]
    torque = u @ m.bodies[m.body_index[load.body]].drawing.R @ load.vector
    final = (torque + radius * rack.mass * m.gravity @ along) / friction.viscous
    decay = friction.viscous / (J + radius**2 * rack.mass)
    start, rate = held(case, "shaft")

    def turn(t):
        gone = -np.expm1(-decay * t)
        return start + final * t + (rate - final) * gone / decay, final + (rate - final) * (1 - gone)

    return [hinged(case, "shaft", turn), sliding(case, "slide", lambda t: tuple(radius * x for x in turn(t)))]


def cam(case):
    """The angle is a linear function of time, the lift a sum of sines of the angle."""
    m = case.mechanism
    (drive,), (coupling,) = m.drives, m.couplings
    start, speed = drive.motion.polynomial
    a, w, phase = coupling.law.harmonics.T

    def lift(t):
        x = w * (start + speed * t) + phase
        return a @ np.sin(x), speed * (a * w) @ np.cos(x)

    return [hinged(case, "shaft", lambda t: (start + speed * t, speed)), sliding(case, "guide", lift)]


def cam_reactions(case):
    """Reactions of both joints at the start, in axes of F; without the drive's torque and the cam's force along z."""
    m = case.mechanism
    (drive,), (coupling,) = m.drives, m.couplings
    start, speed = drive.motion.polynomial
    a, w, phase = coupling.law.harmonics.T
    jerked = {"shaft": 0.0, "guide": -(speed**2) * (a * w**2) @ np.sin(w * start + phase)}
    found = {}
    for (name, push), at in zip(jerked.items(), cam(case), strict=True):
        body = m.bodies[m.body_index[joint_of(case, name).successor]]
        pin, U = drawn_frame(m, joint_of(case, name))
        c, _, turn, spin = at(0.0)
        if name == "guide":
            pin = pin + coupling.law.at(start)[0] * U[:, 2]
        I = turn @ drawn_inertia(body) @ turn.T
        force = body.mass * (push * U[:, 2] + np.cross(spin, np.cross(spin, c - pin)) - m.gravity)
        found[name, "force_F"] = U.T @ force
        found[name, "torque_F"] = U.T @ (np.cross(spin, I @ spin) + np.cross(c - pin, force))
    return found


# --- contact planes and rolling -------------------------------------------------------------------------------------


def incline(case):
    """The centre of mass moves on a parabola in the plane; the rate about the normal is constant."""
    (body,) = case.mechanism.bodies
    at, U = drawn_frame(case.mechanism, joint_of(case, "contact"))
    n = U[:, 2]
    q, rates = (x["contact"] for x in (case.initial.coordinates, case.initial.rates))
    spin = float(rates["angle"])
    g = case.mechanism.gravity - (case.mechanism.gravity @ n) * n
    arm = about(n, float(q["angle"])) @ (drawn_com(body) - at)
    c = at + U @ [q["x"], q["y"], 0.0] + arm
    v = U @ [rates["x"], rates["y"], 0.0] + spin * np.cross(n, arm)
    start = float(q["angle"])
    return [lambda t: (c + v * t + g * t * t / 2, v + g * t, about(n, start + spin * t), spin * n)]


def incline_reactions(case):
    """Normal force, and the moment about the origin of M that lets the block turn about the normal alone."""
    (body,) = case.mechanism.bodies
    at, U = drawn_frame(case.mechanism, joint_of(case, "contact"))
    c, _, turn, spin = incline(case)[0](0.0)
    q = case.initial.coordinates["contact"]
    normal = -body.mass * (case.mechanism.gravity @ U[:, 2]) * U[:, 2]
    I = turn @ drawn_inertia(body) @ turn.T
    moment = np.cross(spin, I @ spin) + np.cross(c - at - U @ [q["x"], q["y"], 0.0], normal)
    return {("contact", "force_F"): U.T @ normal, ("contact", "torque_F"): U.T @ moment}


def rolling_disc(case):
    """Steady rolling of a disc in a circle: with the tilt theta of the axis e, the precession W and the axial rate w3,
    ``(C + m a^2) w3 W sin(theta) = A W^2 sin(theta) cos(theta) - m g a cos(theta)``.

    From the moment of the contact force ``m (a w3 W h + g z)`` about the centre, h the level part of e.
    """
    (body,), (disc,) = case.mechanism.bodies, case.mechanism.rollings
    g, a, up = -case.mechanism.gravity[2], disc.radius, np.array([0.0, 0.0, 1.0])
    _, w = (np.asarray(x, dtype=float) for x in case.initial.velocities[body.name])
    e = body.drawing.R @ disc.axis
    c, I = drawn_com(body), drawn_inertia(body)
    axial = e @ I @ e
    transverse = (np.trace(I) - axial) / 2
    cos, sin = e @ up, np.linalg.norm(np.cross(up, e))
    across = np.cross(up, e) / sin
    down = np.cross(across, e)
    precession, w3 = -(w @ down) / sin, w @ e
    balance = (axial + body.mass * a**2) * w3 * precession * sin
    weight = transverse * precession**2 * sin * cos - body.mass * g * a * cos
    assert abs(balance - weight) < 1e-12
    assert abs(w @ across) < 1e-12
    middle = c + a * w3 / precession * (e - cos * up) / sin

    def at(t):
        carried = about(up, precession * t)
        turn = carried @ about(e, (w3 - precession * cos) * t)
        now = carried @ (c - middle)
        return middle + now, precession * np.cross(up, now), turn, carried @ w

    return [at]


def with_reactions(moving, reactions):
    """Origin from a motion, and from reactions at the start by joint and observable."""

    def values(case, published):
        motion, first = origin(moving), reactions(case)
        return np.array(
            [
                first[known.of, known.observable][known.component] if known.at_start else motion(case, [known])[0]
                for known in published
            ]
        )

    return values


_MOVING = {
    "physical_pendulum-small": physical_pendulum,
    "physical_pendulum-large": physical_pendulum,
    "physical_pendulum-rotating": physical_pendulum,
    "spherical_pendulum": spherical_pendulum,
    "conical_pendulum": conical_pendulum,
    "torque_free_symmetric": thrown,
    "dzhanibekov": thrown,
    "osrf_box": thrown,
    "ballistic_flight": thrown,
    "heavy_top": heavy_top,
    "steady_precession": steady_precession,
    "sliding_masses": spring_chain,
    "nonlinear_springs": nonlinear_springs,
    "gear_pair": gears,
    "bevel_gears": gears,
    "rack_and_pinion": rack_and_pinion,
    "rolling_disc": rolling_disc,
}

ORIGINS = {name: (origin(moving),) for name, moving in _MOVING.items()} | {
    "cam_follower": (with_reactions(cam, cam_reactions),),
    "incline": (with_reactions(incline, incline_reactions),),
}
