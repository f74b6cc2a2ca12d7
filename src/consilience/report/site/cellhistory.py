"""History of cells over reports: each answer with its date and the version of the engine, oldest version first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from packaging.version import InvalidVersion, Version

from consilience.compare.judge import REFERENCE
from consilience.engine import Question
from consilience.report.annotations import counts
from consilience.report.history.changes import DIGITS
from consilience.report.record import Record
from consilience.report.selection import grouped, is_matched
from consilience.report.wording import LOOKS, Look, anchor, cell_anchor, digits_text, severity


@dataclass(frozen=True)
class SiteReport:
    """A report of the site.

    Attributes
    ----------
    address : str
        Folder of the report within the site.
    engines : dict
        Engines that started, by name: fields of the header.
    """

    address: str
    written: str
    quick: bool
    cases: int
    engines: dict[str, dict[str, str]]
    missing: dict[str, str]
    consilience: str

    @property
    def date(self) -> str:
        """Day on which the report was written."""
        return self.written[:10]


@dataclass(frozen=True)
class QuestionVerdict:
    """Verdict of a question in a cell, by the answer that decides it."""

    question: str
    look: Look
    digits: float | None
    method: str
    why: str

    @property
    def digits_text(self) -> str:
        """Digits, or a dash."""
        return digits_text(self.digits)


@dataclass(frozen=True)
class HistoryEntry:
    """A cell in a report.

    Attributes
    ----------
    asked : str
        Name of the engine in the report, with its version where one was asked for.
    line : dict
        Line of the cell in the record.
    digest : str or None
        Digest of what the file of the case asked.
    """

    report: SiteReport
    asked: str
    version: str
    line: dict[str, Any]
    questions: tuple[QuestionVerdict, ...]
    title: str
    digest: str | None

    @property
    def look(self) -> Look:
        """Look of the worst verdict that counts."""
        return _look(self.line["verdict"])

    @property
    def digits_text(self) -> str:
        """Digits of the best motion, or a dash."""
        return digits_text(self.line["digits"])

    @property
    def link(self) -> str:
        """Address of the cell in its report, within the site."""
        return f"{self.report.address}/report.html#{cell_anchor(self.line['case'], self.asked)}"

    @property
    def order(self) -> tuple[tuple[int, Version, str], str]:
        """Order in a history: by version, then by date."""
        return version_order(self.version), self.report.written


@dataclass(frozen=True)
class CellStep:
    """A cell that is worse or better in a version than in the version before."""

    cell: CellHistory
    before: HistoryEntry
    after: HistoryEntry

    @property
    def worse(self) -> bool:
        """Whether the verdict is graver, or digits were lost."""
        return _severity(self.after) > _severity(self.before)


@dataclass(frozen=True)
class CellHistory:
    """A cell over all reports, its entries by version and date; at least one."""

    case: str
    engine: str
    entries: tuple[HistoryEntry, ...]

    @property
    def address(self) -> str:
        """Address of the cell within the site, whatever the reports."""
        return f"cell/{anchor(self.case)}/{anchor(self.engine)}"

    @property
    def current(self) -> HistoryEntry:
        """Entry of the newest version, as it was asked last."""
        return self.entries[-1]

    @property
    def in_full(self) -> HistoryEntry:
        """Last entry of the newest version that was asked in full; the current one if there is none."""
        newest = [entry for entry in self.entries if entry.version == self.current.version]
        return next((entry for entry in reversed(newest) if not entry.report.quick), self.current)

    @property
    def findings(self) -> list[str]:
        """Findings that show in an entry."""
        return sorted({name for entry in self.entries for name in entry.line["findings"]})

    @cached_property
    def versions(self) -> tuple[HistoryEntry, ...]:
        """Last entry of each version."""
        return tuple({entry.version: entry for entry in self.entries}.values())

    def of_question(self, question: str) -> list[tuple[HistoryEntry, QuestionVerdict]]:
        """Return the answers to a question, newest version first."""
        return [(e, answer) for e in reversed(self.entries) for answer in e.questions if answer.question == question]

    @property
    def questions(self) -> list[str]:
        """Questions that were asked at any time."""
        asked = {answer.question for entry in self.entries for answer in entry.questions}
        return [str(question) for question in Question if question in asked]

    @property
    def steps(self) -> Iterator[CellStep]:
        """Steps from a version to the next with another verdict, or with other digits; latest version first."""
        for before, after in reversed(list(zip(self.versions, self.versions[1:], strict=False))):
            if before.report.quick == after.report.quick and _differ(before, after):
                yield CellStep(self, before, after)


def version_order(text: str) -> tuple[int, Version, str]:
    """Order versions as pip does; what is none comes first, by its letters."""
    try:
        return 1, Version(text), text
    except InvalidVersion:
        return 0, Version("0"), text


def engine_of(asked: str) -> str:
    """Return the name of an engine without its version."""
    return asked.partition("@")[0]


def entries_of(record: Record, report: SiteReport) -> Iterator[HistoryEntry]:
    """List the cells of a record; the reference, which is compared with itself alone, has none."""
    about = {case["name"]: case for case in record.cases}
    deciding = grouped(
        ((c["case"], c["engine"], c["question"]), c) for c in record.comparisons if is_matched(c) and counts(c)
    )
    for line in record.cells:
        if line["engine"] == REFERENCE:
            continue
        case, asked = about[line["case"]], line["engine"]
        questions = tuple(
            _question(question, found)
            for question in map(str, Question)
            if (found := deciding.get((line["case"], asked, question)))
        )
        version = record.header["engines"][asked]["version"]
        yield HistoryEntry(report, asked, version, line, questions, case["title"], case.get("digest"))


def histories(entries: Iterable[HistoryEntry]) -> list[CellHistory]:
    """Collect entries by case and engine, cases in alphabetical order."""
    found = grouped(((entry.line["case"], engine_of(entry.asked)), entry) for entry in entries)
    return [CellHistory(*key, tuple(sorted(found[key], key=lambda entry: entry.order))) for key in sorted(found)]


def _question(question: str, found: Sequence[dict[str, Any]]) -> QuestionVerdict:
    worst = max(found, key=lambda c: severity(c["verdict"], c["digits"]))
    why = " ".join(worst["why"].split())
    return QuestionVerdict(question, _look(worst["verdict"]), worst["digits"], worst["method"], why)


def _look(verdict: str) -> Look:
    return next(look for look in LOOKS.values() if look.verdict == verdict)


def _severity(entry: HistoryEntry) -> tuple[int, float]:
    return severity(entry.line["verdict"], entry.line["digits"])


def _differ(before: HistoryEntry, after: HistoryEntry) -> bool:
    """Whether the verdicts differ, or the digits by as much as `diff` tells."""
    digits = before.line["digits"], after.line["digits"]
    lost = None not in digits and abs(digits[0] - digits[1]) >= DIGITS
    return bool(before.line["verdict"] != after.line["verdict"] or lost)
