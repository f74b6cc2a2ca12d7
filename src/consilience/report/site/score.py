"""Interop score: share of the cases of an edition on which engines agree to 3, 6, 9 and 12 digits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from consilience.case import Edition
from consilience.compare import Verdict
from consilience.compare.judge import REFERENCE
from consilience.report.selection import grouped
from consilience.report.site.cellhistory import CellHistory, HistoryEntry
from consilience.report.wording import counted

DIGITS = (3, 6, 9, 12)
"""Digits of the score."""

ALL = "all engines"

_MOVES_ALIKE = (Verdict.AGREES, Verdict.DISCRETISATION, Verdict.REGULARISATION)


@dataclass(frozen=True)
class Score:
    """Score of one engine or of all together.

    Attributes
    ----------
    engine : str
        Name, or `ALL`.
    agreeing : tuple of int
        Number of cases with agreement, for each of `DIGITS`.
    of, unsupported : int
        Number of cases of the edition that count, and of those among them that an engine cannot represent.
    left_out : tuple of (str, int)
        Why other cases of the edition do not count, and how many.
    """

    engine: str
    agreeing: tuple[int, ...]
    of: int
    unsupported: int
    left_out: tuple[tuple[str, int], ...]

    @property
    def shares(self) -> list[str]:
        """Shares in percent, rounded down; empty if no case counts."""
        return [f"{100 * count // self.of} %" for count in self.agreeing] if self.of else []

    @property
    def digits_agreed(self) -> dict[str, int]:
        """Number of cases with agreement, by digits."""
        return {str(digits): count for digits, count in zip(DIGITS, self.agreeing, strict=True)}

    @property
    def note(self) -> str:
        """What the score is of, and what does not count, in words."""
        told = [f"{counted(count, 'case')} {why}" for why, count in self.left_out]
        beyond = [f"{self.unsupported} of them unsupported"] * bool(self.unsupported)
        return "; ".join([", ".join([f"of {counted(self.of, 'case')}", *beyond]), *told])


def digits_of_agreement(entry: HistoryEntry) -> float:
    """Return the digits to which an engine agrees with the reference on a case: 0 for another model or no motion.

    The model must be the same where nothing is integrated; then the best motion counts with the digits that it has.
    """
    line = entry.line
    same = line["model"] in (None, Verdict.AGREES) and line["motion"] in _MOVES_ALIKE
    return line["digits"] or 0.0 if same else 0.0


def why_not(entry: HistoryEntry | None, digest: str) -> str:
    """Return why an answer does not count for an edition; empty if it does."""
    if entry is None:
        return "not asked"
    if entry.digest != digest:
        return "changed since the edition" if entry.digest else "without a digest in the report"
    return "asked quickly" if entry.report.quick else ""


def scores(cells: Sequence[CellHistory], edition: Edition) -> list[Score]:
    """Return the score of all engines, then of each, by the last full answers of their newest versions.

    Formulations of the reference are no engines here. A case counts for all engines if it counts for each.
    """
    current = grouped((c.engine, (c.case, c.in_full)) for c in cells if c.engine.partition(":")[0] != REFERENCE)
    last = {engine: dict(found) for engine, found in current.items()}
    groups = {ALL: list(last)} if len(last) > 1 else {}
    return [_score(name, [last[e] for e in own], edition) for name, own in (groups | {e: [e] for e in last}).items()]


def _score(name: str, engines: Sequence[dict[str, HistoryEntry]], edition: Edition) -> Score:
    agreeing, left_out, of, unsupported = [0] * len(DIGITS), Counter[str](), 0, 0
    for case, digest in edition.digests.items():
        entries = [own.get(case) for own in engines]
        reasons = [reason for entry in entries if (reason := why_not(entry, digest))]
        if reasons:
            left_out[reasons[0]] += 1
            continue
        found = [entry for entry in entries if entry is not None]
        of += 1
        unsupported += any(Verdict.UNSUPPORTED in (e.line["model"], e.line["motion"]) for e in found)
        least = min(map(digits_of_agreement, found))
        for n, digits in enumerate(DIGITS):
            agreeing[n] += least >= digits
    return Score(name, tuple(agreeing), of, unsupported, tuple(left_out.most_common()))
