"""What every output asks of a record: the verdict of a case, an engine and a question, and what decides it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.report.record import Record
from consilience.report.selection import is_matched, judged_largest
from consilience.report.wording import CAUSES, CAUSES_BY_VERDICT, RANK

REFERENCE = "reference"

CODES: dict[Verdict, int] = {
    Verdict.AGREES: 0,
    Verdict.DISCRETISATION: 0,
    Verdict.REGULARISATION: 0,
    Verdict.UNSUPPORTED: 0,
    Verdict.UNRESOLVED: 3,
    Verdict.MODEL: 1,
    Verdict.FAILED: 3,
}
"""Exit code that a verdict alone would make (docs/verdicts.md): an output calls good what the command calls good."""


@dataclass(frozen=True)
class Cell:
    """One engine on one question of one case: its comparisons with matched settings, which alone decide.

    Attributes
    ----------
    comparisons, runs : tuple of dict
        As in the record; neither is empty.
    replay : str
        Command that asks again.
    """

    case: str
    engine: str
    question: str
    comparisons: tuple[dict[str, Any], ...]
    runs: tuple[dict[str, Any], ...]
    replay: str

    @property
    def worst(self) -> dict[str, Any]:
        """The comparison that decides: of the worst verdict, and of these the one of the fewest digits."""
        return max(self.comparisons, key=lambda c: (RANK[c["verdict"]], -_digits(c)))

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


def _digits(comparison: dict[str, Any]) -> float:
    return 17.0 if comparison["digits"] is None else float(comparison["digits"])


def cells(record: Record) -> Iterator[Cell]:
    """All cells in which anything was compared: engine by engine, the reference's own last, then case and question."""
    runs: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    compared: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for run in record.runs:
        runs.setdefault((run["case"], run["engine"], run["question"]), []).append(run)
    for comparison in filter(is_matched, record.comparisons):
        c = comparison
        compared.setdefault((c["case"], c["engine"], c["question"]), []).append(comparison)
    for engine in engines(record, reference=True):
        for case in record.cases:
            for question in record.header["questions"]:
                key = (case["name"], engine, question)
                if key in compared:
                    again = record.again(case, engine, question)
                    yield Cell(*key, tuple(compared[key]), tuple(runs[key]), again)


def engines(record: Record, reference: bool = False) -> list[str]:
    """Engines that started, without the reference, or with it as the last."""
    names = [name for name in record.header["engines"] if name != REFERENCE]
    return [*names, REFERENCE] if reference and REFERENCE in record.header["engines"] else names


def cause(comparison: dict[str, Any]) -> str:
    """Why the verdict is what it is, in a sentence without numbers."""
    rule = comparison["rule"]
    return CAUSES[rule] if rule in CAUSES else CAUSES_BY_VERDICT[comparison["verdict"]]


@dataclass(frozen=True)
class Deciding:
    """The quantity nearest to its bar, or farthest beyond; None where a number is absent or not finite."""

    name: str
    difference: float | None
    bar: float | None


def deciding(comparison: dict[str, Any], case: dict[str, Any]) -> Deciding:
    """The numbers behind a verdict.

    Of a motion the largest difference of the finest level, up to the horizon, and the digits asked.
    """
    if comparison["levels"]:
        return Deciding("motion", judged_largest(comparison, comparison["levels"][-1]), 10.0 ** -case["digits"])
    counted = [q for q in comparison["quantities"] if q["count"]]
    if not counted:
        return Deciding("", None, None)
    worst = max(counted, key=_nearness)
    return Deciding(worst["name"], worst["difference"], worst["bar"])


def _nearness(quantity: dict[str, Any]) -> float:
    """Difference over bar; infinite where the difference is not finite or a bar of 0 is missed."""
    difference, bar = quantity["difference"], quantity["bar"]
    if difference is None:
        return float("inf")
    if not bar:
        return float("inf") if difference else 0.0
    return float(difference / bar)
