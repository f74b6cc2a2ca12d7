"""Closed loops of any size: windows, parallel rods, scissors, rings, the four-bar linkage near its singular pose."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from consilience.case.families.closed_forms import PENDULUM, pendulum, second_kind_inverse
from consilience.case.families.drawing import GRAVITY, SkewPlane, lumps, random_rotation, round_step
from consilience.case.families.parameters import Range
from consilience.case.families.tables import body, case_table, joint, known, numbers
from consilience.case.file.values import TomlTable
from consilience.errors import InvalidInput
from consilience.mechanism import elementary_rotation


def windows(count: Annotated[int, Range(1, 200)] = 2) -> TomlTable:
    """N-four-bar mechanism of the IFToMM library (A02): N windows of slender rods in a row.

    Tests redundant constraints (2 N + 1 bodies, 3 N + 1 hinges, one degree of freedom), and the passage of the singular
    pose in which all rods lie on a line, with N + 1 freedoms.

    Parameters
    ----------
    count : int, 1 to 200
        Number N of windows.

    Returns
    -------
    dict
        Tables of a case file, with the upper end of the first rod after 1 s and 5 s.

    Notes
    -----
    Rods of 1 m and 1 kg, upright at the start, the upper end of the first at 1 m/s [Bayo & Avello 1994; M. Gonzalez et
    al., Library of Computational Benchmark Problems, A02]. On the branch of the parallelograms theta from upward obeys
    ``theta'' = c sin(theta)``, ``c = g ((N + 1) / 2 + N) / ((N + 1) / 3 + N)``. Moments out of the plane are our
    choice.
    """
    bodies, joints = [], []
    upright = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x of the rod along y
    moments = np.array([0.01, 1 / 12, 1 / 12, 0.0, 0.0, 0.0])
    for i in range(count + 1):
        foot, head = np.array([i, 0.0, 0.0]), np.array([i, 1.0, 0.0])
        bodies.append(body(f"upright_{i}", 1.0, foot, upright, [0.5, 0.0, 0.0], moments))
        joints.append(joint(f"foot_{i}", "revolute", "ground", f"upright_{i}", foot, [0.0, 0.0, 1.0]))
        if i:
            joints.append(joint(f"right_{i - 1}", "revolute", f"over_{i - 1}", f"upright_{i}", head, [0.0, 0.0, 1.0]))
        if i < count:
            bodies.append(body(f"over_{i}", 1.0, head, np.eye(3), [0.5, 0.0, 0.0], moments))
            joints.append(joint(f"left_{i}", "revolute", f"upright_{i}", f"over_{i}", head, [0.0, 0.0, 1.0]))
    c = GRAVITY * ((count + 1) / 2 + count) / ((count + 1) / 3 + count)
    times = np.array([1.0, 5.0])
    angle, _ = pendulum(float(np.sqrt(c)), -np.pi, 1.0, times)  # from the stable pose, opposite in sense to the hinges
    source = "closed form: all uprights turn alike, theta'' = c sin(theta), in Jacobi elliptic functions"
    published = [
        known(("body", "over_0"), "p_WB", t, [-np.sin(q), -np.cos(q), 0.0], 1e-11, source)
        for t, q in zip(times, angle, strict=True)
    ]
    return case_table(
        f"N-four-bar mechanism of {count} window{'s' * (count > 1)} (A02)",
        """
