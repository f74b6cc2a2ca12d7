"""Cross-check of all formulations by motions: each against the compiled descriptor form, over the same time.

Every formulation integrates the mechanism in its own coordinates with the same tolerance. The largest difference of
positions, quaternions, velocities and angular velocities over all samples counts relative to the largest value of its
kind, or to one where that is less. Bars: `BAR`, and `LONG_BAR` where the motion amplifies an error of its initial state
by more than `AMPLIFYING`. The amplification is measured: the initial state is displaced by `DISPLACEMENT` along
every free direction and given a change of velocity along every free direction, one after the other.

Forms without projection drift off their constraints; the violation is measured for all. They have no bar to meet.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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
from consilience.reference.formulations.orientations import ORIENTATIONS, SingularOrientation
from consilience.reference.solver import simulate

BAR, LONG_BAR, AMPLIFYING = 1e-9, 1e-8, 100.0
DISPLACEMENT = 1e-8
FINEST = 1e-13
"""Tolerance of the motion that all are compared with."""

DRIFTING = frozenset({"descriptor_baumgarte", "descriptor_unprojected"})
"""Formulations that do not return to the constraints after a step."""

PASSING, PASSING_SAMPLES = 0.02, 1001
"""Distance from a singular orientation, as a pure number, below which a motion passes it; samples to measure it."""

KINDS = ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")


@dataclass(frozen=True)
class Path:
    """One formulation along the motion of one case.

    Attributes
    ----------
    errors : dict of str to float
        Largest difference for each of `KINDS`; empty if there is no motion.
    violation : float
        Largest violation of a constraint at a sample, m, rad or dimensionless.
    steps : int
        Steps of the integrator.
    bar : float
        Infinite for a formulation that has none to meet.
    refusal : str
        Why there is no motion: what the formulation cannot represent, or what stopped it.
    exempt : bool
        The refusal is a property of the coordinates and no failure.
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
        """Whether the formulation keeps its bar, or has a reason of its coordinates to have no motion."""
        return self.exempt if self.refusal else self.error <= self.bar


@dataclass(frozen=True)
class CasePaths:
    """All formulations along the motion of one case, and how much the motion amplifies errors."""

    case: str
    amplification: float
    paths: tuple[Path, ...]


def differences(found: TrajectoryAnswer, wanted: TrajectoryAnswer) -> dict[str, float]:
    """Largest difference of each kind, relative to the largest value of that kind or to one."""
    return {
        kind: float(np.max(np.abs(getattr(found, kind) - getattr(wanted, kind))) / _scale(getattr(wanted, kind)))
        for kind in KINDS
    }


def _scale(values: Array) -> float:
    return max(1.0, float(np.max(np.abs(values))))


def amplification(mechanism: Mechanism, state: State, times: Array, wanted: TrajectoryAnswer) -> float:
    """Largest relative difference over the motion per unit of a change of the initial state."""
    return max(
        max(differences(simulate(mechanism, near, times, FINEST), wanted).values()) / DISPLACEMENT
        for near in _neighbours(mechanism, state)
    )


def _neighbours(mechanism: Mechanism, state: State) -> Iterator[State]:
    """States displaced along each free direction, then states with a change of velocity along each."""
    for direction in free_directions(mechanism, state, holonomic=True).T:
        placed = assemble_positions(mechanism, move(state, DISPLACEMENT * direction))
        yield assemble_velocities(mechanism, placed)
    for direction in free_directions(mechanism, state).T:
        change = DISPLACEMENT * direction.reshape(-1, 6)
        yield State(state.p_WB, state.quat_WB, state.v_WB_W + change[:, :3], state.w_WB_W + change[:, 3:])


