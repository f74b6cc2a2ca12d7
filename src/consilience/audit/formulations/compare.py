"""Cross-check of all formulations at single states: accelerations and determinate reactions of random mechanisms.

At each state all formulations that can represent the mechanism are evaluated independently. The largest difference of
any two answers in a component is the difference of the largest and the least answer; the bar is

    max - min  <=  (1e-10 + 10 eps cond) * largest component

cond: condition number of the mass matrix in free directions (accelerations; `mass_matrix_condition`) or of
``Q M^-1 Q^T`` (reactions; `reaction_condition`). Accelerations are a_WB_W and alpha_WB_W of all bodies,
reactions the components that equilibrium determines. The error of a formulation is its distance from the median of all,
by component.

Not compared, but listed with the reason:

- a state at which the coordinates of a formulation are singular;
- a formulation above the bar at a distance d (a pure number) from a singularity of its orientation coordinates, if its
  error is at most the rounding times two factors 1/d, of rates and their derivatives;
- the same forms near a singular pose: accelerations of their saddle-point system have the condition number of the
  reactions, above `STEEP`; formulations with orthogonal factors do not, and are compared;
- a state near a singular pose of the mechanism (a singular value of the constraints between `ROUNDING` and `SINGULAR`
  times the largest), where accelerations or reactions are not defined to this accuracy.

``consilience crosscheck`` runs the campaign; ``--mechanisms 1 --seed N`` repeats mechanism N.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from consilience.audit.random_mechanisms import random_mechanism, relative_singular_values
from consilience.errors import ConsilienceError
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    determinate_reactions,
    initial_state,
    mass_matrix_condition,
    random_states,
    reaction_condition,
)
from consilience.reference.formulations import registry
from consilience.reference.formulations.coordinates import VARIANTS
from consilience.reference.formulations.orientations import ORIENTATIONS, SingularOrientation
from consilience.reference.formulations.protocol import Formulation

BAR = 1e-10
CONDITION = 10 * float(np.finfo(float).eps)
ROUNDING, SINGULAR = 1e-11, 1e-6
NEAR, LOST = 1e-2, 1e3 * float(np.finfo(float).eps)
"""Largest distance d from a singularity of coordinates that excuses an error, and the rounding, times 1/d^2."""

STEEP = 1e8
"""Condition number of reactions above which a saddle-point system is excused: rounding exceeds the bar a thousand
times."""

QUANTITIES = ("accelerations", "reactions")


@dataclass(frozen=True)
class Difference:
    """Comparison of the answers of all formulations at one state.

    Attributes
    ----------
    seed, state : int
        Seed of the mechanism and number of the state.
    quantity : str
        One of `QUANTITIES`.
    spread : float
        Largest difference of two answers, relative to the largest component of the median.
    bar : float
    distances : dict of str to float
        Distance of each formulation from the median, on the same scale.
    """

    seed: int
    state: int
    quantity: str
    spread: float
    bar: float
    distances: dict[str, float]

    @property
    def agrees(self) -> bool:
        """Whether all formulations agree."""
        return self.spread <= self.bar

    @property
    def farthest(self) -> str:
        """Formulation farthest from the median."""
        return max(self.distances, key=lambda name: self.distances[name])


@dataclass(frozen=True)
class Exempt:
    """A state not compared for one formulation, or (empty) all, with the reason; `failure` if nothing excuses it."""

    seed: int
    state: int
    formulation: str
    reason: str
    failure: bool = False


@dataclass(frozen=True)
class Examination:
    """Comparison of all formulations at all states of one mechanism.

    Attributes
    ----------
    seed : int
    bodies, loops : int
    features : tuple of str
        See `Mechanism.features`.
    refusals : dict of str to tuple of str
        Features that each formulation cannot represent.
    """

    seed: int
    bodies: int
    loops: int
    features: tuple[str, ...]
    states: int
    refusals: dict[str, tuple[str, ...]]
    differences: tuple[Difference, ...]
    exempt: tuple[Exempt, ...]


def examine(seed: int, states: int, names: Sequence[str] = tuple(registry.FORMULATIONS)) -> Examination:
    """Compare formulations, keys of `registry.FORMULATIONS`, on the random mechanism of a seed."""
    mechanism = random_mechanism(seed)
    return compare(mechanism, random_states(mechanism, initial_state(mechanism), states, seed), names, seed)


def compare(mechanism: Mechanism, states: Sequence[State], names: Sequence[str], seed: int) -> Examination:
    """Compare formulations on a mechanism at consistent states.

    The time is zero with drives, which fix the states to a time, else ``0.1 seed`` modulo 2 s.
    """
    refusals = {name: tuple(r.feature for r in registry.unsupported(name, mechanism)) for name in names}
    able = {name: registry.formulation(name, mechanism) for name in names if not refusals[name]}
    t = 0.0 if mechanism.drives else 0.1 * seed % 2.0
    differences: list[Difference] = []
    exempt: list[Exempt] = []
    for n, state in enumerate(states):
        small = _small_singular_value(mechanism, state)
        if small:
            reason = f"near a singular pose: a singular value of the constraints is {small:.1e} of the largest"
            exempt.append(Exempt(seed, n, "", reason))
            continue
        answers, missing = _answers(able, state, t, seed, n)
        exempt += missing
        conditions = mass_matrix_condition(mechanism, state), reaction_condition(mechanism, state)
        determined = determinate_reactions(mechanism, state) & _carried(mechanism)
        for quantity, cond, values in zip(QUANTITIES, conditions, _compared(answers, determined), strict=True):
            bar = BAR + CONDITION * cond
            if len(values) > 1 and next(iter(values.values())).size:
                found = _difference(seed, n, quantity, values, bar)
                difference, near = _without_excused(found, values, state, conditions[1])
                differences.append(difference)
                exempt += near
    loops = len(mechanism.joints) - len(mechanism.bodies)
    features = tuple(mechanism.features)
    return Examination(
        seed, len(mechanism.bodies), loops, features, len(states), refusals, tuple(differences), tuple(exempt)
    )


def _small_singular_value(mechanism: Mechanism, state: State) -> float:
    """Return the least relative singular value of the constraints between `ROUNDING` and `SINGULAR`, or zero."""
    singular = relative_singular_values(mechanism, state)
    between = singular[(singular > ROUNDING) & (singular < SINGULAR)]
    return float(between.min()) if len(between) else 0.0


_FormulationAnswer = tuple[Array, Array | None]


def _answers(
    able: dict[str, Formulation], state: State, t: float, seed: int, n: int
) -> tuple[dict[str, _FormulationAnswer], list[Exempt]]:
    """Evaluate accelerations and reactions of each formulation; list missing answers.

    Parameters
    ----------
    able : dict of str to Formulation
        Formulations that can represent the mechanism.
    state : State
    t : float, s
    seed, n : int
        Seed of the mechanism and number of the state, for the list.

    Returns
    -------
    tuple
        By formulation the accelerations, shape (6 n_b,), and the reactions, shape (n_j, 6), or None; and the list.
    """
    answers: dict[str, _FormulationAnswer] = {}
    missing = []
    for name, equations in able.items():
        try:
            accelerations = np.hstack(equations.accelerations(state, t)).ravel()
            reactions = equations.reactions(state, t)
        except SingularOrientation as error:
            missing.append(Exempt(seed, n, name, f"{error.coordinates} singular at {error.angle}"))
        except (ConsilienceError, np.linalg.LinAlgError) as error:
            missing.append(Exempt(seed, n, name, str(error), failure=True))
        else:
            answers[name] = accelerations, None if reactions is None else np.hstack(reactions)
    return answers, missing


def _carried(mechanism: Mechanism) -> NDArray[np.bool_]:
    """Mark joints that have constraint rows, shape (n_j, 1); others have no reaction to compare."""
    return np.array([bool(joint.rows) for joint in mechanism.joints])[:, None]


def _compared(
    answers: dict[str, _FormulationAnswer], determined: NDArray[np.bool_]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the vectors to compare for each of `QUANTITIES`."""
    accelerations = {name: answer[0] for name, answer in answers.items()}
    reactions = {name: answer[1][determined] for name, answer in answers.items() if answer[1] is not None}
    return accelerations, reactions


