"""Verdict of each case, engine and question of a record, and the quantity that decides the verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.report.record import Record
from consilience.report.selection import grouped, is_matched
from consilience.report.wording import severity


@dataclass(frozen=True)
class QuestionCell:
    """One engine on one question of one case.

    Attributes
    ----------
    comparisons : tuple of dict
        Comparisons of the record with matched settings, which alone decide; at least one.
    runs : tuple of dict
        Runs of the record; at least one.
    replay : str
        Command that asks the question again.
    """

    case: str
    engine: str
    question: str
    comparisons: tuple[dict[str, Any], ...]
    runs: tuple[dict[str, Any], ...]
    replay: str

    @property
    def worst(self) -> dict[str, Any]:
        """The comparison that decides: of the worst verdict, then of the fewest digits."""
        return max(self.comparisons, key=lambda c: severity(c["verdict"], c["digits"]))

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all methods."""
        return Verdict(self.worst["verdict"])

    @property
    def digits(self) -> float | None:
        """Digits of the comparison that decides."""
        value: float | None = self.worst["digits"]
        return value

    @property
    def cpu(self) -> float:
        """CPU time of all runs in s."""
        return float(sum(run["cpu"] for run in self.runs))


def cells(record: Record) -> Iterator[QuestionCell]:
    """List all cells with a comparison: by engine, the reference last, then by case and question."""
    runs, compared = (
        grouped(((one["case"], one["engine"], one["question"]), one) for one in lines)
        for lines in (record.runs, filter(is_matched, record.comparisons))
    )
    for engine in engines(record, reference=True):
        for case in record.cases:
            for question in record.header["questions"]:
                key = (case["name"], engine, question)
                if key in compared:
                    again = record.again(case, engine, question)
                    yield QuestionCell(*key, tuple(compared[key]), tuple(runs[key]), again)


def engines(record: Record, reference: bool = False) -> list[str]:
    """List the engines that started; the reference is left out, or comes last."""
    names = [name for name in record.header["engines"] if name != REFERENCE]
    return [*names, REFERENCE] if reference and REFERENCE in record.header["engines"] else names
