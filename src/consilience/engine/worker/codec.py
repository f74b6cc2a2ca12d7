"""Conversion of values of the package to JSON and arrays, and back, by a closed table of types.

A class is ``{"@": "Method", field: value, ...}``; a tuple, a dict and an array are ``{"@": "tuple", "items": [...]}``,
``{"@": "dict", "items": [[key, value], ...]}`` and ``{"@": "array", "n": index}``; everything else is plain JSON with
the numbers ``NaN`` and ``Infinity``. No message can name another type. Objects are built without the checks of their
constructors, which normalise: the mechanism in the worker must equal the runner's to the last bit. The fields by which
an engine describes itself must have the declared types; `consilience.engine.defects` checks the arrays of answers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from operator import itemgetter
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from consilience.engine.answers import STANDARD, EngineInfo, Manifest, Method, Profile, Route, Unsupported
from consilience.engine.questions import ANSWERS, Question
from consilience.engine.worker.requests import AnswerSet, MethodAnswer, Plan
from consilience.engine.worker.wire import MessageHeader, ProtocolError
from consilience.mechanism import (
    Array,
    Body,
    Frame,
    Joint,
    Mechanism,
    State,
    contact_laws,
    contacts,
    elements,
    functions,
    stops,
)

_MODEL = (
    *(Mechanism, Body, Frame, Joint, State),
    *(elements.Spring, elements.JointSpring, elements.Load, elements.Friction, elements.Control),
    *(elements.Drive, elements.Coupling, elements.Rolling, elements.Skate),
    *(contacts.SpherePlane, contacts.PointPlane, contacts.SphereSphere),
    *(contacts.DiscPlane, contacts.BoxPlane, contacts.CapsulePlane),
    *(contact_laws.Cone, contact_laws.Compliance, contact_laws.ContactLaw, contact_laws.Regularisation),
    *(stops.Stop, stops.DryFriction),
    *(functions.Function, functions.Table),
)
_DESCRIPTIONS = (EngineInfo, Manifest, Method, Unsupported, Plan, MethodAnswer, AnswerSet)
CLASSES: dict[str, type] = {cls.__name__: cls for cls in (*_MODEL, *_DESCRIPTIONS)}
"""Classes that travel, beside those of the answers (`ANSWERS`)."""

WORDS: dict[str, type[str]] = {cls.__name__: cls for cls in (Question, Route, Profile)}

DERIVED: dict[type, tuple[str, ...]] = {functions.Table: ("pieces",)}
"""Attributes that travel beside the fields of a class: the spline of a table, because a worker may have no SciPy."""

CHECKED: dict[type, tuple[str, ...]] = {
    EngineInfo: ("name", "version", "adapter", "remarks"),
    Manifest: ("exact", "approximated"),
    Method: (
        *("name", "route", "order", "substeps", "tolerances", "settings", "profile", "softness"),
        *("soft_at_rest", "contact_law", "law", "soft_law"),
    ),
    Unsupported: ("feature", "reason"),
    Plan: ("unsupported", "methods", "manifest"),
    AnswerSet: ("said", "unsupported"),
    MethodAnswer: ("question", "method", "reason"),
}
"""Fields whose values must have the declared types; of an answer all fields that have no shape in the table."""


@cache
def _names(cls: type[Any]) -> tuple[str, ...]:
    """Return the names of the attributes that travel."""
    return (*(f.name for f in fields(cls)), *DERIVED.get(cls, ()))


# ---------------------------------------------------------------- encoding


def encode(value: object) -> tuple[Any, list[Array]]:
    """Return a value as a tree for JSON, and the arrays to which the tree refers.

    Raises
    ------
    ProtocolError
        If the value holds an object that cannot be sent.
    """
    arrays: list[Array] = []
    return _written(value, arrays), arrays


def outlined(value: object) -> tuple[tuple[Any, ...] | None, list[Array]]:
    """Return a key of the tree of an answer, and its arrays: answers with equal keys have equal trees.

    The key is None for other values, and for answers with fields other than arrays and numbers. A float enters by its
    digits, because 0.0 equals -0.0, and True equals 1.
    """
    cls: type = type(value)
    outline, arrays = list[Any]([cls]), list[Array]()
    if cls not in ANSWERS.values():
        return None, arrays
    for name in _names(cls):
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
    if type(value) in ANSWERS.values():
        return _object(value, arrays)
    if isinstance(value, bool | int | float | str | np.bool_ | np.integer | np.floating):
        return _plain(value)
    if isinstance(value, np.ndarray) or hasattr(value, "__array__"):
        return _array(np.asarray(value), arrays)
    if isinstance(value, tuple | list | dict):  # a subclass travels as its base class
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
    cls: type = type(value)
    tree = {"@": cls.__name__}
    for name in _names(cls):
        tree[name] = _written(getattr(value, name), arrays)
    return tree


def _method_answer(value: MethodAnswer, arrays: list[Array]) -> Any:
    """Write one answer of a set; an answer that cannot be sent becomes a reason, and spares the others."""
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
    **dict.fromkeys(WORDS.values(), lambda value, _: {"@": type(value).__name__, "value": str(value)}),
    **dict.fromkeys(CLASSES.values(), _object),
    MethodAnswer: _method_answer,
}


# ---------------------------------------------------------------- decoding


_Reader = Callable[[Sequence[Array]], Any]
"""Function that builds a value from the arrays of a message; made once for all messages with the same tree."""


class _Constant:
    """Reader of an immutable value that holds no arrays."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __call__(self, arrays: Sequence[Array]) -> Any:
        return self.value


