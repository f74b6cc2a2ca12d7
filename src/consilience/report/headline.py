"""Headline of a record: whether engines mean the same model, how many motions are accurate, what to look at first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.compare.judge import DISPLACED_START, REFERENCE
from consilience.engine import Question, Status
from consilience.report.record import Record
from consilience.report.selection import grouped, is_matched
from consilience.report.wording import LOOKS, RANK, Look, cause_of, counted, phrase

TO_LOOK_AT = (Verdict.FAILED, Verdict.MODEL, Verdict.UNRESOLVED)
"""Verdicts of cells that a reader looks at first, the gravest first."""

OTHERS = (
    Verdict.MODEL,
    Verdict.FAILED,
    Verdict.UNRESOLVED,
    Verdict.DISCRETISATION,
    Verdict.REGULARISATION,
    Verdict.UNSUPPORTED,
)
"""Verdicts other than agreement, in the order in which they are told."""

_ASKED = "the digits asked, by the engine's own integrator or else the harness's"
"""What the method that counts reaches, see `annotations.annotated`."""

Comparisons = Sequence[dict[str, Any]]


@dataclass(frozen=True)
class CellCause:
    """The comparison that decides the verdict of a cell that asks for a look.

    Attributes
    ----------
    cause : str
        Cause in a sentence without numbers; `why` has the numbers.
    """

    case: str
    engine: str
    look: Look
    question: str
    method: str
    cause: str
    why: str

    @property
    def line(self) -> str:
        """The cell and its cause in one line of text."""
        by = f", {self.method}" if self.method else ""
        return f"{self.look.symbol} {self.case}, {self.engine}: {self.cause} ({self.question}{by}: {self.why})"


def headline(record: Record) -> tuple[str, ...]:
    """State whether engines mean the same model, how many motions reach the digits asked, and what is missing."""
    cells = [own for (_, engine), own in _cells(record).items() if engine != REFERENCE]
    asked = [Question(name) for name in record.header["questions"]]
    models = [q for q in asked if not q.over_time]
    places = " and ".join(models)
    means = [_worst(found) for own in cells if (found := [c for c in own if c["question"] in models])]
    moving = [[c for c in own if c["question"] not in models] for own in cells]
    motions = [c for own in moving for c in own if c["best"]]
    beside = sum(_differs(own) and not _differs([c for c in own if c["best"]]) for own in moving)
    missing = record.header["missing"]
    sentences = (
        *_counted(means, "cell", f"at {places}", ("agrees", "agree")),
        *_counted(motions, "motion", _ASKED, ("reaches", "reach")),
        *([f"{counted(beside, 'motion')} {phrase(Verdict.MODEL, beside)} by another method"] if beside else ()),
        *([f"{counted(len(missing), 'engine')} not available: {', '.join(missing)}"] if missing else ()),
    )
    return sentences or ("nothing was compared",)


def look_first(record: Record) -> tuple[CellCause, ...]:
    """List the cells that differ in the model, failed or are unresolved, the gravest first, each with its cause."""
    found = [c for c in map(_worst, _cells(record).values()) if c["verdict"] in TO_LOOK_AT]
    return tuple(_cause(c) for c in sorted(found, key=_gravity, reverse=True))


def without_horizon(record: Record) -> list[str]:
    """Tell the cases without a horizon, since motions of the reference from displaced starts failed, and why."""
    displaced = grouped(
        (run["case"], run)
        for run in record.runs
        if run["engine"] == REFERENCE and run["method"] and DISPLACED_START in run["method"]["name"]
    )
    return [
        f"{case}: the horizon is not known: no motion of the reference from displaced starts has an answer "
        f"({runs[0]['reason']})"
        for case, runs in displaced.items()
        if all(run["status"] == Status.FAILED for run in runs)
    ]


def _cells(record: Record) -> dict[tuple[str, str], list[dict[str, Any]]]:
    """Group the comparisons with matched settings by case and engine."""
    return grouped(((c["case"], c["engine"]), c) for c in record.comparisons if is_matched(c))


def _differs(comparisons: Comparisons) -> bool:
    """Whether any differs in the model."""
    return any(c["verdict"] == Verdict.MODEL for c in comparisons)


def _gravity(comparison: dict[str, Any]) -> int:
    return RANK[comparison["verdict"]]


def _worst(comparisons: Comparisons) -> dict[str, Any]:
    """Choose the first of the gravest answers, since an error in one layer leads to the next; a refusal is none."""
    answered = [c for c in comparisons if c["verdict"] != Verdict.UNSUPPORTED]
    return max(answered or comparisons, key=_gravity)


def _counted(found: Comparisons, noun: str, what: str, verbs: tuple[str, str]) -> Iterator[str]:
    """State how many agree of those that an engine can represent, and the verdicts of the others."""
    count = Counter(Verdict(c["verdict"]) for c in found)
    able = len(found) - count[Verdict.UNSUPPORTED]
    good = count[Verdict.AGREES]
    if not found:
        return
    parts = [f"{good} of {counted(able, noun)} {verbs[good != 1]} {what}"] if able else []
    parts += [f"{count[v]} {phrase(v, count[v])}" for v in OTHERS if count[v]]
    yield "; ".join(parts)


def _cause(comparison: dict[str, Any]) -> CellCause:
    c = comparison
    return CellCause(
        c["case"],
        c["engine"],
        LOOKS[Verdict(c["verdict"])],
        c["question"],
        c["method"],
        cause_of(c["cause"], c["verdict"]).rstrip("."),
        " ".join(c["why"].split()),
    )
