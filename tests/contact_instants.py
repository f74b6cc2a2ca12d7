"""Instants with contacts, stops and dry friction in closed form; lumpy bodies in a turned world.

Each problem is a mechanism, a state and what is right there, in axes of the lab: ``a`` and ``alpha`` of the bodies'
centres of mass, shape (n_b, 3), ``forces`` of the contacts, shape (n_c, 3), their ``total``, or the moment of the first
joint's reaction ``about`` its axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from consilience.engine import InstantAnswer, Question, defects
from consilience.mechanism import (
    GROUND,
    BoxPlane,
    CapsulePlane,
    DiscPlane,
    Frame,
    Initial,
    Joint,
    Mechanism,
    SpherePlane,
    SphereSphere,
    State,
    initial_state,
    quaternion_from_rotation,
)
from contact_problems import (
    BALL,
    LEVEL,
    G,
    Lab,
    ball,
    fallen_rod,
    incline,
    pendulum,
    rolling_ball,
    sliding_ball,
    stacked,
    stop_torque,
    turned,
    turning_feet,
)

LAB = Lab()
TROUGH = LAB.axes @ [0.0, 1.0, 1.0], LAB.axes @ [0.0, -1.0, 1.0]
Truth = dict[str, np.ndarray]
Problem = tuple[Mechanism, State, Truth]


def error(engine, problem: Problem) -> float:
    """Return the largest difference between an engine's headline answer and what is right."""
    mechanism, state, truth = problem
    answer = engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[0])
    assert defects(answer, Question.INSTANT, mechanism, 1) == []
    found = _seen(mechanism, state, answer)
    return max(float(np.max(np.abs(found[name] - value))) for name, value in truth.items() if name in found)


def _seen(mechanism: Mechanism, state: State, answer: InstantAnswer) -> Truth:
    """Return all that a problem may state, of an answer; what an engine does not tell is left out."""
    arm = np.einsum("bij,bj->bi", state.R_WB, [body.com for body in mechanism.bodies])
    w, alpha = state.w_WB_W, answer.alpha_WB_W[0]
    a = answer.a_WB_W[0] + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))
    found = {"a": a @ LAB.axes, "alpha": alpha @ LAB.axes}
    if mechanism.contacts:
        assert answer.contact_force is not None
        found["forces"] = answer.contact_force[0] @ LAB.axes
        found["total"] = np.sum(found["forces"], axis=0)
    if answer.torque_F is not None:  # reactions are not every engine's to tell
        found["about"] = answer.torque_F[0, 0, 2:]
    return found


def _stated(mechanism: Mechanism, state: State, truth: tuple) -> Problem:
    """Return a problem whose truth is acceleration, angular acceleration and forces."""
    return mechanism, state, dict(zip(("a", "alpha", "forces"), map(np.atleast_2d, truth), strict=True))


def pushed_ball() -> Problem:
    """A ball at rest, pushed too hard to roll, slides and is not lifted."""
    friction = -0.1 * 2.0 * G * np.array([3.0, 1.0, 0.0]) / np.sqrt(10.0)
    truth = friction / 2.0 + [15.0, 5.0, 0.0], np.cross([0, 0, -0.1], friction) / 0.008, [*friction[:2], 2.0 * G]
    return _stated(ball(LAB, 0.1, (30.0, 10.0, 0.0)), LAB.state([0, 0, 0.1], [0, 0, 0]), truth)


def rod(rate: float) -> Problem:
    """A rod, its lower end on a smooth floor."""
    mechanism, state, alpha, N = fallen_rod(LAB, 0.7, rate)
    return mechanism, state, {"alpha": np.array([[0.0, alpha, 0.0]]), "forces": np.array([[0.0, 0.0, N]])}


def tipping_box() -> Problem:
    """A box at rest on a slope of 25 deg, twice as steep as its corners allow, tips about its edge."""
    moments = [2.0 / 12.0 * (0.04 + 0.36)] * 2 + [2.0 / 12.0 * 0.08]
    box = BoxPlane("box", "body", LAB.com, np.array([0.1, 0.1, 0.3]), GROUND, LAB.origin, LAB.axes[:, 2],
                   orientation=LAB.principal, friction=0.6)  # fmt: skip
    truth = {"alpha": [[0.0, 2.66008203914944, 0.0]], "total": [-6.69572107186286, 0.0, 18.313775189489]}
    return LAB.free_body(2.0, moments, incline(25), [box]), LAB.state([0, 0, 0.3], [0, 0, 0]), truth


