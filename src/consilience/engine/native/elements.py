"""Elements of a mechanism as data and code of an exported script, for engines without such elements.

Exported scripts do not import this package: they contain the source of `friction_law`, `spring_damper_law` and
`rolling_contact`. A script defines, for each moving frame of its engine (`owner`, by name):

- ``pose(owner)``: origin and axes in the world;
- ``jacobian(owner, p)``: of the velocity of a point p in axes of the owner and of the angular velocity, (6, n), world;
- ``motion(owner, p)``: these velocities, shape (6,);
- ``drift(owner, p)``: their rates where no coordinate accelerates, shape (6,);
- ``coordinate(*place)``: value and rate of a joint coordinate, as the mechanism counts the coordinate, the coefficients
  (n,) of the rate, and the second rate where no coordinate accelerates; `Places.axis` gives the place;
- ``BODIES``: owner, origin and axes of each body in axes of the owner; ``COUNT``: number n of velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import getsource
from typing import Any

from consilience.engine.harness_solvers import solve_constrained
from consilience.engine.native.script import function_data
from consilience.errors import InvalidInput
from consilience.mechanism import (
    Array,
    Function,
    JointSpring,
    Mechanism,
    friction_law,
    rolling_contact,
    spring_damper_law,
)


@dataclass(frozen=True)
class Places:
    """Bodies and joint coordinates in terms of an engine.

    Attributes
    ----------
    frame : callable
        From body: owner, origin and axes of the body in the frame of the owner.
    axis : callable
        From joint and coordinate: the place of the coordinate for the script, often owner and sign.
    exerted : callable
        From joint spring: the part of the spring and damper that the script exerts; default: all, the engine has none.
    """

    frame: Callable[[str], list[Any]]
    axis: Callable[[str, str], list[Any]]
    exerted: Callable[[JointSpring], JointSpring] = lambda spring: spring

    def point(self, body: str, p: Array) -> list[Any]:
        """Return the owner of a body, and a point of the body in the frame of the owner."""
        owner, origin, R = self.frame(body)
        return [owner, origin + R @ p]


def _law(function: Function | None) -> dict[str, Any] | None:
    return None if function is None else function_data(function)


def _forces(m: Mechanism, at: Places) -> dict[str, Any]:
    springs = [
        {
            "from": at.point(s.predecessor, s.point_predecessor),
            "to": at.point(s.successor, s.point_successor),
            "stiffness": s.stiffness,
            "damping": s.damping,
            "free_length": s.free_length,
            "f": _law(s.actuator),
        }
        for s in m.springs
    ]
    loads = [
        {
            "at": at.point(x.body, x.point),
            "kind": x.kind,
            "frame": x.frame,
            "vector": at.frame(x.body)[2] @ x.vector if x.frame == "body" else x.vector,
            "f": _law(x.history),
        }
        for x in m.loads
    ]
    return {"SPRINGS": springs, "LOADS": loads}


def _efforts(m: Mechanism, at: Places) -> dict[str, Any]:
    efforts: list[dict[str, Any]] = []
    for s in m.joint_springs:
        spring, damper = at.exerted(s).laws
        own = {"spring": spring, "damper": damper, "rest": s.rest} if any((*spring, *damper)) else {}
        if own or s.actuator:
            efforts.append({"axis": at.axis(s.joint, s.coordinate), **own, "f": _law(s.actuator)})
    efforts += [
        {"axis": at.axis(f.joint, f.coordinate), "friction": [f.viscous, f.coulomb, f.speed]} for f in m.frictions
    ]
    controls = [
        {
            "axis": at.axis(c.joint, c.coordinate),
            "P": c.proportional,
            "I": c.integral,
            "D": c.derivative,
            "f": function_data(c.target),
        }
        for c in m.controls
    ]
    return {"EFFORTS": efforts, "CONTROLS": controls}


def row_data(m: Mechanism, axis: Callable[[str, str], list[Any]]) -> dict[str, Any]:
    """Return the constants of a script with `ROWS`, without the closed loops ``WELDS``."""
    names = ("body", "center", "axis", "radius", "point", "normal", "rounding")
    return {
        "DRIVES": [[axis(d.joint, d.coordinate), function_data(d.motion)] for d in m.drives],
        "COUPLINGS": [
            [axis(c.joint, c.coordinate), axis(c.driver_joint, c.driver_coordinate), function_data(c.law)]
            for c in m.couplings
        ],
        "ROLLINGS": [{name: getattr(r, name) for name in names} for r in m.rollings],
        "SKATES": [{"body": s.body, "point": s.point, "lateral": s.lateral} for s in m.skates],
    }


def refuse_contacts(mechanism: Mechanism) -> None:
    """Refuse contacts, stops and dry friction, whose numbers follow state and step of an adapter.

    Raises
    ------
    InvalidInput
    """
    groups = {"contact": mechanism.contacts, "stop": mechanism.stops, "dry friction": mechanism.dry_frictions}
    for what, elements in groups.items():
        for element in elements:
            raise InvalidInput(
                f"{what} '{element.name}'", "scripts have no contacts, stops or dry friction", "Export without it."
            )


def element_data(mechanism: Mechanism, at: Places) -> dict[str, Any]:
    """Return the constants of a script with `ELEMENTS`, without the closed loops ``WELDS``, pairs of (owner, p, R).

    Raises
    ------
    InvalidInput
        See `refuse_contacts`.
    """
    refuse_contacts(mechanism)
    bodies = {"BODIES": {body.name: at.frame(body.name) for body in mechanism.bodies}}
    return bodies | _forces(mechanism, at) | _efforts(mechanism, at) | row_data(mechanism, at.axis)


LAWS = "\n" + getsource(friction_law) + "\n\n" + getsource(spring_damper_law)
"""Source of `friction_law` and `spring_damper_law`; the script imports math."""

ROLLING = (
    "\ncross = np.cross\n\n\n"
    + getsource(rolling_contact)
    + '''

def axes_of_plane(n):
    """Normal and two directions of a plane as rows."""
    across = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    across /= np.linalg.norm(across)
    return np.array([n, across, np.cross(n, across)])
'''
)
"""Source of `rolling_contact` and of axes of a plane; the script imports NumPy."""

_APPLIED = '''
def applied(t, integrals):
    """Generalised forces of springs, loads, efforts and control."""
    tau = np.zeros(COUNT)
    for s in SPRINGS:
        ends = [(owner, np.array(p)) for owner, p in (s["from"], s["to"])]
        places = [pose(owner)[0] + pose(owner)[1] @ p for owner, p in ends]
        d = places[1] - places[0]
        length = np.linalg.norm(d)
        rate = (d / length) @ (motion(*ends[1]) - motion(*ends[0]))[:3]
        tension = s["stiffness"] * (length - s["free_length"]) + s["damping"] * rate
        tension -= jet(s["f"], t)[0] if s["f"] else 0.0
        tau += (jacobian(*ends[0]) - jacobian(*ends[1]))[:3].T @ (tension * d / length)
    for load in LOADS:
        owner, p = load["at"]
        R = pose(owner)[1] if load["frame"] == "body" else np.eye(3)
        vector = R @ load["vector"] * (jet(load["f"], t)[0] if load["f"] else 1.0)
        rows = slice(0, 3) if load["kind"] == "force" else slice(3, 6)
        tau += jacobian(owner, np.array(p))[rows].T @ vector
    for e in EFFORTS:
        value, rate, row, _ = coordinate(*e["axis"])
        effort = spring_damper_law(value - e["rest"], rate, e["spring"], e["damper"])[0] if "rest" in e else 0.0
        effort += jet(e["f"], t)[0] if e.get("f") else 0.0
        effort += friction_law(rate, *e["friction"])[0] if "friction" in e else 0.0
        tau += effort * row
    for c, integral in zip(CONTROLS, integrals, strict=True):
        value, rate, row, _ = coordinate(*c["axis"])
        target, target_rate, _ = jet(c["f"], t)
        effort = c["P"] * (target - value) + c["I"] * integral + c["D"] * (target_rate - rate)
        tau += effort * row
    return tau
'''

ROWS = (
    ROLLING
    + '''

def rolling_rows(r):
    """Rows at the point of contact: along the normal and two directions of the plane."""
    owner, p, R_body = BODIES[r["body"]]
    R = pose(owner)[1] @ R_body
    n, w = np.array(r["normal"]), motion(owner, np.array(p))[3:]
    rho, rho_dot = rolling_contact(R @ r["axis"], n, w, r["radius"], r["rounding"])
    plane = axes_of_plane(n)
    touch = np.array(p) + R_body @ (np.array(r["center"]) + R.T @ rho)
    wanted = np.cross(w, np.cross(w, rho) - rho_dot)  # the material point in contact is at rest, and changes
    return plane @ jacobian(owner, touch)[:3], plane @ (wanted - drift(owner, touch)[:3])


def skate_rows(s):
    """Row across a skate, whose direction turns with its body."""
    owner, p, R_body = BODIES[s["body"]]
    R_body = np.array(R_body)
    point = np.array(p) + R_body @ s["point"]
    lateral, moving = pose(owner)[1] @ R_body @ s["lateral"], motion(owner, point)
    wanted = -np.cross(moving[3:], lateral) @ moving[:3]
    return (lateral @ jacobian(owner, point)[:3])[None], np.array([wanted - lateral @ drift(owner, point)[:3]])


def weld_rows(original, copy):
    """Rows of a weld of two frames."""
    (first, p, _), (second, r, _) = original, copy
    J = jacobian(second, np.array(r)) - jacobian(first, np.array(p))
    return J, drift(first, np.array(p)) - drift(second, np.array(r))


def drive_row(t, place, law):
    """Row of a driven coordinate."""
    _, _, row, drifting = coordinate(*place)
    return row[None], np.array([jet(law, t)[2] - drifting])


def coupling_row(place, driver, law):
    """Row of a coordinate that is a function of another coordinate."""
    value, rate, driving, driver_drifting = coordinate(*driver)
    _, slope, bend = jet(law, value)
    _, _, row, drifting = coordinate(*place)
    return (row - slope * driving)[None], np.array([bend * rate**2 + slope * driver_drifting - drifting])


def held(t):
    """Rows ``J a = gamma`` of all loops and constraint elements."""
    found = [(np.zeros((0, COUNT)), np.zeros(0)), *(weld_rows(*weld) for weld in WELDS)]
    found += [drive_row(t, *drive) for drive in DRIVES] + [coupling_row(*coupling) for coupling in COUPLINGS]
    found += [rolling_rows(r) for r in ROLLINGS] + [skate_rows(s) for s in SKATES]
    return np.vstack([rows for rows, _ in found]), np.concatenate([right for _, right in found])
'''
)
"""Source of ``held(t)`` and of its rows one by one; the script imports math and NumPy, and contains `JET`."""

ELEMENTS = LAWS + "\n" + _APPLIED + "\n" + ROWS
"""Source of ``applied(t, integrals)`` and ``held(t)``."""

SOLVE = "\n" + getsource(solve_constrained)
"""Source of `solve_constrained`; the script imports NumPy and has the constant ``RANK_TOLERANCE``."""
