"""Bodies in contact: a cube that slides at any heading, balls in a line, a stack of boxes; with exact motions."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from consilience.case.families.drawing import GRAVITY, lumps, random_rotation, round_step
from consilience.case.families.parameters import Range
from consilience.case.families.tables import body, case_table, known, numbers
from consilience.case.file.values import TomlTable
from consilience.errors import InvalidInput
from consilience.mechanism import Array, quaternion_from_rotation

NORMAL = np.array([1.0, 2.0, 2.0]) / 3.0
PLACE = np.array([0.3, -0.2, 0.1])
COULOMB = "F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996: Coulomb's law"
RESTITUTION = "Newton's law of restitution, simultaneous for contacts that are closed together; all numbers are our own"


def contact_axes(normal: Array) -> Array:
    """Return the axes of a plane as columns: the projection of the world's x axis, the normal times it, the normal."""
    t1 = np.eye(3)[0] - normal[0] * normal
    t1 /= np.linalg.norm(t1)
    return np.column_stack([t1, np.cross(normal, t1), normal])


def free_joint(name: str, at: list[float]) -> TomlTable:
    """Return the free joint of a body that starts at a place."""
    return {"name": f"{name}_flight", "kind": "free", "predecessor": "ground", "successor": name, "at": at}


def flat_box(name: str, rng: np.random.Generator, center: Array, E: Array, half: Array, mass: float) -> TomlTable:
    """Return a box with lumps of mass all over it, their centre in its middle, the body's axes turned against its own.

    Parameters
    ----------
    name : str
    rng : numpy.random.Generator
        Source of the lumps and of the axes.
    center, half : ndarray, shape (3,), m
        Middle of the box in the drawing, and half its edges.
    E : ndarray, shape (3, 3)
        Axes of the box in those of the drawing.
    mass : float, kg
    """
    R = random_rotation(rng)
    com, inertia = lumps(rng, mass, half)
    Q = R.T @ E
    return body(name, mass, center - E @ com, R, Q @ com, Q @ inertia @ Q.T)


def flat_contact(name: str, of: str, center: Array, E: Array, half: Array, foot: Array, mu: float) -> TomlTable:
    """Return the contact of a box that lies flat on a plane.

    Parameters
    ----------
    name, of : str
        Names of the contact and of the body.
    center, half : ndarray, shape (3,), m
        As in `flat_box`.
    E : ndarray, shape (3, 3)
        Axes of the box in those of the drawing; the last one is the normal of the plane.
    foot : ndarray, shape (3,), m
        Point of the plane.
    mu : float
        Coefficient of friction.
    """
    axes = {"quaternion": numbers(quaternion_from_rotation(E))}
    box = {"name": name, "body": of, "at": numbers(center), "half_sizes": numbers(half), "orientation": axes}
    return box | {"point": numbers(foot), "normal": numbers(E[:, 2]), "friction": mu}


def sliding_cube(
    slope: Annotated[float, Range(0.0, 80.0, "deg")] = 0.0,
    heading: Annotated[float, Range(-180.0, 180.0, "deg")] = 20.0,
    friction: Annotated[float, Range(0.01, 2.0)] = 0.4,
    speed: Annotated[float, Range(0.01, 20.0, "m/s")] = 2.0,
    cone: Literal["circle", "pyramid", "box"] = "circle",
) -> TomlTable:
    """A flat cube slides on a plane at a heading from the first tangent of its cone, which points down the slope.

    Tests the cone of friction and its tangents: circle, pyramid and box brake, turn and stop the cube differently.

    Parameters
    ----------
    slope : float, 0 to 80 deg
        Between the normal of the plane and gravity.
    heading : float, -180 to 180 deg
        Of the velocity, from the first tangent towards the second.
    friction : float, 0.01 to 2
    speed : float, 0.01 to 20 m/s
    cone : {"circle", "pyramid", "box"}
        The pyramid has four facets, its vertices along the tangents.

    Returns
    -------
    dict
        Tables of a case file; where the cube stops, if it does and a formula gives the place.

    Notes
    -----
    On a level plane each cone brakes by pieces of uniform acceleration. On a slope a the velocity under Coulomb's
    circle is ``K w^(k-1) (1 + w^2)``, ``w = tan(th/2)`` of the heading th, ``k = friction/tan a``; it stops for k > 1,
    after times and ways that are integrals of powers of w [Pfeiffer & Glocker 1996].
    """
    rng = np.random.default_rng(7)
    E, half = contact_axes(NORMAL), np.array([0.2, 0.2, 0.05])
    a, th = np.radians(slope), np.radians(heading)
    gravity = GRAVITY * (np.sin(a) * E[:, 0] - np.cos(a) * E[:, 2])
    center = PLACE + half[2] * E[:, 2]
    cube = flat_box("cube", rng, center, E, half, 2.0)
    contact = flat_contact("floor", "cube", center, E, half, PLACE, friction)
    if cone != "circle":
        contact["cone"] = {"kind": cone}
    velocity = speed * (np.cos(th) * E[:, 0] + np.sin(th) * E[:, 1])
    stop = _stop(a, th, friction, speed, cone)
    span = min(10.0, 1.25 * stop[0]) if stop else 1.0
    sample = round_step(span / 20)
    times = float(np.ceil(span / sample - 1e-9) * sample), sample
    published = []
    if stop and stop[0] < 0.95 * times[0]:
        place = center + E[:, :2] @ stop[1]
        source = "uniform acceleration by pieces, or the hodograph of a point on a slope"
        published = [known(("body", "cube"), "p_WBcm", times[0], place, 1e-10, source)]
    return case_table(
        f"Cube that slides on a slope of {slope:g} degrees at {heading:g} degrees, cone: {cone}",
        sliding_cube.__doc__ or "",
        [COULOMB],
        ["contact", "lumpy", *(["closed form"] if published else [])],
        {"gravity": numbers(gravity), "body": [cube], "joint": [free_joint("cube", cube["at"])], "contact": [contact]},
        {"bodies": {"cube": {"velocity": numbers(velocity)}}},
        times,
        published,
    )


