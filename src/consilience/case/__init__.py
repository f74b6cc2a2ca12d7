"""Cases: a mechanism with its initial state, the questions to ask and what is known of the answers.

Names of the library of cases are imported when first used: case files and families need Pydantic and SciPy, a `Case`
needs NumPy alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from consilience.case.case import Case
from consilience.case.equations import later_equations
from consilience.case.published import ACCELERATIONS, Published, read_motion, read_start, sample_of, scale_of

if TYPE_CHECKING:
    from consilience.case.drawing import Drawing, frame
    from consilience.case.editions import Edition, chosen_edition, editions
    from consilience.case.file.writer import save_case
    from consilience.case.library import case_files, case_names, cases_like, load_case, load_cases, shipped_cases

__all__ = [
    "ACCELERATIONS",
    "Case",
    "Drawing",
    "Edition",
    "Published",
    "case_files",
    "case_names",
    "cases_like",
    "chosen_edition",
    "editions",
    "frame",
    "later_equations",
    "load_case",
    "load_cases",
    "read_motion",
    "read_start",
    "sample_of",
    "save_case",
    "scale_of",
    "shipped_cases",
]


_ELSEWHERE = {
    "drawing": ("Drawing", "frame"),
    "editions": ("Edition", "chosen_edition", "editions"),
    "file.writer": ("save_case",),
}
"""Modules of the names that are not those of `library`."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'consilience.case' has no attribute '{name}'")
    module = next((module for module, names in _ELSEWHERE.items() if name in names), "library")
    return getattr(import_module(f"consilience.case.{module}"), name)
