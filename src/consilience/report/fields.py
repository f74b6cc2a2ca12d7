"""Fields and messages that the schemas of `report.jsonl` and `replay.json` share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

NameField = Annotated[str, Field(max_length=1_000)]


class StrictModel(BaseModel):
    """A table of a file: values are not converted, and unknown fields are refused."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


def first_problem(error: ValidationError, skip: int = 0) -> str:
    """Describe the first problem of a validation: place and message; `skip` parts of the place are left out."""
    first = error.errors(include_url=False, include_input=False)[0]
    place = ".".join(str(part) for part in first["loc"][skip:])
    return f"{place}: {first['msg']}"
