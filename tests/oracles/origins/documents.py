"""Origins of the examples of the source documents: formulas, and hand-written equations in planes or joint angles."""

import numpy as np

from oracles import four_bar, spatial_pendulum
from oracles.benchmarks import planar as published
from oracles.double_pendulum import DoublePendulum
from oracles.integrate import integrate
from oracles.one_freedom import Motion, OneFreedom
from oracles.origins import newton_euler
from oracles.origins.relative import lagrange
from oracles.planar import drawn_frame

X, Y, Z = np.eye(3)


def _origin(solve):
    """Origin from ``solve(case, times)``: a dictionary from (body or joint, observable) to arrays, time first."""

    def values(case, known):
        times = np.array(sorted({0.0, *(k.time for k in known)}))
        found = solve(case, times)
        rows = [np.searchsorted(times, k.time) for k in known]
        arrays = [np.asarray(found[k.of, k.observable]) for k in known]
        arrays = [a if a.ndim == 2 else a[:, None] for a in arrays]
        return np.array([a[row, k.component] for a, k, row in zip(arrays, known, rows, strict=True)])

    return values


# --- formulas -------------------------------------------------------------------------------------------------------


def _manipulator(case, times):
    """Position of the hand ``l2 e(theta2) + l3 e(theta3)`` as complex x + i z; force of the shoulder at the start."""
    t = times
    two, rate_2 = 0.3 + 1.2 * t, 1.2
    three, rate_3, second_3 = 1 - 0.7 * t**2, -1.4 * t, -1.4
    e2, e3 = np.exp(1j * two), np.exp(1j * three)

    def flat(z):
        return np.column_stack([z.real, 0 * t, z.imag])

    hand = 0.5 * e2 + 0.4 * e3
    velocity = 0.5j * rate_2 * e2 + 0.4j * rate_3 * e3
    elbow = -0.5 * rate_2**2 * e2

    def acceleration(arm):
        """Acceleration of a point of the fore link; `arm` is its position from the elbow at theta3 = 0."""
        return elbow + arm * e3 * (1j * second_3 - rate_3**2)

    upper, fore = case.mechanism.bodies
    assert upper.drawing.p @ X == 0
    center = fore.drawing.p + fore.drawing.R @ fore.com - 0.5 * X
    own = complex(*upper.com[[0, 2]]) * e2 * -(rate_2**2)
    force = upper.mass * (own + 9.81j) + fore.mass * (acceleration(complex(*center[[0, 2]])) + 9.81j)
    return {
        ("fore", "p_WB"): flat(hand),
        ("fore", "v_WB_W"): flat(velocity),
        ("fore", "a_WB_W"): flat(acceleration(0.4)),
        ("shoulder", "force_F"): np.column_stack([force.real, force.imag, 0 * t]),
    }


def _block(case, times):
    """``m x'' = F`` along the slide, and equilibrium of forces and moments."""
    mechanism = case.mechanism
    (body,), (push,), (guide,) = mechanism.bodies, mechanism.loads, mechanism.joints
    F = push.vector @ X
    a, start = F / body.mass, case.initial.rates["guide"]["distance"]
    inertia = body.mass * (a * X - mechanism.gravity)
    R = body.drawing.R
    torque = np.cross(R @ body.com, inertia) - np.cross(R @ push.point, push.vector)
    x = start * times + a * times**2 / 2
    same = np.ones((len(times), 1))
    axes = guide.F.R
    return {
        ("block", "p_WB"): body.drawing.p + x[:, None] * X,
        ("block", "v_WB_W"): (start + a * times)[:, None] * X,
        ("block", "a_WB_W"): same * (a * X),
        ("guide", "force_F"): same * (axes.T @ (inertia - push.vector)),
        ("guide", "torque_F"): same * (axes.T @ torque),
    }


def _excavator(case, times):
    """Law of cosines in the triangle of the foot and both eyes of the cylinder, and its derivative."""
    a, b = 0.6, 1.5
    s, rate = 0.15 * times**2 - 0.05 * times**3, 0.3 * times - 0.15 * times**2
    L = np.hypot(a, b) + s
    phi = np.arccos((a * a + b * b - L * L) / (2 * a * b))
    turn = L * rate / (a * b * np.sin(phi))
    u, hinge = np.array([0.8, 0.6, 0.0]), np.array([0.6, -0.8, 0.0])
    angle = phi - np.pi / 2
    c, d = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return {
        ("foot", "angle"): angle,
        ("foot", "angle_rate"): turn,
        ("rod", "p_WB"): b * (c * u + d * Z),
        ("rod", "v_WB_W"): b * turn[:, None] * (c * Z - d * u),
        ("boom", "w_WB_W"): turn[:, None] * hinge,
    }


