"""View of the answers at the engines' own defaults: digits at the engine's own step, and at the finest step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.compare.result import digits_of
from consilience.report.answers import AnswerView
from consilience.report.cells import Cell
from consilience.report.selection import judged_largest
from consilience.report.wording import DASH, LOOKS, digits_text, step_text


@dataclass(frozen=True)
class DefaultRow:
    """One default method of one engine on one case.

    Attributes
    ----------
    first : bool
        Whether the row is the first of its cell.
    count : int
        Number of rows of the cell.
    digits, step : str
        Digits at an instant, or of a motion at the engine's own step, and that step.
    finest, finest_step : str
        Digits at the finest step asked, and that step.
    """

    cell: Cell
    answer: AnswerView
    first: bool
    count: int
    digits: str
    step: str
    finest: str
    finest_step: str


@dataclass(frozen=True)
class Defaults:
    """The section: sentences, rows, the text of an empty section, and the engines without default methods."""

    sentences: tuple[str, ...]
    rows: tuple[DefaultRow, ...]
    empty: str
    without: tuple[str, ...]


def defaults_view(cells: Sequence[Cell], quick: bool) -> Defaults:
    """Make the view of all default methods of the cells."""
    rows = [_row(cell, answer, n) for cell in cells for n, answer in enumerate(cell.defaults)]
    # a quick run asks no engine at its defaults, so the record cannot tell which engines have no default methods
    without = () if quick else tuple(_without(cells))
    empty = "No engine was asked at its own defaults." + " A quick run leaves them out." * quick
    return Defaults(tuple(_sentences(rows)), tuple(rows), empty, without)


def own_digits(comparison: dict[str, Any]) -> float | None:
    """Return the digits at an instant, or at the first level of a motion, which has the engine's own step."""
    if not comparison["levels"]:
        digits: float | None = comparison["digits"]
        return digits
    largest = judged_largest(comparison, comparison["levels"][0])
    return None if largest is None else digits_of(largest)


def _row(cell: Cell, answer: AnswerView, n: int) -> DefaultRow:
    comparison, method = answer.lines.comparison, answer.lines.method
    levels = comparison["levels"]
    return DefaultRow(
        cell=cell,
        answer=answer,
        first=n == 0,
        count=len(cell.defaults),
        digits=digits_text(own_digits(comparison)),
        step=step_text(levels[0]["step"], method) if levels else DASH,
        finest=digits_text(comparison["digits"]) if levels else DASH,
        finest_step=step_text(levels[-1]["step"], method) if levels else DASH,
    )


def _sentences(rows: Sequence[DefaultRow]) -> Iterator[str]:
    """Summarise the section in one or two sentences."""
    instants, motions = ([r for r in rows if r.answer.question == question] for question in ("instant", "trajectory"))
    if instants:
        within = sum(row.answer.look is LOOKS[Verdict.AGREES] for row in instants)
        yield f"Answers within the bars at given states: {within} of {len(instants)}."
    if motions:
        answered = [(digits, row) for row in motions if (digits := own_digits(row.answer.lines.comparison)) is not None]
        enough = sum(digits >= row.answer.lines.case["digits"] for digits, row in answered)
        text = f"Motions with the digits asked at the engine's own step: {enough} of {len(motions)}"
        if answered:
            digits, least = min(answered, key=lambda pair: pair[0])
            text += f"; the least accurate has {digits_text(digits)} digits ({least.cell.case} on {least.cell.engine})"
        if len(answered) < len(motions):
            text += f"; {len(motions) - len(answered)} without an answer"
        yield f"{text}."


def _without(cells: Sequence[Cell]) -> Iterator[str]:
    """List engines without a default method, with the cases."""
    for engine in dict.fromkeys(cell.engine for cell in cells if cell.engine != REFERENCE):
        own = [cell for cell in cells if cell.engine == engine]
        bare = [cell.case for cell in own if cell.matched and not cell.defaults]
        if bare:
            yield f"{engine} ({'all cases' if len(bare) == len(own) else ', '.join(bare)})"
