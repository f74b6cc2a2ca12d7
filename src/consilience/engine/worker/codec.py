"""Values of the package as JSON and arrays, and back: a closed table of types, so that no message can name another.

A class is ``{"@": "Method", field: value, ...}``; a tuple, a dict and an array are ``{"@": "tuple", "items": [...]}``,
``{"@": "dict", "items": [[key, value], ...]}`` and ``{"@": "array", "n": index}``; everything else is as JSON has it,
with the numbers ``NaN`` and ``Infinity``. A class is built without its own checks: they normalise, and the mechanism
that a worker sees must be the runner's to the last bit. What an engine says about itself is checked against the types
its fields declare; the arrays of its answers are looked at by `consilience.engine.answers.defects`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from enum import Enum
from functools import cache
from operator import itemgetter
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from consilience.engine.answers import (
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Profile,
    Question,
    Route,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.engine.worker.requests import AnswerSet, MethodAnswer, Plan
from consilience.engine.worker.wire import Form, ProtocolError
from consilience.mechanism import Array, Body, Frame, Joint, Mechanism, State, contacts, elements, functions

_MODEL = (
    *(Mechanism, Body, Frame, Joint, State),
    *(elements.Spring, elements.JointSpring, elements.Load, elements.Friction, elements.Control),
    *(elements.Drive, elements.Coupling, elements.Rolling, elements.Skate),
    *(contacts.SpherePlane, contacts.PointPlane, contacts.SphereSphere),
    *(functions.Function, functions.Table),
)
_ANSWERS = (
    ModelAnswer,
    InstantAnswer,
    TrajectoryAnswer,
    EngineInfo,
    Manifest,
    Method,
    Unsupported,
    Plan,
    MethodAnswer,
    AnswerSet,
)
CLASSES: dict[str, type] = {cls.__name__: cls for cls in (*_MODEL, *_ANSWERS)}
ENUMS: dict[str, type[Enum]] = {cls.__name__: cls for cls in (Question, Route, Profile)}

DERIVED: dict[type, tuple[str, ...]] = {functions.Table: ("pieces",)}
"""What travels with a class beside its fields: the spline of a table, because a worker may have no SciPy."""

CHECKED: dict[type, tuple[str, ...]] = {
    EngineInfo: ("name", "version", "adapter", "remarks"),
    Manifest: ("exact", "approximated"),
    Method: ("name", "route", "order", "substeps", "tolerances", "settings", "profile", "softness"),
    Unsupported: ("feature", "reason"),
    Plan: ("unsupported", "methods", "manifest"),
    AnswerSet: ("said", "unsupported"),
    MethodAnswer: ("question", "method", "reason"),
    TrajectoryAnswer: ("counters",),
}
"""Fields whose values must have the declared types before anybody uses them."""


_NAMES: dict[type, tuple[str, ...]] = {
    cls: (*(f.name for f in fields(cls)), *DERIVED.get(cls, ())) for cls in CLASSES.values()
}

# ---------------------------------------------------------------- out


def encode(value: object) -> tuple[Any, list[Array]]:
    """Tree for JSON, and the arrays it refers to.

    Raises
    ------
    ProtocolError
        If there is something in it that cannot be sent.
    """
    arrays: list[Array] = []
    return _written(value, arrays), arrays


_FLAT = (ModelAnswer, InstantAnswer)
"""Classes that usually hold arrays and numbers and nothing deeper."""


def outlined(value: object) -> tuple[tuple[Any, ...] | None, list[Array]]:
    """Outline of a flat answer, and its arrays: answers of equal outlines have equal trees, which need be written once.

    None of any other value. A float is outlined by its digits: 0.0 equals -0.0, and True equals 1.
    """
    cls: type[Any] = type(value)
    outline, arrays = list[Any]([cls]), list[Array]()
    if cls not in _FLAT:
        return None, arrays
    for name in _NAMES[cls]:
        one = getattr(value, name)
        kind = type(one)
        if kind is np.ndarray:
            arrays.append(one)
            outline.append((one.dtype, one.shape))
        elif kind is float:
            outline.append(one.hex())
        elif kind is int or one is None:
            outline.append(one)
        else:
            return None, []
    return tuple(outline), arrays


def _written(value: object, arrays: list[Array]) -> Any:
    writer = _WRITERS.get(type(value))
    if writer is not None:
        return writer(value, arrays)
    if isinstance(value, bool | int | float | str | np.bool_ | np.integer | np.floating):
        return _plain(value)
    if isinstance(value, np.ndarray) or hasattr(value, "__array__"):
        return _array(np.asarray(value), arrays)
    if isinstance(value, tuple | list | dict):  # a subclass travels as what it is
        return _WRITERS[next(kind for kind in (tuple, list, dict) if isinstance(value, kind))](value, arrays)
    raise ProtocolError(f"the answer cannot be sent: it holds a {type(value).__name__}")


def _plain(value: Any) -> Any:
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    return value.item()


def _array(value: Array, arrays: list[Array]) -> Any:
    if value.dtype.kind not in "biufcUS" or value.dtype.hasobject:
        raise ProtocolError(f"the answer cannot be sent: it holds an array of {value.dtype}")
    arrays.append(value)
    return {"@": "array", "n": len(arrays) - 1}


def _object(value: object, arrays: list[Array]) -> Any:
    cls: type[Any] = type(value)
    tree = {"@": cls.__name__}
    for name in _NAMES[cls]:
        tree[name] = _written(getattr(value, name), arrays)
    return tree


def _said(value: MethodAnswer, arrays: list[Array]) -> Any:
    """One answer among many: what cannot be sent fails alone."""
    kept = len(arrays)
    try:
        return _object(value, arrays)
    except (ProtocolError, RecursionError) as error:
        del arrays[kept:]
        return _object(MethodAnswer(value.question, value.method, None, str(error)), arrays)


_WRITERS: dict[type, Callable[[Any, list[Array]], Any]] = {
    **dict.fromkeys((NoneType, bool, int, float, str), lambda value, _: value),
    np.ndarray: _array,
    list: lambda value, arrays: [_written(v, arrays) for v in value],
    tuple: lambda value, arrays: {"@": "tuple", "items": [_written(v, arrays) for v in value]},
    dict: lambda value, arrays: {
        "@": "dict",
        "items": [[_written(k, arrays), _written(v, arrays)] for k, v in value.items()],
    },
    **dict.fromkeys(ENUMS.values(), lambda value, _: {"@": type(value).__name__, "value": value.value}),
    **dict.fromkeys(CLASSES.values(), _object),
    MethodAnswer: _said,
}


# ---------------------------------------------------------------- in


_Reader = Callable[[Sequence[Array]], Any]
"""Makes a value of the arrays of a frame. It is made of a tree once, for all frames with that tree."""


class _Same:
    """A reader of what does not depend on arrays and cannot be changed."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __call__(self, arrays: Sequence[Array]) -> Any:
        return self.value