def _stop(a: float, th: float, mu: float, speed: float, cone: str) -> tuple[float, Array] | None:
    """Time and place of the stop in the tangents, (2,), m; None without a stop or a formula."""
    brake = mu * GRAVITY * np.cos(a)
    v = speed * np.array([np.cos(th), np.sin(th)])
    if a == 0.0:
        return _level_stop(brake, v, cone)
    k, drive = mu / np.tan(a), GRAVITY * np.sin(a)
    if cone != "circle" or k <= 1.05:
        return None
    if abs(np.sin(th)) < 1e-9:
        a_x = brake - drive if v[0] > 0 else brake + drive
        return speed / a_x, np.array([v[0] * speed / (2 * a_x), 0.0])
    w = np.tan(abs(th) / 2)
    c = speed * np.sin(abs(th)) / 2  # K w^k at the start: powers of w by themselves overflow where k is large
    time = c / drive * (1 / (w * (k - 1)) + w / (k + 1))
    x = c**2 / drive * (1 / (w**2 * (2 * k - 2)) - w**2 / (2 * k + 2))
    y = 2 * c**2 / drive * (1 / (w * (2 * k - 1)) + w / (2 * k + 1))
    return float(time), np.array([x, np.sign(th) * y])


def _level_stop(brake: float, v: Array, cone: str) -> tuple[float, Array]:
    """Time and place of the stop on a level plane: straight; each tangent for itself; or one, then both at half."""
    speeds, signs = np.abs(v), np.sign(v)
    if cone == "circle":
        speed = float(np.linalg.norm(v))
        return speed / brake, v * speed / (2 * brake)
    if cone == "box":
        return float(np.max(speeds)) / brake, signs * speeds**2 / (2 * brake)
    fast, slow = np.argsort(-speeds, kind="stable")
    first = (speeds[fast] - speeds[slow]) / brake
    way = np.zeros(2)
    way[fast] = (speeds[fast] ** 2 - speeds[slow] ** 2) / (2 * brake) + speeds[slow] ** 2 / brake
    way[slow] = speeds[slow] * first + speeds[slow] ** 2 / brake
    return float(first + 2 * speeds[slow] / brake), signs * way


