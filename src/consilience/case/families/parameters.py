"""Names of members of families, such as ``windows:count=3``; types and ranges come from signatures."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from consilience.case.file.values import TomlTable
from consilience.errors import InvalidInput, nearest

Family = Callable[..., TomlTable]


@dataclass(frozen=True)
class Range:
    """Least and largest value of a parameter, with its unit."""

    least: float
    most: float
    unit: str = ""

    def text(self) -> str:
        """Return the range with its unit, for messages and tables."""
        return f"{self.least:g} to {self.most:g}{' ' + self.unit if self.unit else ''}"


@dataclass(frozen=True)
class Parameter:
    """A parameter of a family.

    Attributes
    ----------
    kind : type
        int, float, bool or str.
    allowed : Range or tuple of str
        Range of a number, or the allowed words.
    """

    name: str
    kind: type
    default: Any
    allowed: Range | tuple[str, ...]

    def allowed_text(self) -> str:
        """Return the range or words, for messages and tables."""
        return self.allowed.text() if isinstance(self.allowed, Range) else " or ".join(self.allowed)

    def read(self, text: str, where: str) -> Any:
        """Return the value of a text; `where` is its place for messages.

        Raises
        ------
        InvalidInput
            The text is no value of this parameter.
        """
        remedy = f"Give {self.name} as {self.allowed_text()}."
        if isinstance(self.allowed, tuple):
            if text not in self.allowed:
                raise InvalidInput(where, f"'{text}' is not one of its values", remedy)
            return text == "true" if self.kind is bool else text
        try:
            value = self.kind(text)
        except ValueError:
            raise InvalidInput(
                where, f"'{text}' is not {'an integer' if self.kind is int else 'a number'}", remedy
            ) from None
        if not (np.isfinite(value) and self.allowed.least <= value <= self.allowed.most):
            raise InvalidInput(where, f"{text} is out of range", remedy)
        return value


def parameters(family: Family) -> dict[str, Parameter]:
    """Return the parameters of a family by name, in the order of the signature."""
    hints = get_type_hints(family, include_extras=True)
    found = {}
    for name, parameter in inspect.signature(family).parameters.items():
        hint = hints[name]
        if hint is bool:
            found[name] = Parameter(name, bool, parameter.default, ("true", "false"))
        elif get_origin(hint) is Literal:
            found[name] = Parameter(name, str, parameter.default, get_args(hint))
        else:
            kind, allowed = get_args(hint)
            found[name] = Parameter(name, kind, parameter.default, allowed)
    return found


def read_name(name: str, families: Mapping[str, Family]) -> tuple[str, dict[str, Any]]:
    """Return family and given parameters of a name.

    Raises
    ------
    InvalidInput
        Unknown family or parameter, a parameter given twice, a value out of its range or of the wrong type.
    """
    family, _, text = name.partition(":")
    if family not in families:
        raise InvalidInput(f"case '{name}'", f"there is no family '{family}'", nearest(family, families, "Families"))
    known, given = parameters(families[family]), {}
    for part in text.split(",") if text.strip() else []:
        key, equals, value = (piece.strip() for piece in part.partition("="))
        where = f"case '{name}': {key or 'parameter'}"
        if not equals or not value:
            raise InvalidInput(
                where, f"'{part}' gives no value", f"Write {family}:{shown_parameters(families[family])}."
            )
        if key not in known:
            raise InvalidInput(where, f"the family {family} has no such parameter", nearest(key, known, "It has"))
        if key in given:
            raise InvalidInput(where, "it is given twice", "Give it once.")
        given[key] = known[key].read(value, where)
    return family, given


def shown_parameters(family: Family) -> str:
    """Return all parameters with their defaults, as in a name."""
    return ",".join(f"{p.name}={shown(p.default)}" for p in parameters(family).values())


def shown(value: Any) -> str:
    """Return a value as in a name, which reads as the same value."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value
    short = f"{value:.15g}"
    return short if float(short) == value else repr(value)
