"""Suites: many cases, engines and questions, run in parallel, stored, resumed and judged."""

# mypy: implicit-reexport

from consilience.suite.engine_runs import FULL, QUICK, Thoroughness, ask_case, ask_ladder, open_plan
from consilience.suite.store import Store
from consilience.suite.suite import EngineFailure, Results, run_suite, simulate_case