def balls_in_line(
    balls: Annotated[int, Range(2, 50)] = 4,
    restitution: Annotated[float, Range(0.0, 1.0)] = 0.8,
    gap: Annotated[float, Range(0.0, 1.0, "m")] = 0.0,
) -> TomlTable:
    """The first of equal balls in a line hits the others, which touch or have gaps.

    Tests simultaneous impacts, where the balls touch, and chains of impacts through gaps.

    Parameters
    ----------
    balls : int, 2 to 50
        Number n of balls.
    restitution : float, 0 to 1
        e of every pair.
    gap : float, 0 to 1 m
        Between the balls at rest; the first one starts 0.1 m away.

    Returns
    -------
    dict
        Tables of a case file, with the velocities of the first and the last ball after the only impact, if the balls
        touch or are two.

    Notes
    -----
    Balls that touch part with ``(1 + e)/n`` of the speed of the first, which keeps ``(1 - (n - 1) e)/n``: momentum, and
    restitution of the one pair that closes, while the others neither close nor pull [Glocker, Set-Valued Force Laws].
    """
    radius, mass, speed = 0.05, 0.4, 1.0
    d = np.array([2.0, -1.0, 2.0]) / 3.0
    rng = np.random.default_rng(3)
    ways = np.concatenate([[0.0, 2 * radius + 0.1], 2 * radius + gap + np.zeros(balls - 2)]).cumsum()
    names, inertia = [f"ball_{k + 1}" for k in range(balls)], 0.4 * mass * radius**2 * np.eye(3)
    bodies, contacts = [], []
    for name, way in zip(names, ways, strict=True):
        R, com = random_rotation(rng), rng.uniform(-0.3, 0.3, size=3) * radius
        bodies.append(body(name, mass, PLACE + way * d - R @ com, R, com, inertia))
    for k in range(balls - 1):
        ends = {"at": numbers(PLACE + ways[k] * d), "partner_at": numbers(PLACE + ways[k + 1] * d)}
        pair = {"name": f"pair_{k + 1}", "body": names[k], "partner": names[k + 1], "radius": radius}
        contacts.append(pair | ends | {"partner_radius": radius, "restitution": restitution})
    published = []
    if balls == 2 or gap == 0.0:
        left = speed * (1 - (balls - 1) * restitution) / balls
        source = "momentum and restitution of balls that touch: (1 - (n - 1) e)/n and (1 + e)/n"
        after = {names[0]: left, names[-1]: speed * (1 + restitution) / balls}
        published = [known(("body", name), "v_WBcm_W", 0.2, v * d, 1e-11, source) for name, v in after.items()]
    return case_table(
        f"{balls} balls in a line, gaps of {gap:g} m, restitution {restitution:g}",
        balls_in_line.__doc__ or "",
        [RESTITUTION],
        ["contact", "impact", *(["closed form"] if published else [])],
        {
            "gravity": [0.0, 0.0, 0.0],
            "body": bodies,
            "joint": [free_joint(b["name"], b["at"]) for b in bodies],
            "contact": contacts,
        },
        {"bodies": {"ball_1": {"velocity": numbers(speed * d)}}},
        (0.2, 0.01),
        published,
    )


def box_stack(
    boxes: Annotated[int, Range(1, 30)] = 3,
    slope: Annotated[float, Range(0.0, 20.0, "deg")] = 10.0,
    friction: Annotated[float, Range(0.01, 2.0)] = 0.5,
) -> TomlTable:
    """A stack of equal flat boxes at rest on a slope: it stays, if the friction is enough.

    Tests rest of many contacts at once, whose single forces no equation determines.

    Parameters
    ----------
    boxes : int, 1 to 30
    slope : float, 0 to 20 deg
        Below ``atan(friction)``.
    friction : float, 0.01 to 2
        Of the floor and between the boxes.

    Returns
    -------
    dict
        Tables of a case file, with the place of the uppermost box, where it stays.

    Raises
    ------
    InvalidInput
        If the slope is too steep for the friction, or so steep that the stack would tip.
    """
    E, half, rng = contact_axes(NORMAL), np.array([0.3, 0.3, 0.05]), np.random.default_rng(5)
    a = np.radians(slope)
    if np.tan(a) >= friction:
        most = np.degrees(np.arctan(friction))
        raise InvalidInput("slope", f"{slope:g} degrees is too steep for the friction", f"Give less than {most:.4g}.")
    if np.tan(a) >= half[0] / (boxes * half[2]):
        most = np.degrees(np.arctan(half[0] / (boxes * half[2])))
        raise InvalidInput("slope", f"a stack of {boxes} tips at {slope:g} degrees", f"Give less than {most:.4g}.")
    gravity = GRAVITY * (np.sin(a) * E[:, 0] - np.cos(a) * E[:, 2])
    bodies, contacts = [], []
    for k in range(boxes):
        foot = PLACE + 2 * k * half[2] * E[:, 2]
        center = foot + half[2] * E[:, 2]
        bodies.append(flat_box(f"box_{k + 1}", rng, center, E, half, 1.0))
        below = {"partner": f"box_{k}"} if k else {}
        contacts.append(flat_contact(f"on_{k}", f"box_{k + 1}", center, E, half, foot, friction) | below)
    source = "statics: it stays"
    return case_table(
        f"Stack of {boxes} boxes on a slope of {slope:g} degrees",
        box_stack.__doc__ or "",
        [COULOMB],
        ["contact", "stack", "closed form", "lumpy"],
        {
            "gravity": numbers(gravity),
            "body": bodies,
            "joint": [free_joint(b["name"], b["at"]) for b in bodies],
            "contact": contacts,
        },
        {},
        (0.5, 0.05),
        [known(("body", f"box_{boxes}"), "p_WBcm", 0.5, center, 1e-10, source)],
    )
