"""Errors a caller can act on: bad input is an exception, a numerical failure is a value in a `Run`."""

from __future__ import annotations

import re

_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)
"""Characters that steer a terminal or turn the direction of text, halves of surrogate pairs, no characters."""

LONGEST = 8_000
"""Characters of one part of a message at most."""


def visible(text: str) -> str:
    """Text that a terminal shows as it is: what would steer it is written out as an escape sequence of Python's."""
    return _UNSEEN.sub(lambda found: found.group().encode("unicode_escape", "surrogatepass").decode(), text)


def _part(text: str) -> str:
    shown = visible(text).replace("\n", "\\n")
    return shown if len(shown) <= LONGEST else f"{shown[:LONGEST]}..."


class ConsilienceError(Exception):
    """Anything wrong with what the user gave; the command line prints it and exits with 2."""


class InvalidInput(ConsilienceError):
    """A case file, a mechanism or an argument that cannot be used.

    Parameters
    ----------
    where : str
        File, field or name that is wrong, for example ``four_bar.toml: body[1].mass``.
    what : str
        What is wrong with it.
    remedy : str
        What would be right.
    """

    def __init__(self, where: str, what: str, remedy: str) -> None:
        self.where, self.what, self.remedy = (_part(text) for text in (where, what, remedy))
        super().__init__(f"{self.where}: {self.what}. {self.remedy}")

    def __reduce__(self) -> tuple[type[InvalidInput], tuple[str, str, str]]:
        """Survive the trip out of a worker process with all three parts."""
        return type(self), (self.where, self.what, self.remedy)


class CannotAssemble(InvalidInput):
    """The mechanism has no configuration that satisfies its joints, or none was found from the drawing."""


class NumericalFailure(ConsilienceError):
    """A computation cannot go on; the message says when and why."""
