"""View of a cell of the matrix: answers of one engine about one case, matched methods first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.engine import Question
from consilience.report.answers import AnswerView, answer_view
from consilience.report.record import Record
from consilience.report.selection import AnswerLines
from consilience.report.wording import DASH, LOOKS, NOT_ASKED, YARDSTICK, Look, cell_anchor


@dataclass(frozen=True)
class QuestionSummary:
    """One question of a cell: verdict and digits of each matched method, the headline first."""

    question: str
    entries: tuple[tuple[Look, str], ...]


@dataclass(frozen=True)
class Layer:
    """One question of a cell: the worst verdict of its matched methods, and all answers.

    The page shows layers with `opened` unfolded: those that do not plainly agree; if all agree, the last.
    """

    question: str
    sentence: str
    look: Look
    cause: str
    digits: str
    answers: tuple[AnswerView, ...]
    opened: bool


@dataclass(frozen=True)
class Cell:
    """One engine on one case: a cell of the matrix, and a page."""

    anchor: str
    case: str
    engine: str
    command: str
    look: Look
    marks: tuple[QuestionSummary, ...]
    answers: tuple[AnswerView, ...]
    exact: tuple[str, ...]
    approximated: tuple[str, ...]

    @property
    def layers(self) -> list[Layer]:
        """Layers of the questions asked: an error in one layer leads to errors in the next."""
        found = [(q, q.description, [a for a in self.answers if a.question == q]) for q in Question]
        asked = [(q, text, answers, _decisive(answers)) for q, text, answers in found if answers]
        open_ones = [n for n, (_, _, _, a) in enumerate(asked) if a and a.look is not LOOKS[Verdict.AGREES]]
        return [
            Layer(
                question=q,
                sentence=text,
                look=decisive.look if decisive else NOT_ASKED,
                cause=decisive.cause if decisive else "Asked at the engine's defaults alone.",
                digits=decisive.digits if decisive else DASH,
                answers=tuple(answers),
                opened=n in (open_ones or [len(asked) - 1]),
            )
            for n, (q, text, answers, decisive) in enumerate(asked)
        ]

    @property
    def decisive(self) -> AnswerView | None:
        """Answer that decides the verdict of the cell."""
        return _decisive(self.matched)

    @property
    def matched(self) -> list[AnswerView]:
        """Answers with matched settings, which alone decide."""
        return [a for a in self.answers if a.matched]

    @property
    def counting(self) -> list[AnswerView]:
        """Answers that count for the verdict of the cell."""
        return [a for a in self.answers if a.counts]

    @property
    def defaults(self) -> list[AnswerView]:
        """Answers at the engine's own defaults."""
        return [a for a in self.answers if not a.matched]

    @property
    def figures(self) -> bool:
        """Whether there are levels to plot."""
        return any(Question(a.question).over_time and a.tables for a in self.answers)

    @property
    def blind(self) -> bool:
        """Whether an answer with matched settings would have passed with an error of 10 % in a parameter that acts."""
        return any(a.blind for a in self.matched)


def cell_view(record: Record, case: dict[str, Any], engine: str, reference: dict[str, Any] | None) -> Cell:
    """Make the view of a cell; `reference` is the answer of the reference to the question `model`."""
    name = case["name"]
    runs, found = ([one for one in own if one["engine"] == engine] for own in record.of_case(name))
    lines = (AnswerLines(c, record.runs_of(c), case, reference) for c in found)
    answers = sorted(map(answer_view, lines), key=lambda a: not a.matched)
    manifests = [r["manifest"] for r in runs if r["manifest"]]
    otherwise = YARDSTICK if engine == REFERENCE else NOT_ASKED
    matched = [a for a in answers if a.matched]
    return Cell(
        anchor=cell_anchor(name, engine),
        case=name,
        engine=engine,
        command=record.again(case, engine),
        look=max((a.look for a in answers if a.counts), key=lambda look: look.rank, default=otherwise),
        marks=tuple(_marks(record.header["questions"], matched, otherwise)),
        answers=tuple(answers),
        exact=tuple(manifests[0]["exact"]) if manifests else (),
        approximated=tuple(manifests[0]["approximated"]) if manifests else (),
    )


def _decisive(answers: Sequence[AnswerView]) -> AnswerView | None:
    """Return the first answer that counts with the worst verdict."""
    return max((a for a in answers if a.counts), key=lambda a: a.look.rank, default=None)


def _marks(questions: Sequence[str], answers: Sequence[AnswerView], otherwise: Look) -> Iterator[QuestionSummary]:
    for question in questions:
        entries = [(a.look, a.digits if a.digits != DASH else "") for a in answers if a.question == question]
        yield QuestionSummary(question, tuple(entries) or ((otherwise, ""),))
