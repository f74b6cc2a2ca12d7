"""The command ``consilience values``: expected values of the case library beside values of the reference."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from consilience.case import Case, Published, read_motion, read_start
from consilience.cli.options import CaseNames, Form, OutputFormat, chosen_cases
from consilience.compare import markdown_table
from consilience.engine import Question, load_engine
from consilience.report.statement import WRITERS, Statement

TOLERANCE = 1e-13
"""Tolerance of the motions of the reference."""

HEADING = """# Expected values

Every expected value of the shipped cases, and the value of the reference at a tolerance of 1e-13, by
`consilience values`. Origins: [cases.md](cases.md). SI units; off is the difference, of angles modulo full turns.

"""


@dataclass(frozen=True)
class ComparedValue:
    """An expected value and the value of the reference.

    Attributes
    ----------
    known : Published
        Expected value.
    value : float
        Value of the reference.
    off : float
        Difference, of angles modulo full turns.
    """

    case: str
    known: Published
    value: float
    off: float

    @property
    def met(self) -> bool:
        """Whether the difference is within the uncertainty of the expected value plus 1e-9 relative."""
        return self.off <= self.known.uncertainty + 1e-9 * max(1.0, abs(self.known.value))


def found_values(case: Case) -> Iterator[ComparedValue]:
    """Compute every expected value of a case by the reference at its finest tolerance."""
    engine, mechanism = load_engine("reference"), case.mechanism
    start = [known for known in case.published if known.at_start]
    moving = [known for known in case.published if not known.at_start]
    if start:
        method = engine.methods(mechanism, Question.INSTANT)[0]
        answer = engine.instant(mechanism, [case.initial_state], method)
        for known in start:
            value = float(read_start(mechanism, known, answer)[known.component])
            yield ComparedValue(case.name, known, value, known.off(value))
    if moving:
        method = engine.methods(mechanism, Question.TRAJECTORY)[0]
        last = round(max(known.time for known in moving) / case.sample)
        motion = engine.trajectory(mechanism, case.initial_state, case.times[: last + 1], method, TOLERANCE)
        for known in moving:
            value = read_motion(mechanism, known, motion)
            yield ComparedValue(case.name, known, value, known.off(value))


HEADS = ("case", "value", "expected", "uncertainty", "ours", "off", "origin")


def rows(found: Sequence[ComparedValue]) -> Iterator[tuple[str, ...]]:
    """List the rows of the table, with a cell for each of `HEADS`."""
    for one in found:
        known = one.known
        digits = max(3, min(15, 1 + round(np.log10(max(abs(known.value), known.uncertainty) / known.uncertainty))))
        yield (
            one.case,
            known.name,
            f"{known.value:.{digits}g}",
            f"{known.uncertainty:.1g}",
            f"{one.value:.{min(15, digits + 1)}g}",
            f"{one.off:.1e}" + ("" if one.met else " **missed**"),
            f"{known.origin}: {known.source}" + (f"; {known.second}" if known.second else ""),
        )


def table(found: Sequence[ComparedValue]) -> str:
    """Write the values as a Markdown table, a row for each value."""
    lines = markdown_table(HEADS, rows(found), spaced=True, escape=lambda cell: cell.replace("|", "\\|"))
    return "\n".join(lines) + "\n"


def _plain(one: ComparedValue) -> dict[str, str | float | bool]:
    """Return a value as data for JSON."""
    known = one.known
    return {
        "case": one.case,
        "value": known.name,
        "expected": known.value,
        "uncertainty": known.uncertainty,
        "ours": one.value,
        "off": one.off,
        "met": one.met,
        "origin": str(known.origin),
        "source": known.source,
    }


def values(
    cases: CaseNames = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Markdown file for the table.")] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Compare the reference with every expected value: closed forms, publications, independent computations."""
    chosen = chosen_cases(cases)
    found = [one for case in chosen for one in found_values(case)]
    missed = [one for one in found if not one.met]
    sentence = f"{len(found)} values of {len(chosen)} cases, {len(missed)} missed"
    if output is not None:
        output.write_text(HEADING + table(found), encoding="utf-8")
        sentence = f"{sentence}: {output}"
    data = {"missed": len(missed), "values": [_plain(one) for one in found]}
    tables = [] if output is not None else [("expected values", HEADS, list(rows(found)))]
    sys.stdout.write(WRITERS[form](Statement([sentence], tables, data)))
    raise typer.Exit(1 if missed else 0)
