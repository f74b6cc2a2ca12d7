"""Traps, the known errors of adapters as the trackers of the engines report them, and the mutants that plant them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from consilience.audit.mutate.mutated import Planting
from consilience.audit.mutate.subjects import MutationSubject
from consilience.engine import Question

TRAPS: dict[int, str] = {
    1: "armature or rotor inertia by default",
    2: "joint damping, dry friction or implicit damping by default",
    3: "inertia about the wrong point, rotated, or without products",
    4: "inertia from geometry, density 1000, default mass 1 and inertia 1",
    5: "contacts on by default",
    6: "order or conjugate of quaternions",
    7: "frame and order of the twist of a free joint",
    8: "spatial in place of classical acceleration",
    9: "continuous joints with two coordinates",
    10: "mass matrix filled in one triangle only",
    11: "frame and point of external forces",
    12: "sign, frame or reference point of joint wrenches",
    13: "forces cleared, reactions zero after a step",
    14: "state half brought up to date after a step",
    15: "acceleration and reaction of the start or the end of a step",
    16: "error reduction and force mixing shared by the whole process",
    17: "soft equality constraints, impedance clamped",
    18: "anchors computed in another pose",
    19: "Baumgarte terms in a pointwise acceleration",
    20: "redundant rows of planar loops",
    21: "adaptive step, damping, tolerance and step count by default",
    22: "constraints silently ignored",
    23: "other assembly branch",
    24: "integrator of lower order than declared",
    25: "value and direction of gravity by default",
    26: "sparse or dense, islands, warm start, solver stopped early",
    27: "drift of the engine's interface",
    28: "contacts: partner, point, friction and restitution",
    29: "elements of which a coefficient or a law is lost in part",
}
"""Title of each trap by its number, which mutants, reports and docs/detection.md refer to."""

CONTACTS = 28
"""Trap of the errors in contacts."""

UNPLANTED: dict[int, str] = {}
"""Traps without a mutant, with the reason."""

Precondition = Callable[[MutationSubject], bool]
"""Whether a mechanism has what an error acts on."""


def anything(_: MutationSubject) -> bool:
    """Accept every mechanism."""
    return True


@dataclass(frozen=True)
class Mutant:
    """One error, planted in the adapters of some engines.

    Attributes
    ----------
    trap : int
        Key of `TRAPS`.
    name : str
        Unique.
    how : str
        What is changed.
    magnitudes : tuple of float
        Largest first. `WHOLE` for an error that is planted all or nothing.
    unit : str
        Unit of the magnitudes.
    question : Question
        Expected to catch the mutant. `model` and `instant` are always asked both; `trajectory` is asked alone.
    plant : callable
        See `mutated.Planting`.
    precondition : callable
        Whether a mechanism has what the error acts on.
    methods : str
        Text in the names of the methods that are asked; all methods by default.
    harmless : bool
        The change is no error: the harness must not notice it.
    unseen : bool
        No question sees the error, for the reason in `remark`; the report shows the mutant as a known limit.
    remark : str
        Why some of the magnitudes cannot be noticed.
    solver : bool
        Planted only in adapters that solve for the accelerations of an instant with the harness.
    hosts : tuple of str
        Engines in which the mutant is planted; `table` fills this in.
    """

    trap: int
    name: str
    how: str
    magnitudes: tuple[float, ...]
    unit: str
    question: Question
    plant: Planting
    precondition: Precondition = anything
    methods: str = ""
    harmless: bool = False
    unseen: bool = False
    remark: str = ""
    solver: bool = False
    hosts: tuple[str, ...] = ()

    @property
    def questions(self) -> tuple[Question, ...]:
        """Return the questions that are asked."""
        if self.question is Question.TRAJECTORY:
            return (Question.TRAJECTORY,)
        return (Question.MODEL, Question.INSTANT)


def decades(first: int, last: int, step: int = 1) -> tuple[float, ...]:
    """Return powers of ten from ``10**first`` down to ``10**last``."""
    return tuple(float(f"1e{n}") for n in range(first, last - 1, -step))


WHOLE = (1.0,)
"""All or nothing."""

FINE = (1.0, 1e-4, 1e-8, 1e-10, 1e-11, 1e-12)
"""Magnitudes down to the resolution of `model` and `instant`."""

MOTION = (1.0, 1e-4, 1e-7, 1e-9)
"""Magnitudes down to the resolution of `trajectory`."""

FRACTION = "of the whole error"
"""Unit of a magnitude that is 1 for the error as it occurs in practice."""
