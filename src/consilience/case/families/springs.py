"""Bodies on a rail with springs between them: linear motions of any stiffness, all in closed form."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from consilience.case.families.closed_forms import oscillator
from consilience.case.families.drawing import GRAVITY_W, lumps, random_rotation, round_step
from consilience.case.families.parameters import Range
from consilience.case.families.tables import body, case_table, joint, known, numbers
from consilience.case.file.values import TomlTable
from consilience.errors import InvalidInput
from consilience.mechanism import Array

LEVEL, SLANTING = np.array([3.0, 4.0, 0.0]) / 5.0, np.array([2.0, -1.0, 2.0]) / 3.0
START = np.array([0.3, 0.2, -0.1])
SPACING = 0.5


def spring_chain(
    masses: Annotated[int, Range(1, 200)] = 5,
    stiffness: Annotated[float, Range(1.0, 1e9, "N/m")] = 400.0,
    damping: Annotated[float, Range(0.0, 1e3, "N s/m")] = 0.0,
    mass: Annotated[float, Range(1e-3, 1e3, "kg")] = 2.0,
) -> TomlTable:
    """Equal masses on a level rail, springs between them and to both ends; the first one is pushed.

    Tests springs and dampers between points, and prismatic joints, by a motion of all modes at once.

    Parameters
    ----------
    masses : int, 1 to 200
        Number n of masses, 0.5 m apart, each on a prismatic joint to the ground.
    stiffness : float, 1 to 1e9 N/m
        k of each of the n + 1 springs.
    damping : float, 0 to 1000 N s/m
        c of each; less than critical in the fastest mode: ``c^2 < k m / 4`` or so.
    mass : float, 0.001 to 1000 kg

    Returns
    -------
    dict
        Tables of a case file, with the position of the first, middle and last mass after a quarter and all of the span.

    Notes
    -----
    Modes ``sin(i j pi / (n + 1))`` of frequency ``w_j = 2 sqrt(k / m) sin(j pi / (2 n + 2))`` and damping ratio
    ``c w_j / (2 k)`` [Goldstein, Poole & Safko, Classical Mechanics, 2002, section 6].

    Raises
    ------
    InvalidInput
        If a mode is damped beyond the critical.
    """
    n, fastest = masses, 2 * np.sqrt(stiffness / mass)
    if damping * fastest / (2 * stiffness) >= 1:
        raise InvalidInput(
            "damping", f"{damping:g} N s/m is more than critical", f"Give less than {2 * stiffness / fastest:g}."
        )
    sample = round_step(2 * np.pi / fastest / 10)
    # small enough that no spring shrinks to a point
    push = min(1.0, 0.02 * fastest)
    i = np.arange(1, n + 1)
    times = np.array([25, 100]) * sample
    modes = np.sqrt(2 / (n + 1)) * np.sin(np.outer(i, i) * np.pi / (n + 1))
    rates = modes[0] * push
    moved = np.array(
        [
            oscillator(w, damping * w / (2 * stiffness), 0.0, rate, times)
            for w, rate in zip(fastest * np.sin(i * np.pi / (2 * n + 2)), rates, strict=True)
        ]
    )
    displacement = modes @ moved
    source = "closed form: modes of a chain of equal masses and springs, Goldstein, Poole & Safko, section 6"
    rail = _rail(LEVEL, mass, np.full(n + 1, stiffness), np.full(n + 1, damping), np.zeros(n + 1))
    published = [
        known(("joint", f"slide_{b + 1}"), "distance", t, displacement[b, k], 1e-12, source)
        for k, t in enumerate(times)
        for b in sorted({0, (n - 1) // 2, n - 1})
    ]
    return case_table(
        f"{n} masses and {n + 1} springs on a rail",
        "Drawn at rest; the first mass is pushed. Tests springs between points and prismatic joints.",
        [source.removeprefix("closed form: ")],
        ["prismatic", "spring", "closed form"],
        rail,
        {"rates": {"slide_1": {"distance": push}}},
        (100 * sample, sample),
        published,
    )


def stiff_spring(
    stiffness: Annotated[float, Range(10.0, 1e14, "N/m")] = 1e6,
    damping_ratio: Annotated[float, Range(0.0, 0.99)] = 0.0,
    speed: Annotated[float, Range(0.0, 1.0, "m/s")] = 0.1,
) -> TomlTable:
    """Two equal masses on a rail, each on a soft spring of 20 N/m, joined by a stiff one.

    Tests stiffness: the slow motion is of interest, the fast motion limits the steps of an explicit method.

    Parameters
    ----------
    stiffness : float, 10 to 1e14 N/m
        Of the spring between the masses of 1 kg.
    damping_ratio : float, 0 to 0.99
        Of the fast mode, by a damper along the stiff spring.
    speed : float, 0 to 1 m/s
        Speed at which the masses part at the start. Zero: the slow motion alone.

    Returns
    -------
    dict
        Tables of a case file, with both positions after 0.5 s and 2 s.

    Notes
    -----
    ``w_slow^2 = k0 / m``, ``w_fast^2 = (k0 + 2 k) / m``; each is a damped oscillator of its own. The phase of the
    fast one is known to eps times its angle, which is the uncertainty.
    """
    soft, mass = 20.0, 1.0
    slow, fast = np.sqrt(soft / mass), np.sqrt((soft + 2 * stiffness) / mass)
    damping = damping_ratio * fast * mass
    times, start = np.array([0.5, 2.0]), 0.6
    mean = oscillator(slow, 0.0, 0.0, start, times)
    apart = oscillator(fast, damping_ratio, 0.0, speed / 2, times)
    rest = mass * float(GRAVITY_W @ SLANTING) / soft
    rail = _rail(
        SLANTING, mass, np.array([soft, stiffness, soft]), np.array([0.0, damping, 0.0]), np.array([rest, 0.0, -rest])
    )
    source = "closed form: two damped oscillators, the sum and the difference of the displacements"
    rounding = speed / fast * 4e-16
    published = [
        known(("joint", f"slide_{b}"), "distance", t, m + sign * a, 1e-12 + rounding * (fast * t + 1.0), source)
        for t, m, a in zip(times, mean, apart, strict=True)
        for b, sign in ((1, -1.0), (2, 1.0))
    ]
    return case_table(
        f"Two masses joined by a spring of {stiffness:g} N/m",
        f"""
