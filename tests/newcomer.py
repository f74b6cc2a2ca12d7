"""A newcomer's path, timed: the commands of three documentation pages, in the environment that runs this script.

``.venv/bin/python tests/newcomer.py [--before S]`` in an environment with Consilience alone; S is the time in s that
its installation took. Limits of time go by the pace of the machine.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from pace import slowness
from pages import ROOT, execute

PATHS = (
    ("install, run, read", "docs/start.md", 300.0),
    ("write a case", "docs/write-a-case.md", 600.0),
    ("add the example engine", "docs/add-an-engine.md", 900.0),
)
"""Step of the path, its page, and its time limit in s."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Execute the pages and print the time of each; exit code 1 if a command fails or a step takes too long."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=float, default=0.0, help="s that the installation took")
    before = parser.parse_args(arguments).before
    wrong: list[str] = []
    for what, page, limit in PATHS:
        start = time.monotonic() - (before if page == "docs/start.md" else 0.0)
        with tempfile.TemporaryDirectory() as folder:
            # commands of the start page that make the environment are skipped: this script runs in that environment
            wrong += execute(ROOT / page, Path(folder), skip_marked=page == "docs/start.md")
        took, allowed = time.monotonic() - start, limit * slowness()
        print(f"{what}: {took:.0f} s of {allowed:.0f} s", flush=True)
        if took > allowed:
            wrong.append(f"{what}: {took:.0f} s, longer than {allowed:.0f} s")
    print("\n".join(wrong) or "a newcomer gets there")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
