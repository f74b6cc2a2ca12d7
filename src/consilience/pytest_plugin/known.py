"""Known differences: a TOML file of entries with a case, an engine, a question, and the reason.

Known differences are strict: a test fails if its known difference is gone, or if its verdict has become another (a
known difference in the model does not hide a crash).
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from consilience.compare import CODES, Verdict
from consilience.engine import Question
from consilience.errors import InvalidInput
from consilience.report.fields import first_problem
from consilience.report.recordschema import QuestionField

_REMEDY = "Entries are tables [[known]] with case, engine, question and reason, and if need be verdict."


class KnownDifference(BaseModel):
    """One known difference.

    Attributes
    ----------
    case : str
        Name, or a pattern of names as in a shell.
    verdict : Verdict
        Expected verdict.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    case: str
    engine: str
    question: QuestionField
    reason: str = Field(min_length=1)
    verdict: Verdict = Verdict.MODEL

    @field_validator("verdict")
    @classmethod
    def _is_bad(cls, verdict: Verdict) -> Verdict:
        if CODES[verdict] == 0:
            raise ValueError(f"'{verdict}' passes anyway")
        return verdict

    def names(self, case: str, engine: str, question: Question) -> bool:
        """Whether the entry is about a test."""
        return fnmatchcase(case, self.case) and self.engine == engine and self.question is question

    def __str__(self) -> str:
        return f"{self.case}, {self.engine}, {self.question}"


class _KnownFile(BaseModel):
    model_config = ConfigDict(extra="ignore")  # the file may hold other tables

    known: list[KnownDifference]


def read_known(paths: Sequence[Path]) -> list[KnownDifference]:
    """Read the entries of all files.

    Raises
    ------
    InvalidInput
        If a file cannot be read or holds an invalid entry.
    """
    return [entry for path in paths for entry in _entries(path)]


def _entries(path: Path) -> Iterator[KnownDifference]:
    try:
        yield from _KnownFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8"))).known
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be read ({error.strerror})", "Give a TOML file.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(str(path), f"it is not valid TOML: {error}", _REMEDY) from None
    except ValidationError as error:
        where, _, problem = first_problem(error).partition(": ")
        raise InvalidInput(f"{path}: {where}", problem.removeprefix("Value error, "), _REMEDY) from None
