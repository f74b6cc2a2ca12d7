"""One lumpy body on one joint, of each kind; and the heavy top."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from consilience.case.families.closed_forms import PENDULUM, TOP, HeavyTop, pendulum
from consilience.case.families.drawing import GRAVITY, GRAVITY_W, lumps, random_rotation
from consilience.case.families.parameters import Range
from consilience.case.families.tables import body, case_table, joint, known, numbers
from consilience.case.file.schema import InertiaTable
from consilience.case.file.values import TomlTable
from consilience.mechanism import (
    JOINT_KINDS,
    Array,
    quaternion_from_rotation_vector,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
)

WIDTHS = {"position": 3, "orientation": 3}


def single_joint(
    kind: Annotated[str, (*JOINT_KINDS,)] = "revolute", seed: Annotated[int, Range(0, 1_000_000)] = 1
) -> TomlTable:
    """One lumpy body on one joint in a skew pose.

    Tests the translation of one kind of joint, of its coordinates and of the body's inertia, with nothing beside it.

    Parameters
    ----------
    kind : str
        Any kind of joint.
    seed : int, 0 to 1000000
        Of pose, mass, frames and motion.

    Returns
    -------
    dict
        Tables of a case file. Where axis and translation do not mix, the position of the body after 0.5 s and 2 s is
        known: revolute, prismatic, cylindrical, planar, rigid and parallel axes; of a free body that of its centre of
        mass.

    Notes
    -----
    Revolute and cylindrical: a pendulum about the axis, ``phi'' = -m l g_p / I sin(phi)``, g_p gravity across the axis;
    along the axis the body falls freely. Prismatic, planar and parallel axes: the centre of mass falls freely in the
    directions the joint leaves, the body turns at a constant rate about the axis.
    """
    rng = np.random.default_rng(seed)
    mass, axes, R = float(rng.uniform(0.5, 3.0)), random_rotation(rng), random_rotation(rng)
    pin, offset = rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.3, 0.3, 3)
    com, inertia = lumps(rng, mass, 0.3)
    end = {"to": numbers(pin + axes[:, 2] * rng.uniform(0.4, 0.8))} if kind == "rod" else {}
    lump = body("lump", mass, pin + offset, R, com + np.array([0.05, -0.1, 0.08]), inertia)
    connection = joint("joint", kind, "ground", "lump", pin, axes[:, 2], second_axis=numbers(axes[:, 0]), **end)
    if kind == "rod":
        del connection["axis"]
    if kind == "screw":
        connection["pitch"] = float(rng.uniform(0.2, 0.5))
    held = {name: rng.normal(scale=0.3, size=WIDTHS.get(name, 1)) for name in JOINT_KINDS[kind].coordinates}
    rates = {name: rng.normal(scale=1.0, size=WIDTHS.get(name, 1)) for name in JOINT_KINDS[kind].coordinates}
    initial: TomlTable = {"joints": {"joint": _held(held)}, "rates": {"joint": _held(rates, rates=True)}}
    if kind == "rod":
        moving = {name: numbers(rng.normal(size=3)) for name in ("velocity", "angular_velocity")}
        initial = {"bodies": {"lump": moving}}
    published = _published(kind, lump, _Placed(pin, axes, held, rates))
    return case_table(
        f"A lumpy body on a {kind.replace('_', ' ')} joint",
        "One body, one joint, nothing along any axis. Tests the translation of the joint and of the body.",
        ["All numbers are our own, drawn at random"],
        [kind, "lumpy", *(["closed form"] if published else [])],
        {"gravity": numbers(GRAVITY_W), "body": [lump], "joint": [connection]},
        initial,
        (2.0, 0.05),
        published,
    )


def _held(values: dict[str, Array], rates: bool = False) -> TomlTable:
    table: dict[str, Any] = {n: numbers(v) if len(v) > 1 else float(v[0]) for n, v in values.items()}
    if "orientation" in table:
        turn = table.pop("orientation")
        given = {"quaternion": numbers(quaternion_from_rotation_vector(turn))}
        table |= {"angular_velocity": numbers(turn)} if rates else {"orientation": given}
    return table


class _Placed:
    """Pose and velocity of frame M at the start, from the held joint coordinates; frame F is at `pin` with `axes`."""

    def __init__(self, pin: Array, axes: Array, held: dict[str, Array], rates: dict[str, Array]) -> None:
        self.pin, self.axes = pin, axes

        def translation(values: dict[str, Array]) -> Array:
            """Vector (3,) in world axes of the coordinates that translate, in m, or of their rates in m/s."""
            names = {"x": 0, "y": 1, "distance": 2}
            found = np.array(values.get("position", np.zeros(3)))
            for name, k in names.items():
                found[k] += float(values[name][0]) if name in values else 0.0
            return np.asarray(axes @ found)

        self.p, self.v = pin + translation(held), translation(rates)
        self.angle, self.rate = (float(v["angle"][0]) if "angle" in v else 0.0 for v in (held, rates))
        # of a free body: M relative to F
        self.turn = axes @ held.get("orientation", np.zeros(3))
        self.spin = axes @ rates.get("orientation", np.zeros(3))

    def rotation(self, angle: float) -> Array:
        """Return the rotation matrix about the axis of the joint, world components."""
        return rotation_from_quaternion(quaternion_from_rotation_vector(self.axes[:, 2] * angle))


def _published(kind: str, lump: TomlTable, start: _Placed) -> list[TomlTable]:
    """Expected positions after 0.5 s and 2 s; none for joints without a closed form."""
    R = rotation_from_quaternion(np.array(lump["orientation"]["quaternion"]))
    at, com = np.array(lump["at"]) - start.pin, R @ np.array(lump["com"])
    allowed = {"prismatic": (2,), "planar": (0, 1), "rigid": (), "parallel_axes": (0, 1, 2), "free": (0, 1, 2)}
    times = (0.5, 2.0)
    if kind in ("revolute", "cylindrical"):
        return [_on_axis(kind, lump, start, R, t) for t in times]
    if kind not in allowed:
        return []
    U = start.axes[:, allowed[kind]]
    n = start.axes[:, 2]
    turned = start.rotation(start.angle)
    spin = start.rate * n
    if kind == "free":
        turned, spin = rotation_from_quaternion(quaternion_from_rotation_vector(start.turn)), start.spin
    arm = turned @ (at + com)
    velocity = start.v + np.cross(spin, arm)
    source = "closed form: free fall in the directions the joint leaves, a constant rate of turning about its axis"
    found = []
    for t in times:
        center = start.p + arm + velocity * t + 0.5 * t * t * (U @ (U.T @ GRAVITY_W))
        origin = center - start.rotation(start.angle + start.rate * t) @ com
        of, place = ("p_WBcm", center) if kind == "free" else ("p_WB", origin)
        found.append(known(("body", "lump"), of, t, place, 1e-12, source))
    return found


def _on_axis(kind: str, lump: TomlTable, start: _Placed, R: Array, t: float) -> TomlTable:
    """Position of the body at a time: a pendulum about the axis and, on a cylindrical joint, free fall along the axis.

    Parameters
    ----------
    kind : {"revolute", "cylindrical"}
    lump : dict
        Table of the body.
    start : _Placed
    R : ndarray, shape (3, 3)
        Axes of the body in the drawing, world components.
    t : float, s
    """
    n = start.axes[:, 2]
    at = np.array(lump["at"]) - start.pin
    arm = at + R @ np.array(lump["com"])
    across = arm - n * (n @ arm)
    tensor = InertiaTable(**lump["inertia"]).tensor()
    moment = float(n @ R @ tensor @ R.T @ n + lump["mass"] * across @ across)
    g = GRAVITY_W - n * (n @ GRAVITY_W)
    drawn = float(np.arctan2(n @ np.cross(g, across), g @ across))
    w = np.sqrt(lump["mass"] * np.linalg.norm(across) * np.linalg.norm(g) / moment)
    angle, _ = pendulum(float(w), drawn + start.angle, start.rate, [t])
    fall = (start.v @ n * t + 0.5 * t * t * (n @ GRAVITY_W)) * n if kind == "cylindrical" else 0.0
    origin = start.p + fall + start.rotation(float(angle[0]) - drawn) @ at
    return known(("body", "lump"), "p_WB", t, origin, 1e-12, PENDULUM)


def top(
    spin: Annotated[float, Range(1.0, 1e5, "rad/s")] = 150.0,
    tilt: Annotated[float, Range(0.01, 3.1, "rad")] = 1.0,
    precession: Annotated[float, Range(-100.0, 100.0, "rad/s")] = 0.5,
    nutation: Annotated[float, Range(-100.0, 100.0, "rad/s")] = 0.2,
) -> TomlTable:
    """Heavy symmetric top on a ball joint.

    Tests gyroscopic terms, and rotation through many turns: fast spins ask for small steps, and charts of angles break.

    Parameters
    ----------
    spin : float, 1 to 1e5 rad/s
        Rate of psi, about its own axis.
    tilt : float, 0.01 to 3.1 rad
        Of the axis from upward, at the start.
    precession, nutation : float, -100 to 100 rad/s
        Rates of phi and theta, at the start; the second not zero.

    Returns
    -------
    dict
        Tables of a case file, with a point off the axis after a quarter and all of the span.

    Notes
    -----
    Elliptic functions and integrals [Goldstein, Poole & Safko 2002, section 5.7]; see `closed_forms.HeavyTop`. The
    spin's angle is known to eps times itself.
    """
    mass, length, across, along = 2.0, 0.3, 0.03, 0.02
    pivot = np.array([0.1, -0.2, 0.4])
    angles, rates = (0.3, tilt, 0.0), (precession, nutation or 1e-3, spin)
    R = rotation_from_euler_zxz(angles)
    origin = np.array([0.1, 0.05, 0.2])  # off the axis, so that its motion shows the spin, too
    S = rotation_from_euler_zxz([0.4, 0.8, -0.3])  # axes of the body, in axes of the symmetry
    tensor = S.T @ np.diag([across, across, along]) @ S
    com = S.T @ (np.array([0.0, 0.0, length]) - origin)
    wheel = body("wheel", mass, pivot + R @ origin, R @ S, com, (tensor + tensor.T) / 2)
    motion = HeavyTop(across + mass * length**2, along, mass * GRAVITY * length, angles, rates)
    sample = float(f"{min(0.05, 0.9 / (spin + abs(precession) + abs(nutation))):.0e}")
    times = np.array([25, 100]) * sample
    node = np.array([np.cos(angles[0]), np.sin(angles[0]), 0.0])
    w = precession * np.array([0.0, 0.0, 1.0]) + rates[1] * node + spin * R[:, 2]
    places = [pivot + rotation_from_euler_zxz(at) @ origin for at in motion.solve(times)]
    published = [
        known(("body", "wheel"), "p_WB", t, at, 1e-11 + 1e-15 * spin * t, TOP)
        for t, at in zip(times, places, strict=True)
    ]
    ball = {"name": "ball", "kind": "spherical", "predecessor": "ground", "successor": "wheel", "at": numbers(pivot)}
    return case_table(
        f"Heavy symmetric top at {spin:g} rad/s",
        "Tests gyroscopic terms and rotation through many turns. The span is in proportion to the spin.",
        [
            "H. Goldstein, C. Poole, J. Safko, Classical Mechanics, 3rd edition, 2002, section 5.7",
            "All numbers are our own",
        ],
        ["spherical", "gyroscopic", "closed form"],
        {"gravity": numbers(GRAVITY_W), "body": [wheel], "joint": [ball]},
        {"rates": {"ball": {"angular_velocity": numbers(w)}}},
        (100 * sample, sample),
        published,
    )
