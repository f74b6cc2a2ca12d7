"""Known findings: the tables of `reports/findings/README.md`, and the signs by which a finding shows in a run."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class KnownFinding:
    """A finding that a script of `reports/findings` shows with the engine alone."""

    name: str
    what: str
    size: str


_ROW = re.compile(r"^\| \[(?P<name>\w+)\]\([^)]*\) \| (?P<engine>\w+) \| (?P<what>[^|]*?) \|(?: (?P<size>[^|]*?) \|)?$")


@cache
def known_findings() -> dict[str, tuple[KnownFinding, ...]]:
    """Read the findings of each engine from the tables of `reports/findings/README.md`."""
    found: dict[str, tuple[KnownFinding, ...]] = {}
    for line in _text("README.md").splitlines():
        row = _ROW.match(line)
        if row:
            one = KnownFinding(row["name"], row["what"].replace("`", ""), (row["size"] or "").replace("`", ""))
            found[row["engine"].lower()] = (*found.get(row["engine"].lower(), ()), one)
    return found


def _path(name: str) -> Path:
    """Return the path of a file of `reports/findings`, as installed or in the repository."""
    packaged = Path(__file__).parents[1] / "findings" / name
    return packaged if packaged.is_file() else Path(__file__).parents[3] / "reports" / "findings" / name


def _text(name: str) -> str:
    return _path(name).read_text(encoding="utf-8")


def finding_text(finding: str) -> str | None:
    """Return the text of a finding, in Markdown; None for a name that is none."""
    path = _path(f"{finding}/README.md")
    return path.read_text(encoding="utf-8") if re.fullmatch(r"\w+", finding) and path.is_file() else None


@dataclass(frozen=True)
class Sign:
    """Signs of a finding in a run: shell patterns, each of a field of a comparison.

    Attributes
    ----------
    finding : str
        Name of the finding, a folder of `reports/findings`.
    dependent : bool
        Whether only cases with reactions that equilibrium does not determine show the finding.
    """

    finding: str
    engine: str
    question: str
    method: str
    profile: str
    cause: str
    dependent: bool = False

    def shows(self, comparison: Mapping[str, Any], cause: str, case: Mapping[str, Any]) -> bool:
        """Whether a comparison of a case, with the key of its cause, has all signs."""
        fields = {**comparison, "cause": cause, "engine": re.split("[:@]", comparison["engine"])[0]}
        named = ("engine", "question", "method", "profile", "cause")
        if self.dependent and not case["undetermined"]:
            return False
        return all(fnmatchcase(str(fields[name]), getattr(self, name)) for name in named)


@cache
def signs() -> tuple[Sign, ...]:
    """Read the signs of all findings from `reports/findings/signs.toml`."""
    return tuple(Sign(**table) for table in tomllib.loads(_text("signs.toml"))["sign"])


def finding_of(comparison: Mapping[str, Any], cause: str, case: Mapping[str, Any]) -> str | None:
    """Return the name of the known finding that a comparison shows; None if there is none."""
    return next((sign.finding for sign in signs() if sign.shows(comparison, cause, case)), None)
