"""Views of the site's pages: texts that templates only place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from consilience.case import Edition
from consilience.compare import Verdict
from consilience.errors import visible
from consilience.report.exports.badge import Badge
from consilience.report.selection import grouped
from consilience.report.site.cellhistory import CellHistory, CellStep, HistoryEntry, SiteReport, version_order
from consilience.report.site.findings import FindingPage, Thread, finding_page
from consilience.report.site.score import ALL, DIGITS, Score, scores
from consilience.report.wording import RANK, anchor, counted, digits_text

MOST_STEPS = 30
"""Largest number of steps of versions on a page."""

WIDTH, HEIGHT, MOST_DIGITS = 640.0, 150.0, 15.0
"""Size of the drawing of a history in px, and the digits at its upper edge."""


@dataclass(frozen=True)
class EngineVersion:
    """A version of an engine over its cells, by the last entry of each."""

    version: str
    date: str
    same: str
    digits: str
    worse: int
    better: int


@dataclass(frozen=True)
class EngineHistory:
    """An engine: a column of the site's matrix, and a page."""

    name: str
    label: str
    version: str
    cells: tuple[CellHistory, ...]
    versions: tuple[EngineVersion, ...]
    steps: tuple[CellStep, ...]

    @property
    def address(self) -> str:
        """Address within the site."""
        return f"engine/{anchor(self.name)}"


@dataclass(frozen=True)
class ShownFinding:
    """A finding that shows in cells of the site; its page where its text is installed."""

    name: str
    page: FindingPage | None
    cells: tuple[CellHistory, ...]

    @property
    def threads(self) -> tuple[Thread, ...]:
        """Threads upstream that it cites."""
        return self.page.threads if self.page else ()


@dataclass(frozen=True)
class Front:
    """Contents of the site's front page.

    Attributes
    ----------
    rows : tuple of (str, str, tuple)
        Name and title of each case, and its cell on each engine, None where it was not asked.
    """

    edition: Edition
    reports: tuple[SiteReport, ...]
    left_out: Mapping[str, str]
    scores: tuple[Score, ...]
    engines: tuple[EngineHistory, ...]
    rows: tuple[tuple[str, str, tuple[CellHistory | None, ...]], ...]
    steps: tuple[CellStep, ...]
    findings: tuple[ShownFinding, ...]
    digits = DIGITS

    @property
    def headline(self) -> str:
        """What the site holds, in a sentence."""
        of = f"{counted(len(self.rows), 'case')} on {counted(len(self.engines), 'engine')}"
        first, last = self.reports[-1].date, self.reports[0].date
        when = f"from {first} to {last}" if first != last else f"of {last}"
        return f"{of}, {counted(len(self.reports), 'report')} {when}"

    @property
    def labels(self) -> dict[str, str]:
        """Labels of the engines by name."""
        return {engine.name: engine.label for engine in self.engines} | {ALL: "All engines"}


def front(
    cells: Sequence[CellHistory], reports: Sequence[SiteReport], left_out: Mapping[str, str], edition: Edition
) -> Front:
    """Make the view of the front page."""
    by_engine = grouped((cell.engine, cell) for cell in cells)
    engines = tuple(_engine(name, by_engine[name]) for name in sorted(by_engine))
    found = {(cell.case, cell.engine): cell for cell in cells}
    names = dict.fromkeys(cell.case for cell in cells)
    titles = {cell.case: cell.current.title for cell in cells}
    rows = tuple((name, titles[name], tuple(found.get((name, engine.name)) for engine in engines)) for name in names)
    return Front(
        edition,
        tuple(sorted(reports, key=lambda report: (report.written, report.address), reverse=True)),
        left_out,
        tuple(scores(cells, edition)),
        engines,
        rows,
        _steps(cells),
        tuple(shown_findings(cells)),
    )


def shown_findings(cells: Sequence[CellHistory]) -> list[ShownFinding]:
    """List the findings that show, each with its cells."""
    found = grouped((name, cell) for cell in cells for name in cell.findings)
    return [ShownFinding(name, finding_page(name), tuple(found[name])) for name in sorted(found)]


