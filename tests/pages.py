"""Execution of the code blocks of the documentation.

``python tests/pages.py [PAGE ...]`` executes all blocks of each page from top to bottom in a folder of its own, as a
reader would; this takes minutes, with engines. `tests/unit/test_documentation.py` has the short version.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
        *(path for path in (ROOT / "docs").rglob("*.md") if "generated" not in path.parts),
        *(ROOT / "reports" / "findings").rglob("README.md"),
    ]
)
LANGUAGES = ("sh", "python", "toml", "yaml", "text")
"""``text`` is output, a formula or a sketch of folders: nothing that could run."""

SITE = ("{toctree}", "{raw} html")
"""Directives of the site, which are no code."""

INSTALLS = "installs: .ci/run does it in fresh environments (the README's commands, tests/newcomer.py)"
LONG = "a campaign of hours; its short version is among the tests"
CLUSTER = "needs a cluster that exists; tests/harness/test_cluster.py has one of its own"
SHELL = "changes the configuration of the reader's shell"

MARKED: dict[tuple[str, str], str] = {
    ("README.md", "python3 -m venv .venv &&"): INSTALLS,
    ("README.md", "python3 -m venv .venv-test &&"): INSTALLS,
    ("CONTRIBUTING.md", "python3 -m venv .venv &&"): INSTALLS,
    ("CONTRIBUTING.md", "pip install -e '.[docs]'"): INSTALLS,
    ("CONTRIBUTING.md", "python -m sphinx"): ".ci/run builds the site",
    ("docs/start.md", "python3 -m venv .venv"): INSTALLS,
    ("docs/start.md", ".venv/bin/pip install '.[engines]'"): INSTALLS,
    ("docs/start.md", ". .venv/bin/activate"): INSTALLS,
    ("docs/frames.md", "pip install 'consilience[frames]'"): INSTALLS,
    ("docs/add-an-engine.md", "pip install -e ."): "installs: tests/newcomer.py does it, in a fresh environment",
    ("docs/add-an-engine.md", "consilience doctor -e textbook"): "needs the engine installed: tests/newcomer.py",
    ("docs/add-an-engine.md", "consilience validate double_pendulum four_bar"): "the same",
    ("docs/add-an-engine.md", "consilience run double_pendulum furuta_pendulum"): "the same",
    ("docs/add-an-engine.md", "consilience check double_pendulum -e textbook"): "the same",
    ("docs/add-an-engine.md", "consilience run double_pendulum -e textbook"): "the same",
    ("docs/detection.md", "consilience mutate "): LONG,
    ("docs/families.md", "consilience run windows"): "twenty minutes: chains of forty bodies on all engines",
    ("docs/fuzz.md", "consilience fuzz --mechanisms 300"): LONG,
    ("docs/identities.md", "consilience check   "): "an hour: all cases, all engines",
    ("docs/import.md", "python tests/imported.py FILE..."): "the reader's files; tests/conformance has some",
    ("docs/runs.md", "python tests/hostile/campaign.py"): LONG,
    (
        "docs/translate.md",
        "python tests/exported.py",
    ): "ten minutes; tests/conformance/test_exported_models.py has a part",
    ("docs/cluster.md", "pip install 'consilience[cluster]'"): INSTALLS,
    ("docs/cluster.md", "consilience run"): CLUSTER,
    ("docs/cluster.md", "consilience fuzz"): CLUSTER,
    ("docs/cluster.md", "dask "): CLUSTER,
    ("docs/cluster.md", "for k in"): CLUSTER,
    ("docs/runs.md", "python tests/hostile/browser.py"): "needs a browser of the system",
    (
        "docs/workers.md",
        "python -m consilience.engine.worker consilience-report",
    ): "the reader's failed job; tests/harness/test_workers.py",
    ("docs/workers.md", "python tests/benchmarks/"): "measures speed: minutes on a quiet machine",
    ("docs/pytest.md", "pytest --consilience-engine mujoco cases/"): "an hour: the whole library",
    (
        "docs/pytest.md",
        "pytest --consilience-engine mujoco cases -m",
    ): "minutes; tests/harness/test_pytest_plugin.py has both",
    ("docs/pytest.md", "pytest --consilience-engine mujoco cases -n"): "an hour: the whole library",
    ("docs/pytest.md", "name: consilience"): "a workflow of GitHub; tests/harness/test_pytest_plugin.py",
    ("docs/shell.md", "consilience --install-completion"): SHELL,
    ("docs/shell.md", "consilience --show-completion"): "asks which shell it is called from; the tests ask for bash",
}
"""Commands, and blocks by their first line, that the campaign does not execute, with the reason: page and beginning."""

FILES: dict[str, dict[str, str]] = {
    "docs/import.md": {
        "robot.urdf": """<robot name="arm"><link name="base"><inertial><mass value="3"/>
