"""Cross-check of all formulations at single states: accelerations and determinate reactions of random mechanisms.

At each state every formulation that can represent the mechanism answers on its own. Answers are compared each with
each: the largest difference of two answers in any component is that of the largest from the least, and it must keep

    max - min  <=  (1e-10 + 10 eps cond) * largest component

with cond of the matrix that is solved: for accelerations the mass matrix in free directions
(`observe.mass_matrix_condition`), for reactions ``Q M^-1 Q^T`` (`observe.reaction_condition`). Accelerations are a_WB_W
and alpha_WB_W of all bodies, reactions the components that equilibrium determines. What a single formulation is worth
is its distance from the median of all, component by component: one that is wrong is found out, not those that agree.

Not compared, and listed with its reason:

- a state at which a formulation's coordinates are singular;
- a formulation above the bar at a distance d (a pure number) from a singularity of its orientation coordinates, as long
  as its error is no more than the rounding of two factors 1/d, one for rates and one for their derivatives;
- a state near a singular pose of the mechanism (a singular value of its constraints between `ROUNDING` and `SINGULAR`
  of the largest), where accelerations or reactions are not defined to that accuracy.

Run as a module for the whole campaign: ``python -m consilience.reference.crosscheck --mechanisms 200 --states 20``.
A single mechanism N is examined again with ``--mechanisms 1 --seed N``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from consilience.assembly import initial_state, random_states
from consilience.errors import ConsilienceError
from consilience.generate import random_mechanism
from consilience.kinematics import constraint_jacobian
from consilience.mechanism import Mechanism, State
from consilience.observe import determinate_reactions, mass_matrix_condition, reaction_condition
from consilience.reference import registry
from consilience.reference.formulation import Formulation
from consilience.reference.formulations.coordinates import VARIANTS
from consilience.reference.orientations import ORIENTATIONS, SingularOrientation
from consilience.spatial import Array

BAR = 1e-10
CONDITION = 10 * float(np.finfo(float).eps)
ROUNDING, SINGULAR = 1e-11, 1e-6
NEAR, LOST = 1e-2, 1e3 * float(np.finfo(float).eps)
"""Distance d from a singularity of coordinates below which that is a reason, and rounding that grows with 1/d^2."""

QUANTITIES = ("accelerations", "reactions")


@dataclass(frozen=True)
class Difference:
    """Answers to one question at one state against one another.

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
        Distance of each formulation from the median of all, relative to the same.
    """

    seed: int
    state: int
    quantity: str
    spread: float
    bar: float
    distances: dict[str, float]

    @property
    def agrees(self) -> bool:
        """Whether each agrees with each."""
        return self.spread <= self.bar

    @property
    def farthest(self) -> str:
        """Formulation farthest from the median."""
        return max(self.distances, key=lambda name: self.distances[name])


@dataclass(frozen=True)
class Exempt:
    """A state that is not compared, for a formulation or (empty) for all, and why; a failure if for no good reason."""

    seed: int
    state: int
    formulation: str
    reason: str
    failure: bool = False


@dataclass(frozen=True)
class Examination:
    """All formulations at all states of one mechanism.

    Attributes
    ----------
    seed : int
    bodies, loops : int
    features : tuple of str
        See `Mechanism.features`.
    refusals : dict of str to tuple of str
        What each formulation cannot represent, empty if it can.
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
    """Compare the formulations named, keys of `registry.FORMULATIONS`, on the random mechanism of a seed."""
    mechanism = random_mechanism(seed)
    return compare(mechanism, random_states(mechanism, initial_state(mechanism), states, seed), names, seed)


def compare(mechanism: Mechanism, states: Sequence[State], names: Sequence[str], seed: int) -> Examination:
    """Compare formulations on a mechanism at consistent states at the time zero.

    Loads and actuators are at zero where drives bind the states to that time, and at ``0.1 seed`` modulo 2 s otherwise.
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
                difference, near = _without_near_singular(_difference(seed, n, quantity, values, bar), values, state)
                differences.append(difference)
                exempt += near
    loops = len(mechanism.joints) - len(mechanism.bodies)
    features = tuple(mechanism.features)
    return Examination(
        seed, len(mechanism.bodies), loops, features, len(states), refusals, tuple(differences), tuple(exempt)
    )


def _small_singular_value(mechanism: Mechanism, state: State) -> float:
    """Relative singular value of the constraints that is neither rounding nor clear of zero; zero if there is none."""
    Q = constraint_jacobian(mechanism, state)
    if len(Q) == 0:
        return 0.0
    singular = np.linalg.svd(Q, compute_uv=False)
    singular /= singular[0]
    between = singular[(singular > ROUNDING) & (singular < SINGULAR)]
    return float(between.min()) if len(between) else 0.0


_Answer = tuple[Array, Array | None]


def _answers(
    able: dict[str, Formulation], state: State, t: float, seed: int, n: int
) -> tuple[dict[str, _Answer], list[Exempt]]:
    """Accelerations (6 n_b,) and reactions (n_j, 6) of each formulation, and those that have none."""
    answers: dict[str, _Answer] = {}
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
    """Joints that can have a reaction at all, shape (n_j, 1); a zero is no answer to compare."""
    return np.array([bool(joint.rows) for joint in mechanism.joints])[:, None]


def _compared(answers: dict[str, _Answer], determined: NDArray[np.bool_]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Vectors to compare, for each of `QUANTITIES`."""
    accelerations = {name: answer[0] for name, answer in answers.items()}
    reactions = {name: answer[1][determined] for name, answer in answers.items() if answer[1] is not None}
    return accelerations, reactions