def violation(mechanism: Mechanism, motion: TrajectoryAnswer) -> float:
    """Largest violation of a holonomic constraint at any sample; turns of couplings are counted between samples."""
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
) -> CasePaths:
    """Motion of one case in all formulations named.

    Parameters
    ----------
    case : str
        Its name.
    mechanism : Mechanism
    state : State
        Consistent initial state.
    names : sequence of str
        Keys of `registry.FORMULATIONS`.
    duration : float, s
    samples : int
        Times at which motions are compared, the initial one included.
    tolerance : float
        Of the integrators; that of the motion to compare with is `FINEST`.
    """
    times = np.linspace(0.0, duration, samples)
    wanted = simulate(mechanism, state, times, FINEST)
    growth = amplification(mechanism, state, times, wanted)
    bar = LONG_BAR if growth > AMPLIFYING else BAR
    paths = tuple(_path(case, mechanism, state, name, wanted, tolerance, bar) for name in names)
    return CasePaths(case, growth, paths)


def _path(
    case: str, mechanism: Mechanism, state: State, name: str, wanted: TrajectoryAnswer, tolerance: float, bar: float
) -> Path:
    refused = registry.unsupported(name, mechanism)
    if refused:
        return Path(case, name, {}, 0.0, 0, bar, f"{refused[0].feature}: {refused[0].reason}", True)
    try:
        motion = simulate(mechanism, state, wanted.time, tolerance, name)
    except SingularOrientation as error:
        return Path(case, name, {}, 0.0, 0, bar, str(error), True)
    except NumericalFailure as error:
        passing = _closest_to_singular(mechanism, state, name, wanted.time)
        singular = f"; the motion passes its singular orientations at a distance of {passing:.1g}"
        exempt = passing < PASSING
        return Path(case, name, {}, 0.0, 0, bar, f"{error}{singular if exempt else ''}", exempt)
    own = np.inf if name in DRIFTING else bar
    steps = int(motion.counters["steps"])
    return Path(case, name, differences(motion, wanted), violation(mechanism, motion), steps, own)


def _closest_to_singular(mechanism: Mechanism, state: State, name: str, times: Array) -> float:
    """Least distance to a singularity of the orientation coordinates of a descriptor form, along the motion."""
    if name not in VARIANTS:
        return 1.0
    kind = ORIENTATIONS[VARIANTS[name].orientation]
    fine = np.linspace(times[0], times[-1], PASSING_SAMPLES)
    motion = simulate(mechanism, state, fine, 1e-9)
    return min(kind.distance_to_singularity(kind.coordinates(quat)) for quat in motion.quat_WB.reshape(-1, 4))


def table(cases: Sequence[CasePaths]) -> str:
    """Markdown: one row a formulation, one column a case, the largest relative difference in each."""
    names = list(dict.fromkeys(path.formulation for case in cases for path in case.paths))
    found = {(path.case, path.formulation): path for case in cases for path in case.paths}
    titles = [case.case for case in cases]
    rows = [["*amplification*", *(f"{case.amplification:.2g}" for case in cases)]]
    rows += [[f"`{name}`", *(_cell(found.get((case, name))) for case in titles)] for name in names]
    return "\n".join(markdown_table(("formulation", *titles), rows, "l" + "r" * len(titles)))


def _cell(path: Path | None) -> str:
    if path is None:
        return ""
    if path.refusal:
        return "singular" if path.exempt else "**failed**"
    return f"{path.error:.1e}" if path.agrees else f"**{path.error:.1e}**"


def drift_table(cases: Sequence[CasePaths]) -> str:
    """Markdown: largest violation of a constraint, of each form that drifts and of all others together."""
    names = list(dict.fromkeys(path.formulation for case in cases for path in case.paths))
    groups = {f"`{name}`": {name} for name in names if name in DRIFTING}
    groups["all others"] = set(names) - DRIFTING
    rows = []
    for title, members in groups.items():
        found = ([p.violation for p in case.paths if p.formulation in members] for case in cases)
        rows.append([title, *(f"{max(values):.1e}" for values in found)])
    return "\n".join(markdown_table(("formulation", *(case.case for case in cases)), rows, "l" + "r" * len(cases)))


def exceptions(cases: Sequence[CasePaths]) -> str:
    """Markdown: every formulation without a motion, and why."""
    missing = [path for case in cases for path in case.paths if path.refusal]
    rows = [(p.case, f"`{p.formulation}`", f"{'' if p.exempt else '**failed**: '}{p.refusal}") for p in missing]
    lines = markdown_table(("case", "formulation", "no motion because"), rows)
    return "\n".join(lines)
