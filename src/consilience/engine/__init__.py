"""Engines: the protocol of an adapter, the table of questions, answers in canonical observables, installed engines.

An adapter needs nothing beyond this package and `consilience.mechanism`. Both import NumPy and the standard library.
"""

from consilience.engine.answers import (
    CONTACT_MODES,
    EVENT_KINDS,
    CannotRepresent,
    EngineInfo,
    InstantAnswer,
    Manifest,
    Method,
    ModelAnswer,
    Profile,
    Route,
    Run,
    Status,
    TrajectoryAnswer,
    Unsupported,
)
from consilience.engine.contact_samples import joined_mode, limit_of_halved, motion_of_halved, over_parts
from consilience.engine.determinate_impulses import DeterminateImpulses, determinate_impulses
from consilience.engine.elementary_models import ELEMENTARY, axis_link, merged_spring, nonlinear_part, without_screws
from consilience.engine.harness_solvers import numerical_rank, require_stable, runge_kutta_4, solve_constrained
from consilience.engine.installation import adapter_file, engine_distribution, lacks_engine, pip_requirement
from consilience.engine.protocol import (
    Engine,
    beside_adapter,
    beyond,
    engines_like,
    feature_names,
    installed,
    load_engine,
    require_installed,
    split_name,
    steps_per_sample,
)
from consilience.engine.questions import Answer, Question, defects, load_named
from consilience.engine.rods import ROD_MARGIN, rod_turn, rods_of, suited_rods, turned_rods

__all__ = [
    "CONTACT_MODES",
    "ELEMENTARY",
    "EVENT_KINDS",
    "ROD_MARGIN",
    "Answer",
    "CannotRepresent",
    "DeterminateImpulses",
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
    "axis_link",
    "beside_adapter",
    "beyond",
    "defects",
    "determinate_impulses",
    "engine_distribution",
    "engines_like",
    "feature_names",
    "installed",
    "joined_mode",
    "lacks_engine",
    "limit_of_halved",
    "load_engine",
    "load_named",
    "merged_spring",
    "motion_of_halved",
    "nonlinear_part",
    "numerical_rank",
    "over_parts",
    "pip_requirement",
    "require_installed",
    "require_stable",
    "rod_turn",
    "rods_of",
    "runge_kutta_4",
    "solve_constrained",
    "split_name",
    "steps_per_sample",
    "suited_rods",
    "turned_rods",
    "without_screws",
]