Tests redundant constraints, and the passage of the singular pose in which all rods lie on a line. From the source:
lengths, masses, moments about the normal, start. What we chose: the other moments of inertia. Known difficulties: on
the line the mechanism might go on along other branches.""",
        [
            (
                "Library of Computational Benchmark Problems, problem A02 'N four-bar mechanism', M. Gonzalez, "
                "Universidad de La Coruna, 2005"
            ),
            (
                "E. Bayo, A. Avello, Singularity-free augmented Lagrangian algorithms for constrained multibody "
                "dynamics, Nonlinear Dynamics 5, 1994"
            ),
        ],
        ["revolute", "loop", "redundant", "planar", "singular", "closed form"],
        {"gravity": numbers([0.0, -GRAVITY, 0.0]), "body": bodies, "joint": joints},
        {"rates": {"foot_0": {"angle": -1.0}}},
        (5.0, 0.05),
        published,
    )


def parallel_rods(
    rods: Annotated[int, Range(2, 200)] = 4,
    angle: Annotated[float, Range(-3.0, 3.0, "rad")] = 0.6,
    seed: Annotated[int, Range(0, 1_000_000)] = 1,
) -> TomlTable:
    """Platform that hangs on n equal parallel rods: 4 n - 5 redundant constraints and one degree of freedom.

    Tests rank decisions and reactions: each rod more adds four redundant rows and changes the motion only by its mass.

    Parameters
    ----------
    rods : int, 2 to 200
        Number n of rods, lumpy ones, each with two hinges. Two alone may pass a pose in which they lie on one line.
    angle : float, -3 to 3 rad
        Of the rods from the slope line, at the start.
    seed : int, 0 to 1000000
        Of masses and places.

    Returns
    -------
    dict
        Tables of a case file, with the position of the platform after 1 s and 4 s.

    Notes
    -----
    All rods turn alike, the platform only moves along a circle: a pendulum ``J phi'' = -|s| g sin(phi)``, with the
    first moment ``s = sum m_i c_i + m_p l`` of the rods' centres of mass from their upper hinges and of the platform at
    their lower ends, and ``J = sum (J_i + m_i c_i^2) + m_p l^2``.
    """
    plane, rng, length = SkewPlane(), np.random.default_rng(seed), 0.8
    spots = rng.uniform([-0.5, -1.0, -0.3], [0.5, 1.0, 0.3], size=(rods, 3))
    bodies, joints = [], []
    moment, first = 0.0, np.zeros(3)
    for i, spot in enumerate(spots):
        mass = float(rng.uniform(0.5, 1.5))
        com, inertia = lumps(rng, mass, 0.2)
        R = random_rotation(rng)
        arm = plane.R @ rng.uniform([0.2, -0.1, -0.1], [0.6, 0.1, 0.1])  # from the upper hinge to the origin
        upper, lower = plane.point(*spot), plane.point(spot[0] + length, *spot[1:])
        bodies.append(body(f"rod_{i + 1}", mass, upper + arm, R, com, inertia))
        joints.append(plane.joint(f"upper_{i + 1}", "ground", f"rod_{i + 1}", upper))
        joints.append(plane.joint(f"lower_{i + 1}", f"rod_{i + 1}", "platform", lower))
        c = (plane.R.T @ (arm + R @ com)) * [1.0, 1.0, 0.0]
        n = plane.R[:, 2]
        moment += float(n @ R @ inertia @ R.T @ n + mass * c @ c)
        first += mass * c
    mass = 2.0
    com, inertia = lumps(rng, mass, 0.4)
    at = plane.point(length, 0.0, 0.1)
    bodies.append(body("platform", mass, at, random_rotation(rng), com, inertia))
    moment, first = moment + mass * length**2, first + mass * np.array([length, 0.0, 0.0])
    times = np.array([1.0, 4.0])
    lead = float(np.arctan2(first[1], first[0]))
    frequency = float(np.sqrt(np.linalg.norm(first) * plane.slope / moment))
    turned = pendulum(frequency, lead + angle, 0.3, times)[0] - lead
    source = "closed form: all rods turn alike; " + PENDULUM.removeprefix("closed form: ")
    published = [
        known(("body", "platform"), "p_WB", t, at + plane.along(q, length) - plane.along(0.0, length), 1e-11, source)
        for t, q in zip(times, turned, strict=True)
    ]
    return case_table(
        f"Platform on {rods} parallel rods",
        "The rods are lumpy and their plane leans. Tests rank decisions: each rod more adds four redundant rows.",
        [PENDULUM.removeprefix("closed form: "), "All numbers are our own, drawn at random"],
        ["revolute", "loop", "redundant", "lumpy", "closed form"],
        {"gravity": numbers(plane.gravity), "body": bodies, "joint": joints},
        {"joints": {"upper_1": {"angle": angle}}, "rates": {"upper_1": {"angle": 0.3}}},
        (4.0, 0.05),
        published,
    )


def scissor(
    stages: Annotated[int, Range(1, 100)] = 3,
    angle: Annotated[float, Range(0.01, 1.4, "rad")] = 0.4,
    rate: Annotated[float, Range(-5.0, 5.0, "rad/s")] = 0.3,
) -> TomlTable:
    """Scissor linkage on a level plane that opens by its own momentum.

    Tests many small loops in a row: two bars and three hinges a stage, one degree of freedom, half the rows redundant.

    Parameters
    ----------
    stages : int, 1 to 100
        Number n of pairs of bars.
    angle, rate : float, 0.01 to 1.4 rad and -5 to 5 rad/s
        Of the bars from the rail, at the start. It is nearly singular where they lie on the rail or stand across it.

    Returns
    -------
    dict
        Tables of a case file, with the position of the slider and of the last bar after a quarter and all of the span.

    Notes
    -----
    One foot is pinned, the other slides along the rail. Twice the kinetic energy is ``(P - Q sin(theta)^2) theta'^2``
    and constant, so that ``sqrt(P) E(theta | Q / P)`` grows at a constant rate: an elliptic integral of the second
    kind. Bars of length 2 a, mass m and moment J: ``P = 2 n J + 2 m a^2 n (4 n^2 - 1) / 3``,
    ``P - Q = 2 n (J + m a^2) + 4 a^2 m_s``.
    """
    plane, half, mass, slider = SkewPlane(level=True), 0.4, 0.7, 0.9
    J, n = 0.045, stages
    bodies, joints = [], []
    across, along = 2 * half * np.sin(angle), 2 * half * np.cos(angle)
    for k in range(n):
        for name, sign in (("rise", 1.0), ("fall", -1.0)):
            R, layer = plane.turned(sign * angle), 0.05 * sign
            at = plane.point(along / 2, (k + 0.5) * across, layer)
            bodies.append(body(f"{name}_{k + 1}", mass, at, R, [0, 0, 0.04 * sign], [0.03, 0.025, J, 0, 0.004, -0.003]))
        middle = plane.point(along / 2, (k + 0.5) * across)
        joints.append(plane.joint(f"pin_{k + 1}", f"rise_{k + 1}", f"fall_{k + 1}", middle))
        if k:
            left, right = plane.point(0.0, k * across), plane.point(along, k * across)
            joints.append(plane.joint(f"left_{k}", f"fall_{k}", f"rise_{k + 1}", left))
            joints.append(plane.joint(f"right_{k}", f"rise_{k}", f"fall_{k + 1}", right))
    com, inertia = lumps(np.random.default_rng(3), slider, 0.1)
    foot = plane.point(along, 0.0)
    bodies.append(body("slider", slider, foot, plane.turned(0.7), com, inertia))
    joints += [
        plane.joint("foot", "ground", "rise_1", plane.point(0.0, 0.0)),
        plane.joint("wrist", "slider", "fall_1", foot),
        plane.joint("rail", "ground", "slider", foot, kind="prismatic"),
    ]
    P = 2 * n * J + 2 * mass * half**2 * n * (4 * n * n - 1) / 3
    m = (P - 2 * n * (J + mass * half**2) - 4 * half**2 * slider) / P
    span = float(f"{min(4.0, 0.5 / max(abs(rate), 0.1)):.1g}")
    growth = rate * np.sqrt(1 - m * np.sin(angle) ** 2)
    source = "closed form: constant kinetic energy, an elliptic integral of the second kind"
    published = []
    for t in (span / 4, span):
        q = second_kind_inverse(m, angle, growth * t)
        last = plane.point(half * np.cos(q), (2 * n - 1) * half * np.sin(q), 0.05)
        slid = plane.point(2 * half * np.cos(q), 0.0)
        for name, at in (("slider", slid), (f"rise_{n}", last)):
            published.append(known(("body", name), "p_WB", t, at, 1e-12 * n, source))
    return case_table(
        f"Scissor linkage of {stages} stage{'s' * (stages > 1)}",
        "Gravity is along the normal of its plane, so that the reactions bear it. Tests many small loops in a row.",
        ["All numbers are our own; the motion is an elliptic integral of the second kind"],
        ["revolute", "prismatic", "loop", "redundant", "planar", "closed form"],
        {"gravity": numbers(plane.gravity), "body": bodies, "joint": joints},
        {"rates": {"foot": {"angle": rate}}},
        (span, span / 100),
        published,
    )


def closed_ring(
    bodies: Annotated[int, Range(3, 200)] = 6,
    hinges: Literal["parallel", "skew"] = "parallel",
    seed: Annotated[int, Range(0, 1_000_000)] = 1,
) -> TomlTable:
    """Ring of n lumpy bodies and the ground on n + 1 hinges, drawn as half a circle that hangs from two pins.

    Tests one long loop: parallel hinges leave n - 2 freedoms and three redundant rows, skew ones n - 5 and none.

    Parameters
    ----------
    bodies : int, 3 to 200
        Number n of bodies; at least 6 on skew hinges.
    hinges : "parallel" or "skew"
        Directions of the hinges.
    seed : int, 0 to 1000000
        Of masses, axes and rates.

    Returns
    -------
    dict
        Tables of a case file. No value is known in closed form.

    Raises
    ------
    InvalidInput
        If skew hinges would leave no freedom.
    """
    if hinges == "skew" and bodies < 6:
        raise InvalidInput("bodies", f"{bodies} bodies on skew hinges cannot move", "Give at least 6.")
    plane, rng, radius = SkewPlane(), np.random.default_rng(seed), 0.8
    angles = np.linspace(-np.pi / 2, np.pi / 2, bodies + 1)
    pins = [plane.point(radius * np.cos(q), radius * np.sin(q)) for q in angles]
    parts, joints = [], []
    for i in range(bodies):
        mass = float(rng.uniform(0.5, 1.5)) * 6 / bodies
        com, inertia = lumps(rng, mass, 0.4 * radius * np.pi / bodies)
        middle = (pins[i] + pins[i + 1]) / 2
        parts.append(body(f"link_{i + 1}", mass, middle, random_rotation(rng), com, inertia))
    names = ["ground", *(f"link_{i + 1}" for i in range(bodies)), "ground"]
    for i, pin in enumerate(pins):
        axis = plane.R[:, 2] if hinges == "parallel" else rng.normal(size=3)
        joints.append(joint(f"hinge_{i + 1}", "revolute", names[i], names[i + 1], pin, axis))
    return case_table(
        f"Ring of {bodies} lumpy bodies on {hinges} hinges",
        "Tests one long loop, whose last joint an engine has to close. The plane of the ring leans.",
        ["All numbers are our own, drawn at random"],
        ["revolute", "loop", "lumpy", "chain", *(["redundant"] if hinges == "parallel" else [])],
        {"gravity": numbers(plane.gravity), "body": parts, "joint": joints},
        {"rates": {"hinge_1": {"angle": float(rng.uniform(0.3, 0.6))}}},
        (2.0, 0.02),
    )


def four_bar(
    crank: Annotated[float, Range(0.01, 10.0, "m")] = 0.3,
    coupler: Annotated[float, Range(0.01, 10.0, "m")] = 0.9,
    rocker: Annotated[float, Range(0.01, 10.0, "m")] = 0.7,
    distance: Annotated[float, Range(1e-9, 10.0, "m")] = 0.2,
    angle: Annotated[float, Range(-3.1, 3.1, "rad")] = 0.5,
    rate: Annotated[float, Range(-50.0, 50.0, "rad/s")] = 8.0,
) -> TomlTable:
    """Four-bar linkage that passes its singular pose, all links on a line, at any distance.

    Tests conditioning: the ground link is `coupler + rocker - crank - distance` long, so that coupler and rocker are
    straight but for `distance` when the crank points away from the rocker's pivot.

    Parameters
    ----------
    crank, coupler, rocker : float, 0.01 to 10 m
        Lengths.
    distance : float, 1e-9 to 10 m
        By which the lengths miss the singular pose. Reactions there grow like one over its square root.
    angle, rate : float, -3.1 to 3.1 rad and -50 to 50 rad/s
        Of the crank from the ground link, at the start.

    Returns
    -------
    dict
        Tables of a case file, with the angular velocities of coupler and rocker at the start.

    Notes
    -----
    Angles by the intersection of two circles, rates from the loop closure ``a w_1 sin(q_1 - q_3) / (b sin(q_3 - q_2))``
    and so on [E. J. Haug, Computer Aided Kinematics and Dynamics of Mechanical Systems, 1989; textbooks].

    Raises
    ------
    InvalidInput
        If the lengths do not close in that pose.
    """
    ground = coupler + rocker - crank - distance
    plane = SkewPlane()
    pin = crank * np.array([np.cos(angle), np.sin(angle)])
    reach = np.array([ground, 0.0]) - pin
    apart = float(np.hypot(*reach))
    cosine = (coupler**2 + apart**2 - rocker**2) / (2 * coupler * apart)
    if ground <= 0 or abs(cosine) >= 1:
        raise InvalidInput("distance", f"no linkage of ground link {ground:g} m closes there", "Give other lengths.")
    q2 = float(np.arctan2(reach[1], reach[0]) + np.arccos(cosine))
    head = pin + coupler * np.array([np.cos(q2), np.sin(q2)])
    q3 = float(np.arctan2(head[1], head[0] - ground))
    rng = np.random.default_rng(5)
    points = [np.zeros(2), pin, head, np.array([ground, 0.0])]
    masses = {"crank": 5.0, "coupler": 1.0, "rocker": 0.8}
    parts = []
    for (name, mass), start, q, length in zip(
        masses.items(), (points[0], points[1], points[3]), (angle, q2, q3), (crank, coupler, rocker), strict=True
    ):
        com, inertia = lumps(rng, mass, 0.4 * length)
        R = plane.turned(q) @ elementary_rotation(0, 0.7)
        middle = com + np.array([length / 2, 0.0, 0.0])
        parts.append(body(name, mass, plane.point(start[0], start[1], 0.03), R, middle, inertia))
    names = ("ground", "crank", "coupler", "rocker", "ground")
    joints = [
        plane.joint(name, names[i], names[i + 1], plane.point(*points[i]))
        for i, name in enumerate(("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot"))
    ]
    rates = {
        "coupler": rate * crank * np.sin(angle - q3) / (coupler * np.sin(q3 - q2)),
        "rocker": rate * crank * np.sin(angle - q2) / (rocker * np.sin(q3 - q2)),
    }
    source = "closed form: angular velocities by the closure of the loop"
    uncertainty = 1e-13 * (1.0 + abs(rate) * (crank / min(coupler, rocker)) / np.sin(q3 - q2) ** 2)
    published = [
        known(("body", name), "w_WB_W", 0.0, w * plane.R[:, 2], uncertainty, source) for name, w in rates.items()
    ]
    sample = round_step(0.4 / max(abs(rate), 1.0))
    return case_table(
        f"Four-bar linkage, {distance:g} m from its singular pose",
        "The links are lumpy and their plane leans; the heavy crank carries them through the pose. Tests conditioning.",
        [source.removeprefix("closed form: "), "All numbers are our own"],
        ["revolute", "loop", "redundant", "lumpy", "singular", "closed form"],
        {"gravity": numbers(plane.gravity), "body": parts, "joint": joints},
        {"rates": {"crank_pivot": {"angle": rate}}},
        (40 * sample, sample),
        published,
    )