def sliding_box() -> Problem:
    """A box that slides on four corners slows down by ``mu g`` and does not turn."""
    along = np.array([np.cos(0.5), np.sin(0.5), 0.0])
    box = BoxPlane("box", "body", LAB.com, np.array([0.3, 0.3, 0.1]), GROUND, LAB.origin, LAB.axes[:, 2],
                   orientation=LAB.principal, friction=0.4)  # fmt: skip
    truth = {"a": -0.4 * G * along, "alpha": np.zeros(3), "total": 2.0 * G * (np.array([0, 0, 1.0]) - 0.4 * along)}
    return LAB.free_body(2.0, (0.07, 0.06, 0.12), LEVEL, [box]), LAB.state([0, 0, 0.1], 2.0 * along), truth


def held_box() -> Problem:
    """Slope 0.5: the lower corners bear five eighths of the load; of equal shares of friction the upper ones slip."""
    corners = LAB.points([(x, y, -0.2) for x in (0.4, -0.4) for y in (0.3, -0.3)], friction=0.6)
    mechanism = LAB.free_body(2.0, (0.05, 0.06, 0.07), np.array([-4.5, 0.0, -9.0]), corners)
    truth = {"a": np.zeros(3), "alpha": np.zeros(3), "total": [9.0, 0.0, 18.0]}
    return mechanism, LAB.state([0, 0, 0.2], [0, 0, 0]), truth


def ball_on_ball(slides: bool) -> Problem:
    """A ball on a fixed one: ``N = m (g cos th - v^2 / (R + r))``; at rest it rolls with ``5/7 g sin th``."""
    th = 0.3 if slides else 0.1
    contact = SphereSphere("ball", "body", LAB.com, 0.1, GROUND, LAB.origin, 0.5, friction=0.3 if slides else 0.4)
    mechanism = LAB.free_body(2.0, BALL, LEVEL, [contact])
    n, t = np.array([np.sin(th), 0.0, np.cos(th)]), np.array([np.cos(th), 0.0, -np.sin(th)])
    if not slides:
        force = 2.0 * G * (np.cos(th) * n - 2.0 / 7.0 * np.sin(th) * t)
        truth = 5.0 / 7.0 * G * np.sin(th) * t, np.cross(n, 5.0 / 7.0 * G * np.sin(th) * t) / 0.1, force
        return _stated(mechanism, LAB.state(0.6 * n, [0, 0, 0]), truth)
    v, w = 0.7 * t + [0.0, 0.2, 0.0], np.array([1.0, 4.0, 2.0])
    u = v + np.cross(w, -0.1 * n)
    force = 2.0 * (G * n[2] - v @ v / 0.6) * (n - 0.3 * u / np.linalg.norm(u))
    return _stated(mechanism, LAB.state(0.6 * n, v, w), (force / 2.0 + LEVEL, np.cross(-0.1 * n, force) / 0.008, force))


def ball_in_trough() -> Problem:
    """Walls at 45 deg, inclined by 20 deg: a ball at rest rolls with ``g sin a / 1.8``.

    The forces of least norm leave the cones of friction.
    """
    walls = [
        SpherePlane(f"wall {n}", "body", LAB.com, 0.1, GROUND, LAB.origin, normal, friction=0.5)
        for n, normal in enumerate(TROUGH)
    ]
    truth = {"a": [1.86400978112489, 0.0, 0.0], "total": [-2.98241564979983, 0.0, 18.4367692198195]}
    return LAB.free_body(2.0, BALL, incline(20), walls), LAB.state([0, 0, 0.1 * np.sqrt(2.0)], [0, 0, 0]), truth


def boxes(moving: bool) -> Problem:
    """A box on a box that is pushed, both sliding: ``m a`` of each is what is left of push and friction."""
    mechanism, state = stacked(LAB, 25.0)
    if moving:
        state = replace(state, v_WB_W=np.array([2.0, 1.0])[:, None] * LAB.axes[:, 0])
    lower, upper = (25.0 - 0.2 * 4.0 * G - 0.35 * G) / 3.0, 0.35 * G
    truth = {"a": [[lower, 0, 0], [upper, 0, 0]], "alpha": np.zeros((2, 3)), "total": [-0.45 * G, 0.0, 5.0 * G]}
    return mechanism, state, truth


def capsule() -> Problem:
    """A capsule on its side, pushed less than friction bears, stays."""
    ends = LAB.in_body([0.2, 0, 0]), LAB.in_body([-0.1, 0, 0])
    lying = CapsulePlane("c", "body", *ends, 0.1, GROUND, LAB.origin, LAB.axes[:, 2], friction=0.5)
    mechanism = LAB.free_body(2.0, (0.01, 0.02, 0.02), LEVEL, [lying], [(1.0, 0.0, 0.0)])
    truth = {"a": np.zeros(3), "alpha": np.zeros(3), "total": [-1.0, 0.0, 2.0 * G]}
    return mechanism, LAB.state([0, 0, 0.1], [0, 0, 0]), truth


