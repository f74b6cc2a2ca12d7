"""An engine that returns the reference's answers, all correct, under a name of its own."""

from functools import cached_property

from kept_answers import KeptReference

from consilience.engine import EngineInfo, Manifest, Method, Question, Route


class HonestEngine:
    @cached_property
    def _reference(self):
        return KeptReference()

    def info(self):
        return EngineInfo("honest", "1.0", "1.0")

    def unsupported(self, mechanism, question):
        return ()

    def methods(self, mechanism, question):
        tolerances = (1e-10, 1e-12) if question is Question.TRAJECTORY else ()
        return (Method("descriptor", Route.NATIVE, tolerances=tolerances),)

    def manifest(self, mechanism):
        return Manifest(exact=("all joints", "all force elements"))

    def model(self, mechanism, state, method):
        return self._reference.model(mechanism, state, method)

    def instant(self, mechanism, states, method):
        return self._reference.instant(mechanism, states, method)

    def trajectory(self, mechanism, state, times, method, step):
        return self._reference.trajectory(mechanism, state, times, method, step)
