"""Result of a comparison: verdict, compared quantities, levels of a motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from consilience.compare.power import Power
from consilience.compare.softness import Softness
from consilience.compare.uncertainty import Estimate
from consilience.engine import Method, Profile, Question, Route


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
        Largest difference that is allowed.
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
    """A motion at one step size or tolerance, compared with the reference.

    Attributes
    ----------
    difference : tuple of float
        Difference to the reference on `Comparison.times`.
    largest, rms : float
        Largest value and root mean square of the difference over all samples up to the horizon.
    energy : tuple of float
        Change of the total energy since the start, relative to the largest kinetic energy, on `Comparison.times`.
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
class CoarserLevel:
    """A motion at a longer step than those of a ladder, which is not judged.

    Attributes
    ----------
    step, cpu : float, s
    largest : float or None
        Largest difference to the reference up to the horizon; None without a motion.
    """

    step: float
    cpu: float
    largest: float | None


@dataclass(frozen=True)
class Comparison:
    """Comparison of an engine's answer to one question by one method with the reference.

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
        Reason of the verdict, in numbers.
    rule : str
        Name of the rule in `rules.RULES` that decided; empty for questions with bars.
    profile : Profile
        Settings with which the engine ran.
    horizon : float or None, s
        Time up to which a trajectory is judged; None where that is its end.
    softness : Softness or None
        Dependence of the difference on the softness of the engine's constraints.
    observables : tuple of Estimate
        Order and band of each observable of a trajectory.
    growth : tuple of float
        Growth of a perturbation of the reference, on `times`.
    coarser : tuple of CoarserLevel
        Motions at longer steps than those of `levels`, coarse to fine.
    power : tuple of Power
        Smallest errors that would have been noticed, one of each kind of parameter that acts; none of an answer that
        was not judged.
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
    coarser: tuple[CoarserLevel, ...] = ()
    power: tuple[Power, ...] = ()

    def __repr__(self) -> str:
        return f"Comparison: {self.engine} on {self.case}, {self.question}, {self.method}: {self.verdict}"


def digits_of(difference: float) -> float:
    """Return the correct digits of a relative difference, from 0 to 16."""
    return float(np.clip(-np.log10(max(difference, 1e-16)), 0.0, 16.0))


def compare_by_bars(
    case: str, engine: str, question: Question, method: Method, quantities: tuple[Quantity, ...]
) -> Comparison:
    """Return the comparison of an answer by its quantities: a missed bar is a difference of the model.

    Parameters
    ----------
    case, engine : str
    question : Question
    method : Method
    quantities : tuple of Quantity
        The compared quantities, one at least.
    """
    missed = [q for q in quantities if not q.met]
    largest = float(np.max([q.difference for q in quantities]))
    worst = missed[0] if missed else max(quantities, key=lambda q: q.difference)
    relation = "above" if missed else "within"
    return Comparison(
        case=case,
        engine=engine,
        question=question,
        method=method.name,
        route=method.route,
        profile=method.profile,
        verdict=Verdict.MODEL if missed else Verdict.AGREES,
        why=f"{worst.name}: difference {worst.difference:.2g}, {relation} the bar {worst.bar:.2g}",
        digits=digits_of(largest),
        quantities=quantities,
    )
