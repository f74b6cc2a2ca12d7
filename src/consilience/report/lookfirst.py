"""View of what to look at first: at most four lines, alike answers in one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from consilience.compare import Verdict
from consilience.engine.failures import FailureClass
from consilience.report.answers import AnswerView
from consilience.report.cells import Cell
from consilience.report.selection import grouped
from consilience.report.wording import LOOKS, Look

MOST = 4
"""Largest number of lines."""

TOLD_BY_CAUSE = ("steps", FailureClass.NOT_FINITE, FailureClass.TIME, FailureClass.MEMORY, FailureClass.CRASH)
"""Causes whose words say as much as the reason in numbers, and are shorter."""


@dataclass(frozen=True)
class LookLine:
    """A line: verdict, cells, and the cause.

    Attributes
    ----------
    badge : str
        The verdict in words, or the digits of a motion of the same model.
    defaults : bool
        Whether the engine ran at its own defaults.
    cause : str
        Method and reason.
    finding : str
        Name of the known finding that shows; empty if there is none.
    """

    look: Look
    badge: str
    cells: tuple[Cell, ...]
    engine: str
    defaults: bool
    cause: str
    finding: str


@dataclass(frozen=True)
class LookFirst:
    """The lines, the number of lines left out, and whether any answer wants a look."""

    lines: tuple[LookLine, ...]
    more: int
    grave: bool


def look_first_view(cells: Sequence[Cell], labels: Mapping[str, str]) -> LookFirst:
    """Collect the answers that are of another model, failed or cannot be told; fill up with the worst of the rest.

    Parameters
    ----------
    cells : sequence of Cell
    labels : mapping of str to str
        Name of each engine as it writes it.
    """
    decisive = [
        (cell, a) for cell in cells if (a := max(cell.counting, key=_gravity, default=None)) and a.look.wants_look
    ]
    grave = list(_lines(decisive, labels))
    rest = list(_lines(_rest(cells), labels)) if len(grave) < MOST else []
    return LookFirst(tuple((grave + rest)[:MOST]), max(len(grave) - MOST, 0), bool(grave))


def _rest(cells: Sequence[Cell]) -> Iterator[tuple[Cell, AnswerView]]:
    """Choose the worst answer of each cell at defaults, and the coarsest best motion of each engine."""
    for cell in cells:
        answers = [a for a in cell.defaults if a.look not in (LOOKS[Verdict.UNSUPPORTED], LOOKS[Verdict.AGREES])]
        worst = max(answers, key=_gravity, default=None)
        if worst and worst.look is not LOOKS[Verdict.DISCRETISATION]:
            yield cell, worst
    coarse = [(c, a) for c in cells for a in c.matched if a.best and a.look is LOOKS[Verdict.DISCRETISATION]]
    for found in grouped((cell.engine, (cell, a)) for cell, a in coarse).values():
        yield max(found, key=lambda pair: _gravity(pair[1]))


def _gravity(answer: AnswerView) -> tuple[tuple[bool, int], float]:
    digits = answer.lines.comparison["digits"]
    return answer.look.urgency, 0.0 if digits is None else -digits


def _lines(found: Iterable[tuple[Cell, AnswerView]], labels: Mapping[str, str]) -> Iterator[LookLine]:
    """Join alike answers of an engine, the gravest first."""
    ordered = sorted(found, key=lambda pair: _gravity(pair[1]), reverse=True)
    alike = grouped(((c.engine, a.look, a.matched, a.question, a.method, a.cause), (c, a)) for c, a in ordered)
    for together in alike.values():
        cell, answer = together[0]
        short = answer.look.tint == "short"
        comparison = answer.lines.comparison
        badge = f"{answer.digits} of {comparison['digits_asked']:g} digits" if short else answer.look.name
        reason = answer.cause if comparison["cause"] in TOLD_BY_CAUSE else answer.why
        method = answer.method if answer.question in answer.method else f"{answer.question}, {answer.method}"
        yield LookLine(
            answer.look,
            badge,
            tuple(c for c, _ in together),
            labels[cell.engine],
            not answer.matched,
            f"{method.removesuffix(', ')}: {reason}",
            comparison["finding"] or "",
        )
