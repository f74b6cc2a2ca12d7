"""View of the engines on the first screen: one row each, the best first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from consilience.compare import Verdict
from consilience.engine import Profile, Question
from consilience.report.annotations import is_own
from consilience.report.cells import Cell
from consilience.report.defaults import own_digits
from consilience.report.record import Record
from consilience.report.selection import grouped, is_matched, tried_levels
from consilience.report.wording import DASH, LOOKS, anchor, digits_text

DIGITS = (3, 6, 9)
"""Digits to which the CPU time is told."""

GROUPS = (
    ("", (("Same model", ""),)),
    ("Digits of motion, median", (("own", "Digits: "), ("harness's", "Digits: "), ("defaults", "Digits: "))),
    ("CPU time to reach, median", tuple((f"{n} digits", "CPU to ") for n in DIGITS)),
    ("", (("Unsupported", ""), ("Failed", ""), ("Known findings", ""))),
)
"""Columns behind the engine: title of the group, then name and the words before it in a narrow window."""

HEADS = tuple(head for _, heads in GROUPS for head in heads)


@dataclass(frozen=True)
class Entry:
    """An entry of the table.

    Attributes
    ----------
    value : float
        Value by which the column sorts; absent values sort last.
    before, note : str
        Quiet words before and behind the text.
    harness : bool
        Whether the number is of the harness's integrator.
    few : bool
        Whether fewer than half of the cases have the value.
    """

    text: str
    value: float
    before: str = ""
    note: str = ""
    harness: bool = False
    few: bool = False


@dataclass(frozen=True)
class EngineStanding:
    """An engine and its entries, one for each of `HEADS`."""

    name: str
    version: str
    anchor: str
    entries: tuple[Entry, ...]


def standings(record: Record, cells: Sequence[Cell], labels: Mapping[str, str]) -> tuple[EngineStanding, ...]:
    """Make a row for each engine of the cells, by its label: most cells of the same model first, then most digits."""
    by_engine = grouped((cell.engine, cell) for cell in cells)
    rows = [_standing(record, name, labels[name], own) for name, own in by_engine.items()]
    return tuple(sorted(rows, key=lambda row: (row.entries[0].value, row.entries[1].value), reverse=True))


def _standing(record: Record, name: str, label: str, cells: Sequence[Cell]) -> EngineStanding:
    lines = [line for line in record.cells if line["engine"] == name]
    motions = [c for c in record.comparisons if c["engine"] == name and Question(c["question"]).over_time]
    matched = [c for c in motions if is_matched(c)]
    own, harness = ([c for c in matched if is_own(c) is own] for own in (True, False))
    able = sum(line["motion"] not in (None, Verdict.UNSUPPORTED) for line in lines)
    findings = {finding for line in lines for finding in line["findings"]}
    costed = own if any(c["levels"] for c in own) else harness
    entries = (
        _same(lines),
        _digits(own, able, named=True, absent="none"),
        _digits(harness, able, harness=True),
        _defaults(record, cells, able),
        *(_cost(costed, n, able, costed is harness) for n in DIGITS),
        _count(cells, lambda cell: cell.look is LOOKS[Verdict.UNSUPPORTED]),
        _failed(record, name),
        Entry(str(len(findings)), float(len(findings))),
    )
    return EngineStanding(label, record.header["engines"][name]["version"], anchor("page", "engine", name), entries)


def _same(lines: Sequence[dict[str, Any]]) -> Entry:
    """Count the cells that agree where nothing is integrated, of those that the engine can represent."""
    able = [line for line in lines if line["model"] not in (None, Verdict.UNSUPPORTED)]
    same = sum(line["model"] == Verdict.AGREES for line in able)
    return Entry(str(same), same / len(able) if able else -1.0, note=f"/{len(able)}")


def _digits(
    motions: Sequence[dict[str, Any]], able: int, named: bool = False, harness: bool = False, absent: str = DASH
) -> Entry:
    """Return the median over the cases of the digits of the best of these motions, and the most frequent method."""
    best: dict[str, dict[str, Any]] = {}
    for c in motions:
        if c["digits"] is not None and c["digits"] > best.get(c["case"], {"digits": -1.0})["digits"]:
            best[c["case"]] = c
    if not best:
        return Entry(absent, -1.0)
    name = Counter(c["method"] for c in best.values()).most_common(1)[0][0] if named else ""
    return _median([c["digits"] for c in best.values()], digits_text, able, harness, name)


def _median(values: list[float], text: Callable[[float], str], able: int, harness: bool, before: str = "") -> Entry:
    middle, count = median(values), len(values)
    note = f"in {count}" if count < able else ""
    return Entry(text(middle), middle, before, note, harness, few=2 * count < able)


def _defaults(record: Record, cells: Sequence[Cell], able: int) -> Entry:
    """Return the median of the digits at the engine's defaults."""
    moving = [[a for a in cell.defaults if Question(a.question).over_time] for cell in cells]
    found = [[d for a in answers if (d := own_digits(a.lines.comparison)) is not None][:1] for answers in moving]
    values = [digits for first in found for digits in first]
    if not values:
        return Entry("not asked" if record.header.get("quick") else DASH, -1.0)
    return _median(values, digits_text, able, harness=False)


def _cost(motions: Sequence[dict[str, Any]], digits: int, able: int, harness: bool) -> Entry:
    """Return the median CPU time of the cheapest level of each case that has the digits.

    It is a bound where the coarsest level tried has them already: coarser ones were not measured. None is coarser than
    a single step.
    """
    cheapest: dict[str, tuple[float, bool]] = {}
    for c in motions:
        for n, (level, largest) in enumerate(tried_levels(c)):
            if largest is not None and largest <= 10.0**-digits:
                coarsest = n == 0 and level["step"] < c["times"][-1] - c["times"][0]
                cheapest[c["case"]] = min(cheapest.get(c["case"], (float("inf"), False)), (level["cpu"], coarsest))
    if not cheapest:
        return Entry(DASH, -1.0)
    costs = sorted(cheapest.values())
    bound = "\N{LESS-THAN OR EQUAL TO} " if costs[(len(costs) - 1) // 2][1] else ""
    return _median([cpu for cpu, _ in costs], lambda cpu: bound + _time(cpu), able, harness)


def _time(cpu: float) -> str:
    return f"{1000.0 * cpu:.2g} ms" if cpu < 0.0995 else f"{1000.0 * cpu:.0f} ms" if cpu < 1.0 else f"{cpu:.3g} s"


def _count(cells: Sequence[Cell], holds: Callable[[Cell], bool]) -> Entry:
    count = sum(map(holds, cells))
    return Entry(str(count), float(count))


def _failed(record: Record, name: str) -> Entry:
    """Count the cells with a failure, and those that fail at the engine's defaults."""
    failed = {
        profile: {
            c["case"]
            for c in record.comparisons
            if c["engine"] == name and c["profile"] == profile and c["verdict"] == Verdict.FAILED
        }
        for profile in Profile
    }
    count, more = len(failed[Profile.MATCHED]), len(failed[Profile.DEFAULT])
    return Entry(str(count), float(count), note=f"+{more} at defaults" if more else "")