def _difference(seed: int, n: int, quantity: str, values: dict[str, Array], bar: float) -> Difference:
    """Compare the answers of all formulations in one quantity.

    Parameters
    ----------
    seed, n : int
        Seed of the mechanism and number of the state.
    quantity : str
        One of `QUANTITIES`.
    values : dict of str to ndarray
        Answer of each formulation, all of one shape.
    bar : float
        Largest allowed relative difference.
    """
    stacked = np.array(list(values.values()))
    finite = stacked[np.all(np.isfinite(stacked), axis=1)]
    if len(finite) == 0:
        return Difference(seed, n, quantity, np.inf, bar, dict.fromkeys(values, np.inf))
    median = np.median(finite, axis=0)
    scale = float(np.max(np.abs(median))) or 1.0
    distances = np.nan_to_num(np.max(np.abs(stacked - median), axis=1) / scale, nan=np.inf, posinf=np.inf)
    spread = np.inf if len(finite) < len(stacked) else float(np.max(np.ptp(stacked, axis=0)) / scale)
    return Difference(seed, n, quantity, spread, bar, dict(zip(values, distances.tolist(), strict=True)))


def _without_excused(
    difference: Difference, values: dict[str, Array], state: State, reaction_cond: float
) -> tuple[Difference, list[Exempt]]:
    """Remove excused formulations from a difference above its bar."""
    exempt = []
    while not difference.agrees and len(difference.distances) > 2:
        name, error = difference.farthest, difference.distances[difference.farthest]
        reason = _excuse(name, error, state, reaction_cond)
        if not reason:
            break
        off = f"{difference.quantity} {error:.1e} off: {reason}"
        exempt.append(Exempt(difference.seed, difference.state, name, off))
        others = {other: values[other] for other in difference.distances if other != name}
        difference = _difference(difference.seed, difference.state, difference.quantity, others, difference.bar)
    return difference, exempt


