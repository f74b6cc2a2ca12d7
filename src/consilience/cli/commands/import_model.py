"""The command ``consilience import``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from consilience.case.importing.files import import_model, imported_text
from consilience.cli.options import Form, OutputFormat, require_ending, write_new_case
from consilience.cli.terminal import state
from consilience.report.statement import Statement


def import_(
    file: Annotated[Path, typer.Argument(help="URDF or MJCF file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Case file to write; never overwritten.")],
    free_base: Annotated[
        bool, typer.Option("--free-base", help="URDF: the root link floats; otherwise it is the ground.")
    ] = False,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Write a case file from a URDF or MJCF file, and say what was changed or left out."""
    require_ending(output, "case file", ".toml")
    imported = import_model(file, free_base)
    write_new_case(output, imported_text(imported))
    bodies, joints = len(imported.case.mechanism.bodies), len(imported.case.mechanism.joints)
    size = f"{bodies} {'body' if bodies == 1 else 'bodies'}, {joints} joint{'s' * (joints != 1)}"
    notes = list(imported.notes.lines())
    data = {"file": str(output), "bodies": bodies, "joints": joints, "notes": notes}
    sentences = [f"{output}: {size}. Changed or left out:", *(f"- {line}" for line in notes)]
    state(Statement(sentences if form is OutputFormat.TEXT else [sentences[0], *notes], [], data), form)
