"""What the pages say, before any page is written: one view of a record, used for HTML and for Markdown alike.

Everything here is text that a template only has to place. Numbers are formatted, units are given, and absent values
are dashes: a quantity of which no value was compared is never shown as a difference of 0.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.report.answers import AnswerView, Entry, answer_view
from consilience.report.record import Record
from consilience.report.wording import (
    DASH,
    EXIT_CODES,
    LOOKS,
    NOT_ASKED,
    PHRASES,
    QUESTIONS,
    RANK,
    ROUTES,
    YARDSTICK,
    Look,
    anchor,
    counted,
    digits_text,
    number,
    order_text,
)

REFERENCE = "reference"


@dataclass(frozen=True)
class Mark:
    """One question within a cell: verdict and digits of each method, the headline first."""

    question: str
    entries: tuple[tuple[Look, str], ...]


@dataclass(frozen=True)
class Cell:
    """One engine on one case: what the matrix shows, and what opens from it."""

    anchor: str
    case: str
    title: str
    engine: str
    command: str
    look: Look
    marks: tuple[Mark, ...]
    answers: tuple[AnswerView, ...]
    exact: tuple[str, ...]
    approximated: tuple[str, ...]

    @property
    def questions(self) -> list[tuple[str, str, list[AnswerView]]]:
        """Each question asked, what it compares, and the answers to it."""
        return [
            (q, text, found) for q, text in QUESTIONS.items() if (found := [a for a in self.answers if a.question == q])
        ]

    @property
    def figures(self) -> bool:
        """Whether there are levels to plot."""
        return any(a.levels.rows for a in self.answers)

    @property
    def label(self) -> str:
        """The cell in words, for a screen reader."""
        return f"{self.case}, {self.engine}: {self.look.name}"


@dataclass(frozen=True)
class CaseView:
    """A case: one row of the matrix, one section of the page."""

    anchor: str
    name: str
    title: str
    facts: tuple[Entry, ...]
    bodies: tuple[str, ...]
    joints: tuple[tuple[str, str, str, str], ...]
    sources: tuple[str, ...]
    remarks: tuple[str, ...]
    tags: tuple[str, ...]
    command: str
    figures: bool
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Column:
    """An engine of the matrix."""

    name: str
    version: str
    remarks: str


@dataclass(frozen=True)
class Tally:
    """How many cells have a verdict, and which ones."""

    look: Look
    count: int
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class OrderRow:
    """Observed orders of one method of one engine on one case."""

    cell: Cell
    answer: AnswerView
    values: tuple[str, ...]


@dataclass(frozen=True)
class Page:
    """Everything a page says."""

    headline: str
    status: str
    exit_code: int
    facts: tuple[Entry, ...]
    tallies: tuple[Tally, ...]
    columns: tuple[Column, ...]
    missing: tuple[tuple[str, str], ...]
    cases: tuple[CaseView, ...]
    orders: tuple[OrderRow, ...]
    legend: tuple[Look, ...] = (*LOOKS.values(), NOT_ASKED, YARDSTICK)
    routes: tuple[tuple[str, str], ...] = tuple(ROUTES.values())
    order_heads: tuple[str, ...] = (
        "declared",
        "to the reference",
        "among the levels",
        "finest, digits",
        "limit, digits",
        "band",
    )

    @property
    def cells(self) -> list[Cell]:
        """All cells, row by row, the reference's included."""
        return [cell for case in self.cases for cell in case.cells]

    @property
    def remarkable(self) -> list[tuple[Cell, AnswerView]]:
        """Every answer that does not plainly agree, worst first."""
        found = [(c, a) for c in self.cells for a in c.answers if a.look is not LOOKS[Verdict.AGREES]]
        return sorted(found, key=lambda pair: -RANK[pair[1].look.name])


def page(record: Record) -> Page:
    """View of a record."""
    columns = _columns(record.header)
    cases = tuple(_case(record, case, columns) for case in record.cases)
    cells = [cell for case in cases for cell in case.cells if cell.engine != REFERENCE]
    code = record.footer["exit_code"]
    tallies = _tallies(cells)
    return Page(
        headline=_headline(cells, tallies, record),
        status=EXIT_CODES.get(code, "unknown"),
        exit_code=code,
        facts=tuple(_facts(record.header)),
        tallies=tallies,
        columns=columns,
        missing=tuple(record.header["missing"].items()),
        cases=cases,
        orders=tuple(_orders(record, cases)),
    )


def _columns(header: dict[str, Any]) -> tuple[Column, ...]:
    """Engines that started, in the order asked; the reference, which is the yardstick, last."""
    names = sorted(header["engines"], key=lambda name: name == REFERENCE)
    return tuple(Column(n, header["engines"][n]["version"], header["engines"][n]["remarks"]) for n in names)


def _tallies(cells: Sequence[Cell]) -> tuple[Tally, ...]:
    groups = ((look, tuple(c for c in cells if c.look is look)) for look in (*LOOKS.values(), NOT_ASKED))
    return tuple(Tally(look, len(found), found) for look, found in groups if found)


def _headline(cells: Sequence[Cell], tallies: Sequence[Tally], record: Record) -> str:
    """How many cells agree, which verdicts the others have, and what is missing."""
    count = {t.look.name: t.count for t in tallies}
    parts = [f"{count.get(Verdict.AGREES, 0)} of {counted(len(cells), 'cell')} {PHRASES[Verdict.AGREES]}"]
    parts += [f"{count[v]} {PHRASES[v]}" for v in LOOKS if v in count and v is not Verdict.AGREES]
    missing = record.header["missing"]
    if missing:
        parts.append(f"{counted(len(missing), 'engine')} not available ({', '.join(missing)})")
    return "; ".join(parts) + "."


