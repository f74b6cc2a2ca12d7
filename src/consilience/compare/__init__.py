"""Comparison of answers with the reference: verdicts from runs, independent of any engine.

The modules `judge` and `judges` import the cases, which these functions do not need: import from them directly.
"""

# mypy: implicit-reexport

from consilience.compare.campaigns import CODES, exit_code, grouped, markdown_table, write_campaign
from consilience.compare.instant import compare_instant, compare_model, relative_difference
from consilience.compare.result import Comparison, Level, Quantity, Verdict, compare_by_bars
from consilience.compare.trajectory import (
    Prospect,
    ReferenceMotion,
    compare_trajectory,
    reference_spread,
    spread_over_time,
)
