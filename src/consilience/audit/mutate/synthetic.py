"""The synthetic engine: the reference under another name, as a host without errors of its own.

Mutants that act on elements which no adapter represents (drives, couplings, rolling, skates) are planted in this host.
"""

from __future__ import annotations

from consilience.engine import Engine, EngineInfo, Method, Question, Route, load_engine
from consilience.mechanism import Mechanism
from consilience.reference.engine import ReferenceEngine

NAME = "synthetic"


class SyntheticEngine(ReferenceEngine):
    """The descriptor form of the reference, judged like any other engine."""

    def info(self) -> EngineInfo:
        """Return the name, and the version of the reference."""
        return EngineInfo(NAME, super().info().version, NAME)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """Return the descriptor form as the only method."""
        tolerances = (1e-9, 1e-10, 1e-11) if question is Question.TRAJECTORY else ()
        return (Method("descriptor", Route.NATIVE, tolerances=tolerances),)


def host(name: str) -> Engine:
    """Return a new engine to plant in: an installed engine, or the synthetic engine."""
    return SyntheticEngine() if name == NAME else load_engine(name)
