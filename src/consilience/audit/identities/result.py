"""Results of a check of an identity: residual, outcome, finding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from consilience.engine import Profile, Question, Route


class IdentityOutcome(StrEnum):
    """Outcome of an identity, best first."""

    HOLDS = "holds"
    NOT_APPLICABLE = "not applicable"
    NO_ANSWER = "no answer"
    VIOLATED = "violated"


class NotApplicableError(Exception):
    """The identity says nothing about this mechanism or method; the message says why."""


class UnansweredError(Exception):
    """The engine supports the question and gave no sound answer; the message is the evidence."""


@dataclass(frozen=True)
class Residual:
    """Residual of an identity, relative to the size of its terms.

    Attributes
    ----------
    value : float
    bar : float
        Largest residual of rounding (see `equations`) and of the error that the route declares.
    remark : str
        State, body or row of the residual.
    """

    value: float
    bar: float
    remark: str = ""

    @property
    def ratio(self) -> float:
        """Residual over bar; infinite if the residual is not a number."""
        return self.value / self.bar if np.isfinite(self.value) else float("inf")


def relative(left: float, allowed: float, size: float, remark: str = "") -> Residual:
    """Return the relative residual of an amount `left` of a quantity of a size; `allowed` is the bar."""
    unit = size if size > 0.0 else 1.0
    return Residual(float(left / unit), float(max(allowed / unit, np.finfo(float).tiny)), remark)


def worst(residuals: Sequence[Residual]) -> Residual:
    """Return the residual that is largest relative to its bar."""
    return max(residuals, key=lambda r: r.ratio)


@dataclass(frozen=True)
class Finding:
    """Outcome of one identity for one engine, case and method.

    Attributes
    ----------
    residual, bar : float or None
        None without a measured residual.
    remark : str
        Place of the worst residual; or why the identity does not apply or has no answer.
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
    """Return 0 if all identities that apply hold, 1 if one is violated, 3 if an answer or engine is missing.

    1 wins over 3. Findings at an engine's default settings are shown and not judged.
    """
    outcomes = {finding.outcome for finding in findings if finding.profile is Profile.MATCHED}
    if IdentityOutcome.VIOLATED in outcomes:
        return 1
    return 3 if IdentityOutcome.NO_ANSWER in outcomes or missing else 0
