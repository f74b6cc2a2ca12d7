"""The command ``consilience values``: expected values of the case library beside values of the reference."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from consilience.case import Case
from consilience.cli.options import CaseNames, Form, OutputFormat, chosen_cases, require_place, writing
from consilience.compare import markdown_table, spread_over_time
from consilience.compare.instants import Instants
from consilience.compare.published import Measured, measure_motion, measure_start
from consilience.engine import Engine, Question, TrajectoryAnswer, load_engine
from consilience.errors import NumericalFailure
from consilience.report.statement import WRITERS, Statement

HEADING = """# Expected values

Every expected value of the shipped cases, and the value of the reference at its finest tolerance, by
`consilience values`. Origins: [The case library](cases.md). SI units; off is the difference, of angles modulo full
turns.
A value is missed where the difference exceeds both uncertainties together, as in `consilience run`.

"""


@dataclass(frozen=True)
class ComparedValue:
    """An expected value of a case and the value of the reference, judged as in a run."""

    case: str
    measured: Measured

    @property
    def met(self) -> bool:
        """Whether the difference is within both uncertainties."""
        return self.measured.quantity.met


def found_values(case: Case) -> Iterator[ComparedValue]:
    """Compute every expected value of a case by the motions and the answer of the reference that a run asks for."""
    engine, mechanism = load_engine("reference"), case.mechanism
    found: list[Measured] = []
    if any(known.at_start for known in case.published):
        start = [case.initial_state]
        answer = engine.instant(mechanism, start, engine.methods(mechanism, Question.INSTANT)[0])
        found += measure_start(mechanism, case.published, answer, Instants.of(mechanism, start))
    if any(not known.at_start for known in case.published):
        motions = _motions(case, engine)
        found += measure_motion(mechanism, case.published, motions, spread_over_time(mechanism, motions))
    place = {id(known): n for n, known in enumerate(case.published)}
    yield from (ComparedValue(case.name, one) for one in sorted(found, key=lambda one: place[id(one.known)]))


def _motions(case: Case, engine: Engine) -> list[TrajectoryAnswer]:
    """Motions of the reference: the best, then those that bound its uncertainty, as far as they succeed."""
    best, *others = engine.methods(case.mechanism, Question.TRAJECTORY)
    finest = len(best.tolerances) - 1
    asked = [(best, best.tolerances[k]) for k in (finest, *range(1, finest))]
    asked += [(method, tolerance) for method in others for tolerance in method.tolerances]
    motions = []
    for method, tolerance in asked:
        try:
            motions.append(engine.trajectory(case.mechanism, case.initial_state, case.times, method, tolerance))
        except NumericalFailure:
            if not motions:
                raise
    return motions


HEADS = ("case", "value", "expected", "uncertainty", "ours", "off", "origin")


def rows(found: Sequence[ComparedValue]) -> Iterator[tuple[str, ...]]:
    """List the rows of the table, with a cell for each of `HEADS`."""
    for one in found:
        known, measured = one.measured.known, one.measured
        digits = max(3, min(15, 1 + round(np.log10(max(abs(known.value), known.uncertainty) / known.uncertainty))))
        yield (
            one.case,
            known.name,
            f"{known.value:.{digits}g}",
            f"{known.uncertainty:.1g}",
            f"{measured.value:.{min(15, digits + 1)}g}",
            f"{measured.off:.1e}" + ("" if one.met else " **missed**"),
            f"{known.origin}: {known.source}" + (f"; {known.second}" if known.second else ""),
        )


def table(found: Sequence[ComparedValue]) -> str:
    """Write the values as a Markdown table, a row for each value."""
    lines = markdown_table(HEADS, rows(found), spaced=True, escape=lambda cell: cell.replace("|", "\\|"))
    return "\n".join(lines) + "\n"


def _plain(one: ComparedValue) -> dict[str, str | float | bool]:
    """Return a value as data for JSON."""
    known = one.measured.known
    return {
        "case": one.case,
        "value": known.name,
        "expected": known.value,
        "uncertainty": known.uncertainty,
        "ours": one.measured.value,
        "off": one.measured.off,
        "bar": one.measured.bar,
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
    require_place(output)
    chosen = chosen_cases(cases)
    found = [one for case in chosen for one in found_values(case)]
    missed = [one for one in found if not one.met]
    sentence = f"{len(found)} values of {len(chosen)} cases, {len(missed)} missed"
    if output is not None:
        with writing(output):
            output.write_text(HEADING + table(found), encoding="utf-8")
        sentence = f"{sentence}: {output}"
    data = {"missed": len(missed), "values": [_plain(one) for one in found]}
    tables = [] if output is not None else [("expected values", HEADS, list(rows(found)))]
    sys.stdout.write(WRITERS[form](Statement([sentence], tables, data)))
    raise typer.Exit(1 if missed else 0)