def _engine(name: str, cells: Sequence[CellHistory]) -> EngineHistory:
    newest = max((cell.current for cell in cells), key=lambda entry: entry.order)
    own = newest.report.engines[newest.asked]["name"]
    known = grouped((entry.version, entry) for cell in cells for entry in cell.versions)
    steps = [step for cell in cells for step in cell.steps]
    versions = [
        _version(version, known[version], [step for step in steps if step.after.version == version])
        for version in sorted(known, key=version_order, reverse=True)
    ]
    label = name if ":" in name else own or name
    return EngineHistory(name, label, newest.version, tuple(cells), tuple(versions), _steps(cells))


def _version(version: str, entries: Sequence[HistoryEntry], steps: Sequence[CellStep]) -> EngineVersion:
    able = [e for e in entries if e.line["model"] not in (None, Verdict.UNSUPPORTED)]
    same = sum(e.line["model"] == Verdict.AGREES for e in able)
    digits = [e.line["digits"] for e in entries if e.line["digits"] is not None]
    worse = sum(step.worse for step in steps)
    return EngineVersion(
        version,
        max(e.report.date for e in entries),
        f"{same} of {len(able)}",
        digits_text(median(digits) if digits else None),
        worse,
        len(steps) - worse,
    )


def _steps(cells: Sequence[CellHistory]) -> tuple[CellStep, ...]:
    """List steps of versions: those to the worse first, the gravest and latest first."""
    steps = [step for cell in cells for step in cell.steps]
    latest_first = sorted(steps, key=lambda step: version_order(step.after.version), reverse=True)
    gravest_first = sorted(latest_first, key=lambda step: (not step.worse, -RANK[step.after.line["verdict"]]))
    return tuple(gravest_first[:MOST_STEPS])


def drawn_history(cell: CellHistory) -> dict[str, Any] | None:
    """Return the drawing of a history: digits over entries, 0 without a motion; None with fewer than two."""
    entries = cell.entries
    if len(entries) < 2 or all(entry.line["digits"] is None for entry in entries):
        return None
    pitch = WIDTH / len(entries)
    points = [
        {
            "x": round(pitch * (n + 0.5), 1),
            "y": round(HEIGHT * (1.0 - min(max(entry.line["digits"] or 0.0, 0.0), MOST_DIGITS) / MOST_DIGITS), 1),
            "entry": entry,
            "named": pitch >= 45.0 or n in (0, len(entries) - 1),
        }
        for n, entry in enumerate(entries)
    ]
    lines = [{"y": HEIGHT * (1.0 - digits / MOST_DIGITS), "digits": digits} for digits in (0, *DIGITS)]
    return {"width": WIDTH, "height": HEIGHT, "points": points, "lines": lines}


def badges(view: Front) -> dict[str, Badge]:
    """Return the badges by file name: the score at each number of digits, and the cells of each engine that agree."""
    overall = [score for score in view.scores if score.engine == ALL] or view.scores[:1]
    found = {
        f"score-{digits}.svg": _score_badge(view.edition, score, n)
        for score in overall
        for n, digits in enumerate(DIGITS)
    }
    for engine in view.engines:
        found[f"{anchor(engine.name)}.svg"] = _badge(engine)
    return found


def _score_badge(edition: Edition, score: Score, n: int) -> Badge:
    """State a score; only that of all cases is green."""
    subject = f"consilience {edition.name}: {DIGITS[n]} digits"
    if not score.of:
        return Badge(subject, "nothing counts yet", Verdict.UNRESOLVED)
    colour = Verdict.AGREES if score.agreeing[n] == score.of else Verdict.DISCRETISATION
    return Badge(subject, f"{score.shares[n]} of {counted(score.of, 'case')}", colour)


def _badge(engine: EngineHistory) -> Badge:
    """State how many cells mean the same model, with the colour of the worst that does not."""
    models = [Verdict(m) for c in engine.cells if (m := c.current.line["model"]) not in (None, Verdict.UNSUPPORTED)]
    subject = visible(f"consilience: {engine.label} {engine.version}")
    if not models:
        return Badge(subject, "nothing compared", Verdict.UNRESOLVED)
    same = sum(model is Verdict.AGREES for model in models)
    worst = max(models, key=lambda model: RANK[model])
    return Badge(subject, f"same model in {same} of {counted(len(models), 'case')}", worst)
