"""Planar linkages for tests, in a skew plane with lumpy bodies: change points, dead centres, platforms; other units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.mechanism import (
    GROUND,
    Body,
    Drive,
    Frame,
    Joint,
    Mechanism,
    State,
    initial_state,
    linear,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_from_quaternion,
)
from mechanisms import GRAVITY, drawn_joint, lumpy_body, rotation

ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def linkage(name: str, pins: list[tuple[str, str, tuple[float, float]]], seed: int = 1, **elements) -> Mechanism:
    """Planar linkage in a skew plane with lumpy bodies: pins between two bodies, at points of the plane, m."""
    rng = np.random.default_rng(seed)
    R, origin = rotation(rng), rng.normal(size=3)
    names = dict.fromkeys(body for i, j, _ in pins for body in (i, j) if body != GROUND)
    bodies = {n: lumpy_body(n, rng) for n in names}
    joints = [drawn_joint(f"{i}_{j}", "revolute", bodies, i, j, origin + R @ [*at, 0.0], R) for i, j, at in pins]
    if "slider" in bodies:
        end = origin + R @ [*pins[-1][2], 0.0]
        joints.append(drawn_joint("rail", "prismatic", bodies, GROUND, "slider", origin, R @ ALONG_X, end))
    return Mechanism(name, GRAVITY, tuple(bodies.values()), tuple(joints), **elements)


def four_bar_of(points: list[tuple[float, float]]) -> Mechanism:
    bars = [(GROUND, "crank"), ("crank", "coupler"), ("coupler", "rocker"), (GROUND, "rocker")]
    return linkage("four_bar", [(i, j, at) for (i, j), at in zip(bars, points, strict=True)])


def slider_crank(pin: tuple[float, float], end: float, **elements) -> Mechanism:
    pins = [(GROUND, "crank", (0.0, 0.0)), ("crank", "rod", pin), ("rod", "slider", (end, 0.0))]
    return linkage("slider_crank", pins, **elements)


def platform(middle: float) -> Mechanism:
    """Three bars of a platform, 0.5 m long and parallel, the middle one of another length."""
    bars = {"left": (0.0, 0.5), "right": (1.0, 0.5), "middle": (0.5, middle)}
    pins = [(GROUND, bar, (x, 0.5 - length)) for bar, (x, length) in bars.items()]
    return linkage("platform", [*pins, *((bar, "top", (x, 0.5)) for bar, (x, _) in bars.items())])


FOLDED_RHOMBUS = four_bar_of([(0.0, 0.0), (0.5, 0.0), (0.0, 0.0), (0.5, 0.0)])
"""Bars of one length, folded: the first two turn about the first pin, or the last two about the last."""

FLAT_PARALLELOGRAM = four_bar_of([(0.0, 0.0), (0.3, 0.0), (0.8, 0.0), (0.5, 0.0)])
"""At its change point, where the parallelogram and the crossed linkage meet."""


def in_other_units(mechanism: Mechanism, length: float) -> Mechanism:
    """Return the mechanism with all lengths times a factor; drives of distances hold them."""

    def frame(f: Frame) -> Frame:
        return Frame(length * f.p, f.R)

    def body(b: Body) -> Body:
        return replace(b, com=length * b.com, inertia=length**2 * b.inertia, drawing=frame(b.drawing))

    def joint(j: Joint) -> Joint:
        return replace(j, F=frame(j.F), M=frame(j.M), length=length * j.length, pitch=length * j.pitch)

    def drive(d: Drive) -> Drive:
        return replace(d, motion=linear(0.0, length * d.motion.at(0.0)[0])) if d.coordinate == "distance" else d

    drives, gravity = tuple(map(drive, mechanism.drives)), length * mechanism.gravity
    bodies, joints = tuple(map(body, mechanism.bodies)), tuple(map(joint, mechanism.joints))
    return replace(mechanism, gravity=gravity, bodies=bodies, joints=joints, drives=drives)


def with_crank(mechanism: Mechanism, angle: float) -> State:
    """Return the flat parallelogram with crank and rocker turned about their pins, the coupler moved along."""
    start = initial_state(mechanism)
    pins = {j.name: j for j in mechanism.joints}
    axis = pins["ground_crank"].F.R[:, 2]
    turn = quaternion_from_rotation_vector(angle * axis)
    A = rotation_from_quaternion(turn)
    p, quat = start.p_WB.copy(), start.quat_WB.copy()
    for body, pin in (("crank", "ground_crank"), ("rocker", "ground_rocker")):
        n, at = mechanism.body_index[body], pins[pin].F.p
        p[n], quat[n] = at + A @ (start.p_WB[n] - at), quaternion_product(turn, start.quat_WB[n])
    first, second = pins["ground_crank"].F.p, pins["ground_rocker"].F.p
    bar = 0.6 * (second - first)
    p[mechanism.body_index["coupler"]] += A @ bar - bar
    return State(p, quat, start.v_WB_W, start.w_WB_W)
