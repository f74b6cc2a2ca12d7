"""Changes between two records: versions, cases, engines, and verdict, digits and time of every answer.

Answers correspond where case, engine, question and method are equal. A change is worse where the verdict is further
down the list of `Verdict`, digits are lost, or an engine no longer starts. Three kinds of changes are listed and never
called worse: those of answers at the engines' own defaults, which decide nothing; those of answers to a case that asks
something else, which cannot be compared; and those of times, which are noisy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.report.record import Record
from consilience.report.selection import is_matched
from consilience.report.wording import digits_text, seconds

DIGITS = 0.5
"""Least change in digits that is listed by default: a factor of three in the difference."""

RATIO, LEAST_TIME = 2.0, 0.1
"""Least ratio of CPU times that is listed, and the least longer time in s."""

AnswerKey = tuple[str, str, str, str]
"""Case, engine, question and method."""

HEADS = {"effect": "", "kind": "what", "where": "where", "before": "before", "after": "after", "why": "why"}
"""Columns of a table of changes."""

_ORDER = [str(verdict) for verdict in Verdict]

_ASKED = ("duration", "sample", "digits", "instants", "bodies", "joints", "rows")
"""Fields of a case in the record that decide its answers."""


@dataclass(frozen=True)
class Change:
    """A change from one record to another.

    Attributes
    ----------
    kind : {"version", "case", "engine", "answer", "verdict", "digits", "time"}
    effect : {"worse", "better", ""}
        Empty for a change that is neither.
    where : str
        Name of what has changed.
    before, after : str
        Values; empty where a record has none.
    why : str
        Reason of a verdict in the later record.
    """

    kind: str
    effect: str
    where: str
    before: str
    after: str
    why: str = ""


@dataclass(frozen=True)
class AnswerSummary:
    """Verdict, digits and time of an answer in a record.

    Attributes
    ----------
    cpu : float, s
        CPU time of all runs of the method.
    matched : bool
        Whether the engine ran with matched settings.
    """

    verdict: str
    digits: float | None
    cpu: float
    matched: bool
    why: str


def answers(record: Record, renamed: Mapping[str, str] | None = None) -> dict[AnswerKey, AnswerSummary]:
    """Summarise every answer of a record; with `renamed`, answers of the renamed engines alone, under the new names."""
    names = renamed or {name: name for name in record.header["engines"]}
    found = {}
    for c in record.comparisons:
        if c["engine"] not in names:
            continue
        key = (c["case"], names[c["engine"]], c["question"], c["method"])
        cpu = sum(run["cpu"] for run in record.runs_of(c))
        found[key] = AnswerSummary(c["verdict"], c["digits"], cpu, is_matched(c), c["why"])
    return found


def changes(
    before: Record, after: Record, renamed: Mapping[str, str] | None = None, digits: float = DIGITS
) -> list[Change]:
    """List the changes between two records: worse ones first, then better ones.

    Parameters
    ----------
    before, after : Record
    renamed : mapping of str to str
        Names of engines in `before` to their names in `after`; only these engines are compared.
    digits : float
        Least change in digits that is listed.
    """
    names = dict(renamed or {})
    old, new = answers(before, names), answers(after, {name: name for name in names.values()})
    found = [*_surroundings(before, after, names), *_cases(before, after), *_engines(before, after, names)]
    found += _added_and_removed(before, after, old, new)
    timed = before.header["processor"] == after.header["processor"]
    otherwise = _asked_otherwise(before, after)
    for key in old.keys() & new.keys():
        found += _of_answer(key, old[key], new[key], digits, timed, key[0] not in otherwise)
    rank = {"worse": 0, "better": 1, "": 2}
    kinds = ("engine", "verdict", "digits", "case", "version", "answer", "time")
    return sorted(found, key=lambda c: (rank[c.effect], kinds.index(c.kind), c.where))


def _surroundings(before: Record, after: Record, names: Mapping[str, str]) -> Iterator[Change]:
    """List changed versions of engines, adapters and packages, and another machine."""
    old, new = (
        {**h["packages"], "Python": h["python"], "platform": h["platform"], "processor": h["processor"]}
        for h in (before.header, after.header)
    )
    engines = before.header["engines"], after.header["engines"]
    for name, other in (names or {name: name for name in engines[0].keys() & engines[1].keys()}).items():
        for what in ("version", "adapter"):
            old[f"{other}, {what}"], new[f"{other}, {what}"] = engines[0][name][what], engines[1][other][what]
    for name in dict.fromkeys((*old, *new)):
        if name in old and name in new and old[name] != new[name]:
            yield Change("version", "", name, old[name], new[name])


def _cases(before: Record, after: Record) -> Iterator[Change]:
    """List cases that only one record has, and cases that ask something else."""
    old, new = ({case["name"]: case for case in record.cases} for record in (before, after))
    for name in dict.fromkeys((*old, *new)):
        if name not in old or name not in new:
            yield Change("case", "", f"case {name}", "asked" * (name in old), "asked" * (name in new))
        for what in _ASKED if name in old and name in new else ():
            if old[name][what] != new[name][what]:
                yield Change("case", "", f"case {name}, {what}", _short(old[name][what]), _short(new[name][what]))


def _asked_otherwise(before: Record, after: Record) -> set[str]:
    """List the cases that both records have, and whose questions differ."""
    old, new = ({case["name"]: [case[what] for what in _ASKED] for case in r.cases} for r in (before, after))
    return {name for name in old.keys() & new.keys() if old[name] != new[name]}


def _short(value: Any) -> str:
    return f"{len(value)} of them" if isinstance(value, list) else f"{value:g}"


def _engines(before: Record, after: Record, names: Mapping[str, str]) -> Iterator[Change]:
    """List engines that only one record has, or that start in one alone; nothing if engines are renamed."""
    if names:
        return
    old, new = before.header, after.header
    for name in sorted(old["engines"].keys() ^ new["engines"].keys()):
        gone = name in old["engines"]
        missing = (new if gone else old)["missing"]
        if name not in missing:
            yield Change("engine", "", f"engine {name}", "asked" * gone, "asked" * (not gone))
        elif gone:
            yield Change("engine", "worse", f"engine {name}", "available", "not available", missing[name])
        else:
            yield Change("engine", "better", f"engine {name}", "not available", "available")


def _added_and_removed(
    before: Record, after: Record, old: Mapping[AnswerKey, AnswerSummary], new: Mapping[AnswerKey, AnswerSummary]
) -> Iterator[Change]:
    """List answers by methods that only one record has, of cases and engines that both have."""
    cases = {c["name"] for c in before.cases} & {c["name"] for c in after.cases}
    engines = {key[1] for key in old} & {key[1] for key in new}
    for key in sorted(old.keys() ^ new.keys()):
        if key[0] in cases and key[1] in engines:
            gone = key in old
            verdict = (old if gone else new)[key].verdict
            yield Change("answer", "", _words(key), verdict if gone else "", "" if gone else verdict)


def _words(key: AnswerKey) -> str:
    case, engine, question, method = key
    return f"{case} on {engine}, {question}" + (f", {method}" if method else "")


def _of_answer(
    key: AnswerKey, old: AnswerSummary, new: AnswerSummary, digits: float, timed: bool, same: bool
) -> Iterator[Change]:
    """List a changed verdict, else changed digits, and changed time.

    Parameters
    ----------
    key : AnswerKey
    old, new : AnswerSummary
        The answer in the two records.
    digits : float
        Least change in digits that is listed.
    timed : bool
        Whether the times can be compared: the records come from processors of one kind.
    same : bool
        Whether the case asks the same in both records.
    """
    where = _words(key)

    def effect(gain: float) -> str:
        return "" if not (new.matched and same) else "better" if gain > 0 else "worse"

    lost = (old.digits, new.digits)
    if old.verdict != new.verdict:
        gain = _ORDER.index(old.verdict) - _ORDER.index(new.verdict)
        texts = [
            f"{v} ({digits_text(d)} digits)" if d is not None else v
            for v, d in zip((old.verdict, new.verdict), lost, strict=True)
        ]
        yield Change("verdict", effect(gain), where, texts[0], texts[1], new.why)
    elif lost[0] is not None and lost[1] is not None and abs(lost[1] - lost[0]) >= digits:
        yield Change("digits", effect(lost[1] - lost[0]), where, digits_text(lost[0]), digits_text(lost[1]))
    if timed and max(old.cpu, new.cpu) >= LEAST_TIME and not 1 / RATIO < (old.cpu + 1e-9) / (new.cpu + 1e-9) < RATIO:
        yield Change("time", "", where, seconds(old.cpu), seconds(new.cpu))


# ---------------------------------------------------------------- statements


def change_table(found: Sequence[Change], title: str) -> tuple[str, Sequence[str], Sequence[Sequence[str]]]:
    """Write changes as a table of a `Statement`, without empty columns."""
    shown = [name for name in HEADS if any(getattr(change, name) for change in found)]
    rows = [tuple(str(getattr(change, name)) for name in shown) for change in found]
    return title, [HEADS[name] for name in shown], rows


def count_effects(found: Sequence[Change]) -> str:
    """Count worse, better and other changes, in a sentence."""
    count = {name: sum(change.effect == name for change in found) for name in ("worse", "better", "")}
    return f"{count['worse']} worse, {count['better']} better, {count['']} other changes."


def plain(found: Sequence[Change]) -> list[dict[str, str]]:
    """Return changes as data for JSON."""
    return [asdict(change) for change in found]
