"""Motions with contacts, stops and dry friction in closed form; lumpy bodies in a turned world.

Each problem is a mechanism, a state, the end of its motion, and what is right there, in axes of the lab: place ``p``,
velocity ``v`` and spin ``w`` of the bodies' centres of mass, shape (n_b, 3), ``angle`` and ``rate`` of a hinge, the
``impulse`` of all contacts and the energy ``lost`` since the start, and the ``modes`` of the contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from consilience.engine import Method, Question, TrajectoryAnswer, defects
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    CapsulePlane,
    DiscPlane,
    Drive,
    DryFriction,
    Frame,
    Initial,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    Stop,
    initial_state,
    joint_coordinates,
    quaternion_from_rotation_vector,
    relative_motion,
    sine,
)
from contact_instants import TROUGH
from contact_problems import (
    BALL,
    FEET,
    LEVEL,
    G,
    Lab,
    fallen_rod,
    incline,
    pendulum,
    rolling_ball,
    stacked,
    turned,
    turning_feet,
)

LAB = Lab()
HERE = Frame(np.zeros(3), np.eye(3))
UP = np.array([0.0, 0.0, 1.0])
SLIDES, STAYS = 1, 2
Truth = dict[str, object]


@dataclass(frozen=True)
class Problem:
    """A motion and what is right at its end."""

    mechanism: Mechanism
    state: State
    end: float
    truth: Truth

    def answered(self, engine, method: Method, samples: int, substeps: int | None) -> TrajectoryAnswer:
        """Return an engine's motion, whose steps divide the time between two samples; None: to a tolerance of 1e-12."""
        times = np.linspace(0.0, self.end, samples + 1)
        step = times[1] / substeps if substeps else 1e-12
        answer = engine.trajectory(self.mechanism, self.state, times, method, step)
        assert defects(answer, Question.TRAJECTORY, self.mechanism, len(times)) == []
        return answer

    def error(self, answer: TrajectoryAnswer) -> float:
        """Return the largest difference between the state at the end of a motion and what is right, above 1 over it."""
        found = self._seen(answer)
        stated = {name: np.asarray(value) for name, value in self.truth.items() if name in found}
        return max(float(np.max(np.abs(found[n] - v)) / max(1.0, np.max(np.abs(v)))) for n, v in stated.items())

    def _seen(self, answer: TrajectoryAnswer) -> dict[str, np.ndarray]:
        """Return the state of a problem at the end of a motion."""
        state = answer.state(-1)
        arm = np.einsum("bij,bj->bi", state.R_WB, [body.com for body in self.mechanism.bodies])
        found = {
            "p": (state.p_WB + arm - LAB.origin) @ LAB.axes,
            "v": (state.v_WB_W + np.cross(state.w_WB_W, arm)) @ LAB.axes,
            "w": state.w_WB_W @ LAB.axes,
        }
        hinge = self.mechanism.joints[0]
        if hinge.kind == "revolute":
            motion = relative_motion(self.mechanism, state, hinge)
            found["angle"] = np.array(joint_coordinates(hinge, motion)["angle"])
        return found

    def balance(self, answer: TrajectoryAnswer) -> float:
        """Return the largest error of impulse and loss, over their sizes; zero where the method gives none."""
        errors = [0.0]
        if "impulse" in self.truth and answer.contact_impulse is not None:
            impulse = np.asarray(self.truth["impulse"])
            found = np.sum(answer.contact_impulse, axis=(0, 1)) @ LAB.axes
            errors.append(float(np.linalg.norm(found - impulse) / np.linalg.norm(impulse)))
        if "lost" in self.truth and answer.contact_loss is not None:
            errors.append(abs(answer.contact_loss[-1] / self.truth["lost"] - 1.0))
        return max(errors)


def along(degrees: float) -> np.ndarray:
    """Return a direction on the floor."""
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])


def box(gravity, mu: float) -> Mechanism:
    """A flat box of 2 kg on four corners, its centre 0.1 m above the floor."""
    contact = BoxPlane("box", "body", LAB.com, np.array([0.3, 0.3, 0.1]), GROUND, LAB.origin, LAB.axes[:, 2],
                       orientation=LAB.principal, friction=mu)  # fmt: skip
    return LAB.free_body(2.0, (0.07, 0.06, 0.12), gravity, [contact])


