"""The command ``consilience new``: a commented case file to start from, or a copy of a case or of a family."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from consilience.case import case_files, load_cases
from consilience.case.families import family_table, is_family
from consilience.case.file.writer import table_text
from consilience.cli.options import Form, OutputFormat, require_ending, write_new_case
from consilience.cli.terminal import state
from consilience.errors import InvalidInput
from consilience.report.statement import Statement

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")


def starter_text(name: str) -> str:
    """Return the commented case file of a small mechanism, under the name of a case."""
    return (files("consilience.cli.commands") / "starter.toml").read_text(encoding="utf-8").replace("NAME", name)


def copied_text(source: str) -> str:
    """Return the case file of a shipped case, of a path, or of a member of a family; its first line names the source.

    Raises
    ------
    InvalidInput
        If there is no such case, or the case cannot be read.
    """
    heading = f"# Started from {source}: title, sources, remarks and expected values are still those of it.\n"
    if is_family(source) and source not in {path.stem for path in case_files()}:
        return heading + table_text(family_table(source)[1])
    path = Path(source)
    load_cases(source)  # raises the reason if the source is no case
    if not (source.endswith(".toml") or "/" in source):
        # the name of a variant begins with the name of its file
        found = [p for p in case_files() if source == p.stem or source.startswith(f"{p.stem}-")]
        path = max(found, key=lambda p: len(p.stem))
    return heading + path.read_text(encoding="utf-8")


def write_new(name: str, source: str | None, target: Path | None) -> Path:
    """Write a new case file, to `target` or to ``NAME.toml`` in the current folder, and return its path.

    Raises
    ------
    InvalidInput
        If the name is no name of a case, the source is no case, or the file exists or cannot be written.
    """
    if not NAME.fullmatch(name):
        raise InvalidInput(f"name '{name}'", "it is no name of a case", "Use letters, digits and _, a letter first.")
    path = target or Path(f"{name}.toml")
    require_ending(path, "case file", ".toml")
    write_new_case(path, starter_text(name) if source is None else copied_text(source))
    return path


def new(
    name: Annotated[str, typer.Argument(help="Name of the case: letters, digits, _.")],
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="CASE", help="Shipped case, case file, or family such as windows:count=3."),
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File; default: NAME.toml.")] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Write a commented case file to start from; never overwrites."""
    path = write_new(name, source, output)
    sentence = f"{path}: edit it, then `consilience validate {path}` and `consilience run {path}`"
    state(Statement([sentence], [], {"file": str(path)}), form)
