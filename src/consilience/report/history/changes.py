"""Changes between two records: surroundings, cases, and every answer's verdict, digits and time.

Answers are the same where case, engine, question and method are. A change is worse where the verdict is further down
the list of `Verdict`, digits are lost, or an engine no longer starts. Of answers at the engines' own defaults, of cases
that did not ask the same both times, and of time, changes are told and nothing is called worse: the first decide
nothing, the second cannot be compared, the third is noisy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.report.record import Record
from consilience.report.selection import is_matched
from consilience.report.wording import digits_text, seconds

DIGITS = 0.5
"""Change in digits that is told, if nobody says otherwise: a threefold difference."""

RATIO, LEAST_TIME = 2.0, 0.1
"""Ratio of CPU times from which on a change is told, and the time in s that the longer one has to take."""

Key = tuple[str, str, str, str]
"""Case, engine, question and method."""

_ORDER = [str(verdict) for verdict in Verdict]

_ASKED = ("duration", "sample", "digits", "instants", "bodies", "joints", "rows")
"""Of a case, what an answer depends on and the record holds."""


@dataclass(frozen=True)
class Change:
    """One thing that is not as it was.

    Attributes
    ----------
    kind : {"version", "case", "engine", "answer", "verdict", "digits", "time"}
    effect : {"worse", "better", ""}
        Empty where it is neither.
    where : str
        What has changed, in words.
    before, after : str
        Empty where there was, or is, nothing.
    why : str
        Of a verdict, what the later report says.
    """

    kind: str
    effect: str
    where: str
    before: str
    after: str
    why: str = ""


@dataclass(frozen=True)
class Answer:
    """What a record says of one answer.

    Attributes
    ----------
    cpu : float, s
        Of all runs of its method.
    """

    verdict: str
    digits: float | None
    cpu: float
    matched: bool
    why: str


def answers(record: Record, renamed: Mapping[str, str] | None = None) -> dict[Key, Answer]:
    """Every answer of a record; with other names for some engines, to stand beside another record's, theirs alone."""
    names = renamed or {name: name for name in record.header["engines"]}
    found = {}
    for c in record.comparisons:
        if c["engine"] not in names:
            continue
        key = (c["case"], names[c["engine"]], c["question"], c["method"])
        cpu = sum(run["cpu"] for run in record.runs_of(c))
        found[key] = Answer(c["verdict"], c["digits"], cpu, is_matched(c), c["why"])
    return found


def changes(
    before: Record,
    after: Record,
    renamed: Mapping[str, str] | None = None,
    digits: float = DIGITS,
) -> list[Change]:
    """All changes, the worse ones first, then the better ones.

    Parameters
    ----------
    renamed : mapping of str to str
        Engines of `before` and the names they have in `after`; with it only these are compared.
    digits : float
        Change in digits from which on one is told.
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
    """Versions of engines, adapters and packages, and the machine."""
    old, new = ({**r.header["packages"], "Python": r.header["python"]} for r in (before, after))
    old |= {"platform": before.header["platform"], "processor": before.header["processor"]}
    new |= {"platform": after.header["platform"], "processor": after.header["processor"]}
    engines = before.header["engines"], after.header["engines"]
    for name, other in (names or {name: name for name in engines[0].keys() & engines[1].keys()}).items():
        for what in ("version", "adapter"):
            old[f"{other}, {what}"], new[f"{other}, {what}"] = engines[0][name][what], engines[1][other][what]
    for name in dict.fromkeys((*old, *new)):
        if name in old and name in new and old[name] != new[name]:
            yield Change("version", "", name, old[name], new[name])


def _cases(before: Record, after: Record) -> Iterator[Change]:
    """Cases that are new or gone, or ask something else."""
    old, new = ({case["name"]: case for case in record.cases} for record in (before, after))
    for name in dict.fromkeys((*old, *new)):
        if name not in new:
            yield Change("case", "", f"case {name}", "asked", "")
        elif name not in old:
            yield Change("case", "", f"case {name}", "", "asked")
        for what in _ASKED if name in old and name in new else ():
            if old[name][what] != new[name][what]:
                yield Change("case", "", f"case {name}, {what}", _short(old[name][what]), _short(new[name][what]))


def _asked_otherwise(before: Record, after: Record) -> set[str]:
    """Cases of both records that do not ask the same."""
    old, new = ({case["name"]: [case[what] for what in _ASKED] for case in r.cases} for r in (before, after))
    return {name for name in old.keys() & new.keys() if old[name] != new[name]}


def _short(value: Any) -> str:
    return f"{len(value)} of them" if isinstance(value, list) else f"{value:g}"


def _engines(before: Record, after: Record, names: Mapping[str, str]) -> Iterator[Change]:
    """Engines that are new or gone, or no longer start; of engines under two names nothing can be said."""
    if names:
        return
    old, new, missing = set(before.header["engines"]), set(after.header["engines"]), after.header["missing"]
    for name in sorted(old - new):
        if name in missing:
            yield Change("engine", "worse", f"engine {name}", "available", "not available", missing[name])
        else:
            yield Change("engine", "", f"engine {name}", "asked", "")
    for name in sorted(new - old):
        if name in before.header["missing"]:
            yield Change("engine", "better", f"engine {name}", "not available", "available")
        else:
            yield Change("engine", "", f"engine {name}", "", "asked")


def _added_and_removed(
    before: Record, after: Record, old: Mapping[Key, Answer], new: Mapping[Key, Answer]
) -> Iterator[Change]:
    """Answers by methods that only one of the records has, of cases and engines that both have."""
    cases = {c["name"] for c in before.cases} & {c["name"] for c in after.cases}
    engines = {key[1] for key in old} & {key[1] for key in new}
    for key in sorted(old.keys() ^ new.keys()):
        if key[0] in cases and key[1] in engines:
            gone = key in old
            verdict = (old if gone else new)[key].verdict
            yield Change("answer", "", _words(key), verdict if gone else "", "" if gone else verdict)


def _words(key: Key) -> str:
    case, engine, question, method = key
    return f"{case} on {engine}, {question}" + (f", {method}" if method else "")


def _of_answer(key: Key, old: Answer, new: Answer, digits: float, timed: bool, same: bool) -> Iterator[Change]:
    """Verdict, or else digits, and time; neither worse nor better where the case did not ask the same."""
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