def _difference(seed: int, n: int, quantity: str, values: dict[str, Array], bar: float) -> Difference:
    stacked = np.array(list(values.values()))
    finite = stacked[np.all(np.isfinite(stacked), axis=1)]
    if len(finite) == 0:
        return Difference(seed, n, quantity, np.inf, bar, dict.fromkeys(values, np.inf))
    median = np.median(finite, axis=0)
    scale = float(np.max(np.abs(median))) or 1.0
    # what is not finite is as far away as can be
    distances = np.nan_to_num(np.max(np.abs(stacked - median), axis=1) / scale, nan=np.inf, posinf=np.inf)
    spread = np.inf if len(finite) < len(stacked) else float(np.max(np.ptp(stacked, axis=0)) / scale)
    return Difference(seed, n, quantity, spread, bar, dict(zip(values, distances.tolist(), strict=True)))


def _without_near_singular(
    difference: Difference, values: dict[str, Array], state: State
) -> tuple[Difference, list[Exempt]]:
    """A difference above its bar again, without the formulations near a singularity of their coordinates."""
    exempt = []
    while not difference.agrees and len(difference.distances) > 2:
        name, error = difference.farthest, difference.distances[difference.farthest]
        d = _distance_to_singular(name, state)
        if not error <= LOST / d**2 or d > NEAR:
            break
        reason = f"{difference.quantity} {error:.1e} off: a body is {d:.1e} from a singularity of the coordinates"
        exempt.append(Exempt(difference.seed, difference.state, name, reason))
        others = {other: values[other] for other in difference.distances if other != name}
        difference = _difference(difference.seed, difference.state, difference.quantity, others, difference.bar)
    return difference, exempt


def _distance_to_singular(name: str, state: State) -> float:
    """Least distance of any body from a singularity of a formulation's orientation coordinates; one if it has none."""
    if name not in VARIANTS:
        return 1.0
    kind = ORIENTATIONS[VARIANTS[name].orientation]
    return min(kind.distance_to_singularity(kind.coordinates(quat)) for quat in state.quat_WB)


def campaign(
    seeds: Sequence[int], states: int, names: Sequence[str] = tuple(registry.FORMULATIONS), jobs: int = 1
) -> Iterator[Examination]:
    """Examine the random mechanisms of all seeds, in their order, in so many processes."""
    work: Callable[[int], Examination] = partial(examine, states=states, names=tuple(names))
    if jobs == 1:
        yield from map(work, seeds)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(work, seeds)


# ---------------------------------------------------------------- what a campaign found


def disagreements(examinations: Sequence[Examination]) -> list[Difference]:
    """All differences above their bar."""
    return [d for e in examinations for d in e.differences if not d.agrees]


def failures(examinations: Sequence[Examination]) -> list[Exempt]:
    """Answers that failed for no reason of coordinates or pose."""
    return [x for e in examinations for x in e.exempt if x.failure]


def agrees(examinations: Sequence[Examination]) -> bool:
    """Whether each agrees with each at all states compared."""
    return not disagreements(examinations) and not failures(examinations)


