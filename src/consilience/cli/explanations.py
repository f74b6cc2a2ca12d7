"""The explanations of ``consilience explain``, and the search among them.

The tables are in the folder ``explained``. An adapter adds facts about its engine in a file ``explained.toml`` of its
package: ``[KIND.NAME]`` with ``met`` and ``also``, as in the tables, and ``engines``, a sentence in place of
``{engines}`` in the theory.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Any

from consilience.engine import adapter_file, installed
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
        The condition that decides, or the action to take, in a sentence.
    theory : str
        Three lines.
    met : tuple of str
        Threads of public trackers, each with a summary.
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


def _of_adapters() -> list[dict[str, dict[str, dict[str, Any]]]]:
    """Read the additions of adapters: fields by kind and name."""
    paths = [adapter_file(point, "explained.toml") for point in installed().values()]
    return [tomllib.loads(path.read_text(encoding="utf-8")) for path in paths if path]


def _extended(row: dict[str, Any], additions: list[dict[str, Any]]) -> dict[str, Any]:
    """Add the facts of adapters about their engines to an explanation."""
    lists = {
        name: [*row.get(name, ()), *(x for one in additions for x in one.get(name, ()))] for name in ("met", "also")
    }
    engines = " ".join(one["engines"] for one in additions if "engines" in one)
    lines = [line.replace("{engines}", engines).strip() for line in row["theory"].splitlines()]
    return row | lists | {"theory": "\n".join(line for line in lines if line)}


@cache
def read_explanations() -> tuple[Explanation, ...]:
    """Read all explanations, sorted by kind, each kind in the order of its table."""
    found, own = list[Explanation](), _of_adapters()
    for table in TABLES:
        text = files("consilience.cli").joinpath("explained", table).read_text(encoding="utf-8")
        for kind, rows in tomllib.loads(text).items():
            for row in rows:
                additions = [one[kind][row["name"]] for one in own if row["name"] in one.get(kind, {})]
                fields: dict[str, Any] = {
                    name: tuple(value) if isinstance(value, list) else value
                    for name, value in _extended(row, additions).items()
                }
                found.append(Explanation(Topic(kind), **fields))
    return tuple(sorted(found, key=lambda entry: list(Topic).index(entry.kind)))


def _key(text: str) -> str:
    """Reduce a text to letters and digits in lower case, words separated by single blanks."""
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
