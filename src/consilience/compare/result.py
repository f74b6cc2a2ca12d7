"""What a comparison says."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from consilience.compare.softness import Softness
from consilience.compare.uncertainty import Estimate
from consilience.engine import Profile, Question, Route


class Verdict(StrEnum):
    """How an engine's answer stands to the reference, best first."""

    AGREES = "agrees"
    DISCRETISATION = "differs: discretisation"
    REGULARISATION = "differs: regularisation"
    UNSUPPORTED = "unsupported"
    UNRESOLVED = "unresolved"
    MODEL = "differs: model"
    FAILED = "failed"


@dataclass(frozen=True)
class Quantity:
    """One compared quantity.

    Attributes
    ----------
    difference : float
        Largest difference relative to the largest component of the compared vector.
    bar : float
        What was asked: the difference may not be larger.
    count : int
        Number of values compared.
    remark : str
    """

    name: str
    difference: float
    bar: float
    count: int
    remark: str = ""

    @property
    def met(self) -> bool:
        """Whether the bar is met; NaN never is."""
        return self.difference <= self.bar


@dataclass(frozen=True)
class Level:
    """One step size (or tolerance) of a trajectory.

    Attributes
    ----------
    difference : tuple of float
        To the reference over time, on `Comparison.times`.
    largest, rms : float
        Of `difference` over all samples up to the horizon, not only the kept ones.
    energy : tuple of float
        Change of the total energy since the start, over the largest kinetic energy, on `Comparison.times`.
    residual : float
        Largest violation of a joint, m or dimensionless.
    """

    step: float
    cpu: float
    largest: float
    rms: float
    difference: tuple[float, ...]
    energy: tuple[float, ...]
    residual: float
    counters: dict[str, int | float] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """One engine, question and method against the reference.

    Attributes
    ----------
    digits : float or None
        Correct digits: minus the decimal logarithm of the largest difference; of a trajectory at its finest level.
    limit_digits : float or None
        The same for the Richardson limit of a trajectory.
    order : float or None
        Observed order of a fixed-step integrator, from the two finest levels against the reference.
    self_order : float or None
        Observed order from three levels among themselves, without the reference.
    band : float or None
        Uncertainty of the finest level by the grid convergence index.
    why : str
        The rule that decided, in numbers.
    rule : str
        Its name in `rules.RULES`; empty for questions with bars.
    profile : Profile
        Whose settings the engine ran with.
    horizon : float or None, s
        Time up to which a trajectory is judged; None where that is its end.
    softness : Softness or None
        How the difference moves with the engine's own softness.
    observables : tuple of Estimate
        Order and band of each observable of a trajectory.
    growth : tuple of float
        Growth of a perturbation of the reference, on `times`.
    """

    case: str
    engine: str
    question: Question
    method: str
    route: Route | None
    verdict: Verdict
    why: str
    digits: float | None = None
    limit_digits: float | None = None
    declared_order: int | None = None
    order: float | None = None
    self_order: float | None = None
    band: float | None = None
    reference_spread: float | None = None
    rule: str = ""
    profile: Profile = Profile.MATCHED
    horizon: float | None = None
    softness: Softness | None = None
    observables: tuple[Estimate, ...] = ()
    growth: tuple[float, ...] = ()
    quantities: tuple[Quantity, ...] = ()
    times: tuple[float, ...] = ()
    levels: tuple[Level, ...] = ()


def digits_of(difference: float) -> float:
    """Correct digits of a relative difference: 16 for none at all, 0 where nothing is right."""
    return float(np.clip(-np.log10(max(difference, 1e-16)), 0.0, 16.0))
