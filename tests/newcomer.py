"""A newcomer's path, timed: the commands of three documentation pages, in the environment that runs this script.

``.venv/bin/python tests/newcomer.py [--before S]`` in an environment with Consilience alone; S is the time in s that
its installation took.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from pages import ROOT, execute

PATHS = (
    ("install, run, read", "docs/start.md", 300.0),
    ("write a case", "docs/write-a-case.md", 600.0),
    ("add the example engine", "docs/add-an-engine.md", 900.0),
)
"""Step of the path, its page, and its time limit in s."""


def main() -> None:
    """Execute the pages and print the time of each; exit code 1 if a command fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=float, default=0.0, help="s that the installation took")
    before = parser.parse_args().before
    wrong: list[str] = []
    for what, page, limit in PATHS:
        start = time.monotonic() - (before if page == "docs/start.md" else 0.0)
        with tempfile.TemporaryDirectory() as folder:
            # commands of the start page that make the environment are skipped: this script runs in that environment
            wrong += execute(ROOT / page, Path(folder), skip_marked=page == "docs/start.md")
        took = time.monotonic() - start
        print(f"{what}: {took:.0f} s, {'longer than' if took > limit else 'within'} {limit:.0f} s", flush=True)
    print("\n".join(wrong) or "a newcomer gets there")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
