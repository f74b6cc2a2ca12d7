"""Cases: a mechanism with its initial state, the questions to ask and what is known of the answers."""

from __future__ import annotations

from consilience.case.case import Case
from consilience.case.library import (
    case_files,
    case_names,
    cases_like,
    load_case,
    load_cases,
    shipped_cases,
)
from consilience.case.published import Published, read_motion, read_start, scale_of

__all__ = [
    "Case",
    "Published",
    "case_files",
    "case_names",
    "cases_like",
    "load_case",
    "load_cases",
    "read_motion",
    "read_start",
    "scale_of",
    "shipped_cases",
]