def _excuse(name: str, error: float, state: State, reaction_cond: float) -> str:
    """Return the excuse of a descriptor form in orientation coordinates for an error, or an empty string."""
    if name not in VARIANTS:
        return ""
    d = distance_to_singular(name, state.quat_WB)
    if error <= LOST / d**2 and d <= NEAR:
        return f"a body is {d:.1e} from a singularity of the coordinates"
    if error <= CONDITION * reaction_cond and reaction_cond >= STEEP:
        return f"near a singular pose: its saddle-point system solves Q M^-1 Q^T of condition {reaction_cond:.1e}"
    return ""


def distance_to_singular(name: str, quats: Array) -> float:
    """Return the least distance of orientations, shape (n, 4), from a singularity of a form's coordinates."""
    kind = ORIENTATIONS[VARIANTS[name].orientation]
    return min(kind.distance_to_singularity(kind.coordinates(quat)) for quat in quats)


def campaign(
    seeds: Sequence[int], states: int, names: Sequence[str] = tuple(registry.FORMULATIONS), jobs: int = 1
) -> Iterator[Examination]:
    """Examine the random mechanisms of all seeds, in order, in `jobs` processes."""
    work: Callable[[int], Examination] = partial(examine, states=states, names=tuple(names))
    if jobs == 1:
        yield from map(work, seeds)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(work, seeds)


# ---------------------------------------------------------------- results of a campaign


def disagreements(examinations: Sequence[Examination]) -> list[Difference]:
    """Return all differences above their bar."""
    return [d for e in examinations for d in e.differences if not d.agrees]


def failures(examinations: Sequence[Examination]) -> list[Exempt]:
    """Return all failures that nothing excuses."""
    return [x for e in examinations for x in e.exempt if x.failure]


def agrees(examinations: Sequence[Examination]) -> bool:
    """Tell whether all formulations agree at all compared states."""
    return not disagreements(examinations) and not failures(examinations)
