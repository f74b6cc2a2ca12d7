"""View of an engine: answers, unsupported features, differences by cause, known findings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from consilience.compare import Verdict
from consilience.engine import Question
from consilience.report.cells import Cell
from consilience.report.facts import Fact
from consilience.report.findings import KnownFinding, known_findings
from consilience.report.wording import LOOKS, Look, anchor, counted


@dataclass(frozen=True)
class Group:
    """Cells with the same text: a reason, a line of a manifest or a cause."""

    text: str
    look: Look | None
    cells: tuple[Cell, ...]

    @property
    def count(self) -> str:
        """Number of cases, in words."""
        return counted(len(self.cells), "case")


@dataclass(frozen=True)
class EngineView:
    """An engine: a column of the matrix, and a page."""

    anchor: str
    name: str
    facts: tuple[Fact, ...]
    tallies: tuple[tuple[str, tuple[tuple[Look, int], ...]], ...]
    unsupported: tuple[Group, ...]
    differing: tuple[Group, ...]
    approximated: tuple[Group, ...]
    known: tuple[KnownFinding, ...]
    cells: tuple[Cell, ...]

    @property
    def supported(self) -> str:
        """Number of cases that the engine can represent, in words."""
        able = sum(any(a.look is not LOOKS[Verdict.UNSUPPORTED] for a in c.matched) for c in self.cells)
        return f"It represents {able} of {counted(len(self.cells), 'case')} of this run."


def engine_view(name: str, facts: Sequence[Fact], cells: Sequence[Cell]) -> EngineView:
    """Make the view of an engine from its cells."""
    answers = [(cell, a) for cell in cells for a in cell.matched]
    return EngineView(
        anchor=anchor("page", "engine", name),  # an identifier of a cell has two names
        name=name,
        facts=tuple(facts),
        tallies=tuple((q, _tally(a.look for _, a in answers if a.question == q)) for q in Question),
        unsupported=_grouped((reason, None, cell) for cell, a in answers for reason in a.unsupported),
        differing=_grouped(
            (f"{a.question}, {a.title}: {a.cause}", a.look, cell)
            for cell, a in answers
            if a.look not in (LOOKS[Verdict.AGREES], LOOKS[Verdict.UNSUPPORTED])
        ),
        approximated=_grouped((line, None, cell) for cell in cells for line in cell.approximated),
        known=known_findings().get(name.partition(":")[0], ()),
        cells=tuple(cells),
    )


def _tally(looks: Iterable[Look]) -> tuple[tuple[Look, int], ...]:
    found = list(looks)
    return tuple((look, found.count(look)) for look in LOOKS.values() if look in found)


def _grouped(entries: Iterable[tuple[str, Look | None, Cell]]) -> tuple[Group, ...]:
    """Group cells by text and verdict, the gravest verdict first, then the most frequent."""
    found: dict[tuple[str, Look | None], dict[str, Cell]] = {}
    for text, look, cell in entries:
        found.setdefault((text, look), {})[cell.anchor] = cell
    groups = [Group(text, look, tuple(cells.values())) for (text, look), cells in found.items()]
    return tuple(sorted(groups, key=lambda g: (-g.look.rank if g.look else 0, -len(g.cells))))
