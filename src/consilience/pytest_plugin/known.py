"""Known differences: a TOML file of entries with a case, an engine, a question, and the reason.

They are strict: a difference that is gone fails its test, and so does one that has become another (a crash is not
hidden by an entry that knows a difference in the model).
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from consilience.compare import Verdict
from consilience.engine import Question
from consilience.errors import InvalidInput
from consilience.report.exports.digest import CODES
from consilience.report.recordschema import QuestionField

_REMEDY = "Entries are tables [[known]] with case, engine, question and reason, and if need be verdict."


class Known(BaseModel):
    """One known difference.

    Attributes
    ----------
    case : str
        Name, or a pattern of names as in a shell.
    verdict : Verdict
        What is expected instead of agreement.
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
        """Whether this is about a test."""
        return fnmatchcase(case, self.case) and self.engine == engine and self.question is question

    def __str__(self) -> str:
        return f"{self.case}, {self.engine}, {self.question}"


class _File(BaseModel):
    model_config = ConfigDict(extra="ignore")  # the file may hold other tables of the adapter

    known: list[Known]


def read_known(paths: Sequence[Path]) -> list[Known]:
    """Entries of all files.

    Raises
    ------
    InvalidInput
        With the file and what is wrong in it.
    """
    return [entry for path in paths for entry in _entries(path)]


def _entries(path: Path) -> Iterator[Known]:
    try:
        yield from _File.model_validate(tomllib.loads(path.read_text(encoding="utf-8"))).known
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be read ({error.strerror})", "Give a TOML file.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(str(path), f"it is not valid TOML: {error}", _REMEDY) from None
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in problem["loc"])
        raise InvalidInput(f"{path}: {where}", problem["msg"].removeprefix("Value error, "), _REMEDY) from None
