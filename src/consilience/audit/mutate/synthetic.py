"""The synthetic engine: the reference under a name of its own, and what it can do that no engine of ours does.

It is right in all it says, so that a mutant of it is wrong by what was planted and by nothing else. Mechanisms that no
adapter can represent (drives, couplings, rolling, skates) are planted here.
"""

from __future__ import annotations

from consilience.engine import Engine, EngineInfo, Method, Question, Route, load_engine
from consilience.mechanism import Mechanism
from consilience.reference.engine import ReferenceEngine

NAME = "synthetic"


class SyntheticEngine(ReferenceEngine):
    """The descriptor form of the reference, to be judged like any other engine."""

    def info(self) -> EngineInfo:
        """Name, and version of the reference."""
        return EngineInfo(NAME, super().info().version, NAME)

    def methods(self, mechanism: Mechanism, question: Question) -> tuple[Method, ...]:
        """The descriptor form alone."""
        tolerances = (1e-9, 1e-10, 1e-11) if question is Question.TRAJECTORY else ()
        return (Method("descriptor", Route.NATIVE, tolerances=tolerances),)


def host(name: str) -> Engine:
    """A new engine to plant in: an installed one, or the synthetic."""
    return SyntheticEngine() if name == NAME else load_engine(name)