def value_of(form: Form, arrays: Sequence[Array]) -> Any:
    """Value of a frame that has one.

    Raises
    ------
    ProtocolError
        If its tree names anything unknown, or a field has not the declared type.
    """
    try:
        if form.reader is None:
            form.reader = _reader(form.told["value"])
        return form.reader(arrays)
    except RecursionError:
        raise ProtocolError("the message is nested too deeply") from None
    except IndexError:
        raise ProtocolError(f"the message has {len(arrays)} arrays, and needs more") from None


def _reader(tree: object) -> _Reader:
    if isinstance(tree, list):
        items = [_reader(one) for one in tree]
        return lambda arrays: [read(arrays) for read in items]
    if isinstance(tree, str):
        return _Same(_text(tree))
    if not isinstance(tree, dict):
        return _Same(tree)
    kind = tree.get("@")
    if not isinstance(kind, str):
        raise ProtocolError("an object of the message has no type")
    if kind in CLASSES:
        return _instance(CLASSES[kind], tree)
    with _readable(kind):
        return _Same(ENUMS[kind](tree["value"])) if kind in ENUMS else _READERS[kind](tree)


@contextmanager
def _readable(kind: str) -> Iterator[None]:
    """Say what cannot be read.

    Raises
    ------
    ProtocolError
    """
    try:
        yield
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        raise ProtocolError(f"a {kind[:40]} of the message cannot be read: {type(error).__name__}: {error}") from None


