"""Editions of the case list: names of shipped cases with digests of what they ask, frozen at a date."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date

from consilience.case.library import case_folder, shipped_cases
from consilience.errors import InvalidInput, nearest


@dataclass(frozen=True)
class Edition:
    """A frozen list of cases.

    Attributes
    ----------
    name : str
    frozen : str
        Date.
    digests : mapping of str to str
        Digest of each case, by its name.
    """

    name: str
    frozen: str
    digests: Mapping[str, str]


def editions() -> list[Edition]:
    """Return the shipped editions, oldest first."""
    found = [tomllib.loads(path.read_text(encoding="utf-8")) for path in case_folder().glob("edition-*.toml")]
    read = [Edition(one["name"], str(one["frozen"]), one["digests"]) for one in found]
    return sorted(read, key=lambda edition: edition.frozen)


def chosen_edition(name: str | None) -> Edition:
    """Return the edition of a name, the newest without one.

    Raises
    ------
    InvalidInput
        There is no such edition.
    """
    known = {edition.name: edition for edition in editions()}
    if name is None:
        return list(known.values())[-1]
    if name not in known:
        raise InvalidInput(f"edition '{name}'", "there is no such edition", nearest(name, known, "Editions"))
    return known[name]


def edition_text(name: str, frozen: date) -> str:
    """Write the file of a new edition: all shipped cases as they are."""
    lines = [f'name = "{name}"', f"frozen = {frozen}", "", "[digests]"]
    return "\n".join([*lines, *(f'"{case.name}" = "{case.digest}"' for case in shipped_cases())]) + "\n"
