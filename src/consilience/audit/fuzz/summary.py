"""Outcome of a fuzzing campaign: data for JSON, and a Markdown page made of the data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from consilience.audit.fuzz.campaign import FuzzCampaign
from consilience.audit.fuzz.findings import ShrunkDisagreement, exit_code
from consilience.audit.fuzz.judging import JudgedComparison
from consilience.compare import Verdict, grouped, markdown_table
from consilience.engine import Profile, Question

_VERDICTS = {
    "differs": Verdict.MODEL,
    "failed": Verdict.FAILED,
    "unresolved": Verdict.UNRESOLVED,
    "unsupported": Verdict.UNSUPPORTED,
}

_OUTCOMES = {
    "agrees": Verdict.AGREES,
    "by steps": Verdict.DISCRETISATION,
    "by softness": Verdict.REGULARISATION,
    **_VERDICTS,
}

COUNTS = ("judged", *_VERDICTS)
"""Counts of mechanisms of an engine: those with comparisons of matched methods, and those with each verdict."""


def outcome(campaign: FuzzCampaign, findings: Sequence[ShrunkDisagreement]) -> dict[str, Any]:
    """Summarise a campaign as data for JSON."""
    entries = [entry for judged in campaign.judged for entry in judged.entries]
    compared = [entry for entry in entries if entry.question is not Question.MODEL and entry.method]
    groups = grouped(compared, lambda entry: (entry.question, entry.engine, entry.method, entry.against))
    spent, count = campaign.spent, len(campaign.judged)
    return {
        "consilience": version("consilience"),
        "seeds": [judged.specimen.seed for judged in campaign.judged],
        "sorts": dict(Counter(judged.specimen.sort for judged in campaign.judged)),
        "not_drawn": campaign.undrawn,
        "missing": campaign.missing,
        "engines": {name: _engine(name, info.version, campaign) for name, info in campaign.engines.items()},
        "methods": [_method(group) for group in groups.values()],
        "findings": [_finding(finding) for finding in findings],
        "time": {
            "elapsed": spent.elapsed,
            "per_minute": 60.0 * count / spent.elapsed if spent.elapsed else 0.0,
            "cpu": {"drawing": spent.drawing, "judging": spent.judging, **spent.engines},
        },
        "exit_code": exit_code(campaign),
    }


def _engine(name: str, of_version: str, campaign: FuzzCampaign) -> dict[str, Any]:
    """Count the mechanisms of an engine by verdict, and by the reasons of those that the engine refuses."""
    counts = dict.fromkeys(COUNTS, 0)
    reasons: Counter[str] = Counter()
    digits = []
    for judged in campaign.judged:
        own = [e for e in judged.entries if e.engine == name and (e.alarm or e.profile is Profile.MATCHED)]
        verdicts = {e.verdict for e in own}
        for name_of_count, verdict in _VERDICTS.items():
            counts[name_of_count] += verdict in verdicts
        refused = [e for e in own if e.verdict is Verdict.UNSUPPORTED]
        at_states = [e for e in refused if e.question is Question.INSTANT]
        reasons.update({e.why for e in at_states or refused})
        matched = [e for e in own if e.profile is Profile.MATCHED and e.question is Question.INSTANT]
        found = [e.digits for e in matched if e.digits is not None]
        counts["judged"] += bool(found)
        digits += [min(found)] if found else []
    return {"version": of_version, **counts, "reasons": dict(reasons.most_common()), **_digits(digits)}


def _digits(found: Sequence[float]) -> dict[str, float | None]:
    return {"worst_digits": min(found) if found else None, "median_digits": float(np.median(found)) if found else None}


def _method(group: Sequence[JudgedComparison]) -> dict[str, Any]:
    first = group[0]
    verdicts = Counter(entry.verdict for entry in group)
    return {
        "engine": first.engine,
        "method": first.method,
        "against": first.against,
        "question": str(first.question),
        "profile": str(first.profile),
        "compared": sum(entry.digits is not None for entry in group),
        **{name: verdicts[verdict] for name, verdict in _OUTCOMES.items()},
        **_digits([entry.digits for entry in group if entry.digits is not None]),
    }


def _finding(finding: ShrunkDisagreement) -> dict[str, Any]:
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
        "command": finding.command,
    }


# ---------------------------------------------------------------- Markdown


def markdown(data: dict[str, Any]) -> str:
    """Write the page of an outcome."""
    count, clock = len(data["seeds"]), data["time"]
    cpu = ", ".join(f"{name} {1e3 * spent / max(count, 1):.0f}" for name, spent in clock["cpu"].items())
    sorts = ", ".join(f"{number} {sort}" for sort, number in data["sorts"].items())
    rows = [{"engine": name, **e} for name, e in data["engines"].items()]
    instants, motions = (
        [row for row in data["methods"] if row["question"] == question]
        for question in (Question.INSTANT, Question.TRAJECTORY)
    )
    lines = [
        "# Differential fuzzing",
        "",
        f"{count} mechanisms ({sorts}) in {clock['elapsed']:.0f} s, {clock['per_minute']:.0f} a minute.",
        f"CPU time of a mechanism in ms: {cpu}.",
        "",
        *_table(("engine", "version", *COUNTS), rows),
        *_reason_lines(data["engines"]),
        *_method_lines("How far each way agrees", instants, Profile.MATCHED),
        *_method_lines("Engines as they come out of the box, judged among themselves alone", instants, Profile.DEFAULT),
        *_method_lines("Motions", motions, Profile.MATCHED, tuple(_OUTCOMES)),
        *_finding_lines(data["findings"]),
    ]
    lines += [f"- Seed {seed} could not be drawn: {why}" for seed, why in data["not_drawn"].items()]
    lines += [f"- {name} is missing: {why}" for name, why in data["missing"].items()]
    return "\n".join([*lines, ""])


def digits_cell(value: float | None) -> str:
    """Write correct digits in a table."""
    return "-" if value is None else f"{value:.1f}"


def _table(keys: Sequence[str], rows: Sequence[dict[str, Any]]) -> list[str]:
    """Write the values of some keys, the worst digits and the median digits, as a table and a blank line."""
    cells = [
        (*(row[key] for key in keys), digits_cell(row["worst_digits"]), digits_cell(row["median_digits"]))
        for row in rows
    ]
    heads = (*keys, "worst digits", "median")
    return [*markdown_table(heads, cells, spaced=True, escape=_escape), ""]


def _escape(cell: object) -> str:
    return str(cell).replace("|", "\\|").replace("\n", " ")


def _reason_lines(engines: dict[str, Any]) -> list[str]:
    reasons = [
        f"- {name}: {number} mechanisms, {reason}"
        for name, e in engines.items()
        for reason, number in e["reasons"].items()
    ]
    return ["Unsupported:", "", *reasons, ""] if reasons else []


def _method_lines(
    title: str, methods: Sequence[dict[str, Any]], profile: Profile, counts: tuple[str, ...] = ("differs", "failed")
) -> list[str]:
    rows = [row for row in methods if row["profile"] == profile]
    keys = ("engine", "method", "against", "compared", *counts)
    return [f"## {title}", "", *_table(keys, rows)] if rows else []


def _finding_lines(findings: Sequence[dict[str, Any]]) -> list[str]:
    lines = ["## Disagreements", "", *(() if findings else ("None.", ""))]
    for f in findings:
        seeds, smallest = f["seeds"], f["smallest"]
        named = ", ".join(map(str, seeds[:12])) + (", ..." if len(seeds) > 12 else "")
        lines += [
            f"### {f['engine']}, {f['method'] or f['quantity']}: {f['verdict']}",
            "",
            f"- Against {f['against']}, {f['question']}, in {len(seeds)} mechanisms, seeds {named}.",
            f"- Met in {f['met']['bodies']} bodies (seed {f['met']['seed']}): {f['met']['why']}",
            f"- Smallest, {smallest['bodies']} bodies, `{smallest['file']}`: {smallest['why']}",
            f"- `{f['command']}`",
            "",
        ]
    return lines
