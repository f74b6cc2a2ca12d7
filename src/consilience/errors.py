"""Errors that a caller can act on; bad input raises, a numerical failure of an engine is a value in a `Run`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from math import isfinite
from numbers import Real

_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)
"""Characters that control a terminal or the direction of text, halves of surrogate pairs, and noncharacters."""

LONGEST = 8_000
"""Largest number of characters of one part of a message."""


def visible(text: str) -> str:
    """Replace characters that control a terminal by escape sequences of Python."""
    return _UNSEEN.sub(lambda found: found.group().encode("unicode_escape", "surrogatepass").decode(), text)


def _part(text: str) -> str:
    shown = visible(text).replace("\n", "\\n")
    return shown if len(shown) <= LONGEST else f"{shown[:LONGEST]}..."


def nearest(name: str, known: Iterable[str], all_of_them: str) -> str:
    """Name the known names that are nearest to one that is not known, then all of them.

    Parameters
    ----------
    all_of_them : str
        Noun for all names, in the plural and with a capital, such as ``Engines``.
    """
    names, name = list(known), str(name)
    by_case = {one.casefold(): one for one in names}
    near = [by_case[one] for one in get_close_matches(name.casefold(), by_case, n=3, cutoff=0.5)]
    return (f"Nearest: {', '.join(near)}. " if near else "") + f"{all_of_them}: {', '.join(names)}."


class ConsilienceError(Exception):
    """Base of all errors of this package; the command line prints the error and exits with 2."""


class InvalidInput(ConsilienceError):
    """Case file, mechanism or argument that cannot be used.

    Parameters
    ----------
    where : str
        File, field or name, for example ``four_bar.toml: body[1].mass``.
    what : str
        What is wrong there.
    remedy : str
        What would be right.
    """

    def __init__(self, where: str, what: str, remedy: str) -> None:
        self.where, self.what, self.remedy = (_part(text) for text in (where, what, remedy))
        super().__init__(f"{self.where}: {self.what}. {self.remedy}")

    def __reduce__(self) -> tuple[type[InvalidInput], tuple[str, str, str]]:
        """Pickle all three parts: errors travel from worker processes."""
        return type(self), (self.where, self.what, self.remedy)


def require(value: object, kind: type, where: str, remedy: str) -> None:
    """Refuse a value of another type than the one that an argument or field needs.

    Raises
    ------
    InvalidInput
    """
    if not isinstance(value, kind):
        given, needed = (
            f"{'an' if name[0] in 'AEIO' else 'a'} {name}" for name in (type(value).__name__, kind.__name__)
        )
        raise InvalidInput(where, f"it is {given}, not {needed}", remedy)


def in_range(where: str, value: object, least: float, most: float, remedy: str, open_below: bool = False) -> None:
    """Refuse what is no number of ``least <= value <= most`` (``least < value`` if open below), and infinity.

    Parameters
    ----------
    where, remedy : str
        What the value is, and what would be right, for the message.
    value : object
    least, most : float
    open_below : bool

    Raises
    ------
    InvalidInput
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InvalidInput(where, f"{value!r} is no number", remedy)
    number = float(value)
    if not (least < number if open_below else least <= number) or not (number <= most and isfinite(number)):
        raise InvalidInput(where, f"{number:g} is out of range", remedy)


class CannotAssemble(InvalidInput):
    """No configuration satisfies the joints of a mechanism, or none was found from the drawing."""


class NumericalFailure(ConsilienceError):
    """Computation that cannot go on; the message says when and why."""
