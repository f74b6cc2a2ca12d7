"""``consilience translate``: the native model of a case, for use with the engine alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from consilience.case import cases_like, load_case
from consilience.cli.native_files import native_files, write_native
from consilience.engine import engines_like


def translate(
    case: Annotated[str, typer.Argument(help="Name or case file.", autocompletion=cases_like)],
    engine: Annotated[
        str, typer.Option("-e", "--engine", help="Engine whose model to write.", autocompletion=engines_like)
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="New folder for the files.")],
) -> None:
    """Write the native model of a case, its initial state and its manifest, for use with the engine alone."""
    files = native_files(load_case(case), engine)
    write_native(files, output)
    names = ", ".join(sorted(files))
    Console().print(f"{output}: {names}; start with {output / 'run.py'}", soft_wrap=True, highlight=False, markup=False)
