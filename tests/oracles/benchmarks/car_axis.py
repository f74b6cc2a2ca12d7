"""Car axis: the rheonomic problem of the test set for initial value problems [Mazzia & Iavernaro 2003].

The left wheel stays in the origin; the right wheel, at the distance L from it, follows a wavy road,
``yb = r sin(w t)``. Two point masses hang on springs of unit stiffness at the wheels. A rod of length L joins the
masses, and the left mass stays on the line through the origin perpendicular to the axle:

    k l'' = f(l) + lam1 b + 2 lam2 (l - r) - k g y,     k r'' = f(r - b) - 2 lam2 (l - r) - k g y,
    l . b = 0,     |l - r| = L,     f(d) = (l0 - |d|) d / |d|.
"""

import numpy as np

from consilience.mechanism import GROUND, Drive, Function, Spring, sine
from oracles.benchmarks.build import X, Y, Z, body, mechanism, started

LENGTH, FREE, AMPLITUDE, FREQUENCY, GRAVITY = 1.0, 0.5, 0.1, 10.0, 1.0
MASS = 10 * 0.01**2 / 2

ACROSS = np.column_stack([Y, Z, X])
"""Axes of a frame with its z along x."""
UPRIGHT = np.column_stack([Z, X, Y])
"""With its z along y."""


def _axle_by_carriage():
    """Drive of the axle by a carriage that moves up and down and on which the axle's end slides; yb is exact."""
    carriage = body("carriage", 0.7, (1.3, -0.2, 0.1), (0.2, 0.3, 0.25))
    joints = [
        ("lift", "prismatic", GROUND, "carriage", X, UPRIGHT),
        ("wheel", "point_in_plane", "carriage", "axle", LENGTH * X, UPRIGHT),
    ]
    return [carriage], joints, Drive("road", "lift", "distance", sine(AMPLITUDE, FREQUENCY))


def _axle_by_angle(order=15):
    """Drive of the axle's angle by the Fourier series of arcsin(r / L sin(w t)); its terms fall like (r / 2 L)^n."""
    x = 2 * np.pi * (np.arange(64) + 0.5) / 64
    angle = np.arcsin(AMPLITUDE / LENGTH * np.sin(x))
    odd = np.arange(1, order + 1, 2)
    waves = [(2 * np.mean(angle * np.sin(n * x)), n * FREQUENCY, 0.0) for n in odd]
    return [], [], Drive("road", "axle", "angle", Function(harmonics=np.array(waves)))


MAKES = {"carriage": _axle_by_carriage, "angle": _axle_by_angle}


def car_axis(how):
    """The mechanism, its axle driven in one of the two ways above, and its initial state.

    The motion of the axle is prescribed: its mass has no effect, nor has the inertia of the point masses.
    """
    axle = body("axle", 0.4, (0.3, 0.1, -0.2), (0.05, 0.04, 0.06), at=0 * X)
    points = [body(name, MASS, at, 3 * (1e-5,)) for name, at in (("left", FREE * Y), ("right", LENGTH * X + FREE * Y))]
    more, joints, drive = MAKES[how]()
    joints = [
        ("axle", "revolute", GROUND, "axle", 0 * X, Z),
        *joints,
        ("upright", "point_in_plane", "axle", "left", 0 * X, ACROSS, FREE * Y),
        ("bar", "rod", "right", "left", LENGTH * X + FREE * Y, ACROSS, FREE * Y),
        ("flat_left", "point_in_plane", GROUND, "left", FREE * Y, Z),
        ("flat_right", "point_in_plane", GROUND, "right", LENGTH * X + FREE * Y, Z),
    ]
    ends = (("left", GROUND, 0 * X), ("right", "axle", LENGTH * X))
    springs = tuple(Spring(f"k_{name}", on, name, end, 0 * X, 1.0, 0.0, FREE) for name, on, end in ends)
    plain = mechanism("car_axis", -GRAVITY * Y, [axle, *more, *points], joints, springs=springs, drives=(drive,))
    speed = -AMPLITUDE * FREQUENCY * FREE / LENGTH
    return plain, started(plain, velocities={name: (speed * X, 0 * X) for name in ("left", "right")})
