"""Classes of failed runs, by the beginning of their reason."""

from __future__ import annotations

import re
from enum import StrEnum


class FailureClass(StrEnum):
    """What became of a run without an answer."""

    NOT_FINITE = "not finite"
    """The answer has values that are not finite."""

    TIME = "time"
    """No answer within the time limit."""

    MEMORY = "memory"
    """The process grew beyond the limit of its memory."""

    CRASH = "crash"
    """The process died, or lost its connection."""

    REFUSED = "refused"
    """The engine raised an exception."""

    STOPPED = "stopped"
    """The run was ended from outside."""

    MALFORMED = "malformed"
    """The answer is of another type, shape or number than asked, or its message cannot be read."""

    OTHER = "other"
    """There is no answer for another reason."""


AT_A_STATE = (FailureClass.NOT_FINITE, FailureClass.REFUSED)
"""Failures that a state on the way may cause."""

_CLASSES: tuple[tuple[FailureClass, str], ...] = (
    (FailureClass.TIME, r"no answer within "),
    (FailureClass.MEMORY, r"out of memory: "),
    (FailureClass.CRASH, r"the worker (died|closed its connection)"),
    (FailureClass.STOPPED, r"stopped before it answered"),
    (FailureClass.REFUSED, r"[A-Za-z_][\w.]*: "),
    (FailureClass.NOT_FINITE, r"(.*; )?\w+ has \d+ values that are not finite"),
    (
        FailureClass.MALFORMED,
        r"the answer is an? |\w+ (is no array|holds|has shape) |garbage on the wire|the message cannot",
    ),
    (FailureClass.MALFORMED, r"it (answered job|sent more) "),
)
"""Beginnings of the reasons that `engine.worker` and `engine.questions` write; the first that matches decides."""

_STARTING = "while it started, "


def failure_class(reason: str) -> FailureClass:
    """Classify the reason of a failed run."""
    text = reason.removeprefix(_STARTING)
    return next((name for name, begin in _CLASSES if re.match(begin, text)), FailureClass.OTHER)