def value_of(header: MessageHeader, arrays: Sequence[Array], entry: str = "value") -> Any:
    """Build the value of an entry of a message; each kind of message has one such entry at most.

    Raises
    ------
    ProtocolError
        If its tree names an unknown type, or a field has not the declared type.
    """
    try:
        if header.reader is None:
            header.reader = _reader(header.entries[entry])
        return header.reader(arrays)
    except RecursionError:
        raise ProtocolError("the message is nested too deeply") from None
    except IndexError:
        raise ProtocolError(f"the message has {len(arrays)} arrays, and needs more") from None


def _reader(tree: object) -> _Reader:
    if isinstance(tree, list):
        items = [_reader(one) for one in tree]
        return lambda arrays: [read(arrays) for read in items]
    if isinstance(tree, str):
        return _Constant(_text(tree))
    if not isinstance(tree, dict):
        return _Constant(tree)
    kind = tree.get("@")
    if not isinstance(kind, str):
        raise ProtocolError("an object of the message has no type")
    cls = CLASSES.get(kind) or ANSWERS.get(kind)
    if cls is not None:
        return _instance(cls, tree)
    with _readable(kind):
        return _Constant(WORDS[kind](tree["value"])) if kind in WORDS else _READERS[kind](tree)


@contextmanager
def _readable(kind: str) -> Iterator[None]:
    """Raise errors of the block as one that names the unreadable type.

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
    names = _names(cls)
    if tree.keys() != {"@", *names}:
        wrong = ", ".join(sorted(str(name)[:40] for name in tree.keys() ^ {"@", *names}))
        raise ProtocolError(f"a {cls.__name__} of the message has too many or too few fields: {wrong}")
    readers = {name: _reader(tree[name]) for name in names}
    same = {name: read.value if isinstance(read, _Constant) else None for name, read in readers.items()}
    varying = [(name, read) for name, read in readers.items() if not isinstance(read, _Constant)]
    checked = bool(_declared(cls))

    def read(arrays: Sequence[Array]) -> object:
        """Build an object of the class, with its fields from the arrays."""
        value: Any = object.__new__(cls)
        content = value.__dict__
        content.update(same)  # all names first: the order of the fields is that of the class
        for name, part in varying:
            content[name] = part(arrays)
        if checked:
            _check(value)
        return value

    return read


def _check(value: Any) -> None:
    """Check that the description of an engine has the declared types, and that its numbers are possible.

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
    """Whether a plan has methods or refusals for every question that it must and that it does know."""
    questions = {*STANDARD, *plan.unsupported}
    return all(q in plan.unsupported and (plan.unsupported[q] or q in plan.methods) for q in questions)


def _array_reader(tree: dict[str, Any]) -> _Reader:
    n = tree["n"]
    if type(n) is not int or n < 0:
        raise ProtocolError("an array of the message has no number")
    return itemgetter(n)


def _tuple_reader(tree: dict[str, Any]) -> _Reader:
    items = [_reader(one) for one in tree["items"]]
    if all(isinstance(read, _Constant) for read in items):
        return _Constant(tuple(read(()) for read in items))
    return lambda arrays: tuple([read(arrays) for read in items])


def _dict_reader(tree: dict[str, Any]) -> _Reader:
    items = [(_reader(k), _reader(v)) for k, v in tree["items"]]

    def read(arrays: Sequence[Array]) -> dict[Any, Any]:
        """Build a dict, with its keys and values from the arrays."""
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
def _declared(cls: type) -> dict[str, Callable[[object], bool]]:
    """Return the check of each field that must have its declared type, by name."""
    if cls in ANSWERS.values():
        shaped = {name for question in Question if question.answer is cls for name in question.shapes}
        names = [name for name in _names(cls) if name not in shaped]
    else:
        names = list(CHECKED.get(cls, ()))
    hints = get_type_hints(cls) if names else {}
    return {name: _fitting(hints[name]) for name in names}


def _fitting(hint: Any) -> Callable[[object], bool]:
    """Return the check of a declared type."""
    origin, inner = get_origin(hint), [_fitting(one) for one in get_args(hint) if one is not Ellipsis]
    if origin is UnionType:
        return lambda value: any(fits(value) for fits in inner)
    if origin is tuple:
        return lambda value: isinstance(value, tuple) and all(inner[0](one) for one in value)
    if origin is dict:
        return lambda value: isinstance(value, dict) and all(inner[0](k) and inner[1](v) for k, v in value.items())
    if hint in (int, float):  # a truth value is no number, an integer is a float
        return lambda value: isinstance(value, int | hint) and not isinstance(value, bool)
    return lambda value: hint is Any or isinstance(value, hint)


def _shown(value: object) -> str:
    text = repr(value)[:80]
    return f"{text}, a {type(value).__name__}: not what it declares"
