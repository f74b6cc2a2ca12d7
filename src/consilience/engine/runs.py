"""Run: what one engine answered to one question about one case by one method at one level."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from consilience.engine.answers import Manifest, Method
from consilience.engine.questions import Answer, Question


class Status(StrEnum):
    """How a run ended."""

    ANSWERED = "answered"
    UNSUPPORTED = "unsupported"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Run:
    """Answer of one engine to one question by one method at one level, or why there is none.

    Attributes
    ----------
    level : int
        Index into `Method.substeps` or `Method.tolerances`; 0 for questions without levels.
    step : float or None
        Step size of a trajectory in s, or its tolerance where the method is adaptive.
    answer : Answer or None
        None unless `status` is ``answered``.
    reason : str
        Why the question is unsupported or the run failed, with the evidence.
    cpu : float, s
        CPU time of the worker for the answer.
    log : str
        Output of the engine.
    """

    case: str
    engine: str
    question: Question
    method: Method | None
    level: int
    step: float | None
    status: Status
    answer: Answer = None
    reason: str = ""
    manifest: Manifest | None = None
    cpu: float = 0.0
    log: str = ""
