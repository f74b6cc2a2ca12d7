"""Mechanisms and states that mutants and correct adapters are judged on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from consilience.audit.random_mechanisms import MOST_BODIES, random_mechanism
from consilience.case import Case, load_case
from consilience.compare import ReferenceMotion, spread_over_time
from consilience.compare.instants import EPS, Bars, Instants
from consilience.engine import InstantAnswer, ModelAnswer, Question
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    characteristic_length,
    drawing_state,
    random_states,
    worst_condition,
)
from consilience.reference.engine import ReferenceEngine

INSTANTS = 3
"""States of each mechanism."""

CLEAR = Bars().reaction / (4.0 * EPS)
"""Largest `worst_condition` of a random state that is judged, about 1e5. Bars at this condition are eleven times those
of well-conditioned equations; `consilience.audit.fuzz` judges states nearer to a singular pose."""

CASES = (
    "bevel_gears",
    "double_pendulum",
    "four_bar",
    "manipulator",
    "nonlinear_springs",
    "rotating_end_pendulum",
    "slider_crank",
    "spatial_pendulum",
)
"""Shipped cases that mutants are judged on. The simple pendulum, a mass on a string, shows hardly any error; few
random mechanisms have a drive or a coupling, and their springs are linear."""

MOTIONS = ("double_pendulum", "four_bar")
"""Cases that are asked for trajectories: a tree, and a loop with dependent rows."""

SPAN, SAMPLE = 0.5, 0.05
"""Duration and sampling interval of the trajectories, s."""

CONTACT_CASES = (
    "bowling-hook",
    "ladder_leaves_wall",
    "thrown_across_stops",
    "ball_off_ball",
    "trough_rolls",
    "pendulum_at_a_stop",
)
"""Shipped cases with contacts or stops that mutants of contacts are judged on at states."""

CONTACT_MOTIONS = ("wheel_caught_by_stop", "bouncing_sphere", "ball_across_incline", "ball_slips")
"""The same for motions: a stop, an impact, a slip that turns, and a slip that ends."""

CONTACT_SPAN = 0.8
"""Longest duration of a trajectory with contacts, s: at the sampling interval of the case."""


@dataclass(eq=False)
class MutationSubject:
    """A mechanism with the states, and for a shipped case the trajectory, that engines are asked about.

    Attributes
    ----------
    name : str
    mechanism : Mechanism
    states : list of State
    case : Case or None
        The shipped case; None for a random mechanism, which is asked for no trajectory.
    """

    name: str
    mechanism: Mechanism
    states: list[State]
    case: Case | None = None

    @cached_property
    def size(self) -> float:
        """Length in m to which the suite relates differences of the question `model`."""
        return max(float(np.max(np.abs(self.states[0].p_WB))), characteristic_length(self.mechanism))

    @cached_property
    def instants(self) -> Instants:
        """Conditions and scales of the states, for the bars."""
        return Instants.of(self.mechanism, self.states)

    @cached_property
    def model_answer(self) -> ModelAnswer:
        """Answer of the reference to `model`."""
        engine = ReferenceEngine()
        return engine.model(self.mechanism, self.states[0], engine.methods(self.mechanism, Question.MODEL)[0])

    @cached_property
    def instant_answer(self) -> InstantAnswer:
        """Answer of the reference to `instant`."""
        engine = ReferenceEngine()
        return engine.instant(self.mechanism, self.states, engine.methods(self.mechanism, Question.INSTANT)[0])

    @property
    def times(self) -> Array:
        """Samples of the trajectory, s; none of a random mechanism."""
        return self.case.times if self.case is not None else np.empty(0)

    @cached_property
    def yardstick(self) -> ReferenceMotion:
        """Motion of the reference, with the spread of its formulations and tolerances."""
        assert self.case is not None
        engine = ReferenceEngine()
        first, *others = engine.methods(self.mechanism, Question.TRAJECTORY)
        asked = [(first, t) for t in reversed(first.tolerances[1:])] + [(m, t) for m in others for t in m.tolerances]
        motions = [engine.trajectory(self.mechanism, self.states[0], self.times, m, t) for m, t in asked]
        return ReferenceMotion(motions[0], spread_over_time(self.mechanism, motions), self.case.digits)


@lru_cache(maxsize=512)
def random_subject(seed: int) -> MutationSubject | None:
    """Return the random mechanism of a seed with moving states; None if a state is too near to a singular pose."""
    mechanism = random_mechanism(seed)
    states = random_states(mechanism, drawing_state(mechanism), INSTANTS, seed)
    if max(worst_condition(mechanism, state) for state in states) > CLEAR:
        return None
    return MutationSubject(f"seed {seed}", mechanism, states)


@lru_cache(maxsize=16)
def shipped_subject(name: str) -> MutationSubject:
    """Return a shipped case over a short span; with contacts, at no more states than its reactions are determined."""
    case = load_case(name)
    if name in CONTACT_CASES + CONTACT_MOTIONS:
        case = replace(case, instants=min(case.instants, INSTANTS)).with_span(min(case.duration, CONTACT_SPAN), None)
    else:
        case = replace(case, instants=INSTANTS).with_span(SPAN, SAMPLE)
    return MutationSubject(name, case.mechanism, case.states, case)


def random_subjects(count: int, first: int = 0, bodies: int = MOST_BODIES) -> Iterator[int]:
    """Yield the seeds, from `first` on, of `count` random mechanisms that can be judged, of at most `bodies` bodies."""
    seed = first
    while count:
        subject = random_subject(seed)
        if subject is not None and len(subject.mechanism.bodies) <= bodies:
            yield seed
            count -= 1
        seed += 1
