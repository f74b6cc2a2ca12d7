"""Problems of a case file: all that can be found at once, each with its field and its line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from typing import Any, TypeVar

from pydantic import ValidationError

from consilience.case.file.lines import field_lines, line_of
from consilience.case.file.schema import CaseTable
from consilience.case.file.values import LARGEST
from consilience.errors import InvalidInput

_Given = TypeVar("_Given")
_Made = TypeVar("_Made")

_STAND_INS: dict[str, Any] = {"title": "title", "gravity": [0.0, 0.0, 0.0]}
"""Required fields that no other table depends on, with a value for the search for further problems."""


class InvalidCase(InvalidInput):
    """Case file with problems; the message tells the first, and how many more there are.

    Attributes
    ----------
    problems : tuple of InvalidInput
    """

    def __init__(self, problems: Iterable[InvalidInput]) -> None:
        self.problems = tuple(problems)
        first, more = self.problems[0], len(self.problems) - 1
        where = "`consilience validate`, or `problems` of this error, tells all"
        also = f" ({more} more problem{'s' * (more > 1)}; {where}.)"
        super().__init__(first.where, first.what, first.remedy + (also if more else ""))

    def __reduce__(self) -> tuple[type[InvalidCase], tuple[tuple[InvalidInput, ...]]]:  # type: ignore[override]
        """Pickle all problems: errors travel from worker processes."""
        return type(self), (self.problems,)


def located(file: str, problems: Iterable[InvalidInput], raw: Mapping[str, Any], text: str = "") -> InvalidCase:
    """Put the file and, where its text is given, the line before each problem; problems that are equal become one."""
    lines = field_lines(text)
    found: dict[str, InvalidInput] = {}
    for problem in problems:
        line = line_of(problem.where, raw, lines)
        place = f"{file}:{line}" if line else file
        one = InvalidInput(f"{place}: {problem.where}", problem.what, problem.remedy)
        found.setdefault(str(one), one)
    return InvalidCase(found.values())


def gathered(
    make: Callable[[_Given], _Made], given: Iterable[_Given], problems: list[InvalidInput]
) -> tuple[_Made, ...]:
    """Make something of each table; add the problem of each that is invalid."""
    made = []
    for one in given:
        try:
            made.append(make(one))
        except InvalidInput as problem:
            problems.append(problem)
    return tuple(made)


def checked_table(raw: Mapping[str, Any], problems: list[InvalidInput]) -> CaseTable | None:
    """Check the tables of a file field by field, and add all problems.

    Returns
    -------
    CaseTable or None
        What is valid, for the search for further problems; None if too little is.
    """
    try:
        return CaseTable.model_validate(raw)
    except ValidationError as error:
        found = error.errors(include_url=False)
    problems += [_problem(raw, one) for one in found]
    try:
        return CaseTable.model_validate(_without(raw, found))
    except ValidationError:
        return None


def _problem(raw: Mapping[str, Any], found: Any) -> InvalidInput:
    """Word a problem that Pydantic found."""
    where = _location(raw, found["loc"])
    if found["type"] == "extra_forbidden":
        remedy = "Remove it or correct its spelling; `consilience schema case` lists the fields."
        return InvalidInput(where, "unknown field", remedy)
    if found["type"] == "missing":
        return InvalidInput(where, "the field is missing", "Add it.")
    message = found["msg"].removeprefix("Value error, ")
    given = "" if isinstance(found["input"], dict) else f" (given: {_shown(found['input'])})"
    return InvalidInput(where, message[0].lower() + message[1:] + given, "See `consilience schema case`.")


def _without(raw: Mapping[str, Any], found: Iterable[Any]) -> dict[str, Any]:
    """Copy the tables without unknown fields, and without the entries and top-level fields that are invalid."""
    kept, spoilt = deepcopy(dict(raw)), dict[str, set[int]]()

    def alone(one: Any) -> bool:
        return bool(one["type"] == "extra_forbidden" and len(one["loc"]) <= 3)

    for one in sorted(found, key=lambda one: not alone(one)):  # before the tables that hold them go
        top, *inner = one["loc"]
        if alone(one):
            holder = kept
            for key in one["loc"][:-1]:
                holder = holder[key]
            del holder[one["loc"][-1]]
        elif inner and isinstance(inner[0], int):
            spoilt.setdefault(top, set()).add(inner[0])
        else:
            kept.pop(top, None)
    for top, numbers in spoilt.items():
        kept[top] = [entry for n, entry in enumerate(kept[top]) if n not in numbers]
    return {**_STAND_INS, **kept}


def _shown(value: Any) -> str:
    """Beginning of a value, a text in quotes; Python refuses to print integers of thousands of digits."""
    if isinstance(value, str):
        return f'"{value[:60]}"'
    many = isinstance(value, int) and abs(value) > LARGEST
    return f"more than {LARGEST:g}" if many else str(value)[:60]


def _location(raw: Any, loc: tuple[int | str, ...]) -> str:
    """Path of a field in a file; entries of lists are named by their field `name`."""
    text = ""
    for part in loc:
        if isinstance(part, int):
            if not isinstance(raw, list):  # one number in place of a list
                continue
            entry = raw[part] if part < len(raw) else None
            name = entry.get("name") if isinstance(entry, dict) else None
            text += f" '{name}'" if isinstance(name, str) else f"[{part}]"
            raw = entry
        else:
            text += f".{part}" if text else part
            raw = raw.get(part) if isinstance(raw, dict) else None
    return text
