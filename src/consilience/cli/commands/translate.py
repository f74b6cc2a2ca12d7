"""The command ``consilience translate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from consilience.case import load_case
from consilience.cli.native_files import native_files, write_native
from consilience.cli.options import CaseName, EngineToTranslate, Form, OutputFormat
from consilience.cli.terminal import state
from consilience.report.statement import Statement


def translate(
    case: CaseName,
    engine: EngineToTranslate,
    output: Annotated[Path, typer.Option("-o", "--output", help="New folder for the files.")],
    form: Form = OutputFormat.TEXT,
) -> None:
    """Write the native model of a case, its initial state and its manifest, for use with the engine alone."""
    files = native_files(load_case(case), engine)
    write_native(files, output)
    sentence = f"{output}: {', '.join(sorted(files))}; start with {output / 'run.py'}"
    state(Statement([sentence], [], {"folder": str(output), "files": sorted(files)}), form)
