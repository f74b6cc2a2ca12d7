"""Cells of the matrix: what one engine says to one case, matched methods first, and what of it decides."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.report.answers import AnswerView, answer_view
from consilience.report.record import Record
from consilience.report.wording import DASH, NOT_ASKED, QUESTIONS, RANK, YARDSTICK, Look, anchor

REFERENCE = "reference"


@dataclass(frozen=True)
class Mark:
    """One question within a cell: verdict and digits of each matched method, the headline first."""

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
        """Each question asked, what it compares, and the answers to it, those of matched methods first."""
        return [
            (q, text, found) for q, text in QUESTIONS.items() if (found := [a for a in self.answers if a.question == q])
        ]

    @property
    def matched(self) -> list[AnswerView]:
        """Answers with matched settings, which alone decide."""
        return [a for a in self.answers if a.matched]

    @property
    def defaults(self) -> list[AnswerView]:
        """Answers at the engine's own defaults."""
        return [a for a in self.answers if not a.matched]

    @property
    def figures(self) -> bool:
        """Whether there are levels to plot."""
        return any(a.question == "trajectory" and a.tables for a in self.answers)

    @property
    def label(self) -> str:
        """The cell in words, for a screen reader."""
        return f"{self.case}, {self.engine}: {self.look.name}"


def cell_view(record: Record, case: dict[str, Any], engine: str, reference: dict[str, Any] | None) -> Cell:
    """View of one engine on one case; `reference` is the reference's own account of the model."""
    name = case["name"]
    runs, found = ([one for one in own if one["engine"] == engine] for own in record.of_case(name))
    answers = sorted((answer_view(c, record.runs_of(c), case, reference) for c in found), key=lambda a: not a.matched)
    manifests = [r["manifest"] for r in runs if r["manifest"]]
    otherwise = YARDSTICK if engine == REFERENCE else NOT_ASKED
    matched = [a for a in answers if a.matched]
    return Cell(
        anchor=anchor(name, engine),
        case=name,
        title=case["title"],
        engine=engine,
        command=f"consilience run {shlex.quote(name)} -e {shlex.quote(engine)}",
        look=worst([a.look for a in matched], otherwise),
        marks=tuple(_marks(record.header["questions"], matched, otherwise)),
        answers=tuple(answers),
        exact=tuple(manifests[0]["exact"]) if manifests else (),
        approximated=tuple(manifests[0]["approximated"]) if manifests else (),
    )


def worst(looks: Sequence[Look], otherwise: Look) -> Look:
    """The verdict that a cell shows; `otherwise` where nothing was compared."""
    return max(looks, key=lambda look: RANK[look.name], default=otherwise)


def _marks(questions: Sequence[str], answers: Sequence[AnswerView], otherwise: Look) -> Iterator[Mark]:
    for question in questions:
        entries = [(a.look, a.digits if a.digits != DASH else "") for a in answers if a.question == question]
        yield Mark(question, tuple(entries) or ((otherwise, ""),))