# --- loops in the plane -----------------------------------------------------------------------------------------------


def _bodies(linkage, q, rate):
    """Origins and angular velocities of the bodies of a planar linkage."""
    plane, found = linkage.plane, {}
    for body, motion in zip(plane.mechanism.bodies, linkage.motions(q), strict=True):
        arm = motion.turn * (plane.flat(body.drawing.p) - motion.drawn)
        height = plane.normal @ body.drawing.p
        p, v = motion.anchor + arm, (motion.anchor_q + 1j * motion.a_q * arm) * rate
        flat = np.array([plane.e1, plane.e2])
        found[body.name, "p_WB"] = np.column_stack([p.real, p.imag]) @ flat + height * plane.normal
        found[body.name, "v_WB_W"] = np.column_stack([v.real, v.imag]) @ flat
        found[body.name, "w_WB_W"] = (motion.a_q * rate)[:, None] * plane.normal
    return found


def _welded(case):
    """The linkage of `four_bar` on a base that is fixed to the ground."""
    linkage = four_bar.linkage(case)

    def motions(q):
        one = np.ones_like(q)
        return [Motion(0.0, 0 * one + 0j, 0.0, 0.0, one + 0j, 0 * one, 0 * one), *linkage.motions(q)]

    return OneFreedom(linkage.plane, motions)


def _pin_forces(linkage, q, rate):
    """Forces in the plane on the successors of the four pins, from Newton's and Euler's laws for the three links.

    Nine equations for eight components: the nine are consistent only if the accelerations are correct.
    """
    J, h, Q = linkage.coefficients(q)
    second = (Q - h * rate**2) / J
    plane = linkage.plane
    pins = [plane.pin(name) for name in PINS]
    links = list(zip(linkage.bodies, linkage.motions(q), strict=True))[-3:]
    # for each link: its pins, with the signs of their forces on the link
    held = (((0, 1), (1, -1)), ((1, 1), (2, -1)), ((2, 1), (3, 1)))
    A, b = np.zeros((9, 8)), np.zeros(9)
    for n, ((body, motion), hands) in enumerate(zip(links, held, strict=True)):
        c_q, c_qq = motion.com_derivatives(body)
        needed = body.mass * (c_q * second + c_qq * rate**2 - plane.gravity)
        b[3 * n : 3 * n + 3] = needed.real, needed.imag, body.inertia * (motion.a_q * second + motion.a_qq * rate**2)
        for pin, sign in hands:
            arm = pins[pin] - body.com  # the initial pose is the drawing
            A[3 * n : 3 * n + 3, 2 * pin : 2 * pin + 2] = sign * np.array([(1, 0), (0, 1), (-arm.imag, arm.real)])
    forces, residual, rank, _ = np.linalg.lstsq(A, b, rcond=None)
    assert rank == 8
    assert residual[0] < 1e-20 * (b @ b)
    return forces.reshape(4, 2)


PINS = ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot")


def _free_four_bar(case, times):
    """Lagrange's equation in the crank angle."""
    linkage = _welded(case)
    start = np.array([0.0, case.initial.rates["crank_pivot"]["angle"]])
    q, rate = linkage.solve(start, times).T
    found = _bodies(linkage, q, rate)
    found |= {("crank_pivot", "angle"): q, ("crank_pivot", "angle_rate"): rate}
    for name, force in zip(PINS, _pin_forces(linkage, 0.0, start[1]), strict=True):
        found[name, "force_F"] = np.tile(_in_joint(linkage.plane, name, force), (len(times), 1))
    return found


def _in_joint(plane, name, force):
    """A force in the plane, in axes of the joint as drawn; components along the normal are unknown (NaN)."""
    mechanism = plane.mechanism
    _, axes = drawn_frame(mechanism, mechanism.joints[mechanism.joint_index[name]])
    found = axes.T @ (force[0] * plane.e1 + force[1] * plane.e2)
    found[np.abs(axes.T @ plane.normal) > 1e-9] = np.nan
    return found


def _driven_four_bar(case, times):
    """Crank angle as driven, and loop closure by intersection of two circles."""
    linkage = four_bar.linkage(case)
    return _bodies(linkage, 0.5 * np.sin(4 * times), 2 * np.cos(4 * times))


