"""Tables of results, and a description of the machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Protocol

PACKAGES = ("numpy", "scipy", "numba", "exudyn", "pin", "mujoco", "dartpy", "heyoka")


@dataclass
class Table:
    """One table of results.

    Attributes
    ----------
    title, about : str
        Subject, and how to read the table.
    columns : sequence of str
    rows : list of sequence of str
    """

    title: str
    about: str
    columns: Sequence[str]
    rows: list[Sequence[str]] = field(default_factory=list)

    def markdown(self) -> str:
        """The table as a section of a page."""
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        text = "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)
        return f"## {self.title}\n{self.about}\n\n{text}\n"


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def machine() -> str:
    """Return CPU, cores, Python and packages; no host name."""
    known = []
    for name in PACKAGES:
        try:
            known.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            known.append(f"{name} not installed")
    python = f"{platform.python_implementation()} {platform.python_version()}"
    return f"{_cpu()}, {os.cpu_count()} cores; {platform.system()}; {python}; {', '.join(known)}."


class Part(Protocol):
    """A part of the page."""

    def markdown(self) -> str: ...


_MARK = "<!-- benchmark: {} -->"


def block(name: str, tables: Sequence[Part], short: bool) -> str:
    """Return all results of one benchmark as a part of the page."""
    kind = " The short set: too few rounds and cases to be quoted." if short else ""
    measured = f"*Measured on {date.today():%Y-%m-%d}: {machine()}{kind}*\n"
    return "\n".join([_MARK.format(name), measured, *(table.markdown() for table in tables)])


def page(blocks: Mapping[str, str], names: Sequence[str], old: str) -> str:
    """Return all benchmarks as one page of the documentation.

    Parameters
    ----------
    blocks : mapping
        New parts by name; the other parts stay as in the old page.
    names : sequence of str
        All benchmarks, in order.
    old : str
        The present page, or an empty string.
    """
    known = {}
    for part in old.split(_MARK.partition("{}")[0])[1:]:
        name = part.partition(" ")[0]
        known[name] = _MARK.format(name) + part.partition("-->")[2]
    head = (Path(__file__).parent / "page.md").read_text(encoding="utf-8")
    found = known | dict(blocks)
    return "\n".join([head, *(found[name].rstrip() + "\n" for name in names if name in found)])
