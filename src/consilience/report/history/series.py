"""A series of reports by date: verdicts, digits and time of every engine, and the changes between reports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from consilience.compare import Verdict
from consilience.errors import InvalidInput
from consilience.report.history.changes import (
    AnswerSummary,
    Change,
    answers,
    change_table,
    changes,
    count_effects,
    plain,
)
from consilience.report.record import Record, read_record
from consilience.report.selection import grouped
from consilience.report.statement import Statement
from consilience.report.wording import counted, digits_text, seconds

MOST_REPORTS = 1_000
"""Largest number of reports in a series."""

NamedRecord = tuple[str, Record]
"""Folder of a report, relative to the folder of the series, and its record."""


def read_series(folder: Path) -> tuple[list[NamedRecord], dict[str, str]]:
    """Read the reports in and below a folder, sorted by date; the second result names unreadable reports and why.

    Raises
    ------
    InvalidInput
        If there is no readable report, or there are too many.
    """
    paths = sorted(folder.rglob("report.jsonl"))
    if len(paths) > MOST_REPORTS:
        raise InvalidInput(str(folder), f"it holds {len(paths)} reports", f"Choose {MOST_REPORTS} at most.")
    found: list[NamedRecord] = []
    unread: dict[str, str] = {}
    for path in paths:
        name = str(path.parent.relative_to(folder))
        try:
            found.append((name, read_record(path.parent)))
        except InvalidInput as error:
            unread[name] = error.what
    if not found:
        reasons = "; ".join(f"{name}: {why}" for name, why in unread.items())
        what = f"none of its reports can be read: {reasons}" if reasons else "there is no report in it"
        raise InvalidInput(str(folder), what, "Give a folder of folders that `consilience run -o` wrote.")
    return sorted(found, key=lambda named: datetime.fromisoformat(named[1].header["written"])), unread


def series_statement(series: Sequence[NamedRecord], unread: dict[str, str], digits: float) -> Statement:
    """State a series: a row for each report and engine, then the changes from each report to the next."""
    steps = [(b[0], changes(a[1], b[1], digits=digits)) for a, b in pairwise(series)]
    rows = [row for name, record in series for row in _rows(name, record)]
    sentences = [
        f"{counted(len(series), 'report')} from {series[0][1].header['written']} to {series[-1][1].header['written']}."
    ]
    sentences += [f"{name}: {count_effects(found)}" for name, found in steps]
    sentences += [f"{name} is left out: {why}" for name, why in unread.items()]
    heads = ("report", "written", "engine", "version", "agree", "answers", "median digits", "CPU time")
    data: dict[str, Any] = {
        "reports": [_about(name, record) for name, record in series],
        "left_out": unread,
        "worse": _worse(steps[-1][1]) if steps else 0,
        "changes": [{"report": name, "worse": _worse(found), "changes": plain(found)} for name, found in steps],
        "series": _series(series),
    }
    tables = [change_table(found, f"changes to {name}") for name, found in steps]
    return Statement(sentences, [("engines over time, matched methods", heads, rows), *tables], data)


def _worse(found: Sequence[Change]) -> int:
    return sum(change.effect == "worse" for change in found)


def _about(name: str, record: Record) -> dict[str, Any]:
    engines = {engine: about["version"] for engine, about in record.header["engines"].items()}
    return {
        "report": name,
        "written": record.header["written"],
        "exit_code": record.footer["exit_code"],
        "engines": engines,
        "missing": record.header["missing"],
    }


def _rows(name: str, record: Record) -> Iterator[tuple[str, ...]]:
    """Summarise each engine of a report: answers that agree, all answers, median digits, CPU time."""
    found = answers(record)
    for engine, about in record.header["engines"].items():
        own = [answer for key, answer in found.items() if key[1] == engine and answer.matched]
        if own:
            known = [answer.digits for answer in own if answer.digits is not None]
            yield (
                name,
                record.header["written"],
                engine,
                about["version"],
                str(sum(answer.verdict == Verdict.AGREES for answer in own)),
                str(len(own)),
                digits_text(median(known) if known else None),
                seconds(sum(answer.cpu for answer in own)),
            )


def _series(series: Sequence[NamedRecord]) -> list[dict[str, Any]]:
    """List every answer over time, a point for each report that has the answer."""
    found = grouped(
        (key, _point(name, record, answer)) for name, record in series for key, answer in answers(record).items()
    )
    heads = ("case", "engine", "question", "method")
    return [{**dict(zip(heads, key, strict=True)), "points": points} for key, points in found.items()]


def _point(name: str, record: Record, answer: AnswerSummary) -> dict[str, Any]:
    written = record.header["written"]
    return {"report": name, "written": written, "verdict": answer.verdict, "digits": answer.digits, "cpu": answer.cpu}