def formulation_table(examinations: Sequence[Examination]) -> str:
    """Markdown: for each formulation mechanisms and states, and the worst distance from the median, with its place."""
    names = list(dict.fromkeys(name for e in examinations for name in e.refusals))
    lines = [
        "| formulation | mechanisms | refused | states without answer | worst accelerations | worst reactions |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for name in names:
        able = sum(not e.refusals[name] for e in examinations)
        missing = sum(x.formulation == name for e in examinations for x in e.exempt)
        worst = [_worst(examinations, name, quantity) for quantity in QUANTITIES]
        cells = [f"`{name}`", str(able), str(len(examinations) - able), str(missing), *worst]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _worst(examinations: Sequence[Examination], name: str, quantity: str) -> str:
    """Worst distance from the median relative to the bar: value, ratio, and where."""
    found = [d for e in examinations for d in e.differences if d.quantity == quantity and name in d.distances]
    if not found:
        return "none"
    worst = max(found, key=lambda d: d.distances[name] / d.bar)
    distance = worst.distances[name]
    return f"{distance:.1e} ({distance / worst.bar:.1g} of the bar; {worst.seed}/{worst.state})"


def summary(examinations: Sequence[Examination]) -> str:
    """Markdown: what was examined, each with each, by kind of mechanism."""
    groups: dict[str, Callable[[Examination], bool]] = {
        "trees": lambda e: e.loops == 0,
        "loops": lambda e: e.loops > 0,
        "all": lambda _: True,
    }
    lines = [
        "| mechanisms | number | bodies | states | compared | worst accelerations | worst reactions | above the bar |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for title, member in groups.items():
        chosen = [e for e in examinations if member(e)]
        if not chosen:
            continue
        bodies = [e.bodies for e in chosen]
        found = [d for e in chosen for d in e.differences]
        cells = [title, str(len(chosen)), f"{min(bodies)} to {max(bodies)}", str(sum(e.states for e in chosen))]
        cells.append(str(sum(d.quantity == QUANTITIES[0] for d in found)))
        cells += [_widest([d for d in found if d.quantity == q]) for q in QUANTITIES]
        cells.append(str(len(disagreements(chosen))))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _widest(found: Sequence[Difference]) -> str:
    if not found:
        return "none"
    worst = max(found, key=lambda d: d.spread / d.bar)
    return f"{worst.spread:.1e} ({worst.spread / worst.bar:.1g} of the bar; {worst.seed}/{worst.state})"


def exceptions(examinations: Sequence[Examination]) -> str:
    """Markdown: refusals and states not compared, counted with their reasons, then every disagreement and failure."""
    refused = Counter(
        (name, _feature_kind(feature))
        for e in examinations
        for name, features in e.refusals.items()
        for feature in {_feature_kind(f) for f in features}
    )
    lines = ["| formulation | cannot represent | mechanisms |", "|---|---|---:|"]
    lines += [f"| `{name}` | {feature} | {count} |" for (name, feature), count in sorted(refused.items())]
    lines += ["", "| formulation | state (mechanism/state) | not compared because |", "|---|---|---|"]
    for x in (x for e in examinations for x in e.exempt):
        what = f"`{x.formulation}`" if x.formulation else "all"
        lines.append(f"| {what} | {x.seed}/{x.state} | {'**failed**: ' if x.failure else ''}{x.reason} |")
    lines += [
        "",
        "| above the bar (mechanism/state) | quantity | difference | bar | farthest |",
        "|---|---|---:|---:|---|",
    ]
    for d in disagreements(examinations):
        lines.append(f"| {d.seed}/{d.state} | {d.quantity} | {d.spread:.1e} | {d.bar:.1e} | `{d.farthest}` |")
    return "\n".join(lines)


def _feature_kind(feature: str) -> str:
    """A feature without the name of the one that has it: ``joint 'j1': screw`` to ``joint: screw``."""
    parts = feature.split("'")
    return feature if len(parts) < 3 else (parts[0].strip() + parts[2]).strip()


def report(examinations: Sequence[Examination]) -> str:
    """Markdown: all tables of a campaign."""
    return "\n\n".join([summary(examinations), formulation_table(examinations), exceptions(examinations)]) + "\n"


def main(
    mechanisms: Annotated[int, typer.Option(help="Number of random mechanisms.")] = 200,
    states: Annotated[int, typer.Option(help="States of each.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the first mechanism; the others follow.")] = 1,
    formulations: Annotated[list[str] | None, typer.Option("-f", "--formulation", help="Only these.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 1,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Markdown file for the tables.")] = None,
) -> None:
    """Compare all formulations with one another on random mechanisms; exit code 1 if any two disagree."""
    names = formulations or list(registry.FORMULATIONS)
    for name in names:
        registry.entry(name)
    found = []
    for examination in campaign(range(seed, seed + mechanisms), states, names, jobs):
        found.append(examination)
        typer.echo(f"\r{len(found)} of {mechanisms} mechanisms", nl=False, err=True)
    typer.echo(err=True)
    text = report(found)
    if output is not None:
        output.write_text(text, encoding="utf-8")
    typer.echo(summary(found) if output is not None else text)
    raise typer.Exit(0 if agrees(found) else 1)


if __name__ == "__main__":
    typer.run(main)
