"""What a check of an identity says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from consilience.engine import Profile, Question, Route


class IdentityOutcome(StrEnum):
    """How an identity came out, best first."""

    HOLDS = "holds"
    NOT_APPLICABLE = "not applicable"
    NO_ANSWER = "no answer"
    VIOLATED = "violated"


class NotApplicableError(Exception):
    """The identity says nothing about this mechanism or method; the message says why."""


class UnansweredError(Exception):
    """The engine was asked what it says it can, and gave no sound answer; the message is the evidence."""


@dataclass(frozen=True)
class Residual:
    """What is left of an identity, relative to its terms.

    Attributes
    ----------
    value : float
    bar : float
        The most that rounding leaves, as `equations` says, and what the route states for itself.
    remark : str
    """

    value: float
    bar: float
    remark: str = ""

    @property
    def ratio(self) -> float:
        """Residual over bar; infinite if it is not a number."""
        return self.value / self.bar if np.isfinite(self.value) else float("inf")


def relative(left: float, allowed: float, size: float, remark: str = "") -> Residual:
    """Residual of an amount `left` of a quantity of the given size, of which `allowed` is no fault."""
    unit = size if size > 0.0 else 1.0
    return Residual(float(left / unit), float(max(allowed / unit, np.finfo(float).tiny)), remark)


def worst(residuals: Sequence[Residual]) -> Residual:
    """The one that comes nearest to its bar, or passes it furthest."""
    return max(residuals, key=lambda r: r.ratio)


@dataclass(frozen=True)
class Finding:
    """One engine, case, method and identity.

    Attributes
    ----------
    residual, bar : float or None
        None where nothing was measured.
    remark : str
        Why it does not apply or has no answer; where the worst residual was found.
    """

    case: str
    engine: str
    question: Question
    method: str
    route: Route | None
    profile: Profile
    identity: str
    outcome: IdentityOutcome
    residual: float | None = None
    bar: float | None = None
    remark: str = ""


def exit_code(findings: Sequence[Finding], missing: int = 0) -> int:
    """0: all that apply hold; 1: one is violated; 3: an answer is missing, or an engine. 1 wins over 3.

    What an engine does at its defaults is shown, and not judged: it was not told what the case means.
    """
    outcomes = {finding.outcome for finding in findings if finding.profile is Profile.MATCHED}
    if IdentityOutcome.VIOLATED in outcomes:
        return 1
    return 3 if IdentityOutcome.NO_ANSWER in outcomes or missing else 0
