"""Published comparisons of engines in contact, rebuilt at any size: balls on a pushed box, a lattice of balls.

The source is SimBenchmark (github.com/leggedrobotics/SimBenchmark, 2018-2021): "rolling" and "666", "elastic 666", with
its masses, sizes, coefficients and forces; the axes of the plane, of bodies, and the origins of bodies are our own.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import Annotated

import numpy as np

from consilience.case.families.contacts import NORMAL, PLACE, contact_axes, flat_contact, free_joint
from consilience.case.families.drawing import GRAVITY, random_rotation
from consilience.case.families.parameters import Range
from consilience.case.families.tables import body, case_table, known, numbers
from consilience.case.file.values import TomlTable
from consilience.mechanism import Array

SOURCE = "J. Hwangbo, D. Kang, SimBenchmark, github.com/leggedrobotics/SimBenchmark"


def _ball(rng: np.random.Generator, name: str, mass: float, radius: float, center: Array) -> TomlTable:
    """Homogeneous ball, its origin beside its centre."""
    R, com = random_rotation(rng), rng.uniform(-0.3, 0.3, size=3) * radius
    return body(name, mass, center - R @ com, R, com, 0.4 * mass * radius**2 * np.eye(3))


def balls_on_box(
    rows: Annotated[int, Range(1, 5)] = 2, heading: Annotated[float, Range(-180.0, 180.0, "deg")] = 60.0
) -> TomlTable:
    """A box is pushed along the floor, with balls that roll on it.

    Tests rolling on a body that accelerates, and a box that slides at a heading: engines whose cone is a box or a
    pyramid hold it still. With 5 rows the "rolling" test of SimBenchmark, whose force is at 60 or 90 degrees.

    Parameters
    ----------
    rows : int, 1 to 5
        Of as many balls each, 2 m apart; 5 in the source.
    heading : float, -180 to 180 deg
        Of the force, from the first tangent of the floor towards the second.

    Returns
    -------
    dict
        Tables of a case file, with the places of the box and of a ball.

    Notes
    -----
    n balls of mass m = 1 kg, radius r = 0.5 m on a box of M = 10 kg, friction 0.4 under the box and 0.8 on it, force
    F = 150 N. A ball that rolls is driven by the friction ``f = m a_ball``, and ``2/5 m r^2 w' = f r``: its centre has
    2/7 of the acceleration of the box, ``a = (F - 0.4 (M + n m) g)/(M + 2/7 n m)``.
    """
    rng = np.random.default_rng(11)
    E, half, radius, count = contact_axes(NORMAL), np.array([10.0, 10.0, 0.5]), 0.5, rows * rows
    along = E[:, :2] @ [np.cos(np.radians(heading)), np.sin(np.radians(heading))]
    center, top = PLACE + half[2] * E[:, 2], PLACE + 2 * half[2] * E[:, 2]
    R, com = random_rotation(rng), np.array([0.3, -0.2, 0.1])
    tensor = R.T @ E @ np.diag(10.0 / 3.0 * (half @ half - half**2)) @ E.T @ R
    box = body("box", 10.0, center - R @ com, R, com, tensor)
    contacts = [flat_contact("floor", "box", center, E, half, PLACE, 0.4)]
    bodies, places = [box], []
    for k, (i, j) in enumerate(product(range(rows), repeat=2)):
        name, place = f"ball_{k + 1}", top + E @ np.array([2.0 * i - rows + 1.0, 2.0 * j - rows + 1.0, radius])
        bodies.append(_ball(rng, name, 1.0, radius, place))
        contacts.append(
            {"name": f"under_{name}", "body": name, "partner": "box", "at": numbers(place), "radius": radius}
            | {"point": numbers(top), "normal": numbers(E[:, 2]), "friction": 0.8}
        )
        places.append(place)
    a = (150.0 - 0.4 * (10.0 + count) * GRAVITY) / (10.0 + count * 2 / 7)
    push = {"name": "push", "body": "box", "at": numbers(center), "vector": numbers(150.0 * along), "frame": "world"}
    source = "Newton's and Euler's equations: balls that roll have 2/7 of the acceleration of the box"
    published = [
        known(("body", "box"), "p_WBcm", 1.0, center + a / 2 * along, 1e-10, source),
        known(("body", "ball_1"), "p_WBcm", 1.0, places[0] + a / 7 * along, 1e-10, source),
    ]
    table = case_table(
        f"{count} balls roll on a box that is pushed at {heading:g} degrees",
        balls_on_box.__doc__ or "",
        [SOURCE],
        ["contact", "rolling", "closed form"],
        {
            "gravity": numbers(-GRAVITY * E[:, 2]),
            "body": bodies,
            "joint": [free_joint(b["name"], b["at"]) for b in bodies],
            "contact": contacts,
            "force": [push],
        },
        {},
        (1.0, 0.05),
        published,
    )
    return table | {"instant": {"states": 1, "seed": 1}}  # the box that turns on its feet has no determined motion


def ball_lattice(
    edge: Annotated[int, Range(2, 4)] = 2, restitution: Annotated[float, Range(0.0, 1.0)] = 1.0
) -> TomlTable:
    """A cubic lattice of smooth balls, each a little off its place, falls on the floor.

    Tests many impacts, and how long a motion is determined: a difference grows tenfold and more with every impact. The
    "666" tests of SimBenchmark have 6 balls along an edge and restitutions of 0 and 1.

    Parameters
    ----------
    edge : int, 2 to 4
        Number n of balls along an edge.
    restitution : float, 0 to 1
        Of every pair, the floor included.

    Returns
    -------
    dict
        Tables of a case file.
    """
    rng = np.random.default_rng(42)
    E, radius, gap = contact_axes(NORMAL), 0.1, 0.21
    height = 0.101 if restitution == 0.0 else 1.101
    centers, bodies = {}, []
    for k, at in enumerate(product(range(edge), repeat=3)):
        off = gap * np.array(at) + rng.uniform(0.0, 0.001, size=3) + np.array([0.0, 0.0, height])
        centers[f"ball_{k + 1}"] = PLACE + E @ off
        bodies.append(_ball(rng, f"ball_{k + 1}", 10.0, radius, PLACE + E @ off))
    floor = {"point": numbers(PLACE), "normal": numbers(E[:, 2])}
    ball = {name: {"body": name, "at": numbers(c), "radius": radius} for name, c in centers.items()}
    contacts = [{"name": f"floor_{name}", "restitution": restitution} | ball[name] | floor for name in centers]
    for one, two in combinations(centers, 2):
        other = {"partner": two, "partner_at": numbers(centers[two]), "partner_radius": radius}
        contacts.append({"name": f"{one}_{two}", "restitution": restitution} | ball[one] | other)
    return case_table(
        f"Lattice of {edge} x {edge} x {edge} smooth balls that falls, restitution {restitution:g}",
        ball_lattice.__doc__ or "",
        [SOURCE],
        ["contact", "impact"],
        {
            "gravity": numbers(-GRAVITY * E[:, 2]),
            "body": bodies,
            "joint": [free_joint(b["name"], b["at"]) for b in bodies],
            "contact": contacts,
        },
        {},
        (0.6, 0.02),
    )
