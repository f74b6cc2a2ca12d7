"""Chains of bodies: spatial ones of any length, planar ones with known small oscillations, the double pendulum."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
import scipy

from consilience.case.families.drawing import GRAVITY_W, SkewPlane, lumps, random_rotation, round_step
from consilience.case.families.parameters import Range
from consilience.case.families.tables import body, case_table, joint, known, numbers
from consilience.case.file.values import TomlTable
from consilience.errors import InvalidInput
from consilience.mechanism import Array

LINEAR = 1e-2
"""Largest nonlinear share of the amplitude at which the linear solution is an expected value."""


def chain(bodies: Annotated[int, Range(1, 1000)] = 10, seed: Annotated[int, Range(0, 1_000_000)] = 1) -> TomlTable:
    """Spatial chain of lumpy bodies on hinges of random directions.

    Tests how cost and rounding of an engine grow with the number of bodies; every term of spatial motion.

    Parameters
    ----------
    bodies : int, 1 to 1000
        Number of bodies, 0.3 m or so each. Equations in joint coordinates grow ill-conditioned with it.
    seed : int, 0 to 1000000
        Of masses, axes and angles.

    Returns
    -------
    dict
        Tables of a case file. No value is known in closed form.
    """
    rng = np.random.default_rng(seed)
    at = np.array([0.1, 0.2, 2.0])
    parts, joints, held, rates = [], [], {}, {}
    for i in range(bodies):
        R = random_rotation(rng)
        mass, arm = float(rng.uniform(0.5, 1.5)), np.append(rng.uniform(-0.12, 0.12, 2), -0.3)
        com, inertia = lumps(rng, mass, 0.15)
        parts.append(body(f"link_{i + 1}", mass, at + 0.4 * arm, R, com, inertia))
        before = f"link_{i}" if i else "ground"
        joints.append(joint(f"hinge_{i + 1}", "revolute", before, f"link_{i + 1}", at, rng.normal(size=3)))
        # amplitudes fall along the chain: otherwise the end of a long chain cracks like a whip
        held[f"hinge_{i + 1}"] = {"angle": float(rng.normal(scale=0.3 / np.sqrt(i + 1)))}
        rates[f"hinge_{i + 1}"] = {"angle": float(rng.normal(scale=0.5 / np.sqrt(i + 1)))}
        at = at + arm
    return case_table(
        f"Chain of {bodies} lumpy bodies on skew hinges",
        "Tests how cost and rounding grow with the number of bodies, and every term of spatial motion.",
        ["All numbers are our own, drawn at random"],
        ["chain", "revolute", "spatial", "lumpy"],
        {"gravity": numbers(GRAVITY_W), "body": parts, "joint": joints},
        {"joints": held, "rates": rates},
        (2.0, 0.02),
    )


def planar_chain(
    bodies: Annotated[int, Range(1, 100)] = 5,
    mode: Annotated[int, Range(1, 100)] = 1,
    amplitude: Annotated[float, Range(1e-6, 1.5, "rad")] = 1e-3,
    length: Annotated[float, Range(0.01, 10.0, "m")] = 0.5,
) -> TomlTable:
    """Hanging chain of rigid links that moves like beads on a thread, released in one of its modes.

    Tests small oscillations of many bodies: a wrong moment of inertia or stiffness of gravity shows in the phase.

    Parameters
    ----------
    bodies : int, 1 to 100
        Number of links.
    mode : int, 1 to `bodies`
        Released in this mode, the slowest is 1.
    amplitude : float, 1e-6 to 1.5 rad
        Largest angle of a link from the vertical line. Large angles have no closed form.
    length : float, 0.01 to 10 m
        Of a link.

    Returns
    -------
    dict
        Tables of a case file, with the lower ends of the first and last link after a quarter and all of the span.

    Notes
    -----
    A link with the mass moments of two points at its pins moves in the plane like these two points. The chain therefore
    moves like beads of equal mass on a thread: ``w_k^2 = x_k g / l`` with the zeros x_k of the Laguerre polynomial L_n,
    and bead j from below moves by ``L_j(x_k)`` [D. Bernoulli 1733; A. B. Pippard, The Physics of Vibration, 1978].
    Nonlinear terms are of the third order in the amplitude, and grow with w^2.

    Raises
    ------
    InvalidInput
        If the chain has no such mode.
    """
    if mode > bodies:
        raise InvalidInput("mode", f"{mode} of a chain of {bodies}", f"Give a mode of 1 to {bodies}.")
    x = float(scipy.special.roots_laguerre(bodies)[0][mode - 1])
    shape = [0.0, 1.0]  # L_(-1) takes no part in the recursion, L_0
    for j in range(bodies - 1):
        shape.append(((2 * j + 1 - x) * shape[-1] - j * shape[-2]) / (j + 1))
    title = f"Hanging chain of {bodies} links in its mode {mode}"
    source = (
        "closed form: small oscillations of a chain of equal beads, w^2 = x g / l, x a zero of the Laguerre polynomial"
    )
    return _beads(title, [1.0] * bodies, np.array(shape[:0:-1]), x, amplitude, length, source)


def mass_ratio(
    ratio: Annotated[float, Range(1e-6, 1e6)] = 1000.0,
    mode: Literal["slow", "fast"] = "slow",
    amplitude: Annotated[float, Range(1e-6, 1.5, "rad")] = 1e-3,
) -> TomlTable:
    """Double pendulum of very unequal masses, released in one of its two modes.

    Tests rounding where a heavy body hangs on a light one, and stiffness: the fast mode limits steps in either motion.

    Parameters
    ----------
    ratio : float, 1e-6 to 1e6
        Mass mu of the lower bead over that of the upper.
    mode : "slow" or "fast"
        Released in this mode.
    amplitude : float, 1e-6 to 1.5 rad
        Largest angle of a link from the vertical line. Only angles far below ``1 / sqrt(mu)`` in the fast mode, or far
        below one in the slow mode, have a closed form.

    Returns
    -------
    dict
        Tables of a case file, with the lower ends of both links after a quarter and all of the span.

    Notes
    -----
    ``w^2 = ((1 + mu) -+ sqrt(mu (1 + mu))) g / l`` [Landau & Lifshitz, Mechanics, section 23, problem 2, equal
    lengths]; links as in `planar_chain`. Nonlinear terms grow with w^2, because of the height of the heavy bead in the
    fast mode.
    """
    a, b = np.sqrt(1.0 + ratio), np.sqrt(ratio)
    # a^2 - a b without cancellation
    x, upper = (a / (a + b), b / (a + b)) if mode == "slow" else (a * (a + b), -b * (a + b))
    title = f"Double pendulum, masses 1 : {ratio:g}, {mode} mode"
    source = (
        "closed form: small oscillations of the double pendulum, Landau & Lifshitz, Mechanics, section 23, problem 2"
    )
    return _beads(title, [1.0, ratio], np.array([upper, 1.0]), float(x), amplitude, 1.0, source)


def _beads(
    title: str, beads: Sequence[float], shape: Array, x: float, amplitude: float, length: float, source: str
) -> TomlTable:
    """Case of a chain that moves like beads on a thread.

    Parameters
    ----------
    beads : sequence of float, kg
        From above.
    shape : ndarray, shape (n,)
        Displacements of the beads in the mode, from above.
    title, source : str
        Title of the case, and formula of the expected values.
    x : float
        ``w^2 l / g`` of the mode.
    amplitude : float, rad
        Largest angle of a link.
    length : float, m
        Of a link.
    """
    plane = SkewPlane()
    n, w = len(beads), float(np.sqrt(x * plane.slope / length))
    tilt = np.diff(shape, prepend=0.0)
    tilt *= amplitude / np.max(np.abs(tilt))
    tops = [beads[0] / 4] + [min(pair) / 4 for pair in pairwise(beads)]
    bodies = [
        _link(plane, i, top, bead - below, length)
        for i, (top, bead, below) in enumerate(zip(tops, beads, [*tops[1:], 0.0], strict=True))
    ]
    names = ["ground", *(f"link_{i + 1}" for i in range(n))]
    joints = [
        plane.joint(f"hinge_{i + 1}", names[i], names[i + 1], plane.point(i * length, 0.0, 0.02 * i)) for i in range(n)
    ]
    sample = round_step(2 * np.pi / w / 40)
    span = (100 * sample, sample)
    published = []
    for count in (25, 100):
        angles = tilt * np.cos(w * count * sample)
        beyond = 2 * length * amplitude**3 * (1 + x) * (1 + w * count * sample)
        if beyond > LINEAR * amplitude * length:
            break
        for i in sorted({1, n}):
            end = plane.point(length * np.cos(angles[:i]).sum(), length * np.sin(angles[:i]).sum(), 0.02 * i)
            published.append(known(("body", f"link_{i}"), "p_WB", count * sample, end, 1e-13 * n + beyond, source))
    return case_table(
        title,
        f"""
