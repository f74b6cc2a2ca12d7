"""CSV: a row for each comparison, with matched and with default settings."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from math import inf
from typing import Any

from consilience.report.record import Record
from consilience.report.selection import deciding, levels_of

COLUMNS: dict[str, str] = {
    "case": "name of the case",
    "engine": "name the engine was asked by",
    "version": "version of the engine",
    "question": "model, instant or trajectory",
    "method": "in the engine's own words",
    "route": "how much of the answer is the engine's own",
    "profile": "matched or default settings; default ones decide nothing",
    "verdict": "as in verdicts.md",
    "rule": "rule that decided a motion",
    "digits": "correct digits, of a motion at its finest level",
    "quantity": "what is nearest to its bar or farthest beyond",
    "difference": "its relative difference to the reference; empty: nothing compared, or not finite",
    "bar": "what was asked of it",
    "step": "finest step in s, or tolerance",
    "power": "smallest errors that would have been noticed, relative, of an axis in rad; inf: any would pass",
    "order": "observed order of convergence",
    "horizon": "time in s up to which a motion is judged; empty: its end",
    "cpu": "CPU time of its runs in s",
    "why": "the decision in numbers",
}
"""Columns, and their meaning."""


def render(record: Record) -> str:
    """Write the CSV of a record (RFC 4180): numbers at full precision, absent numbers empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    writer.writerows(rows(record))
    return text.getvalue()


def rows(record: Record) -> Iterator[dict[str, Any]]:
    """List the rows as values by column; None for an absent value."""
    cases = {case["name"]: case for case in record.cases}
    for comparison in record.comparisons:
        runs = levels_of(record.runs_of(comparison))
        found = deciding(comparison, cases[comparison["case"]])
        same = {name: comparison[name] for name in COLUMNS if name in comparison}
        yield same | {
            "version": record.header["engines"][comparison["engine"]]["version"],
            "quantity": found.name,
            "difference": found.difference,
            "bar": found.bar,
            "power": "; ".join(
                f"{p['of']}: {inf if p['limit'] is None else p['limit']:.2g}" for p in comparison["power"]
            ),
            "step": runs[-1]["step"] if runs else None,
            "cpu": sum(run["cpu"] for run in runs),
        }
