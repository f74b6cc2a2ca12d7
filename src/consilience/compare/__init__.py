"""Runs in, verdicts out. Knows answers and the mechanism, never an engine."""

from __future__ import annotations

from consilience.compare.campaigns import CODES, exit_code, markdown_table, write_campaign
from consilience.compare.instant import compare_instant, compare_model
from consilience.compare.result import Comparison, Level, Quantity, Verdict
from consilience.compare.trajectory import Prospect, Yardstick, compare_trajectory, reference_spread, spread_over_time

__all__ = [
    "CODES",
    "Comparison",
    "Level",
    "Prospect",
    "Quantity",
    "Verdict",
    "Yardstick",
    "compare_instant",
    "compare_model",
    "compare_trajectory",
    "exit_code",
    "markdown_table",
    "reference_spread",
    "spread_over_time",
    "write_campaign",
]
