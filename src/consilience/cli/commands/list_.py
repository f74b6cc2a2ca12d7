"""The command ``consilience list``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from itertools import groupby
from typing import Annotated, Any

import typer

from consilience.case import Case, shipped_cases
from consilience.case.families import FAMILIES, shown_parameters
from consilience.cli.options import Form, OutputFormat, Tags, tagged_cases
from consilience.cli.terminal import out, say, state
from consilience.engine import installed, lacks_engine, pip_requirement
from consilience.errors import InvalidInput
from consilience.reference.formulations.registry import FORMULATIONS, SYSTEMS
from consilience.report.columns import cut, wrapped
from consilience.report.statement import Statement

HEADS = ("group", "name", "bodies", "joints", "title", "tags")


def joints_of(case: Case) -> str:
    """Name the joint kinds of a case, with the number of joints of each kind."""
    count = Counter(joint.kind for joint in case.mechanism.joints)
    return ", ".join(f"{n} {kind}" if n > 1 else kind for kind, n in count.items())


def row_of(case: Case) -> dict[str, Any]:
    """Describe a case by the fields of `HEADS`."""
    bodies = len(case.mechanism.bodies)
    return dict(zip(HEADS, (case.group, case.name, bodies, joints_of(case), case.title, list(case.tags)), strict=True))


def has_words(words: Sequence[str], *texts: object) -> bool:
    """Whether each word is part of one of the texts, in letters of any case."""
    text = "\n".join(map(str, texts)).casefold()
    return all(word.casefold() in text for word in words)


def list_(
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="WORD", help="Only what has all these words in its name, title, tags or joints."),
    ] = None,
    tag: Tags = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """List the shipped cases, the families and the installed engines."""
    asked = words or []
    rows = [row for row in map(row_of, tagged_cases(shipped_cases(), tag)) if has_words(asked, *row.values())]
    families = {name: shown_parameters(family) for name, family in FAMILIES.items() if not tag}
    families = {name: shown for name, shown in families.items() if has_words(asked, name, shown)}
    if not rows and not families:
        names = [case.name for case in shipped_cases()] + list(FAMILIES)
        near = get_close_matches(" ".join(asked), names, n=3, cutoff=0.4)
        remedy = f"Nearest: {', '.join(near)}." if near else "`consilience list` names all."
        raise InvalidInput(f"list {' '.join(asked)}", "no case or family has all these words", remedy)
    data: dict[str, Any] = {"cases": rows, "families": families}
    if not asked and not tag:
        lacking = {name: pip_requirement(point) for name, point in installed().items() if lacks_engine(point)}
        data |= {"engines": list(installed()), "formulations": [*FORMULATIONS, *SYSTEMS], "lacking": lacking}
    if form is OutputFormat.TEXT:
        lines = [*_case_lines(rows, out.width), *_family_lines(families), *_engine_lines(data)]
        say(wrapped("\n".join(lines), out.width))
    else:
        table = [[", ".join(v) if isinstance(v, list) else str(v) for v in row.values()] for row in rows]
        tables: list[tuple[str, Sequence[str], Sequence[Sequence[str]]]] = [
            ("cases", HEADS, table),
            ("families: FAMILY:PARAMETER=VALUE,...", ("name", "parameters and their defaults"), list(families.items())),
        ]
        state(Statement(list(_engine_lines(data)), tables, data), form)


def _case_lines(rows: Sequence[dict[str, Any]], width: int) -> Iterator[str]:
    """Give each case one line, below the name of its group; a title that does not fit is cut off at a blank."""
    longest = max((len(row["name"]) for row in rows), default=0)
    for group, members in groupby(rows, key=lambda row: row["group"]):
        yield group
        for row in members:
            noun = "body" if row["bodies"] == 1 else "bodies"
            yield cut(f"  {row['name']:<{longest}}  {row['bodies']:>3} {noun:<6}  {row['title']}", width)
        yield ""


def _family_lines(families: dict[str, str]) -> Iterator[str]:
    if families:
        yield "families, as FAMILY:PARAMETER=VALUE,..., with their defaults"
        # a blank behind each comma: a line breaks there
        yield from (f"  {name}: {shown.replace(',', ', ')}" for name, shown in families.items())
        yield ""


def _engine_lines(data: dict[str, Any]) -> Iterator[str]:
    if "engines" in data:
        yield f"engines: {', '.join(data['engines'])}"
        yield from (f"{name} is not installed: pip install '{needed}'" for name, needed in data["lacking"].items())
        yield f"formulations of the reference, as engines reference:NAME: {', '.join(data['formulations'])}"
