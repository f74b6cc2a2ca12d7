"""Results of a campaign of mutants as Markdown and as JSON."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from consilience.audit.mutate.campaign import MutationCampaign, TaskOutcome
from consilience.audit.mutate.mutants import TRAPS, UNPLANTED
from consilience.audit.mutate.summary import MutantRow, Standing, exit_code, rows_of, verdict_of
from consilience.compare import grouped, markdown_table, write_campaign

FORMAT = 1


def _shares(outcome: TaskOutcome | None) -> str:
    """Return magnitude and number of mechanisms, as ``1e-08 (8 of 8)``."""
    if outcome is None:
        return "-"
    if outcome.broken:
        return f"{outcome.magnitude:g} ({outcome.broken})"
    return f"{outcome.magnitude:g} ({outcome.caught} of {outcome.judged})"


def _cells(row: MutantRow) -> tuple[str, ...]:
    m = row.mutant
    if m.harmless or len(row.outcomes) == 1:
        first = row.outcomes[0]
        share = f"{first.caught} of {first.judged}" if not first.broken else first.broken
        smallest, everywhere = (f"all or nothing ({share})" if not m.unit else _shares(row.smallest)), ""
        if m.harmless:
            smallest = f"{max(o.caught for o in row.outcomes)} of {first.judged} noticed"
    else:
        unit = f" {m.unit}" if m.unit else ""
        smallest = _shares(row.smallest).replace(" (", f"{unit} (", 1)
        everywhere = "" if row.smallest_everywhere is row.smallest else _shares(row.smallest_everywhere)
    return m.name, row.host, str(row.standing), smallest, everywhere, row.by, row.why_missed


_HEADINGS = (
    "mutant",
    "planted in",
    "standing",
    "smallest magnitude caught (mechanisms)",
    "smallest caught on as many as the largest",
    "given away by",
    "largest not caught",
)


def _escaped(cell: str) -> str:
    return cell.replace("|", "/")


def markdown(campaign: MutationCampaign) -> str:
    """Return tables of mutants by trap, then the false alarms."""
    rows = rows_of(campaign)
    lines = ["# Detection power", "", verdict_of(campaign), "", _settings(campaign), ""]
    for trap, group in grouped(rows, lambda r: r.mutant.trap).items():
        lines += [f"## {trap}. {TRAPS[trap]}", "", *markdown_table(_HEADINGS, map(_cells, group), escape=_escaped), ""]
        told = {r.mutant.name: r.mutant for r in group}.values()
        lines += [f"- {m.name}: {m.how}{f'. {m.remark}' if m.remark else ''}" for m in told] + [""]
    lines += [f"## {n}. {TRAPS[n]}\n\nNot planted: {reason}\n" for n, reason in UNPLANTED.items()]
    lines += ["## False alarms", ""]
    judged = ", ".join(f"{name}: {n}" for name, n in campaign.judged.items())
    lines.append(f"Correct adapters on random mechanisms, `model` and `instant`: {judged or 'none judged'}.")
    if campaign.alarms:
        cells = [(a.host, a.subject, a.question, a.method, a.verdict, a.why) for a in campaign.alarms]
        heads = ("engine", "mechanism", "question", "method", "verdict", "why")
        lines += ["", *markdown_table(heads, cells, escape=_escaped)]
    else:
        lines.append("None.")
    return "\n".join(lines) + "\n"


def _settings(campaign: MutationCampaign) -> str:
    engines = ", ".join(campaign.engines.values())
    missing = "".join(f"; {name} is missing: {reason}" for name, reason in campaign.missing.items())
    own = f"consilience {version('consilience')}, numpy {version('numpy')}, Python {platform.python_version()}"
    place = f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"
    return f"{engines}{missing}. {own}; {place}; {campaign.elapsed:.0f} s."


def as_json(campaign: MutationCampaign) -> dict[str, Any]:
    """Return all results as data for JSON."""
    rows = rows_of(campaign)
    return {
        "format": FORMAT,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "elapsed": round(campaign.elapsed, 1),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "packages": {name: version(name) for name in ("consilience", "numpy", "scipy")},
        "engines": campaign.engines,
        "missing": campaign.missing,
        "summary": verdict_of(campaign),
        "exit_code": exit_code(campaign),
        "traps": {str(n): title for n, title in TRAPS.items()},
        "not_planted": {str(n): reason for n, reason in UNPLANTED.items()},
        "mutants": [_row(row) for row in rows],
        "alarms": [vars(alarm) for alarm in campaign.alarms],
        "correct_adapters_judged": dict(campaign.judged),
        "random_mechanisms": campaign.mechanisms,
    }


_OF_THE_ROW = ("mutant", "host", "unusable")
"""Fields of an outcome that the JSON has once for a row, or not at all."""


def _row(row: MutantRow) -> dict[str, Any]:
    smallest = row.smallest
    m = row.mutant
    return {
        "trap": m.trap,
        "mutant": m.name,
        "how": m.how,
        "host": row.host,
        "question": str(m.question),
        "harmless": m.harmless,
        "unit": m.unit,
        "standing": str(row.standing),
        "smallest_caught": None if smallest is None else smallest.magnitude,
        "magnitudes": [
            {name: value for name, value in vars(outcome).items() if name not in _OF_THE_ROW}
            for outcome in row.outcomes
        ],
    }


def write_report(campaign: MutationCampaign, folder: Path) -> None:
    """Write ``detection.md`` and ``detection.json``."""
    write_campaign(folder, "detection", as_json(campaign), markdown(campaign))


def short_table(campaign: MutationCampaign) -> list[tuple[str, ...]]:
    """Return a row for each trap: number, title, mutants caught of those judged, smallest magnitude caught."""
    lines: list[tuple[str, ...]] = []
    for trap, same in grouped(rows_of(campaign), lambda r: r.mutant.trap).items():
        group = [r for r in same if r.standing in (Standing.CAUGHT, Standing.MISSED)]
        caught = [r for r in group if r.standing is Standing.CAUGHT]
        small = [r.smallest.magnitude for r in caught if r.smallest is not None and len(r.outcomes) > 1]
        lines.append(
            (str(trap), TRAPS[trap], f"{len(caught)} of {len(group)}", f"{min(small):g}" if small else "all or nothing")
        )
    return lines
