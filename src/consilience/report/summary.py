"""Texts for the terminal: the matrix of verdicts, and the description of a case."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from consilience.case import Case
from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.mechanism import (
    TOUCHING,
    Contact,
    DryFriction,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    State,
    Stop,
    characteristic_length,
    constraint_residual,
    contact_parts,
    contact_velocity,
    joint_coordinates,
    nearest_points,
    relative_motion,
    shapes_in_words,
    strikes,
)
from consilience.report.anatomy import anatomy, dependency_lines, expected_lines, freedom_line
from consilience.report.annotations import counts
from consilience.report.record import Record
from consilience.report.selection import is_matched
from consilience.report.textdrawing import draw
from consilience.report.wording import LOOKS


def matrix(record: Record) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Return the engines, and for each case the verdict of its cell in a report and the least digits with it.

    The reference is an engine where one of its formulations differs from another.
    """
    rows, matched = [], _counting(record)
    doubted = any(c["engine"] == REFERENCE and c["verdict"] != Verdict.AGREES for c in matched)
    engines = [name for name in record.header["engines"] if name != REFERENCE or doubted]
    for case in record.cases:
        found = [[c for c in matched if (c["case"], c["engine"]) == (case["name"], e)] for e in engines]
        rows.append((case["name"], [_cell(comparisons) for comparisons in found]))
    return engines, rows


def legend(record: Record) -> list[str]:
    """Explain the symbols that occur in the matrix."""
    engines, _ = matrix(record)
    occur = {c["verdict"] for c in _counting(record) if c["engine"] in engines}
    return [f"{look.symbol} {look.name}: {look.sentence}" for v, look in LOOKS.items() if str(v) in occur]


def _counting(record: Record) -> list[dict[str, Any]]:
    """Return the comparisons that count for a cell: with matched settings, of motions by the best method."""
    return [c for c in record.comparisons if is_matched(c) and counts(c)]


def _cell(comparisons: list[dict[str, Any]]) -> str:
    if not comparisons:
        return "not asked"
    worst = max((Verdict(c["verdict"]) for c in comparisons), key=list(Verdict).index)
    digits = [c["digits"] for c in comparisons if c["verdict"] == worst and c["digits"] is not None]
    return f"{LOOKS[worst].symbol} {min(digits):.1f}" if digits else f"{LOOKS[worst].symbol} {LOOKS[worst].name}"


def describe_case(case: Case) -> str:
    """Describe a case as plain text."""
    mechanism, state = case.mechanism, case.initial_state
    lines = [
        f"{case.name}: {case.title}",
        "",
        *(f"source: {source}" for source in case.sources or ["not stated"]),
        "",
        *case.remarks.splitlines(),
        "",
        draw(mechanism, state),
        "",
        f"gravity {_vector(mechanism.gravity)} m/s^2",
        *_freedom(mechanism, state),
        "",
        *(
            f"body {b.name}: {b.mass:g} kg, centre of mass {_vector(b.com)} m, "
            f"principal moments {_vector(np.linalg.eigvalsh(b.inertia))} kg m^2"
            for b in mechanism.bodies
        ),
        *(_joint(mechanism, state, joint) for joint in mechanism.joints),
        *(
            f"spring {s.name}: {s.predecessor} - {s.successor}, {s.stiffness:g} N/m" + _powered(s)
            for s in mechanism.springs
        ),
        *(
            f"joint spring {s.name}: about {s.joint}, {_powers(s.stiffness, s.higher_stiffness)}"
            + (f", damping {_powers(s.damping, s.higher_damping)}" if any(s.higher_damping) else "")
            + _powered(s)
            for s in mechanism.joint_springs
        ),
        *(_load(load) for load in mechanism.loads),
        *_elements(mechanism),
        "",
        f"initial state: joints satisfied to {np.max(np.abs(constraint_residual(mechanism, state)), initial=0.0):.1g}",
        *(_touch(mechanism, state, contact) for contact in mechanism.contacts),
        f"trajectory: {case.duration:g} s, sampled every {case.sample:g} s, {case.digits} digits asked",
        _instants(case),
        *(f"expected: {line}" for line in expected_lines(case)),
        "",
    ]
    return "\n".join(lines)


def _freedom(mechanism: Mechanism, state: State) -> list[str]:
    """State degrees of freedom, dependent rows, undetermined reactions, features that an engine must know."""
    facts = anatomy(mechanism, state)
    return [
        freedom_line(facts.freedom, facts.rows, facts.redundant),
        f"an engine needs: {', '.join(facts.features)}",
        *dependency_lines(facts.dependent, facts.undetermined, facts.singular),
    ]


def _powers(first: float, higher: tuple[float, ...]) -> str:
    """Coefficients of a law by degree; of a linear law the one number."""
    return f"[{', '.join(f'{x:g}' for x in (first, *higher))}]" if any(higher) else f"{first:g}"


def _powered(spring: Spring | JointSpring) -> str:
    return ", with an actuator" if spring.actuator is not None else ""


def _load(load: Load) -> str:
    varies = ", a function of time" if load.history is not None else ""
    return f"{load.kind} {load.name}: {_vector(load.vector)}, fixed in the {load.frame}{varies}"