def sliding_box(end: float) -> Problem:
    """A box thrown over the floor slows down by ``mu g``, straight on and without a turn, until it stops."""
    slowed, heading = 0.4 * G, along(30)
    time = min(end, 3.0 / slowed)
    v = 3.0 - slowed * time
    p = 0.5 * (3.0 + v) * time
    impulse = 2.0 * (v - 3.0) * heading + 2.0 * G * end * UP
    truth = {"p": p * heading + 0.1 * UP, "v": v * heading, "w": 0.0, "impulse": impulse, "lost": 9.0 - v**2,
             "modes": [SLIDES if v > 0.0 else STAYS]}  # fmt: skip
    return Problem(box(LEVEL, 0.4), LAB.state(0.1 * UP, 3.0 * heading), end, truth)


def box_up_a_slope() -> Problem:
    """A block thrown up a slope, which holds it, stops after ``v^2 / (2 (g sin a + mu g cos a))``."""
    g = incline(20.0)
    x = -(3.0**2) / (2.0 * (g[0] - 0.5 * g[2]))
    truth = {"p": [x, 0.0, 0.1], "v": 0.0, "w": 0.0, "modes": [STAYS], "lost": 2.0 * (4.5 + g[0] * x)}
    return Problem(box(g, 0.5), LAB.state(0.1 * UP, [-3.0, 0.0, 0.0]), 0.6, truth)


def box_across_a_slope() -> Problem:
    """A block thrown across a slope turns to it: ``v' = g sin a - mu g cos a v/|v|``, integrated."""
    g, v = incline(20.0)[:2], 2.0 * along(110)[:2]
    mu_g = 0.3 * G * np.cos(np.radians(20.0))

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], g - mu_g * y[2:] / np.linalg.norm(y[2:])])

    x, y, u, v_y = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0, *v], "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    truth = {"p": [x, y, 0.1], "v": [u, v_y, 0.0], "w": 0.0, "modes": [SLIDES]}
    return Problem(box(incline(20.0), 0.3), LAB.state(0.1 * UP, [*v, 0.0]), 1.0, truth)