def _facts(header: dict[str, Any]) -> Iterator[Entry]:
    yield Entry("written", header["written"].replace("T", " ").replace("+00:00", " UTC"))
    yield Entry("took", f"{header['elapsed']:.3g} s")
    yield Entry("machine", f"{header['processor']}, {header['platform']}")
    packages = {"Python": header["python"], **header["packages"]}
    yield Entry("versions", ", ".join(f"{name} {version}" for name, version in packages.items()))
    for engine in header["engines"].values():
        yield Entry(f"engine {engine['name']}", f"{engine['version']}, adapter {engine['adapter']}", engine["remarks"])
    for name, reason in header["missing"].items():
        yield Entry(f"engine {name}", "not available", reason)


def _case(record: Record, case: dict[str, Any], columns: Sequence[Column]) -> CaseView:
    name = case["name"]
    reference = _reference_model(record, name)
    return CaseView(
        anchor=anchor("case", name),
        name=name,
        title=case["title"],
        facts=tuple(_case_facts(case, reference)),
        bodies=tuple(case["bodies"]),
        joints=tuple((j[0], j[1], j[2], j[3]) for j in case["joints"]),
        sources=tuple(case["sources"]),
        remarks=tuple(unwrapped(p) for p in case["remarks"].split("\n\n") if p.strip()),
        tags=tuple(case["tags"]),
        command=f"consilience run {shlex.quote(name)}",
        figures=any(c["case"] == name and c["levels"] for c in record.comparisons),
        cells=tuple(_cell(record, case, column.name, reference) for column in columns),
    )


def unwrapped(paragraph: str) -> str:
    """A paragraph without the line breaks of its file; indented lines keep theirs."""
    text = ""
    for line, before in zip((lines := paragraph.strip("\n").split("\n")), ["", *lines], strict=False):
        text += ("\n" if line.startswith(" ") or before.startswith(" ") else " ") + line.strip()
    return text.strip()


def _reference_model(record: Record, case: str) -> dict[str, Any] | None:
    """The reference's own account of the model, if it was asked for."""
    found = (r["answer"] for r in record.runs if (r["case"], r["engine"], r["question"]) == (case, REFERENCE, "model"))
    return next((answer for answer in found if answer), None)


def _case_facts(case: dict[str, Any], reference: dict[str, Any] | None) -> Iterator[Entry]:
    rows = case["rows"]
    if reference is not None:
        dependent = rows - (6 * len(case["bodies"]) - reference["freedom"])
        yield Entry("degrees of freedom", str(reference["freedom"]))
        yield Entry("constraint rows", str(rows), f"{dependent} of them dependent")
        yield Entry("total mass", f"{number(reference['mass'], 3)} kg")
    else:
        yield Entry("constraint rows", str(rows))
    yield Entry("trajectory", f"{case['duration']:g} s", f"sampled every {case['sample']:g} s")
    yield Entry("digits asked of a trajectory", str(case["digits"]))
    yield Entry("states of the question instant", str(case["instants"]))


def _cell(record: Record, case: dict[str, Any], engine: str, reference: dict[str, Any] | None) -> Cell:
    name = case["name"]
    runs = [r for r in record.runs if (r["case"], r["engine"]) == (name, engine)]
    found = [c for c in record.comparisons if (c["case"], c["engine"]) == (name, engine)]
    answers = tuple(answer_view(c, _runs_of(c, runs), case, reference) for c in found)
    manifests = [r["manifest"] for r in runs if r["manifest"]]
    return Cell(
        anchor=anchor(name, engine),
        case=name,
        title=case["title"],
        engine=engine,
        command=f"consilience run {shlex.quote(name)} -e {shlex.quote(engine)}",
        look=worst([a.look for a in answers], YARDSTICK if engine == REFERENCE else NOT_ASKED),
        marks=tuple(_marks(record.header["questions"], answers, YARDSTICK if engine == REFERENCE else NOT_ASKED)),
        answers=answers,
        exact=tuple(manifests[0]["exact"]) if manifests else (),
        approximated=tuple(manifests[0]["approximated"]) if manifests else (),
    )


def worst(looks: Sequence[Look], otherwise: Look) -> Look:
    """The verdict that a cell shows; `otherwise` where nothing was compared."""
    return max(looks, key=lambda look: RANK[look.name], default=otherwise)


def _runs_of(comparison: dict[str, Any], runs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Runs that a comparison judges, coarse to fine."""
    key = (comparison["question"], comparison["method"])
    return [r for r in runs if (r["question"], r["method"]["name"] if r["method"] else "") == key]


def _marks(questions: Sequence[str], answers: Sequence[AnswerView], otherwise: Look) -> Iterator[Mark]:
    for question in questions:
        entries = [(a.look, a.digits if a.digits != DASH else "") for a in answers if a.question == question]
        yield Mark(question, tuple(entries) or ((otherwise, ""),))


def _orders(record: Record, cases: Sequence[CaseView]) -> Iterator[OrderRow]:
    """One row for every trajectory by a method of declared order that was compared."""
    found = {(c["case"], c["engine"], c["method"]): c for c in record.comparisons if c["levels"]}
    for cell in (cell for case in cases for cell in case.cells):
        for answer in cell.answers:
            c = found.get((cell.case, cell.engine, answer.method))
            if answer.question == "trajectory" and c is not None and c["declared_order"] is not None:
                values = (
                    str(c["declared_order"]),
                    order_text(c["order"]),
                    order_text(c["self_order"]),
                    digits_text(c["digits"]),
                    digits_text(c["limit_digits"]),
                    number(c["band"]),
                )
                yield OrderRow(cell, answer, values)
