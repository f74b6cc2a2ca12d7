"""Outcome of a fuzz as data, and as Markdown made from it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from consilience.audit.fuzz.campaign import Campaign
from consilience.audit.fuzz.findings import Finding, exit_code
from consilience.audit.fuzz.judging import Entry
from consilience.compare import Verdict
from consilience.engine import Profile, Question

Data = dict[str, Any]


def outcome(campaign: Campaign, findings: Sequence[Finding]) -> Data:
    """Everything a reader may want to know, ready for JSON."""
    entries = [entry for judged in campaign.judged for entry in judged.entries]
    spent, count = campaign.spent, len(campaign.judged)
    return {
        "consilience": version("consilience"),
        "seeds": [judged.specimen.seed for judged in campaign.judged],
        "sorts": dict(Counter(judged.specimen.sort for judged in campaign.judged)),
        "not_drawn": campaign.undrawn,
        "missing": campaign.missing,
        "engines": {name: _engine(name, info.version, campaign) for name, info in campaign.engines.items()},
        "methods": [_method(group) for group in _groups(entries)],
        "findings": [_finding(finding) for finding in findings],
        "time": {
            "elapsed": spent.elapsed,
            "per_minute": 60.0 * count / spent.elapsed if spent.elapsed else 0.0,
            "cpu": {"drawing": spent.drawing, "judging": spent.judging, **spent.engines},
        },
        "exit_code": exit_code(campaign),
    }


def _engine(name: str, of_version: str, campaign: Campaign) -> Data:
    """Mechanisms by what became of them; the reasons of those that the engine refuses."""
    counts: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    digits = []
    for judged in campaign.judged:
        own = [e for e in judged.entries if e.engine == name and (e.alarm or e.profile is Profile.MATCHED)]
        verdicts = {e.verdict for e in own}
        for verdict in (Verdict.FAILED, Verdict.MODEL, Verdict.UNRESOLVED, Verdict.UNSUPPORTED):
            counts[str(verdict)] += verdict in verdicts
        reasons.update({e.why for e in own if e.verdict is Verdict.UNSUPPORTED})
        matched = [e for e in own if e.profile is Profile.MATCHED and e.question is Question.INSTANT]
        found = [e.digits for e in matched if e.digits is not None]
        counts["judged"] += bool(found)
        digits += [min(found)] if found else []
    return {
        "version": of_version,
        "judged": counts["judged"],
        "differs": counts[Verdict.MODEL],
        "failed": counts[Verdict.FAILED],
        "unresolved": counts[Verdict.UNRESOLVED],
        "unsupported": counts[Verdict.UNSUPPORTED],
        "reasons": dict(reasons.most_common()),
        **_digits(digits),
    }


def _digits(found: Sequence[float]) -> Data:
    return {
        "worst_digits": min(found) if found else None,
        "median_digits": float(np.median(found)) if found else None,
    }


def _groups(entries: Iterable[Entry]) -> list[list[Entry]]:
    """Entries of the instant that compare the same with the same."""
    groups: dict[tuple[str, ...], list[Entry]] = {}
    for entry in entries:
        if entry.question is Question.INSTANT and entry.method:
            groups.setdefault((entry.engine, entry.method, entry.against), []).append(entry)
    return list(groups.values())


def _method(group: Sequence[Entry]) -> Data:
    first = group[0]
    verdicts = Counter(entry.verdict for entry in group)
    return {
        "engine": first.engine,
        "method": first.method,
        "against": first.against,
        "profile": str(first.profile),
        "compared": sum(entry.digits is not None for entry in group),
        "differs": verdicts[Verdict.MODEL],
        "failed": verdicts[Verdict.FAILED],
        **_digits([entry.digits for entry in group if entry.digits is not None]),
    }


def _finding(finding: Finding) -> Data:
    met, shown = finding.entry, finding.shown
    return {
        "engine": met.engine,
        "method": met.method,
        "against": met.against,
        "question": str(met.question),
        "verdict": str(met.verdict),
        "quantity": met.quantity,
        "met": {"seed": finding.seed, "bodies": finding.met, "why": met.why},
        "smallest": {"file": finding.file, "bodies": finding.bodies, "why": shown.why, "tried": finding.tried},
        "seeds": list(finding.seeds),
    }


# ---------------------------------------------------------------- Markdown


def markdown(data: Data) -> str:
    """Page of an outcome."""
    count, clock = len(data["seeds"]), data["time"]
    cpu = ", ".join(f"{name} {1e3 * spent / max(count, 1):.0f}" for name, spent in clock["cpu"].items())
    sorts = ", ".join(f"{number} {sort}" for sort, number in data["sorts"].items())
    lines = [
        "# Differential fuzzing",
        "",
        f"{count} mechanisms ({sorts}) in {clock['elapsed']:.0f} s, {clock['per_minute']:.0f} a minute.",
        f"CPU time of a mechanism in ms: {cpu}.",
        "",
        *_engine_lines(data),
        *_method_lines("How far each way agrees", _of_profile(data, Profile.MATCHED)),
        *_method_lines(
            "Engines as they come out of the box, judged among themselves alone",
            _of_profile(data, Profile.DEFAULT),
        ),
        *_finding_lines(data["findings"]),
    ]
    lines += [f"- Seed {seed} could not be drawn: {why}" for seed, why in data["not_drawn"].items()]
    lines += [f"- {name} is missing: {why}" for name, why in data["missing"].items()]
    return "\n".join([*lines, ""])


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    cells = [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return ["| " + " | ".join(row) + " |" for row in [list(head), ["---"] * len(head), *cells]] + [""]


def shown_digits(value: float | None) -> str:
    """Digits in a table."""
    return "-" if value is None else f"{value:.1f}"


def _engine_lines(data: Data) -> list[str]:
    head = ("engine", "version", "judged", "differs", "failed", "unresolved", "unsupported", "worst digits", "median")
    rows = [
        (
            name,
            *(e[key] for key in ("version", "judged", "differs", "failed", "unresolved", "unsupported")),
            shown_digits(e["worst_digits"]),
            shown_digits(e["median_digits"]),
        )
        for name, e in data["engines"].items()
    ]
    reasons = [
        f"- {name}: {number} mechanisms, {reason}"
        for name, e in data["engines"].items()
        for reason, number in e["reasons"].items()
    ]
    return [*_table(head, rows), *(["Unsupported:", "", *reasons, ""] if reasons else [])]


def _of_profile(data: Data, profile: Profile) -> list[Data]:
    return [row for row in data["methods"] if row["profile"] == profile]


def _method_lines(title: str, methods: Sequence[Data]) -> list[str]:
    if not methods:
        return []
    head = ("engine", "method", "against", "compared", "differs", "failed", "worst digits", "median")
    rows = [
        (
            *(m[key] for key in ("engine", "method", "against", "compared", "differs", "failed")),
            shown_digits(m["worst_digits"]),
            shown_digits(m["median_digits"]),
        )
        for m in methods
    ]
    return [f"## {title}", "", *_table(head, rows)]


def _finding_lines(findings: Sequence[Data]) -> list[str]:
    if not findings:
        return ["## Disagreements", "", "None.", ""]
    lines = ["## Disagreements", ""]
    for f in findings:
        seeds, smallest = f["seeds"], f["smallest"]
        lines += [
            f"### {f['engine']}, {f['method'] or f['quantity']}: {f['verdict']}",
            "",
            f"- Against {f['against']}, {f['question']}, in {len(seeds)} mechanisms, seeds "
            + ", ".join(map(str, seeds[:12]))
            + (", ..." if len(seeds) > 12 else "")
            + ".",
            f"- Met in {f['met']['bodies']} bodies (seed {f['met']['seed']}): {f['met']['why']}",
            f"- Smallest, {smallest['bodies']} bodies, `{smallest['file']}`: {smallest['why']}",
            f"- `consilience run {smallest['file']} -e {f['engine']} -q {f['question']}`",
            "",
        ]
    return lines


def write_outcome(data: Data, folder: Path) -> None:
    """Write ``fuzz.json`` and ``fuzz.md``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fuzz.json").write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (folder / "fuzz.md").write_text(markdown(data), encoding="utf-8")
