"""The explanations of ``consilience explain``: tables beside this file, and the search among them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Any

from consilience.errors import InvalidInput


class Topic(StrEnum):
    """Kinds of explanations, in the order of the list."""

    VERDICT = "verdict"
    RULE = "rule"
    ROUTE = "route"
    PROFILE = "profile"
    QUESTION = "question"
    TERM = "term"
    TRAP = "trap"

    @property
    def title(self) -> str:  # type: ignore[override] # a heading, not the method of strings
        """Heading of the list."""
        return f"{self.value.capitalize()}s"


TABLES = ("verdicts.toml", "terms.toml", "traps.toml")


@dataclass(frozen=True)
class Explanation:
    """The explanation of a name.

    Attributes
    ----------
    kind : Topic
    name : str
        Unique among the explanations of a kind.
    rule : str
        A sentence: what decides, or what to do.
    theory : str
        Three lines.
    met : tuple of str
        Threads of public trackers, each with its gist.
    also : tuple of str
        Other names.
    see : str
        Page of the documentation; empty for the page of the kind.
    number : int
        Number of a trap, as in `consilience.audit.mutate`; 0 for the other kinds.
    """

    kind: Topic
    name: str
    rule: str
    theory: str
    met: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    see: str = ""
    number: int = 0

    @property
    def words(self) -> tuple[str, ...]:
        """All names and numbers by which the explanation is found."""
        numbers = (str(self.number), f"trap {self.number}") if self.number else ()
        return (self.name, *self.also, *numbers)

    @property
    def page(self) -> str:
        """Page of the documentation that says more."""
        return self.see or ("detection.md" if self.kind is Topic.TRAP else "verdicts.md")


@cache
def read_explanations() -> tuple[Explanation, ...]:
    """Read all explanations, sorted by kind, each kind in the order of its table."""
    found = []
    for table in TABLES:
        text = files("consilience.cli").joinpath("explained", table).read_text(encoding="utf-8")
        for kind, rows in tomllib.loads(text).items():
            for row in rows:
                fields: dict[str, Any] = {
                    name: tuple(value) if isinstance(value, list) else value for name, value in row.items()
                }
                found.append(Explanation(Topic(kind), **fields))
    return tuple(sorted(found, key=lambda entry: list(Topic).index(entry.kind)))


def _key(text: str) -> str:
    """Letters and digits of a text, in lower case, words separated by single blanks."""
    return " ".join("".join(c if c.isalnum() else " " for c in text.lower()).split())


def find_explanations(asked: str) -> tuple[Explanation, ...]:
    """Find the explanations of a name, of the number of a trap, or of a part of exactly one name.

    Raises
    ------
    InvalidInput
        If there is none; the message has the nearest names.
    """
    wanted = _key(asked)
    entries = read_explanations()
    same = tuple(entry for entry in entries if wanted in {_key(word) for word in entry.words})
    if same:
        return same
    inside = tuple(entry for entry in entries if wanted and any(wanted in _key(word) for word in entry.words))
    if len(inside) == 1:
        return inside
    words = {_key(word): word for entry in entries for word in entry.words}
    near = [entry.name for entry in inside] or [
        words[key] for key in get_close_matches(wanted, list(words), n=5, cutoff=0.5)
    ]
    remedy = f"Nearest: {', '.join(dict.fromkeys(near))}." if near else "`consilience explain` lists everything."
    raise InvalidInput(f"explain '{asked}'", "nothing, or more than one thing, is called so", remedy)
