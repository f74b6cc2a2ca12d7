"""Suites: many cases, engines and questions, run in parallel, stored, resumed and judged."""

from consilience.suite.dense import densely_sampled
from consilience.suite.engine_runs import ask_case, ask_ladder, open_plan
from consilience.suite.store import Store
from consilience.suite.suite import EngineFailure, Resources, Results, run_suite, simulate_case
from consilience.suite.thoroughness import FULL, QUICK, Thoroughness

__all__ = [
    "FULL",
    "QUICK",
    "EngineFailure",
    "Resources",
    "Results",
    "Store",
    "Thoroughness",
    "ask_case",
    "ask_ladder",
    "densely_sampled",
    "open_plan",
    "run_suite",
    "simulate_case",
]