def pad_of_the_ground() -> Problem:
    """A plane of the body on a sphere of the ground: the force is that on the ground."""
    plane = LAB.in_body([0, 0, -0.3]), -LAB.principal[:, 2]
    pad = SpherePlane("pad", GROUND, LAB.origin, 0.2, "body", *plane, friction=0.4)
    mechanism = LAB.free_body(2.0, (0.1, 0.2, 0.15), LEVEL, [pad])
    return _stated(mechanism, LAB.state((0, 0, 0.5), (0, 0, 0)), (np.zeros(3), np.zeros(3), [0, 0, -2.0 * G]))


def eulers_disc() -> Problem:
    """A disc that rolls about its resting centre: ``w^2 = 4 g / (a sin th)``, and the spin precesses."""
    a, tilt, mass = 0.1, np.radians(30.0), 1.5
    rate, R = np.sqrt(4 * G / (a * np.sin(tilt))), turned(0.0, tilt, 0.0)
    spin = rate * (np.array([0, 0, 1.0]) - np.cos(tilt) * R[:, 2])
    rim = DiscPlane("rim", "body", LAB.com, LAB.principal[:, 2], a, GROUND, LAB.origin, LAB.axes[:, 2], friction=0.3)
    mechanism = LAB.free_body(mass, mass * a**2 * np.array([0.25, 0.25, 0.5]), LEVEL, [rim])
    truth = np.zeros(3), np.cross([0, 0, rate], spin), [0, 0, mass * G]
    return _stated(mechanism, LAB.state((0, 0, a * np.sin(tilt)), (0, 0, 0), spin, R), truth)


def held_slide() -> Problem:
    """A smooth ball on a slide down an incline touches the floor: the slide carries it, or both in any shares."""
    smooth, state = LAB.free_body(2.0, BALL, incline(20.0), [LAB.sphere(0.1)]), LAB.state([0, 0, 0.1], [0, 0, 0])
    along, drawn = LAB.axes[:, [1, 2, 0]], smooth.bodies[0].drawing  # z of the joint is x of the lab
    slide = Joint("slide", "prismatic", GROUND, "body", Frame(drawn.p, along), Frame(np.zeros(3), drawn.R.T @ along))
    state = replace(state, p_WB=drawn.p[None], quat_WB=quaternion_from_rotation(drawn.R)[None])
    floor = replace(smooth.contacts[0], point=drawn.p + drawn.R @ LAB.com - 0.1 * LAB.axes[:, 2])
    held = replace(smooth, joints=(slide,), contacts=(floor,))
    return held, state, {"a": [[G * np.sin(np.radians(20.0)), 0.0, 0.0]]}


def hinge_with_friction(angle: float, rate: float) -> Problem:
    """A rod on a hinge with dry friction, which slides or holds: ``th'' = 3 (M - m g l/2 sin th)``."""
    mechanism, weight = pendulum(LAB, bound=0.5), -stop_torque(angle)
    brake = -0.5 * np.sign(rate) if rate else -np.clip(weight, -0.5, 0.5)
    state = initial_state(mechanism, Initial({"hinge": {"angle": angle}}, {"hinge": {"angle": rate}}))
    return mechanism, state, {"alpha": [[0.0, 3.0 * (weight + brake), 0.0]], "about": [0.0]}


def rod_on_a_stop() -> Problem:
    """A rod rests on a stop, whose effort is no reaction of the hinge."""
    mechanism = pendulum(LAB, stop={"lower": 0.3})
    state = initial_state(mechanism, Initial({"hinge": {"angle": 0.3}}))
    return mechanism, state, {"alpha": np.zeros((1, 3)), "about": [0.0]}


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "ball that rolls, pushed": lambda: _stated(*rolling_ball(LAB)),
    "ball that slides, pushed": lambda: _stated(*sliding_ball(LAB)),
    "ball that starts to slide": pushed_ball,
    "feet that turn and slide": lambda: _stated(*turning_feet(LAB)),
    "rod that turns": lambda: rod(2.0),
    "rod at rest": lambda: rod(0.0),
    "box that tips": tipping_box,
    "box that slides": sliding_box,
    "box that friction holds": held_box,
    "ball that slides on a ball": lambda: ball_on_ball(slides=True),
    "ball that rolls off a ball": lambda: ball_on_ball(slides=False),
    "ball in a trough": ball_in_trough,
    "boxes that start to slide": lambda: boxes(moving=False),
    "boxes that slide": lambda: boxes(moving=True),
    "capsule that stays": capsule,
    "pad of the ground": pad_of_the_ground,
    "Euler's disc": eulers_disc,
    "slide on a floor": held_slide,
    "hinge that starts": lambda: hinge_with_friction(1.5, 0.0),
    "hinge that friction holds": lambda: hinge_with_friction(0.05, 0.0),
    "hinge that turns": lambda: hinge_with_friction(0.7, 2.0),
    "hinge that turns back": lambda: hinge_with_friction(0.7, -2.0),
    "rod on a stop": rod_on_a_stop,
}
