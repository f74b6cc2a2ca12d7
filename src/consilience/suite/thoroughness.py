"""How much a suite asks: methods, states, samples and levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from consilience.case import Case
from consilience.compare.judge import REFERENCE
from consilience.engine import Method, Question


@dataclass(frozen=True)
class Thoroughness:
    """How many methods, states, samples and levels a suite asks for.

    Attributes
    ----------
    methods, reference_methods : int or None
        Number of methods of an engine, and of the reference, the headline method first; None: all. At states an engine
        is asked by all of its methods, since they are judged in the light of one another (`compare.other_methods`).
    states : int or None
        Largest number of states of the question `instant`.
    samples : int or None
        Largest number of sample intervals of a motion.
    closer : bool
        Whether to ask for more levels and other softness where three levels decide nothing, and for displaced motions.
    """

    methods: int | None = None
    reference_methods: int | None = None
    states: int | None = None
    samples: int | None = None
    closer: bool = True

    def case(self, case: Case) -> Case:
        """Return the case with as many states and samples as are asked for."""
        if self.states is not None:
            case = replace(case, instants=min(case.instants, self.states))
        if self.samples is not None and len(case.times) > self.samples + 1:
            case = case.with_span(self.samples * case.sample, None)
        return case

    def some(self, methods: Sequence[Method], engine: str, question: Question) -> Sequence[Method]:
        """Return the methods by which a question is asked."""
        if engine == REFERENCE:
            return methods[: self.reference_methods]
        return methods if question.at_states else methods[: self.methods]


FULL = Thoroughness()

QUICK = Thoroughness(methods=1, reference_methods=2, states=3, samples=5, closer=False)
"""Few states, and a short motion by the headline method of each engine: enough to see that something is wrong."""
