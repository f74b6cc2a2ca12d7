"""Reductions of a case: removal of parts, and simplification of parts by choices from 0 (simplest) to `AS_IS`.

Reductions change the tables of a case file. The file draws the mechanism: a joint is a place and a direction in the
world, so that a reduced mechanism is still assembled. A reduced case that is no mechanism (a body without a joint, a
rod of length zero) is refused by the reader of case files.

When a body is removed, its joints and elements move to its parent in the spanning tree; joints and elements that then
connect a body to itself, or act on the ground alone, are removed, too.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.case.file.values import TomlTable
from consilience.mechanism import AXIS_COORDINATES, GROUND, Mechanism, spanning_tree

_SMOOTH = ("spring", "joint_spring", "force", "torque", "friction", "control", "drive", "coupling", "rolling", "skate")
ELEMENTS = (*_SMOOTH, "contact", "stop", "dry_friction")
_SIDES = ("predecessor", "successor")
_JOINTS = (("joint", "coordinate"), ("driver_joint", "driver_coordinate"))
_FRAMELESS = ("spherical", "free", "rigid")
_SIMPLE_KINDS = ("revolute", "prismatic", "spherical")
_NUMBERS = ("stiffness", "damping", "free_length", "rest", "viscous", "coulomb", "speed", "proportional", "integral")
_LAWS = ("cone", "compliance", "torsional", "rolling")
_FUNCTIONS = ("actuator", "history", "target", "motion", "law")

AS_IS = 3
"""Choice that leaves a part unchanged."""


# ---------------------------------------------------------------- smaller


@dataclass(frozen=True)
class Part:
    """A removable part of a case: the list of its table, and its name."""

    group: str
    name: str


def parts(table: TomlTable, mechanism: Mechanism) -> list[Part]:
    """List the removable parts: elements, joints that close loops, then bodies in depth-first order of the tree."""
    found = [Part(group, entry["name"]) for group in ELEMENTS for entry in table.get(group, [])]
    tree, closing = spanning_tree(mechanism)
    found += [Part("joint", mechanism.joints[k].name) for k in closing]
    return found + [Part("body", _child(mechanism, k, backward)) for k, backward in tree]


def _child(mechanism: Mechanism, joint: int, backward: bool) -> str:
    return getattr(mechanism.joints[joint], _SIDES[not backward])


def without(table: TomlTable, mechanism: Mechanism, gone: Sequence[Part]) -> TomlTable:
    """Return a copy of the table without the given parts."""
    new = copy.deepcopy(table)
    for part in gone:
        new[part.group] = [entry for entry in new[part.group] if entry["name"] != part.name]
    bodies = {part.name for part in gone if part.group == "body"}
    heir = {
        _child(mechanism, k, backward): getattr(mechanism.joints[k], _SIDES[backward])
        for k, backward in spanning_tree(mechanism)[0]
    }
    for group in ("joint", *ELEMENTS):
        for entry in new.get(group, []):
            for field in ("predecessor", "successor", "body", "partner"):
                while entry.get(field) in bodies:
                    entry[field] = heir[entry[field]]
    new["joint"] = [entry for entry in new["joint"] if entry["predecessor"] != entry["successor"]]
    guesses = new.get("initial", {}).get("bodies", {})
    for name in bodies & set(guesses):
        del guesses[name]
    return tidy(new)


def tidy(table: TomlTable) -> TomlTable:
    """Remove elements without a joint or body to act on, in place."""
    kinds = {joint["name"]: joint["kind"] for joint in table["joint"]}

    def stands(entry: Mapping[str, Any]) -> bool:
        coordinates = [(entry[j], entry[c]) for j, c in _JOINTS if j in entry]
        known = all(c in AXIS_COORDINATES.get(kinds.get(j, ""), ()) for j, c in coordinates)
        loose = any(a in entry and entry[a] == entry[b] for a, b in (_SIDES, ("partner", "body")))
        return known and entry.get("body") != GROUND and not loose

    for group in ELEMENTS:
        if group in table:
            table[group] = [entry for entry in table[group] if stands(entry)]
            if not table[group]:
                del table[group]
    return table


def without_rest(table: TomlTable) -> TomlTable:
    """Remove initial velocities of zero, in place: zero is the default."""
    guesses = table.get("initial", {}).get("bodies", {})
    for name in [name for name, guess in guesses.items() if not any(any(v) for v in guess.values())]:
        del guesses[name]
    return table


# ---------------------------------------------------------------- simpler

Knob = Callable[[TomlTable, int], None]
"""Function that simplifies a table in place by a choice from 0 (simplest) to `AS_IS` - 1."""


def simplified(table: TomlTable, choices: Sequence[int]) -> TomlTable:
    """Return a copy of the table, simplified by one choice for each of its `knobs`."""
    new = copy.deepcopy(table)
    for knob, choice in zip(knobs(table), choices, strict=True):
        if choice < AS_IS:
            knob(new, choice)
    return tidy(new)


def knobs(table: TomlTable) -> list[Knob]:
    """List the simplifications of a table, the most telling first."""
    found: list[Knob] = [_states]
    joints, bodies = range(len(table["joint"])), range(len(table["body"]))
    found += [_entry("joint", n, change) for change in (_kind, _sides, _axes, _places) for n in joints]
    found += [_gravity]
    names = [b["name"] for b in table["body"]]
    found += [_guess(name) for name in names if name in table.get("initial", {}).get("bodies", {})]
    found += [_entry("body", n, change) for change in (_axes_of_body, _inertia, _com, _mass, _places) for n in bodies]
    simplify = {"contact": _surface}
    found += [
        _entry(group, n, simplify.get(group, _element)) for group in ELEMENTS for n in range(len(table.get(group, [])))
    ]
    return found


def _entry(group: str, number: int, change: Callable[[TomlTable, int], None]) -> Knob:
    def knob(table: TomlTable, choice: int) -> None:
        change(table[group][number], choice)

    return knob


def _number(x: float, choice: int) -> float:
    """Round a number: to one (or zero), to one digit, to two digits."""
    if choice == 0:
        return 1.0 if x else 0.0
    return float(f"{x:.{choice - 1}e}")


def _higher(given: Sequence[float], choice: int) -> float | list[float]:
    """Simplify coefficients of several degrees: to the first alone, or each by `_number`."""
    return _number(given[0], choice) if choice == 0 else [_number(x, choice) for x in given]


def _vector(v: Sequence[float], choice: int) -> list[float]:
    """Round a vector: to zero, to integers, to one decimal."""
    return [0.0 if choice == 0 else round(x, choice - 1) + 0.0 for x in v]


def _nearest_axis(v: Sequence[float], taken: int = -1) -> list[float]:
    """Return the coordinate axis nearest to a direction, axis number `taken` excluded."""
    n = max((k for k in range(3) if k != taken), key=lambda k: abs(v[k]))
    return [math.copysign(1.0, v[k]) if k == n else 0.0 for k in range(3)]


def _states(table: TomlTable, choice: int) -> None:
    """Keep the initial state as the only state."""
    if choice < 2:
        table["instant"] = {**table["instant"], "states": 1}


def _kind(joint: TomlTable, choice: int) -> None:
    if joint["kind"] == "rod":
        joint.setdefault("axis", [b - a for a, b in zip(joint["at"], joint["to"], strict=True)])
        joint.setdefault("second_axis", _nearest_axis(joint["axis"][1:] + joint["axis"][:1]))
    elif joint["kind"] in _FRAMELESS:
        joint.setdefault("axis", [0.0, 0.0, 1.0])
        joint.setdefault("second_axis", [1.0, 0.0, 0.0])
    for field in ("to", "pitch"):
        joint.pop(field, None)
    joint["kind"] = _SIMPLE_KINDS[choice]


def _sides(joint: TomlTable, choice: int) -> None:
    """Make the ground the predecessor."""
    if choice == 0 and joint["successor"] == GROUND:
        joint["predecessor"], joint["successor"] = joint["successor"], joint["predecessor"]


def _axes(joint: TomlTable, choice: int) -> None:
    """Replace the axes of a joint: by those of the world, by coordinate axes, by one decimal."""
    if joint["kind"] == "rod" or "axis" not in joint:
        joint.pop("second_axis", None)
        return
    if choice == 0:
        joint["axis"], joint["second_axis"] = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
        if joint["kind"] in _FRAMELESS:
            del joint["axis"], joint["second_axis"]
    elif choice == 1:
        axis = _nearest_axis(joint["axis"])
        taken = next(k for k in range(3) if axis[k])
        joint["axis"], joint["second_axis"] = axis, _nearest_axis(joint["second_axis"], taken)
    else:
        joint["axis"], joint["second_axis"] = _vector(joint["axis"], 2), _vector(joint["second_axis"], 2)


def _places(entry: TomlTable, choice: int) -> None:
    for field in ("at", "to"):
        if field in entry:
            entry[field] = _vector(entry[field], choice)


def _gravity(table: TomlTable, choice: int) -> None:
    table["gravity"] = ([0.0, 0.0, 0.0], [0.0, 0.0, -10.0], _vector(table["gravity"], 1))[choice]


def _guess(name: str) -> Knob:
    def knob(table: TomlTable, choice: int) -> None:
        guess = table["initial"]["bodies"][name]
        table["initial"]["bodies"][name] = {field: _vector(v, choice) for field, v in guess.items()}

    return knob


def _axes_of_body(body: TomlTable, choice: int) -> None:
    if choice == 0:
        body.pop("orientation", None)


def _inertia(body: TomlTable, choice: int) -> None:
    """Simplify an inertia: to a ball, to principal axes along those of the body, to two digits."""
    I = body["inertia"]
    if choice == 0:
        body["inertia"] = {"xx": 1.0, "yy": 1.0, "zz": 1.0}
    elif choice == 1:
        body["inertia"] = {name: float(f"{I[name]:.1e}") for name in ("xx", "yy", "zz")}
    else:
        body["inertia"] = {name: float(f"{value:.1e}") for name, value in I.items()}


def _com(body: TomlTable, choice: int) -> None:
    body["com"] = _vector(body["com"], choice)


def _mass(body: TomlTable, choice: int) -> None:
    body["mass"] = _number(body["mass"], choice)


def _surface(contact: TomlTable, choice: int) -> None:
    """Simplify the law of a contact: to none, to friction alone, to a coefficient of one digit; shapes must touch."""
    contact["friction"] = 0.0 if choice == 0 else float(f"{contact['friction']:.0e}")
    if choice < 2:
        contact["restitution"] = 0.0
        for name in _LAWS:
            contact.pop(name, None)


def _element(entry: TomlTable, choice: int) -> None:
    _places(entry, choice)
    for field in _NUMBERS:
        if field in entry:
            given = entry[field]
            entry[field] = _higher(given, choice) if isinstance(given, list) else _number(given, choice)
    if "vector" in entry:
        entry["vector"] = [0.0, 0.0, 1.0] if choice == 0 else _vector(entry["vector"], choice)
    for field in _FUNCTIONS:
        if field in entry and choice == 0:
            entry[field] = {"polynomial": [0.0, 1.0]}
