"""The command ``consilience schema``."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

from consilience.errors import InvalidInput


def schema(kind: Annotated[str, typer.Argument(help="What to describe: case.")]) -> None:
    """Print the JSON Schema of a case file."""
    from consilience.case.file.schema import case_schema

    if kind != "case":
        raise InvalidInput(f"schema '{kind}'", "there is none", "Schemas: case.")
    sys.stdout.write(json.dumps(case_schema(), indent=2) + "\n")
