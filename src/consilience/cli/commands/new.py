"""``consilience new``: a case file to start from, with every field explained, or a copy of a case or of a family."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from consilience.case import case_files, load_cases
from consilience.case.families import family_table, is_family
from consilience.case.file.writer import table_text
from consilience.errors import InvalidInput

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")


def starter_text(name: str) -> str:
    """Commented case file of a small mechanism under a name."""
    return (files("consilience.cli.commands") / "starter.toml").read_text(encoding="utf-8").replace("NAME", name)


def copied_text(source: str) -> str:
    """Case file of a shipped case, of another file, or of a member of a family, with a first line that says so.

    Raises
    ------
    InvalidInput
        If there is no such case, or it cannot be read.
    """
    heading = f"# Started from {source}: title, sources, remarks and expected values are still those of it.\n"
    if is_family(source) and source not in {path.stem for path in case_files()}:
        return heading + table_text(family_table(source)[1])
    path = Path(source)
    load_cases(source)  # names what is wrong with it
    if not (source.endswith(".toml") or "/" in source):
        # a variant's name begins with that of its file
        found = [p for p in case_files() if source == p.stem or source.startswith(f"{p.stem}-")]
        path = max(found, key=lambda p: len(p.stem))
    return heading + path.read_text(encoding="utf-8")


def write_new(name: str, source: str | None, target: Path | None) -> Path:
    """Write a new case file.

    Returns
    -------
    Path
        The file: `target`, or ``NAME.toml`` in the current folder.

    Raises
    ------
    InvalidInput
        A name that no case can have, a source that is none, a file that exists or cannot be written.
    """
    if not NAME.fullmatch(name):
        raise InvalidInput(f"name '{name}'", "it is no name of a case", "Use letters, digits and _, a letter first.")
    path = target or Path(f"{name}.toml")
    if path.suffix != ".toml":
        raise InvalidInput(str(path), "it is no name of a case file", "Let it end with .toml.")
    text = starter_text(name) if source is None else copied_text(source)
    try:
        with path.open("x", encoding="utf-8") as handle:
            handle.write(text)
    except FileExistsError:
        raise InvalidInput(str(path), "it exists, and nothing is overwritten", "Choose another name.") from None
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be written ({error.strerror})", "Choose another place.") from None
    return path


def new(
    name: Annotated[str, typer.Argument(help="Name of the case: letters, digits, _.")],
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="CASE", help="Shipped case, case file, or family such as windows:count=3."),
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File; default: NAME.toml.")] = None,
) -> None:
    """Write a commented case file to start from; never overwrites."""
    path = write_new(name, source, output)
    Console().print(
        f"{path}: edit it, then `consilience validate {path}` and `consilience run {path}`",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )
