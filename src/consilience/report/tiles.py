"""View of the matrix: a row for each case, worst first, and a tile for each engine.

The colour of a tile tells whether the engine means the same model. Its bar is a second channel: the digits of the best
motion, by an integrator of the engine's own if it has one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.engine import Question
from consilience.report.answers import AnswerView
from consilience.report.cases import CaseView
from consilience.report.cells import Cell
from consilience.report.defaults import own_digits
from consilience.report.record import Record
from consilience.report.selection import grouped
from consilience.report.wording import LOOKS, Look, digits_text

MOST_DIGITS = 16.0
"""Digits of a full bar: those of a double."""

PLAIN = (Verdict.AGREES, Verdict.DISCRETISATION)
"""Verdicts of a motion that have no mark: the bar tells the digits."""


@dataclass(frozen=True)
class Bar:
    """Digits of the best motion on a scale; positions are percentages of the width.

    Attributes
    ----------
    defaults : float or None
        Digits at the engine's defaults.
    asked : float
        Digits that the case asks.
    """

    length: float
    defaults: float | None
    asked: float


@dataclass(frozen=True)
class Mark:
    """A question that wants a look: symbol and words."""

    look: Look
    text: str


@dataclass(frozen=True)
class Tile:
    """A cell as the matrix shows it.

    Attributes
    ----------
    tint : str
        Colour class of the model: of the worst answer where nothing is integrated, or of a motion of another model.
    marks : tuple of Mark
        Questions that do not plainly agree.
    bar : Bar or None
        None where there is no motion, or where marks take its place.
    digits : str
        Digits of the best motion; empty where there is none.
    findings : tuple of str
        Known findings that show in the cell.
    own : bool
        Whether its integrator is the engine's own.
    keys : tuple of str
        Key of the worst verdict of each question of the run, for the filters.
    label : str
        Words of the tile for a screen reader.
    urgency, shortfall
        Gravest mark, and digits that are missing, for the order of rows.
    """

    cell: Cell
    tint: str
    marks: tuple[Mark, ...]
    bar: Bar | None
    digits: str
    findings: tuple[str, ...]
    own: bool
    keys: tuple[str, ...]
    label: str
    urgency: tuple[bool, int]
    shortfall: float


@dataclass(frozen=True)
class MatrixRow:
    """A case and its tiles, in the order of the columns."""

    case: CaseView
    tiles: tuple[Tile, ...]

    @property
    def urgency(self) -> tuple[tuple[bool, int], float]:
        """Key of the order of rows: larger for a graver tile, then for more digits missing."""
        return max(((t.urgency, t.shortfall) for t in self.tiles), default=((False, 0), 0.0))


def matrix_rows(record: Record, cases: Sequence[CaseView], columns: Sequence[str]) -> tuple[MatrixRow, ...]:
    """Make the rows of the matrix, worst first."""
    lines = {(line["case"], line["engine"]): line for line in record.cells}
    questions = record.header["questions"]
    rows = [
        MatrixRow(
            case,
            tuple(_tile(c, lines.get((c.case, c.engine), {}), questions) for c in case.cells if c.engine in columns),
        )
        for case in cases
    ]
    return tuple(sorted(rows, key=lambda row: row.urgency, reverse=True))


def _tile(cell: Cell, line: dict[str, Any], questions: Sequence[str]) -> Tile:
    by_question = grouped((a.question, a) for a in cell.matched)
    looks = {
        q: max((a.look for a in found if a.counts), key=lambda look: look.urgency) for q, found in by_question.items()
    }
    tint, marks, digits = _tint(cell, line), tuple(_marks(by_question)), line.get("digits")
    words = [cell.case, cell.engine, *(f"{m.look.name}: {m.text}" for m in marks if m.text)]
    words += [] if marks else [cell.look.name]
    words += [f"{digits_text(digits)} digits"] if digits is not None else []
    asked, findings = line.get("digits_asked") or 0.0, tuple(line.get("findings", ()))
    words += [f"known finding {name}" for name in findings]
    return Tile(
        cell=cell,
        tint=tint,
        marks=marks,
        bar=_bar(cell, line) if digits is not None and not marks else None,
        digits="" if digits is None else digits_text(digits),
        findings=findings,
        own=bool(line.get("own")),
        keys=tuple(looks[q].key if q in looks else "empty" for q in questions),
        label=", ".join(words),
        urgency=max((m.look.urgency for m in marks if m.look.wants_look), default=(False, 0)),
        shortfall=0.0 if digits is None else asked - digits,
    )


def _tint(cell: Cell, line: dict[str, Any]) -> str:
    """Choose the colour: another model anywhere, else the worst answer where nothing is integrated, else the motion."""
    if any(a.look is LOOKS[Verdict.MODEL] for a in cell.matched):
        return LOOKS[Verdict.MODEL].tint
    verdict = line.get("model") or line.get("motion")
    if verdict is None:
        return cell.look.tint
    return LOOKS[Verdict(verdict)].model_tint


def _marks(by_question: dict[str, list[AnswerView]]) -> Iterator[Mark]:
    """Mark each question by its worst answer; motions that are only less accurate than asked have no mark."""
    refused = all(a.look is LOOKS[Verdict.UNSUPPORTED] for found in by_question.values() for a in found)
    if by_question and refused:
        yield Mark(LOOKS[Verdict.UNSUPPORTED], "unsupported")
        return
    for question, found in by_question.items():
        moving = Question(question).over_time
        plain = [LOOKS[v] for v in PLAIN] if moving else [LOOKS[Verdict.AGREES]]
        shown = [a for a in found if a.look not in plain and a.counts]
        if shown:
            worst = max(shown, key=lambda a: a.look.urgency)
            digits = f" {worst.digits}" if worst.look is LOOKS[Verdict.MODEL] else ""
            yield Mark(worst.look, f"{question}{digits}")


def _bar(cell: Cell, line: dict[str, Any]) -> Bar:
    defaults = [own_digits(a.lines.comparison) for a in cell.defaults if Question(a.question).over_time]
    at_defaults = next((d for d in defaults if d is not None), None)

    def at(digits: float) -> float:
        return round(min(max(digits, 0.0), MOST_DIGITS) / MOST_DIGITS * 100.0, 1)

    return Bar(at(line["digits"]), None if at_defaults is None else at(at_defaults), at(line["digits_asked"] or 0.0))
