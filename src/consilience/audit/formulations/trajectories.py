"""Cross-check of all formulations by motions, each compared with the compiled descriptor form.

Every formulation integrates in its own coordinates with the same tolerance. Errors are the largest differences of
positions, quaternions, velocities and angular velocities over all samples, relative to the largest value of the kind or
to one. Bars: `BAR`, and `LONG_BAR` if the motion amplifies errors of its initial state by more than `AMPLIFYING`. The
amplification is computed by displacing the initial state, and changing its velocities, by `DISPLACEMENT` along each
free direction.

Forms without projection drift off the constraints and have no bar; the constraint violation is computed for all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from consilience.audit.formulations.compare import distance_to_singular
from consilience.compare import markdown_table
from consilience.engine import TrajectoryAnswer
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    assemble_positions,
    assemble_velocities,
    constraint_residual,
    count_turns,
    free_directions,
    move,
)
from consilience.reference.formulations import registry
from consilience.reference.formulations.coordinates import VARIANTS
from consilience.reference.formulations.orientations import SingularOrientation
from consilience.reference.solver import simulate

BAR, LONG_BAR, AMPLIFYING = 1e-9, 1e-8, 100.0
DISPLACEMENT = 1e-8
FINEST = 1e-13
"""Tolerance of the motion to compare with."""

DRIFTING = frozenset({"descriptor_baumgarte", "descriptor_unprojected"})
"""Formulations without projection."""

PASSING, PASSING_SAMPLES = 0.02, 1001
"""Distance from a singular orientation (pure number) that counts as passing it; samples to compute the distance."""

KINDS = ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")


@dataclass(frozen=True)
class FormulationMotion:
    """Motion of one case in one formulation, compared.

    Attributes
    ----------
    errors : dict of str to float
        Largest difference of each of `KINDS`; empty without motion.
    violation : float
        Largest violation of a constraint at a sample, m, rad or dimensionless.
    steps : int
        Steps of the integrator.
    bar : float
        Infinite for a formulation without bar.
    refusal : str
        Reason if there is no motion.
    exempt : bool
        The refusal is due to the coordinates and not a failure.
    """

    case: str
    formulation: str
    errors: Mapping[str, float]
    violation: float
    steps: int
    bar: float
    refusal: str = ""
    exempt: bool = False

    @property
    def error(self) -> float:
        """Largest difference of any kind."""
        return max(self.errors.values(), default=0.0)

    @property
    def agrees(self) -> bool:
        """Whether the error is below the bar, or the coordinates excuse a missing motion."""
        return self.exempt if self.refusal else self.error <= self.bar


@dataclass(frozen=True)
class CaseMotions:
    """Motions of one case in all formulations, and the amplification of initial errors."""

    case: str
    amplification: float
    motions: tuple[FormulationMotion, ...]


def differences(found: TrajectoryAnswer, wanted: TrajectoryAnswer) -> dict[str, float]:
    """Return the largest difference of each kind, relative to the largest value of the kind or to one."""
    pairs = {kind: (getattr(found, kind), getattr(wanted, kind)) for kind in KINDS}
    return {kind: float(np.max(np.abs(a - b)) / max(1.0, np.max(np.abs(b)))) for kind, (a, b) in pairs.items()}


def amplification(mechanism: Mechanism, state: State, times: Array, wanted: TrajectoryAnswer) -> float:
    """Return the largest relative difference of motions per unit of a change of the initial state."""
    return max(
        max(differences(simulate(mechanism, near, times, FINEST), wanted).values()) / DISPLACEMENT
        for near in _neighbours(mechanism, state)
    )


def _neighbours(mechanism: Mechanism, state: State) -> Iterator[State]:
    """Yield states displaced along each free direction, then states with changed velocities along each."""
    for direction in free_directions(mechanism, state, holonomic=True).T:
        placed = assemble_positions(mechanism, move(state, DISPLACEMENT * direction))
        yield assemble_velocities(mechanism, placed)
    for direction in free_directions(mechanism, state).T:
        change = DISPLACEMENT * direction.reshape(-1, 6)
        yield State(state.p_WB, state.quat_WB, state.v_WB_W + change[:, :3], state.w_WB_W + change[:, 3:])


def violation(mechanism: Mechanism, motion: TrajectoryAnswer) -> float:
    """Return the largest violation of a holonomic constraint at any sample, full turns counted between samples."""
    largest, angles = 0.0, dict[str, float]()
    for k, t in enumerate(motion.time):
        state = motion.state(k)
        angles = count_turns(mechanism, state, angles)
        largest = max(largest, float(np.max(np.abs(constraint_residual(mechanism, state, t, angles)), initial=0.0)))
    return largest


def follow(
    case: str,
    mechanism: Mechanism,
    state: State,
    names: Sequence[str] = tuple(registry.FORMULATIONS),
    duration: float = 5.0,
    samples: int = 51,
    tolerance: float = 1e-12,
) -> CaseMotions:
    """Integrate one case in several formulations and compare the motions.

    Parameters
    ----------
    case : str
        Name of the case.
    mechanism : Mechanism
    state : State
        Consistent initial state.
    names : sequence of str
        Keys of `registry.FORMULATIONS`.
    duration : float, s
    samples : int
        Number of equidistant times, the initial one included.
    tolerance : float
        Tolerance of the integrators; that of the motion to compare with is `FINEST`.
    """
    times = np.linspace(0.0, duration, samples)
    wanted = simulate(mechanism, state, times, FINEST)
    growth = amplification(mechanism, state, times, wanted)
    bar = LONG_BAR if growth > AMPLIFYING else BAR
    motions = tuple(_compared_motion(case, mechanism, state, name, wanted, tolerance, bar) for name in names)
    return CaseMotions(case, growth, motions)


def _compared_motion(
    case: str, mechanism: Mechanism, state: State, name: str, wanted: TrajectoryAnswer, tolerance: float, bar: float
) -> FormulationMotion:
    """Integrate one case in one formulation and compare the motion.

    Parameters
    ----------
    case : str
        Name of the case.
    mechanism : Mechanism
    state : State
        Consistent initial state.
    name : str
        Key of `registry.FORMULATIONS`.
    wanted : TrajectoryAnswer
        Motion to compare with, at the same samples.
    tolerance : float
        Tolerance of the integrator.
    bar : float
        Largest allowed difference.
    """
    refused = registry.unsupported(name, mechanism)
    if refused:
        return FormulationMotion(case, name, {}, 0.0, 0, bar, f"{refused[0].feature}: {refused[0].reason}", True)
    try:
        motion = simulate(mechanism, state, wanted.time, tolerance, name)
    except SingularOrientation as error:
        return FormulationMotion(case, name, {}, 0.0, 0, bar, str(error), True)
    except NumericalFailure as error:
        passing = _closest_to_singular(mechanism, state, name, wanted.time)
        singular = f"; the motion passes its singular orientations at a distance of {passing:.1g}"
        exempt = passing < PASSING
        return FormulationMotion(case, name, {}, 0.0, 0, bar, f"{error}{singular if exempt else ''}", exempt)
    own = np.inf if name in DRIFTING else bar
    steps = int(motion.counters["steps"])
    return FormulationMotion(case, name, differences(motion, wanted), violation(mechanism, motion), steps, own)


def _closest_to_singular(mechanism: Mechanism, state: State, name: str, times: Array) -> float:
    """Return the least distance of a motion from a singularity of the orientation coordinates of a form."""
    if name not in VARIANTS:
        return 1.0
    fine = np.linspace(times[0], times[-1], PASSING_SAMPLES)
    motion = simulate(mechanism, state, fine, 1e-9)
    return distance_to_singular(name, motion.quat_WB.reshape(-1, 4))


def table(cases: Sequence[CaseMotions]) -> str:
    """Tabulate the largest relative difference by formulation (rows) and case (columns)."""
    names = list(dict.fromkeys(one.formulation for case in cases for one in case.motions))
    found = {(one.case, one.formulation): one for case in cases for one in case.motions}
    titles = [case.case for case in cases]
    rows = [["*amplification*", *(f"{case.amplification:.2g}" for case in cases)]]
    rows += [[f"`{name}`", *(_cell(found.get((case, name))) for case in titles)] for name in names]
    return "\n".join(markdown_table(("formulation", *titles), rows, "l" + "r" * len(titles)))


def _cell(one: FormulationMotion | None) -> str:
    if one is None:
        return ""
    if one.refusal:
        return "singular" if one.exempt else "**failed**"
    return f"{one.error:.1e}" if one.agrees else f"**{one.error:.1e}**"


def drift_table(cases: Sequence[CaseMotions]) -> str:
    """Tabulate the largest constraint violation of each drifting form and of all others together."""
    names = list(dict.fromkeys(one.formulation for case in cases for one in case.motions))
    groups = {f"`{name}`": {name} for name in names if name in DRIFTING}
    groups["all others"] = set(names) - DRIFTING
    rows = []
    for title, members in groups.items():
        found = ([p.violation for p in case.motions if p.formulation in members] for case in cases)
        rows.append([title, *(f"{max(values):.1e}" for values in found)])
    return "\n".join(markdown_table(("formulation", *(case.case for case in cases)), rows, "l" + "r" * len(cases)))


def exceptions(cases: Sequence[CaseMotions]) -> str:
    """Tabulate the formulations without a motion, with reasons."""
    missing = [one for case in cases for one in case.motions if one.refusal]
    rows = [(p.case, f"`{p.formulation}`", f"{'' if p.exempt else '**failed**: '}{p.refusal}") for p in missing]
    return "\n".join(markdown_table(("case", "formulation", "no motion because"), rows))