<inertia ixx="0.02" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="upper"><inertial><origin xyz="0.1 0 0.2"/>
<mass value="2"/><inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/>
<axis xyz="0 1 0"/><limit effort="1" velocity="1" lower="-1" upper="1"/></joint></robot>""",
        "scene.xml": """<mujoco><worldbody><body name="rod" pos="0 0 1"><joint name="pin" axis="0 1 0"/>
<inertial pos="0 0 -0.2" mass="1" diaginertia="0.01 0.012 0.004"/></body></worldbody></mujoco>""",
    }
}
"""Files that a page expects in its folder."""

CODES: dict[str, tuple[int, ...]] = {
    "consilience run": (0, 1, 3),
    "consilience check": (0, 1, 3),
    "consilience trend": (0, 1),
    "consilience bisect": (0, 1),
    "consilience mutate": (0, 1, 3),
}
"""Exit codes that are no failure, by the beginning of a command; 0 for all others."""


@dataclass(frozen=True)
class Block:
    """One code block of a page."""

    page: str
    line: int
    language: str
    text: str

    @property
    def commands(self) -> list[str]:
        """Commands of a shell block, one per line."""
        return [line for line in self.text.splitlines() if line.strip()]

    @property
    def file(self) -> str:
        """File name in the first line of the block, or an empty string."""
        found = re.match(r"# ([\w./-]+\.(?:toml|py))$", self.text.partition("\n")[0])
        return found[1] if found else ""


@cache
def blocks(page: Path) -> tuple[Block, ...]:
    """Return the code blocks of a page in order; indented blocks have no language."""
    name = str(page.relative_to(ROOT))
    tokens = MarkdownIt("commonmark").disable("inline").parse(page.read_text(encoding="utf-8"))
    return tuple(
        Block(name, token.map[0] + 1, token.info.strip(), token.content)
        for token in tokens
        if token.type in ("fence", "code_block")
    )


def mark(page: str, text: str) -> str:
    """Return why a command or block is not executed; an empty string if it is executed."""
    return next((why for (where, start), why in MARKED.items() if where == page and text.startswith(start)), "")


def environment(folder: Path) -> dict[str, str]:
    """Return environment variables by which commands find `consilience`, `python`, `pytest` of this environment."""
    programs = folder / ".programs"
    programs.mkdir(exist_ok=True)
    for name, module in (("consilience", "consilience.cli.main"), ("pytest", "")):
        call = f"from {module} import main; main()" if module else "import sys, pytest; sys.exit(pytest.main())"
        (programs / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -c "{call}" "$@"\n')
        (programs / name).chmod(0o755)
    # a script, not a symbolic link: Python looks for packages beside the path by which it is called
    (programs / "python").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n')
    (programs / "python").chmod(0o755)
    return os.environ | {"PATH": f"{programs}:{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "120"}


def execute(page: Path, folder: Path, skip_marked: bool = True) -> list[str]:
    """Execute the blocks of a page in a folder; return the failures."""
    found, names = [], {"__name__": page.stem}
    for name in ("tests", "cases", "reports"):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    for name, text in FILES.get(str(page.relative_to(ROOT)), {}).items():
        (folder / name).write_text(text)
    own = environment(folder)
    for block in blocks(page):
        where = f"{block.page}:{block.line}"
        if block.file:
            (folder / block.file).write_text(block.text)
        if block.language == "python" and not block.file:
            found += _python(block, folder, names, where)
        for command in block.commands if block.language == "sh" else []:
            if skip_marked and mark(block.page, command):
                continue
            start = time.monotonic()
            done = subprocess.run(
                command, shell=True, cwd=folder, env=own, capture_output=True, text=True, check=False, timeout=1800
            )
            print(f"{time.monotonic() - start:7.1f} s  {done.returncode}  {where}: {command}", flush=True)
            allowed = next((codes for begin, codes in CODES.items() if command.startswith(begin)), (0,))
            if done.returncode not in allowed:
                found.append(f"{where}: {command}: exit code {done.returncode}: {done.stderr.strip()[-600:]}")
    return found


def _python(block: Block, folder: Path, names: dict[str, object], where: str) -> list[str]:
    here = Path.cwd()
    os.chdir(folder)
    try:
        exec(compile("\n" * block.line + block.text, where, "exec"), names)
    except AssertionError as error:
        return [f"{where}: an assertion does not hold: {error}"]
    finally:
        os.chdir(here)
    return []


def main() -> None:
    """Execute pages; exit code 1 if a block fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="*", help="such as docs/runs.md; default: all")
    chosen = [ROOT / name for name in parser.parse_args().pages] or PAGES
    wrong = []
    for page in chosen:
        with tempfile.TemporaryDirectory() as folder:
            wrong += execute(page, Path(folder))
    print("\n".join(wrong) or f"{len(chosen)} pages do what they say")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
