"""First bad release: bisection over the versions of an engine, each asked in an environment of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.report.history.changes import Change, change_table, changes, plain
from consilience.report.record import Record
from consilience.report.statement import Statement
from consilience.report.wording import DASH, RANK, digits_text

AskVersion = Callable[[str], Record | str]
"""Function from the name of an engine with its version to a record, or to the reason why there is none."""


@dataclass(frozen=True)
class TriedVersion:
    """A version that was tried.

    Attributes
    ----------
    record : Record or None
        None if the version could not be asked.
    worse : tuple of Change
        What is worse than in the first version that could be asked.
    why : str
        Why the version could not be asked; empty if it was.
    """

    version: str
    record: Record | None
    worse: tuple[Change, ...] = ()
    why: str = ""

    @property
    def outcome(self) -> str:
        """``good``, ``bad`` or ``not asked``."""
        return "not asked" if self.record is None else "bad" if self.worse else "good"


@dataclass(frozen=True)
class Bisection:
    """Trials of an engine by ascending version, and the two that enclose the change; None where there is none."""

    engine: str
    trials: tuple[TriedVersion, ...]
    last_good: TriedVersion | None = None
    first_bad: TriedVersion | None = None

    @property
    def between(self) -> tuple[TriedVersion, ...]:
        """Trials between the last good and the first bad version: those that could not be asked."""
        if self.last_good is None or self.first_bad is None:
            return ()
        return self.trials[self.trials.index(self.last_good) + 1 : self.trials.index(self.first_bad)]


def bisect(engine: str, versions: Sequence[str], ask: AskVersion, digits: float) -> Bisection:
    """Find the first version whose answers are worse than those of the first version.

    A version that cannot be asked is passed over, as in ``git bisect skip``. If quality comes and goes between the two
    ends, one of the changes to the worse is found.

    Parameters
    ----------
    engine : str
    versions : sequence of str
        In ascending order.
    ask : callable
    digits : float
        Least loss of digits that counts.
    """
    found: dict[int, TriedVersion] = {}

    def attempt(number: int) -> TriedVersion:
        if number not in found:
            name = f"{engine}@{versions[number]}"
            record, base = ask(name), next((t for t in found.values() if t.record is not None), None)
            if isinstance(record, str):
                found[number] = TriedVersion(versions[number], None, why=record)
            else:
                worse = _worse(base, record, engine, versions[number], digits)
                found[number] = TriedVersion(versions[number], record, worse)
        return found[number]

    def enclosing() -> tuple[TriedVersion | None, TriedVersion | None]:
        low = next((n for n in range(len(versions)) if attempt(n).record is not None), None)
        if low is None:
            return None, None
        high = next(n for n in range(len(versions) - 1, low - 1, -1) if attempt(n).record is not None)
        if found[high].outcome == "good":
            return found[high], None
        while open_ones := [n for n in range(low + 1, high) if n not in found]:
            middle = open_ones[len(open_ones) // 2]
            outcome = attempt(middle).outcome
            low, high = (middle, high) if outcome == "good" else (low, middle) if outcome == "bad" else (low, high)
        return found[low], found[high]

    good, bad = enclosing()
    return Bisection(engine, tuple(found[n] for n in sorted(found)), good, bad)


def _worse(base: TriedVersion | None, record: Record, engine: str, version: str, digits: float) -> tuple[Change, ...]:
    if base is None or base.record is None:
        return ()
    names = {f"{engine}@{base.version}": f"{engine}@{version}"}
    return tuple(c for c in changes(base.record, record, names, digits) if c.effect == "worse")


def bisection_statement(found: Bisection) -> Statement:
    """State a bisection: the first bad version, what is worse in it, and all versions that were tried."""
    rows = [(trial.version, trial.outcome, *_answer(found.engine, trial), trial.why) for trial in found.trials]
    heads = ("version", "outcome", "model", "motion", "digits", "why")
    bad, good = found.first_bad, found.last_good
    data: dict[str, Any] = {
        "engine": found.engine,
        "first_bad": bad.version if bad else None,
        "last_good": good.version if good else None,
        "not_asked_between": [trial.version for trial in found.between],
        "changes": plain(bad.worse) if bad else [],
        "trials": [dict(zip(heads, row, strict=True)) for row in rows],
    }
    tables = [change_table(bad.worse, f"worse in {bad.version}")] if bad else []
    return Statement(list(_sentences(found)), [*tables, (f"versions of {found.engine} tried", heads, rows)], data)


def _sentences(found: Bisection) -> Iterator[str]:
    bad, good = found.first_bad, found.last_good
    if good is None:
        yield f"{found.engine}: no version could be asked."
        return
    first = next(trial for trial in found.trials if trial.record is not None)
    between = f"; {', '.join(t.version for t in found.between)} between them could not be asked" * bool(found.between)
    if bad is None:
        yield f"{found.engine}: nothing is worse in {good.version} than in {first.version}."
    else:
        yield f"{found.engine}: first bad version {bad.version}, last good version {good.version}{between}."
    verdict, *_ = _answer(found.engine, first)
    if verdict not in (DASH, Verdict.AGREES):
        yield f"{first.version}, with which the others are compared, does not agree itself: {verdict}."


def _answer(engine: str, trial: TriedVersion) -> tuple[str, str, str]:
    """Return the worst verdict at model and instants, that of the motion, and the least digits of it."""
    cells = (
        [] if trial.record is None else [c for c in trial.record.cells if c["engine"] == f"{engine}@{trial.version}"]
    )
    if not cells:
        return DASH, DASH, DASH
    models, motions = ([c[what] for c in cells if c[what]] for what in ("model", "motion"))
    digits = [c["digits"] for c in cells if c["digits"] is not None]
    return _gravest(models), _gravest(motions), digits_text(min(digits, default=None))


def _gravest(verdicts: Sequence[str]) -> str:
    return max(verdicts, key=lambda verdict: RANK[verdict], default=DASH)