def tripod() -> Problem:
    """Three feet slide and turn: forces of Newton and Euler at each place, integrated."""
    mechanism, state, _ = turning_feet(LAB)

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        feet = FEET @ turned(0.0, 0.0, y[2]).T
        u = y[3:5] + y[5] * np.column_stack([-feet[:, 1], feet[:, 0]])
        pull = np.column_stack([-0.35 * u / np.linalg.norm(u, axis=1)[:, None], np.ones(3)])
        wrenches = np.hstack([pull, np.cross(feet, pull)]).T
        total = wrenches @ np.linalg.solve(wrenches[[2, 3, 4]], [2.0 * G, 0.0, 0.0])
        return np.concatenate([y[3:], total[[0, 1]] / 2.0, total[[5]] / 0.04])

    start = [0.0, 0.0, 0.0, 1.2, 0.3, 8.0]
    x, y, _, u, v, w = solve_ivp(rates, (0.0, 0.3), start, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    impulse = [2.0 * (u - 1.2), 2.0 * (v - 0.3), 0.6 * G]
    truth = {"p": [x, y, 0.1], "v": [u, v, 0.0], "w": [0.0, 0.0, w], "impulse": impulse, "modes": [SLIDES] * 3}
    return Problem(mechanism, state, 0.3, truth)


def bowling(end: float) -> Problem:
    """A bowling ball slides on a parabola until ``2 |u| / (7 mu g)``, and rolls on."""
    r, v, w = 0.11, np.array([3.0, 1.0, 0.0]), np.array([25.0, 10.0, 40.0])
    u = v + np.cross(w, -r * UP)
    push, time = -0.2 * G * u / np.linalg.norm(u), min(end, 2.0 * np.linalg.norm(u) / (1.4 * G))
    p, v = v * time + 0.5 * push * time**2, v + push * time
    w = w + np.cross(-r * UP, push) * time / (0.4 * r**2)
    rolls = time < end
    lost = 0.5 * (10.0 + 0.4 * r**2 * 2325.0 - v @ v - 0.4 * r**2 * (w @ w))
    truth = {
        "p": p + v * (end - time) + r * UP,
        "v": v,
        "w": w,
        "lost": 2.0 * lost,
        "modes": [STAYS if rolls else SLIDES],
    }
    mechanism = LAB.free_body(2.0, [0.8 * r**2] * 3, LEVEL, [LAB.sphere(r, friction=0.2)])
    return Problem(mechanism, LAB.state(r * UP, [3.0, 1.0, 0.0], [25.0, 10.0, 40.0]), end, truth)


def ball_down_a_slope(mu: float) -> Problem:
    """A ball from rest rolls where mu exceeds ``2/7 tan 30 deg`` = 0.16496, and slides where it does not."""
    g = incline(30.0)
    rolls = mu > 2.0 / 7.0 * np.tan(np.radians(30.0))
    a = 5.0 / 7.0 * g[0] if rolls else g[0] + mu * g[2]
    spin = a / 0.1 if rolls else -2.5 * mu * g[2] / 0.1
    truth = {"p": [0.5 * a, 0.0, 0.1], "v": [a, 0.0, 0.0], "w": [0.0, spin, 0.0], "modes": [STAYS if rolls else SLIDES]}
    mechanism = LAB.free_body(2.0, BALL, g, [LAB.sphere(0.1, friction=mu)])
    return Problem(mechanism, LAB.state(0.1 * UP, np.zeros(3)), 1.0, truth)


def pushed_ball() -> Problem:
    """A ball that rolls and is pushed goes on rolling, by constant accelerations; its spin about the normal stays."""
    mechanism, state, (a, alpha, _) = rolling_ball(LAB)
    v, w, end = np.array([1.0, 0.5, 0.0]), np.array([-5.0, 10.0, 3.0]), 0.5
    truth = {"p": v * end + 0.5 * a * end**2 + 0.1 * UP, "v": v + a * end, "w": w + alpha * end, "modes": [STAYS]}
    return Problem(mechanism, state, end, truth)


def ball_in_a_trough() -> Problem:
    """Walls at 45 deg, inclined by 20 deg: a ball from rest rolls with ``g sin a / 1.8``; no force is unique."""
    walls = [
        SpherePlane(f"wall {n}", "body", LAB.com, 0.1, GROUND, LAB.origin, normal, friction=0.5)
        for n, normal in enumerate(TROUGH)
    ]
    a, height = G * np.sin(np.radians(20.0)) / 1.8, 0.1 * np.sqrt(2.0)
    truth = {"p": [0.5 * a, 0.0, height], "v": [a, 0.0, 0.0], "w": [0.0, a / (0.1 * np.sqrt(0.5)), 0.0]}
    return Problem(LAB.free_body(2.0, BALL, incline(20.0), walls), LAB.state(height * UP, np.zeros(3)), 1.0, truth)


def sliding_capsule() -> Problem:
    """A capsule slides along its axis, both ends on the floor."""
    ends = [LAB.in_body([x, 0.0, 0.0]) for x in (-0.2, 0.3)]
    capsule = CapsulePlane("capsule", "body", *ends, 0.1, GROUND, LAB.origin, LAB.axes[:, 2], friction=0.1)
    slowed, end = 0.1 * G, 0.5
    truth = {"p": [end - 0.5 * slowed * end**2, 0.0, 0.1], "v": [1.0 - slowed * end, 0.0, 0.0], "w": 0.0,
             "modes": [SLIDES], "impulse": [-2.0 * slowed * end, 0.0, 2.0 * G * end]}  # fmt: skip
    mechanism = LAB.free_body(2.0, (0.07, 0.06, 0.12), LEVEL, [capsule])
    return Problem(mechanism, LAB.state(0.1 * UP, [1.0, 0.0, 0.0]), end, truth)


def eulers_disc() -> Problem:
    """A disc that rolls about its resting centre: ``w^2 = 4 g / (a sin th)``."""
    a, tilt, mass = 0.1, np.radians(30.0), 1.5
    rate, R = np.sqrt(4 * G / (a * np.sin(tilt))), turned(0.0, tilt, 0.0)
    spin = rate * (UP - np.cos(tilt) * R[:, 2])
    rim = DiscPlane("rim", "body", LAB.com, LAB.principal[:, 2], a, GROUND, LAB.origin, LAB.axes[:, 2], friction=0.3)
    mechanism = LAB.free_body(mass, mass * a**2 * np.array([0.25, 0.25, 0.5]), LEVEL, [rim])
    place = a * np.sin(tilt) * UP
    truth = {"p": place, "v": 0.0, "w": turned(0.0, 0.0, 0.1 * rate) @ spin, "modes": [STAYS]}
    return Problem(mechanism, LAB.state(place, np.zeros(3), spin, R), 0.1, truth)


def falling_rod() -> Problem:
    """A rod that is let go, its lower end on a smooth floor: forces of Newton and Euler, integrated."""
    mechanism, state, *_ = fallen_rod(LAB, 0.2, 0.0)

    def rates(_: float, y: np.ndarray) -> list[float]:
        return [y[1], 6.0 * (G - 0.5 * y[1] ** 2 * np.cos(y[0])) / (1.0 + 3.0 * np.sin(y[0]) ** 2) * np.sin(y[0])]

    th, w = solve_ivp(rates, (0.0, 0.4), [0.2, 0.0], "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    height, falls = 0.5 * np.cos(th) * UP, -0.5 * np.sin(th) * w * UP
    truth = {"p": height, "v": falls, "w": [0.0, w, 0.0], "impulse": (0.4 * G + falls[2]) * UP}
    return Problem(mechanism, state, 0.4, truth)


def ladder() -> Problem:
    """A ladder between smooth wall and floor leaves the wall at two thirds of its height, and keeps its speed."""
    wall = PointPlane("head", "body", LAB.in_body([0, 0, 1.0]), GROUND, LAB.origin, LAB.axes[:, 0])
    mechanism = LAB.free_body(1.0, (1 / 3, 1 / 3, 1e-3), LEVEL, [*LAB.points([[0, 0, -1.0]]), wall])
    state = LAB.state([0.5, 0.0, np.sqrt(0.75)], np.zeros(3), turn=turned(0, -np.pi / 6, 0))

    def held(_: float, y: np.ndarray) -> list[float]:
        return [y[1], 0.75 * G * np.sin(y[0])]

    def free(_: float, y: np.ndarray) -> list[float]:
        N = (G - y[1] ** 2 * np.cos(y[0])) / (1.0 + 3.0 * np.sin(y[0]) ** 2)
        return [y[1], 3.0 * N * np.sin(y[0])]

    def leaves(_: float, y: np.ndarray) -> float:
        return float(np.cos(y[0]) - np.sqrt(0.75) * 2.0 / 3.0)

    leaves.terminal = True  # type: ignore[attr-defined]
    exact = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    first = solve_ivp(held, (0.0, 0.6), [np.pi / 6, 0.0], events=leaves, **exact)
    at, (th, rate) = first.t[-1], first.y[:, -1]
    x, kept = np.sin(th), np.cos(th) * rate
    th, rate = solve_ivp(free, (at, 0.6), [th, rate], **exact).y[:, -1]
    truth = {
        "p": [x + kept * (0.6 - at), 0.0, np.cos(th)],
        "v": [kept, 0.0, -np.sin(th) * rate],
        "w": [0.0, -rate, 0.0],
    }
    return Problem(mechanism, state, 0.6, truth)


def boxes() -> Problem:
    """A box on a box that is pushed, both sliding: ``m a`` of each is what is left of push and friction."""
    mechanism, state = stacked(LAB, 25.0)
    v = np.array([2.0, 1.0])
    state = replace(state, v_WB_W=v[:, None] * LAB.axes[:, 0])
    a, end = np.array([(25.0 - 0.2 * 4.0 * G - 0.35 * G) / 3.0, 0.35 * G]), 0.2
    x, height = v * end + 0.5 * a * end**2, [0.1, 0.3]
    truth = {"p": [[x[k], 0.0, height[k]] for k in range(2)], "v": (v + a * end)[:, None] * [1.0, 0.0, 0.0], "w": 0.0}
    return Problem(mechanism, state, end, truth)


def bouncing_ball() -> Problem:
    """A ball that falls from 1 m rebounds with half its speed."""
    hit, end = np.sqrt(2.0 / G), 0.7
    up, later = 0.5 * np.sqrt(2.0 * G), end - hit
    truth = {"p": (0.1 + up * later - 0.5 * G * later**2) * UP, "v": (up - G * later) * UP, "w": 0.0,
             "impulse": 3.0 * np.sqrt(2.0 * G) * UP, "lost": 0.75 * 2.0 * G}  # fmt: skip
    mechanism = LAB.free_body(2.0, BALL, LEVEL, [LAB.sphere(0.1, restitution=0.5)])
    return Problem(mechanism, LAB.state(1.1 * UP, np.zeros(3)), end, truth)


def rough_spheres(mu: float) -> Problem:
    """Two spheres that meet askew; the tangential impulse is ``mu P``, or what grips: ``2/7 m_eff u_t``."""
    offsets, radii, masses = np.array([[0.03, -0.02, 0.05], [-0.04, 0.06, 0.01]]), (0.2, 0.3), (1.2, 2.5)
    moments = [0.4 * m * r**2 for m, r in zip(masses, radii, strict=True)]
    bodies = tuple(Body(f"sphere {n}", masses[n], offsets[n], moments[n] * np.eye(3), HERE) for n in range(2))
    joints = tuple(Joint(f"free {n}", "free", GROUND, bodies[n].name, HERE, HERE) for n in range(2))
    contact = SphereSphere(
        "hit", "sphere 0", offsets[0], radii[0], "sphere 1", offsets[1], radii[1], restitution=0.7, friction=mu
    )
    p, v = np.array([[0.0, 0.0, 0.0], [1.5, 0.4, 0.1]]), np.array([[2.0, 0.5, -0.3], [-0.5, 0.1, 0.2]])
    w, arms = np.array([[1.0, 0.5, -2.0], [0.0, -1.0, 0.4]]), offsets @ LAB.axes.T
    quat = quaternion_from_rotation_vector([0.4, -0.3, 0.8])
    state = State(p @ LAB.axes.T - arms + LAB.origin, np.array([quat] * 2),
                  v @ LAB.axes.T - np.cross(w @ LAB.axes.T, arms), w @ LAB.axes.T)  # fmt: skip
    d, u = p[1] - p[0], v[1] - v[0]
    hit = (-d @ u - np.sqrt((d @ u) ** 2 - (u @ u) * (d @ d - 0.25))) / (u @ u)
    n, mass = (d + u * hit) / 0.5, masses[0] * masses[1] / sum(masses)
    slip = -u + np.cross(0.2 * w[0] + 0.3 * w[1], n)
    across = slip - (slip @ n) * n
    P = 1.7 * mass * (slip @ n)
    T = min(mu * P, 2.0 / 7.0 * mass * np.linalg.norm(across))
    push = -P * n - T * across / np.linalg.norm(across)
    after = v + push * np.array([[1.0 / masses[0]], [-1.0 / masses[1]]])
    spins = w + np.array([np.cross(r * n, push) / m for r, m in zip(radii, moments, strict=True)])
    end = 0.55
    truth = {"p": p + v * hit + after * (end - hit), "v": after, "w": spins, "impulse": push}
    return Problem(Mechanism("spheres", np.zeros(3), bodies, joints, contacts=(contact,)), state, end, truth)


def swung(angle: float, bound: float) -> float:
    """Return where the rod of `pendulum`, let go at an angle, comes to rest by dry friction: energy, swing by swing."""
    weight = 0.5 * G
    while weight * abs(np.sin(angle)) > bound:
        start, sense = abs(angle), -np.sign(angle)

        def left(q: float, start: float = start) -> float:
            return weight * (np.cos(q) - np.cos(start)) - bound * (start + q)

        # the other end, or where the rod stops before its lowest point
        angle = sense * brentq(left, -np.arcsin(bound / weight), start, xtol=1e-15)
    return float(angle)


def released(mechanism: Mechanism, angle: float, rate: float = 0.0) -> State:
    """Return a state of a hinge."""
    return initial_state(mechanism, Initial({"hinge": {"angle": angle}}, {"hinge": {"angle": rate}}))


def braked_pendulum() -> Problem:
    """Dry friction stops a pendulum away from its lowest point."""
    mechanism, rest = pendulum(LAB, bound=0.5), swung(1.5, 0.5)
    lost = 0.5 * G * (np.cos(rest) - np.cos(1.5))
    return Problem(mechanism, released(mechanism, 1.5), 6.0, {"angle": rest, "v": 0.0, "w": 0.0, "lost": lost})


def pendulum_on_a_stop(end: str, restitution: float) -> Problem:
    """A pendulum falls on its stop, and rests on it, at once or after bounces."""
    sense = 1.0 if end == "lower" else -1.0
    mechanism = pendulum(LAB, stop={end: 0.3 * sense, "restitution": restitution})
    lost = 0.5 * G * (np.cos(0.3) - np.cos(1.0))
    return Problem(mechanism, released(mechanism, sense), 2.0, {"angle": 0.3 * sense, "v": 0.0, "w": 0.0, "lost": lost})


def wheel(**elements) -> Mechanism:
    """A wheel of 0.5 kg m^2 whose joint leads from it to the ground."""
    body = Body("wheel", 1.0, np.zeros(3), 0.5 * np.eye(3), HERE)
    return Mechanism(
        "wheel", np.zeros(3), (body,), (Joint("hinge", "revolute", "wheel", GROUND, HERE, HERE),), **elements
    )


def wheel_between_stops() -> Problem:
    """A braked wheel that its stop throws back: ``1/2 I w^2`` less the friction, and ``e^2`` of what is left."""
    stop, brake = Stop("stop", "hinge", "angle", -1.0, 0.0, 0.8), DryFriction("brake", "hinge", "angle", 0.2)
    mechanism = wheel(stops=(stop,), dry_frictions=(brake,))
    energy, angle = 0.25 * 9.0, -0.5
    for wall in (-1.0, 0.0, -1.0, 0.0, -1.0, 0.0):
        if (run := energy / 0.2) < abs(wall - angle):
            angle += np.sign(wall - angle) * run
            break
        energy, angle = 0.64 * (energy - 0.2 * abs(wall - angle)), wall
    return Problem(mechanism, released(mechanism, -0.5, -3.0), 4.0, {"angle": angle, "w": 0.0, "lost": 2.25})


def wheel_on_a_stop() -> Problem:
    """A stop without restitution catches a wheel."""
    mechanism = wheel(stops=(Stop("stop", "hinge", "angle", -1.0, 0.2),))
    return Problem(mechanism, released(mechanism, 0.0, -3.0), 0.5, {"angle": -1.0, "w": 0.0, "lost": 2.25})


def shaken_table() -> Problem:
    """A table shaken by ``A sin(W t)`` throws the ball on it where it would have to pull, and catches it again."""
    A, W, end, axes = 0.02, 30.0, 0.2, Frame(np.zeros(3), LAB.axes)
    table = Body("table", 5.0, np.array([0.02, 0.03, -0.01]), 0.3 * np.eye(3), replace(axes, p=LAB.origin))
    thrown = Body("ball", 2.0, np.zeros(3), 8e-3 * np.eye(3), replace(axes, p=LAB.origin + LAB.axes @ (0.1 * UP)))
    joints = (
        Joint("lift", "prismatic", GROUND, "table", table.drawing, HERE),
        Joint("free", "free", GROUND, "ball", HERE, HERE),
    )
    rest = SpherePlane("rest", "ball", np.zeros(3), 0.1, "table", np.zeros(3), UP)
    shake = Drive("shake", "lift", "distance", sine(A, W))
    mechanism = Mechanism("shaken", LAB.axes @ LEVEL, (table, thrown), joints, drives=(shake,), contacts=(rest,))
    state = initial_state(mechanism, Initial(velocities={"ball": (A * W * LAB.axes[:, 2], np.zeros(3))}))
    lifted, rises = A * np.sin(W * end), A * W * np.cos(W * end)
    impulse = 2.0 * (rises - A * W + G * end) * UP
    truth = {
        "p": [[0.02, 0.03, -0.01 + lifted], [0.0, 0.0, 0.1 + lifted]],
        "v": rises * UP,
        "w": 0.0,
        "impulse": impulse,
    }
    return Problem(mechanism, state, end, truth)


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "box that slides": lambda: sliding_box(0.7),
    "box that stops": lambda: sliding_box(0.8),
    "box that stops on a slope": box_up_a_slope,
    "box across a slope": box_across_a_slope,
    "tripod": tripod,
    "ball that slips": lambda: bowling(0.5),
    "ball that slips, then rolls": lambda: bowling(2.0),
    "ball that rolls down": lambda: ball_down_a_slope(0.17),
    "ball that slides down": lambda: ball_down_a_slope(0.16),
    "ball that rolls, pushed": pushed_ball,
    "ball in a trough": ball_in_a_trough,
    "capsule": sliding_capsule,
    "Euler's disc": eulers_disc,
    "rod that falls": falling_rod,
    "ladder": ladder,
    "boxes": boxes,
    "ball that bounces": bouncing_ball,
    "spheres that slip": lambda: rough_spheres(0.1),
    "spheres that grip": lambda: rough_spheres(0.8),
    "pendulum that friction stops": braked_pendulum,
    "pendulum on a lower stop": lambda: pendulum_on_a_stop("lower", 0.0),
    "pendulum on an upper stop": lambda: pendulum_on_a_stop("upper", 0.0),
    "pendulum that bounces to rest": lambda: pendulum_on_a_stop("lower", 0.5),
    "wheel between stops": wheel_between_stops,
    "wheel on a stop": wheel_on_a_stop,
    "shaken table": shaken_table,
}
