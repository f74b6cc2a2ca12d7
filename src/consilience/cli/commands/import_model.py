"""``consilience import``: a case file from a URDF or MJCF file, and what of it a case cannot keep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from consilience.case.importing.files import import_model, imported_text
from consilience.errors import InvalidInput


def import_(
    file: Annotated[Path, typer.Argument(help="URDF or MJCF file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Case file to write; never overwritten.")],
    free_base: Annotated[
        bool, typer.Option("--free-base", help="URDF: the root link floats; otherwise it is the ground.")
    ] = False,
) -> None:
    """Write a case file from a URDF or MJCF file, and say what was changed or left out."""
    if output.suffix != ".toml":
        raise InvalidInput(str(output), "it is no name of a case file", "Let it end with .toml.")
    imported = import_model(file, free_base)
    text = imported_text(imported)
    try:
        with output.open("x", encoding="utf-8") as handle:
            handle.write(text)
    except FileExistsError:
        raise InvalidInput(str(output), "it exists, and nothing is overwritten", "Choose another name.") from None
    except OSError as error:
        raise InvalidInput(str(output), f"it cannot be written ({error.strerror})", "Choose another place.") from None
    out, mechanism = Console(), imported.case.mechanism
    bodies, joints = len(mechanism.bodies), len(mechanism.joints)
    size = f"{bodies} {'body' if bodies == 1 else 'bodies'}, {joints} joint{'s' * (joints != 1)}"
    lines = [f"{output}: {size}. Changed or left out:"]
    lines += [f"- {line}" for line in imported.notes.lines()]
    out.print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
