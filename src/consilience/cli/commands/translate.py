"""The command ``consilience translate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from consilience.case import load_case
from consilience.cli.native_files import native_files, write_native
from consilience.cli.options import CaseName, EngineToTranslate
from consilience.cli.terminal import say


def translate(
    case: CaseName,
    engine: EngineToTranslate,
    output: Annotated[Path, typer.Option("-o", "--output", help="New folder for the files.")],
) -> None:
    """Write the native model of a case, its initial state and its manifest, for use with the engine alone."""
    files = native_files(load_case(case), engine)
    write_native(files, output)
    say(f"{output}: {', '.join(sorted(files))}; start with {output / 'run.py'}")
