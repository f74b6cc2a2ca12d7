"""Parameters of a mechanism or case by path: list, read, change.

A path is the kind and name of an element, a field, and an index if the field is an array:

    body.rod.mass    body.rod.com[0]    body.rod.inertia[0,1]    joint.pin.F.p[2]    joint.pin.F.turn[0]
    spring.s.stiffness    joint_spring.k.rest    load.push.vector[1]    gravity[2]    rolling.wheel.radius
    drive.crank.motion.polynomial[1]    coupling.cam.law.table.y[3]    control.c.target.harmonics[0,1]
    initial.coordinates.shoulder.angle    initial.rates.elbow.angle          (of a case)

``turn[k]`` of a frame or an orientation is the angle, rad, of an additional rotation about its own axis k; its value is
zero. ``turn[k]`` of a direction (axis and normal of a rolling body, lateral of a skate) is about axis k of the
direction's frame. A product of inertia is one parameter for both entries; so are the ends of a periodic table.

``joint.pin.place[k]`` moves both frames of a joint: it is a coordinate of the origin of F in the drawing, world axes.
The kind may be left out where one element alone has the name and the field: ``rod.mass``, ``pin.place[2]``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from consilience.case import Case
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Array,
    Frame,
    Mechanism,
    Table,
    elementary_rotation,
    quaternion_from_rotation_vector,
    quaternion_product,
)

T = TypeVar("T", bound=Mechanism | Case)

_SINGULAR = {"bodies": "body"}
_DIRECTIONS = (".axis", ".normal", ".lateral")
_ONLY_OF = {"length": "rod", "pitch": "screw", "offset": "pyramid", "facets": "none"}
"""Fields of one kind of joint or cone alone; a count is no parameter."""

PathStep = tuple[str, Any]
"""Step from an object to a part: ("field", name), ("key", key), ("item", index), ("entry", indices) of an array,
("mirrored", indices) of a symmetric matrix, ("ends", None) of a periodic table, ("turn", axis); of a mechanism
("place", (joint, axis))."""


def parameter_paths(subject: Mechanism | Case) -> tuple[str, ...]:
    """Return the paths of all parameters in the order of the elements."""
    return tuple(_parameters(subject))


def parameter(subject: Mechanism | Case, path: str) -> float:
    """Return the value of a parameter, SI units.

    Raises
    ------
    InvalidInput
        Unknown path; the message lists known ones.
    """
    return float(_part(subject, _steps(subject, path)))


def with_parameter(subject: T, path: str, value: float) -> T:
    """Return the mechanism or case with another value of one parameter.

    Parameters
    ----------
    subject : Mechanism or Case
        Unchanged.
    path : str
        See the module.
    value : float
        In SI units.

    Raises
    ------
    InvalidInput
        Unknown path (the message lists known ones), or an impossible value.
    """
    return change_of(subject, path)(subject, value)


def change_of(subject: T, path: str) -> Callable[[T, float], T]:
    """Return the function that gives a parameter another value, as `with_parameter`, in this subject or one like it.

    Raises
    ------
    InvalidInput
        Unknown path.
    """
    steps = _steps(subject, path)

    def change(given: T, value: float) -> T:
        changed: T = _changed(given, steps, float(value))
        return changed

    return change


def array_around(subject: Mechanism | Case, path: str) -> Array:
    """Return the array that contains a parameter, or the parameter as an array of one number."""
    steps = _steps(subject, path)
    whole = steps[:-1] if steps[-1][0] in ("entry", "mirrored", "ends") else steps
    return np.atleast_1d(np.asarray(_part(subject, whole), dtype=float))


def _parameters(subject: Mechanism | Case, places: bool = False) -> dict[str, tuple[PathStep, ...]]:
    """Return all parameters by path, with those of the places of joints, or without them."""
    mechanism = subject if isinstance(subject, Mechanism) else subject.mechanism
    own = _inventory(mechanism) | (dict(_places(mechanism)) if places else {})
    if isinstance(subject, Mechanism):
        return own
    found = {path: (("field", "mechanism"), *steps) for path, steps in own.items()}
    return found | dict(_inside(subject.initial, "initial", (("field", "initial"),)))


@lru_cache(maxsize=4)
def _inventory(mechanism: Mechanism) -> dict[str, tuple[PathStep, ...]]:
    """Return all parameters of a mechanism, cached by its identity."""
    return dict(_of_mechanism(mechanism))


def _of_mechanism(mechanism: Mechanism) -> Iterator[tuple[str, tuple[PathStep, ...]]]:
    for field in fields(mechanism):
        value = getattr(mechanism, field.name)
        here = (("field", field.name),)
        if isinstance(value, tuple):
            kind = _SINGULAR.get(field.name, field.name.removesuffix("s"))
            for n, element in enumerate(value):
                yield from _inside(element, f"{kind}.{element.name}", (*here, ("item", n)))
        else:
            yield from _inside(value, field.name, here)


def _places(mechanism: Mechanism) -> Iterator[tuple[str, tuple[PathStep, ...]]]:
    for n, joint in enumerate(mechanism.joints):
        for axis in range(3):
            yield f"joint.{joint.name}.place[{axis}]", (("place", (n, axis)),)


def _inside(value: Any, path: str, steps: tuple[PathStep, ...]) -> Iterator[tuple[str, tuple[PathStep, ...]]]:
    """Yield paths and steps of all numbers in a value: number, array, or compound."""
    if isinstance(value, Frame):
        yield from _inside(value.p, f"{path}.p", (*steps, ("field", "p")))
        yield from _turns(path, (*steps, ("field", "R")))
    elif (path.endswith(".orientation") and np.shape(value) in ((4,), (3, 3))) or path.endswith(_DIRECTIONS):
        yield from _turns(path, steps)
    elif isinstance(value, Table) and value.periodic:
        yield from _inside(value.x, f"{path}.x", (*steps, ("field", "x")))
        inner = _inside(value.y[:-1], f"{path}.y", (*steps, ("field", "y")))
        yield f"{path}.y[0]", (*next(inner)[1][:-1], ("ends", None))
        yield from inner
    elif _is_numeric(value):
        symmetric = path.endswith(".inertia")
        for index in np.ndindex(np.shape(value)):
            label = f"[{','.join(map(str, index))}]" if index else ""
            if not symmetric or index[0] <= index[1]:
                yield path + label, (*steps, ("mirrored" if symmetric else "entry", index)) if index else steps
    else:
        for label, step, part in _children(value):
            yield from _inside(part, path + label, (*steps, step))


def _children(value: Any) -> list[tuple[str, PathStep, Any]]:
    """Return the parts of a compound value: label in the path, step, part."""
    if is_dataclass(value):
        kind = getattr(value, "kind", None)
        names = [f.name for f in fields(value) if _ONLY_OF.get(f.name, kind) == kind]
        return [(f".{name}", ("field", name), getattr(value, name)) for name in names]
    if isinstance(value, Mapping):
        return [(f".{key}", ("key", key), value[key]) for key in value]
    if isinstance(value, (tuple, list)):
        return [(f"[{n}]", ("item", n), item) for n, item in enumerate(value)]
    return []


def _turns(path: str, steps: tuple[PathStep, ...]) -> Iterator[tuple[str, tuple[PathStep, ...]]]:
    for axis in range(3):
        yield f"{path}.turn[{axis}]", (*steps, ("turn", axis))


def _is_numeric(value: Any) -> bool:
    if isinstance(value, (bool, str)) or value is None:
        return False
    if isinstance(value, (tuple, list)):
        return len(value) > 0 and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value)
    return isinstance(value, (int, float, np.number)) or (isinstance(value, np.ndarray) and value.dtype.kind in "fi")


def _steps(subject: Mechanism | Case, path: str) -> tuple[PathStep, ...]:
    known = _parameters(subject, places=True)
    wanted = path.replace(" ", "").replace("][", ",")
    head, bracket, tail = wanted.rpartition("[")
    swapped = f"{head}[{','.join(reversed(tail[:-1].split(',')))}]" if bracket else wanted
    for candidate in (path, wanted, swapped):
        if candidate in known:
            return known[candidate]
    short = [p for p in known if p.partition(".")[2] in (path, wanted, swapped)]
    if len(short) == 1:
        return known[short[0]]
    if short:
        raise InvalidInput(f"parameter '{path}'", "several parts have it", f"Say which: {', '.join(short)}.")
    found = get_close_matches(wanted, [*known, *(p.partition(".")[2] for p in known)], n=3, cutoff=0.75)
    nearest = f"Nearest: {', '.join(found)}. " if found else ""
    start = path
    while start and not any(p.startswith(start) for p in known):
        start = start[:-1]
    start = start[: start.rfind(".") + 1]
    if start:
        near = [p for p in known if p.startswith(start)]
    else:
        near = sorted({p.split(".")[0].split("[")[0] for p in known})
    listed = ", ".join(near[:24]) + (", ..." if len(near) > 24 else "")
    raise InvalidInput(f"parameter '{path}'", "there is none of that name", f"{nearest}There are: {listed}.")


def _part(value: Any, steps: tuple[PathStep, ...]) -> Any:
    for kind, which in steps:
        value = _READ[kind](value, which)
    return value


_READ: dict[str, Callable[[Any, Any], Any]] = {
    "field": getattr,
    "key": lambda value, key: value[key],
    "item": lambda value, n: value[n],
    "entry": lambda value, index: np.asarray(value)[index],
    "mirrored": lambda value, index: np.asarray(value)[index],
    "ends": lambda value, _: value[0],
    "turn": lambda value, axis: 0.0,
    "place": lambda mechanism, which: _place(mechanism, which[0])[which[1]],
}


def _changed(value: Any, steps: tuple[PathStep, ...], new: float) -> Any:
    if not steps:
        return new
    (kind, which), rest = steps[0], steps[1:]
    inner = (
        new
        if kind in ("entry", "mirrored", "ends", "turn", "place")
        else _changed(_READ[kind](value, which), rest, new)
    )
    return _WRITE[kind](value, which, inner)


def _place(mechanism: Mechanism, joint: int) -> Array:
    """Return the origin of F of a joint in the drawing, world axes, m."""
    own = mechanism.joints[joint]
    body = _drawn(mechanism, own.predecessor)
    place: Array = body.p + body.R @ own.F.p
    return place


def _drawn(mechanism: Mechanism, name: str) -> Frame:
    return Frame(np.zeros(3), np.eye(3)) if name == GROUND else mechanism.bodies[mechanism.body_index[name]].drawing


def _moved(mechanism: Mechanism, which: tuple[int, int], new: float) -> Mechanism:
    """Move both frames of a joint so that a coordinate of the origin of F in the drawing has a new value."""
    n, axis = which
    joint, step = mechanism.joints[n], np.zeros(3)
    step[axis] = new - _place(mechanism, n)[axis]
    ends = ((joint.predecessor, joint.F), (joint.successor, joint.M))
    F, M = (Frame(end.p + _drawn(mechanism, body).R.T @ step, end.R) for body, end in ends)
    joints = (*mechanism.joints[:n], replace(joint, F=F, M=M), *mechanism.joints[n + 1 :])
    return replace(mechanism, joints=joints)


def _with_entries(value: Any, indices: tuple[Any, ...], new: float) -> Array:
    changed = np.array(value, dtype=float)
    for index in indices:
        changed[index] = new
    return changed


def _turned(value: Any, axis: int, angle: float) -> Array:
    if np.shape(value) == (4,):
        return quaternion_product(value, quaternion_from_rotation_vector(angle * np.eye(3)[axis]))
    turn = elementary_rotation(axis, angle)
    turned: Array = turn @ value if np.shape(value) == (3,) else np.asarray(value) @ turn
    return turned


_WRITE: dict[str, Callable[[Any, Any, Any], Any]] = {
    "field": lambda value, name, new: replace(value, **{name: new}),
    "key": lambda value, key, new: {**value, key: new},
    "item": lambda value, n, new: (*value[:n], new, *value[n + 1 :]),
    "entry": lambda value, index, new: _with_entries(value, (index,), new),
    "mirrored": lambda value, index, new: _with_entries(value, (index, index[::-1]), new),
    "ends": lambda value, _, new: _with_entries(value, (0, -1), new),
    "turn": _turned,
    "place": _moved,
}