def _drake(case, times):
    """Lagrange's equation in the crank angle; without an initial rate the linkage is in equilibrium."""
    linkage = four_bar.linkage(case)
    start = np.array([0.0, case.initial.rates["crank_pivot"]["angle"]])
    q, rate = linkage.solve(start, times).T if start[1] else np.zeros((2, len(times)))
    found = _bodies(linkage, q, rate)
    found |= {("crank_pivot", "angle"): q, ("crank_pivot", "angle_rate"): rate}
    found |= {(name, "alpha_WB_W"): np.zeros((len(times), 3)) for name in "ABC"}
    # equilibrium: moments of A about its pivot from the weights of A and half of B; axes x and -z
    weight = 20 * 9.81
    found["crank_pivot", "force_F"] = np.tile([-weight / np.sqrt(15), -1.5 * weight, np.nan], (len(times), 1))
    return found


# --- chains -----------------------------------------------------------------------------------------------------------


def _chrono_double(case, times):
    """Double pendulum in absolute angles from x."""
    two = DoublePendulum(1.0, 1.0, 1.0, 1.0, 0.5 + 0j, 0.5 + 0j, 1.0 + 0j, -10j)
    a, b, rate_a, rate_b = two.solve(np.zeros(4), times).T
    zero = 0 * a
    return {
        ("shoulder", "angle"): a,
        ("elbow", "angle"): b - a,
        ("second", "w_WB_W"): np.column_stack([zero, zero, rate_b]),
        ("second", "p_WB"): np.column_stack([np.cos(a), np.sin(a), zero]),
        ("first", "w_WB_W"): np.column_stack([zero, zero, rate_a]),
    }


def _chrono_slider(case, times):
    x, phi, x_rate, phi_rate = published.slider_pendulum_solve(times).T
    return {
        ("slide", "distance"): x,
        ("slide", "distance_rate"): x_rate,
        ("pin", "angle"): phi,
        ("pin", "angle_rate"): phi_rate,
    }


def _robot(case, times):
    """Lagrange's equations in joint angles by complex step; integrals of the controllers are additional states."""
    chain = spatial_pendulum.Chain(case.mechanism)
    controls = case.mechanism.controls
    P, I, D = (np.array([getattr(c, name) for c in controls]) for name in ("proportional", "integral", "derivative"))
    n = len(controls)

    def target(t):
        return np.array([c.target.at(t)[:2] for c in controls]).T

    def rhs(y):
        t, q, rates, integrals = y[-1], y[:n], y[n : 2 * n], y[2 * n : 3 * n]
        wanted, wanted_rate = target(t)
        effort = P * (wanted - q) + I * integrals + D * (wanted_rate - rates)
        M, _ = chain.mass_matrix_and_potential(q[None].astype(complex))
        dy = chain.rhs(y[: 2 * n])
        dy[n:] += np.linalg.solve(M[0].real, effort)
        return np.concatenate([dy, wanted - q, [1.0]])

    y = integrate(rhs, np.concatenate([spatial_pendulum.start(case), np.zeros(n + 1)]), times, longest=0.05)
    found = {}
    for k, joint in enumerate(case.mechanism.joints):
        found |= {(joint.name, "angle"): y[:, k], (joint.name, "angle_rate"): y[:, n + k]}
    for (R, t), body in zip(chain.displacements(y[:, :n]), case.mechanism.bodies, strict=True):
        found[body.name, "p_WB"] = R @ body.drawing.p + t
    return found


ORIGINS = {
    "manipulator": (_origin(_manipulator),),
    "sliding_block": (_origin(_block),),
    "excavator_arm": (_origin(_excavator),),
    "four_bar_driven": (_origin(_driven_four_bar),),
    **{
        f"four_bar_{name}": (_origin(_free_four_bar), newton_euler.values)
        for name in ("welded", "point_on_line", "cylinder_ball")
    },
    "engine": (lagrange("gudgeon"), newton_euler.values),
    "excavator_powered": (lagrange("upper_eye"), newton_euler.values),
    "chrono_double_pendulum": (_origin(_chrono_double), newton_euler.values),
    "chrono_slider_pendulum": (_origin(_chrono_slider), newton_euler.values),
    "drake_four_bar-equilibrium": (_origin(_drake),),
    "drake_four_bar-turning": (_origin(_drake), newton_euler.values),
    "robot_arm": (_origin(_robot), lagrange()),
}