def _contact(c: Contact) -> str:
    """Describe shapes and laws of a contact; laws at their defaults are left out."""
    words = [f"contact {c.name}: {c.body} on {c.partner}, {shapes_in_words(c)}, restitution {c.restitution:g}"]
    words[0] += f" ({c.impact_law.capitalize()})" if c.impact_law != "newton" else ""
    words[0] += f" above {c.rebound_threshold:g} m/s" if c.rebound_threshold else ""
    words.append(f"friction {c.friction:g}")
    if c.static_friction is not None:
        words[-1] += f" (sticking {c.static_friction:g})"
    if c.cone.kind != "circle":
        words[-1] += f" in a pyramid of {c.cone.facets} facets" if c.cone.kind == "pyramid" else " in a box"
    words += ["associated"] if c.associated else []
    words += [f"{name} friction {getattr(c, name):g} m" for name in ("torsional", "rolling") if getattr(c, name)]
    if c.compliance is not None:
        words.append(f"stiffness {c.compliance.stiffness:g} N/m, damping {c.compliance.damping:g} N s/m")
    return ", ".join(words)


def _instants(case: Case) -> str:
    if strikes(case.mechanism, case.initial_state):
        return f"instants: {case.instants} random consistent states; at the initial one something strikes"
    return f"instants: the initial state and {case.instants - 1} random consistent ones"


def _touch(mechanism: Mechanism, start: State, c: Contact) -> str:
    """Tell gap and slip of a contact at the start, of the part that is nearest."""
    near, part = min(
        ((nearest_points(mechanism, start, part), part) for part in contact_parts(c)), key=lambda both: both[0].gap
    )
    if near.gap > TOUCHING * characteristic_length(mechanism):
        return f"contact {c.name} at the start: apart by {near.gap:.4g} m"
    u = contact_velocity(mechanism, start, part, near)
    closing, slip = float(near.normal @ u), float(np.linalg.norm(u - (near.normal @ u) * near.normal))
    least = 1e-9 * float(np.max(np.abs(start.v_WB_W), initial=0.0))
    told = [f"approaches at {-closing:.4g} m/s"] if closing < -least else []
    told += [f"slides at {slip:.4g} m/s"] if slip > least else []
    return f"contact {c.name} at the start: closed, {' and '.join(told) or 'no slip'}"


def _stop(s: Stop) -> str:
    limits = [f"{value:g} {sign} " for value, sign in ((s.lower, "<="),) if value is not None]
    limits += [f"{s.coordinate} of {s.joint}"]
    limits += [f" <= {s.upper:g}"] if s.upper is not None else []
    return f"stop {s.name}: {''.join(limits)}, restitution {s.restitution:g}"


def _dry_friction(d: DryFriction) -> str:
    where = f"dry friction {d.name}: {d.coordinate} of {d.joint}"
    if d.bound is not None:
        return f"{where}, bound {d.bound:g}"
    return f"{where}, coefficient {d.coefficient:g}" + ("" if d.radius is None else f", radius {d.radius:g} m")


_ELEMENTS = {
    "frictions": "friction {0.name}: {0.joint}, viscous {0.viscous:g}, Coulomb {0.coulomb:g} regularised",
    "controls": "control {0.name}: {0.coordinate} of {0.joint}, "
    "P {0.proportional:g}, I {0.integral:g}, D {0.derivative:g}",
    "drives": "drive {0.name}: {0.coordinate} of {0.joint} is a function of time",
    "couplings": "coupling {0.name}: {0.coordinate} of {0.joint} follows {0.driver_coordinate} of {0.driver_joint}",
    "rollings": "rolling {0.name}: {0.body}, radius {0.radius:g} m, rounding {0.rounding:g} m",
}
"""Line of an element in a description, by the field of a mechanism that has the elements."""


def _elements(mechanism: Mechanism) -> Iterator[str]:
    """Describe each element that is neither a spring nor a load."""
    yield from (line.format(element) for field, line in _ELEMENTS.items() for element in getattr(mechanism, field))
    yield from (_contact(contact) for contact in mechanism.contacts)
    yield from (_stop(stop) for stop in mechanism.stops)
    yield from (_dry_friction(friction) for friction in mechanism.dry_frictions)
    yield from (f"skate {s.name}: {s.body}, no motion along {_vector(s.lateral)}" for s in mechanism.skates)


def _vector(v: np.typing.ArrayLike) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in np.asarray(v)) + ")"


def _joint(mechanism: Mechanism, state: State, joint: Joint) -> str:
    values = joint_coordinates(joint, relative_motion(mechanism, state, joint))
    # remove rounding errors of the assembly; + 0.0 turns a negative zero into zero
    rounded = {name: np.round(v, 12) + 0.0 for name, v in values.items()}
    at = ", ".join(f"{name} {_vector(v) if np.ndim(v) else f'{v:.6g}'}" for name, v in rounded.items())
    kind = f"{joint.kind} of {joint.pitch:g} m a turn" if joint.pitch else joint.kind
    return f"joint {joint.name}: {kind}, {joint.predecessor} -> {joint.successor}" + (f"; {at}" if at else "")
