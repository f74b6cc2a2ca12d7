"""An engine that returns the reference's answers, all correct, under a name of its own."""

from consilience.engine import EngineInfo, Method, Question, Route
from consilience.reference.engine import ReferenceEngine


class HonestEngine(ReferenceEngine):
    def info(self):
        return EngineInfo("honest", "1.0", "1.0")

    def methods(self, mechanism, question):
        tolerances = (1e-10, 1e-12) if question is Question.TRAJECTORY else ()
        return (Method("descriptor", Route.NATIVE, tolerances=tolerances),)