Drawn at rest under gravity. Both masses are pushed along the rail, and slightly apart: a slow motion of {slow:.4g}
rad/s and a fast one of {fast:.4g} rad/s. Tests stiffness. Known difficulties: explicit methods need steps below
{2 / fast:.2g} s.""",
        [source.removeprefix("closed form: ")],
        ["prismatic", "spring", "stiff", "closed form"],
        rail,
        {"rates": {"slide_1": {"distance": start - speed / 2}, "slide_2": {"distance": start + speed / 2}}},
        (2.0, 0.02),
        published,
    )


def _rail(direction: Array, mass: float, stiffness: Array, damping: Array, strain: Array) -> TomlTable:
    """Return lumpy bodies on prismatic joints along one line, and springs along a line beside it.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Of the rail, a unit vector in world axes.
    mass : float, kg
        Of each body.
    stiffness, damping : ndarray, shape (n + 1,), N/m and N s/m
    strain : ndarray, shape (n + 1,), m
        By which the springs are longer than free in the drawing.
    """
    rng = np.random.default_rng(7)
    n = len(stiffness) - 1
    names = ["ground", *(f"mass_{i + 1}" for i in range(n)), "ground"]
    ends = [START + direction * SPACING * i for i in range(n + 2)]
    bodies = []
    for name, at in zip(names[1:-1], ends[1:-1], strict=True):
        com, inertia = lumps(rng, mass, 0.1)
        bodies.append(body(name, mass, at + rng.uniform(-0.05, 0.05, 3), random_rotation(rng), com, inertia))
    joints = [joint(f"slide_{i}", "prismatic", "ground", names[i], ends[i], direction) for i in range(1, n + 1)]
    beside = np.array([0.0, 0.1, 0.05])
    springs = [
        {
            "name": f"spring_{i + 1}",
            "predecessor": names[i],
            "successor": names[i + 1],
            "at": numbers(ends[i] + beside),
            "to": numbers(ends[i + 1] + beside),
            "stiffness": float(stiffness[i]),
            "damping": float(damping[i]),
            "free_length": float(SPACING - strain[i]),
        }
        for i in range(n + 1)
    ]
    return {"gravity": numbers(GRAVITY_W), "body": bodies, "joint": joints, "spring": springs}
