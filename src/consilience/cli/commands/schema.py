"""The command ``consilience schema``."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

from consilience.engine import load_named
from consilience.errors import InvalidInput

SCHEMAS = {
    "case": "consilience.case.file.schema:case_schema",
    "record": "consilience.report.recordschema:record_schema",
}
"""Functions that return a JSON Schema, by what it describes."""


def schema(kind: Annotated[str, typer.Argument(help=f"What to describe: {' or '.join(SCHEMAS)}.")]) -> None:
    """Print the JSON Schema of a case file, or of a line of report.jsonl."""
    if kind not in SCHEMAS:
        raise InvalidInput(f"schema '{kind}'", "there is none", f"Schemas: {', '.join(SCHEMAS)}.")
    sys.stdout.write(json.dumps(load_named(SCHEMAS[kind])(), indent=2) + "\n")