def _text(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ProtocolError("a text of the message is no Unicode") from None
    return text


def _instance(cls: type, tree: dict[str, Any]) -> _Reader:
    names = _NAMES[cls]
    if tree.keys() != {"@", *names}:
        wrong = ", ".join(sorted(str(name)[:40] for name in tree.keys() ^ {"@", *names}))
        raise ProtocolError(f"a {cls.__name__} of the message has too many or too few fields: {wrong}")
    readers = {name: _reader(tree[name]) for name in names}
    same = {name: read.value if isinstance(read, _Same) else None for name, read in readers.items()}
    varying = [(name, read) for name, read in readers.items() if not isinstance(read, _Same)]
    checked = cls in CHECKED

    def read(arrays: Sequence[Array]) -> object:
        """A new object of the class, with its fields out of the arrays."""
        value: Any = object.__new__(cls)
        content = value.__dict__
        content.update(same)  # first, all of them: the order of the fields is that of the class
        for name, part in varying:
            content[name] = part(arrays)
        if checked:
            _check(value)
        return value

    return read


def _check(value: Any) -> None:
    """See that what an engine says about itself has the declared types.

    Raises
    ------
    ProtocolError
    """
    cls: type = type(value)
    for name, fits in _declared(cls).items():
        if not fits(value.__dict__[name]):
            raise ProtocolError(f"{cls.__name__}.{name} is {_shown(value.__dict__[name])}")
    if isinstance(value, Method) and not all(0.0 < x < np.inf for x in (*value.substeps, *value.tolerances)):
        raise ProtocolError(f"Method.substeps and tolerances are not positive: {value.substeps}, {value.tolerances}")
    if isinstance(value, Plan) and not _complete(value):
        raise ProtocolError("a Plan says of a question neither methods nor what is unsupported")


def _complete(plan: Plan) -> bool:
    """Whether a plan says something of every question."""
    return all(q in plan.unsupported and (plan.unsupported[q] or q in plan.methods) for q in Question)


def _array_reader(tree: dict[str, Any]) -> _Reader:
    n = tree["n"]
    if type(n) is not int or n < 0:
        raise ProtocolError("an array of the message has no number")
    return itemgetter(n)


def _tuple_reader(tree: dict[str, Any]) -> _Reader:
    items = [_reader(one) for one in tree["items"]]
    if all(isinstance(read, _Same) for read in items):
        return _Same(tuple(read(()) for read in items))
    return lambda arrays: tuple([read(arrays) for read in items])


def _dict_reader(tree: dict[str, Any]) -> _Reader:
    items = [(_reader(k), _reader(v)) for k, v in tree["items"]]

    def read(arrays: Sequence[Array]) -> dict[Any, Any]:
        """A new dict, with its keys and values out of the arrays."""
        with _readable("dict"):
            return {key(arrays): value(arrays) for key, value in items}

    return read


_READERS: dict[str, Callable[[dict[str, Any]], _Reader]] = {
    "array": _array_reader,
    "tuple": _tuple_reader,
    "dict": _dict_reader,
}


# ---------------------------------------------------------------- declared types


@cache
def _declared(cls: type[Any]) -> dict[str, Callable[[object], bool]]:
    """By the name of a field that is checked: whether a value has its type."""
    hints = get_type_hints(cls)
    return {name: _fitting(hints[name]) for name in CHECKED.get(cls, ())}


def _fitting(hint: Any) -> Callable[[object], bool]:
    """Make the check of a declared type."""
    origin, inner = get_origin(hint), [_fitting(one) for one in get_args(hint) if one is not Ellipsis]
    if origin is UnionType:
        return lambda value: any(fits(value) for fits in inner)
    if origin is tuple:
        return lambda value: isinstance(value, tuple) and all(inner[0](one) for one in value)
    if origin is dict:
        return lambda value: isinstance(value, dict) and all(inner[0](k) and inner[1](v) for k, v in value.items())
    if hint in (int, float):  # a truth value is no number, and a whole number is one
        return lambda value: isinstance(value, int | hint) and not isinstance(value, bool)
    return lambda value: hint is Any or isinstance(value, hint)


def _shown(value: object) -> str:
    text = repr(value)[:80]
    return f"{text}, a {type(value).__name__}: not what it declares"
