"""View of a record, shared by the HTML page and the Markdown page.

A view holds text that a template only places: numbers are formatted with their units, and absent values are dashes. A
quantity without a compared value is never shown as a difference of 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.report.answers import AnswerView
from consilience.report.cases import CaseView, case_view
from consilience.report.cells import Cell
from consilience.report.choice import Choice, choice_view
from consilience.report.defaults import Defaults, defaults_view
from consilience.report.engines import EngineView, Group, engine_view
from consilience.report.facts import Fact
from consilience.report.headline import headline
from consilience.report.lookfirst import LookFirst, look_first_view
from consilience.report.record import Record
from consilience.report.standings import GROUPS, HEADS, EngineStanding, standings
from consilience.report.tables import MethodTable, method_tables
from consilience.report.tiles import MatrixRow, matrix_rows
from consilience.report.wording import EXIT_CODES, LOOKS, NOT_ASKED, ROUTES, YARDSTICK, Look, counted

QUICKLY = "quickly (few states, the start of each motion by one method of each engine)"


@dataclass(frozen=True)
class Page:
    """Contents of a page; `columns` are names and versions of the engines `engine_names` that the matrix shows.

    `headline` is the sentence about the model, `sentences` are those about motions and engines that are not available.
    """

    headline: str
    sentences: tuple[str, ...]
    summary: str
    status: str
    exit_code: int
    again: str
    facts: tuple[Fact, ...]
    columns: tuple[tuple[str, str], ...]
    engine_names: tuple[str, ...]
    missing: tuple[tuple[str, str], ...]
    standings: tuple[EngineStanding, ...]
    look_first: LookFirst
    rows: tuple[MatrixRow, ...]
    cases: tuple[CaseView, ...]
    choice: Choice
    defaults: Defaults
    tables: tuple[MethodTable, ...]
    engines: tuple[EngineView, ...]
    questions: tuple[str, ...]
    legend: tuple[Look, ...] = (*LOOKS.values(), NOT_ASKED, YARDSTICK)
    routes: tuple[tuple[str, str], ...] = tuple(ROUTES.values())
    groups = GROUPS
    heads = HEADS

    @property
    def cells(self) -> list[Cell]:
        """All cells, row by row, with those of the reference."""
        return [cell for case in self.cases for cell in case.cells]

    @property
    def soft(self) -> bool:
        """Whether a cell of the matrix is marked for soft constraints."""
        marks = [mark for row in self.rows for tile in row.tiles for mark in tile.marks]
        return any(mark.look is LOOKS[Verdict.REGULARISATION] for mark in marks)

    @property
    def tags(self) -> list[tuple[str, int]]:
        """Tags with the number of their cases, the most frequent first."""
        count = Counter(tag for case in self.cases for tag in case.tags)
        return sorted(count.items(), key=lambda pair: (-pair[1], pair[0]))

    @property
    def findings(self) -> list[tuple[EngineView, Group]]:
        """Groups of cells that do not plainly agree, the gravest verdict first."""
        found = [(engine, group) for engine in self.engines for group in engine.differing]
        return sorted(found, key=lambda pair: -pair[1].look.rank if pair[1].look else 0)

    @property
    def remarkable(self) -> list[tuple[Cell, AnswerView]]:
        """Answers with matched settings that do not plainly agree, the worst verdict first."""
        found = [(c, a) for c in self.cells for a in c.matched if a.look is not LOOKS[Verdict.AGREES]]
        return sorted(found, key=lambda pair: -pair[1].look.rank)


def page(record: Record) -> Page:
    """Make the view of a record."""
    engines = record.header["engines"]
    # the engines in the order asked; the reference comes last
    labels = {name: name if ":" in name or "@" in name else about["name"] or name for name, about in engines.items()}
    names = sorted(engines, key=lambda name: name == REFERENCE)
    asked = tuple(case_view(record, case, names) for case in record.cases)
    doubted = any(line["verdict"] != Verdict.AGREES for line in record.cells if line["engine"] == REFERENCE)
    columns = [name for name in names if name != REFERENCE or doubted]
    rows = matrix_rows(record, asked, columns)
    cases = tuple(row.case for row in rows)
    every = [cell for case in cases for cell in case.cells]
    told, *sentences = (f"{sentence[0].upper()}{sentence[1:]}." for sentence in headline(record))
    code, quick = record.footer["exit_code"], bool(record.header.get("quick"))
    views = tuple(_engine(name, engines[name], every) for name in names if name != REFERENCE)
    return Page(
        headline=told,
        sentences=tuple(sentences),
        summary=_summary(record, len(columns), quick),
        status=EXIT_CODES.get(code, "unknown"),
        exit_code=code,
        again=record.again(),
        facts=tuple(_facts(record.header)),
        columns=tuple((labels[name], engines[name]["version"]) for name in columns),
        engine_names=tuple(columns),
        missing=tuple(record.header["missing"].items()),
        standings=standings(record, [cell for cell in every if cell.engine != REFERENCE], labels),
        look_first=look_first_view([cell for cell in every if cell.engine in columns], labels),
        rows=rows,
        cases=cases,
        choice=choice_view(record, views),
        defaults=defaults_view(every, quick),
        tables=method_tables(every, quick),
        engines=views,
        questions=tuple(str(q) for q in record.header["questions"]),
    )


def _engine(name: str, info: dict[str, str], cells: Sequence[Cell]) -> EngineView:
    facts = [Fact("version", info["version"]), Fact("adapter", info["adapter"])]
    facts += [Fact("remarks", info["remarks"])] if info["remarks"] else []
    return engine_view(name, facts, [c for c in cells if c.engine == name])


def _summary(record: Record, engines: int, quick: bool) -> str:
    """State how much was asked, and when."""
    asked = f"{counted(len(record.cases), 'case')}, {counted(engines, 'engine')}"
    return f"{asked}, asked {'quickly' if quick else 'in full'}; {record.header['written'][:10]}"


def _facts(header: dict[str, Any]) -> Iterator[Fact]:
    yield Fact("written", header["written"].replace("T", " ").replace("+00:00", " UTC"))
    yield Fact("took", f"{header['elapsed']:.3g} s")
    if header.get("quick") is not None:
        yield Fact("asked", QUICKLY if header["quick"] else "in full")
    yield Fact("machine", f"{header['processor']}, {header['platform']}")
    packages = {"Python": header["python"], **header["packages"]}
    yield Fact("versions", ", ".join(f"{name} {version}" for name, version in packages.items()))
    for engine in header["engines"].values():
        yield Fact(f"engine {engine['name']}", f"{engine['version']}, adapter {engine['adapter']}", engine["remarks"])
    for name, reason in header["missing"].items():
        yield Fact(f"engine {name}", "not available", reason)
