"""Tables of results, and the machine they were measured on."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
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
        What is compared, and how to read it.
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
    """CPU, cores, Python and packages; no host name."""
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


def page(tables: Sequence[Part], short: bool) -> str:
    """All tables as one page of the documentation."""
    head = (Path(__file__).parent / "page.md").read_text(encoding="utf-8")
    kind = " The short set: too few rounds and cases to be quoted." if short else ""
    measured = f"Measured on {date.today():%Y-%m-%d}: {machine()}{kind}\n"
    return "\n".join([head, measured, *(table.markdown() for table in tables)])
