"""Comparison of answers with the reference: verdicts from runs, independent of any engine.

The modules `judge` and `judges` import the cases, which these functions do not need: import from them directly.
"""

from consilience.compare.campaigns import CODES, exit_code, grouped, markdown_table, write_campaign
from consilience.compare.instant import compare_instant, compare_model, relative_difference
from consilience.compare.power import Power
from consilience.compare.prospect import Prospect
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import Comparison, Level, Quantity, Verdict, compare_by_bars
from consilience.compare.trajectory import compare_trajectory, reference_spread, spread_over_time

__all__ = [
    "CODES",
    "Comparison",
    "Level",
    "Power",
    "Prospect",
    "Quantity",
    "ReferenceMotion",
    "Verdict",
    "compare_by_bars",
    "compare_instant",
    "compare_model",
    "compare_trajectory",
    "exit_code",
    "grouped",
    "markdown_table",
    "reference_spread",
    "relative_difference",
    "spread_over_time",
    "write_campaign",
]
