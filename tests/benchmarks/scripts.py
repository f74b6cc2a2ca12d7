"""Benchmarks that print their own tables: each part runs in a new process, and its output becomes a section."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Section:
    """A part of the page, as printed."""

    title: str
    text: str

    def markdown(self) -> str:
        return f"## {self.title}\n{self.text}\n"


SCRIPTS = {
    "evaluation": (
        ("One evaluation of a spatial chain of revolutes against Pinocchio's `aba` (bar: 0.8)", ("pinocchio",), True),
        ("Growth of one evaluation with the number of bodies (bar: exponent 1.05)", ("growth",), False),
        ("A batch of states on two cores (bars: 1 million bodies a second a core; 1.8)", ("batch",), False),
        ("Memory of a run of a chain of 2000 bodies (bar: 1 GB)", ("memory",), False),
    ),
    "growth": (("Growth of one evaluation with the number of loops (bar: exponent 1.2)", (), False),),
    "anatomy": (("Where the time of the reference goes", (), False),),
    "trajectories": (("Work and precision of the reference", (), False),),
}
"""By module: title, arguments, and whether it belongs to the short set."""


def run(name: str, short: bool) -> Iterator[Section]:
    """Yield one section for each part."""
    for title, arguments, quick in SCRIPTS[name]:
        if short and not quick:
            continue
        command = [sys.executable, str(FOLDER / f"{name}.py"), *arguments]
        printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
        yield Section(title, printed.strip())
