"""Engines: the protocol of an adapter, its answers in canonical observables, and how adapters are found.

What an adapter needs beside this package is in `consilience.mechanism`; NumPy and the standard library alone.
"""

from __future__ import annotations

from consilience.engine.answers import (
    Answer,
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Profile,
    Question,
    Route,
    Run,
    Status,
    TrajectoryAnswer,
    Unsupported,
    defects,
)
from consilience.engine.harness_solvers import runge_kutta_4, solve_constrained
from consilience.engine.installation import adapter_file, engine_distribution, lacks_engine, pip_requirement
from consilience.engine.protocol import (
    Engine,
    beside_adapter,
    beyond,
    engines_like,
    installed,
    load_engine,
    require_installed,
    split_name,
)

__all__ = [
    "Answer",
    "Engine",
    "EngineInfo",
    "InstantAnswer",
    "Manifest",
    "Method",
    "ModelAnswer",
    "Profile",
    "Question",
    "Route",
    "Run",
    "Status",
    "TrajectoryAnswer",
    "Unsupported",
    "adapter_file",
    "beside_adapter",
    "beyond",
    "defects",
    "engine_distribution",
    "engines_like",
    "installed",
    "lacks_engine",
    "load_engine",
    "pip_requirement",
    "require_installed",
    "runge_kutta_4",
    "solve_constrained",
    "split_name",
]