The links are lumpy across the plane of the motion, which leans; in it each moves like two points at its pins, so that
the chain moves like beads on a thread: w = {w:.6g} rad/s in this mode. Tests small oscillations of many bodies.
Known difficulties: the fastest mode takes part in every rounding error.""",
        [source.removeprefix("closed form: ")],
        ["chain", "revolute", "planar", *(["closed form"] if published else [])],
        {"gravity": numbers(plane.gravity), "body": bodies, "joint": joints},
        {"joints": {f"hinge_{i + 1}": {"angle": q} for i, q in enumerate(numbers(np.diff(tilt, prepend=0.0)))}},
        span,
        published,
    )


def _link(plane: SkewPlane, i: int, top: float, bottom: float, length: float) -> TomlTable:
    """Link that moves in the plane like two masses at its pins; the origin is the lower pin.

    Parameters
    ----------
    plane : SkewPlane
    i : int
        Number of the link from above.
    top, bottom : float, kg
        Masses at the upper and at the lower pin.
    length : float, m
    """
    mass = top + bottom
    across = top * bottom / mass * length**2
    inertia = across * np.array([0.6, 0.7, 1.0, 0.0, 0.08, -0.05])
    com = [-top / mass * length, 0.0, 0.05 * length]
    at = plane.point((i + 1) * length, 0.0, 0.02 * (i + 1))
    return body(f"link_{i + 1}", mass, at, plane.turned(0.0), com, inertia)
