"""How commands write what they have to say: the same option everywhere."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Format(StrEnum):
    """Formats of commands that tell something."""

    TEXT = "text"
    MARKDOWN = "markdown"
    JSON = "json"


SheetFormat = Annotated[Format, typer.Option("-f", "--format", help="How to write it.")]
"""The option itself."""
