"""An adapter of an engine of many versions, whose wheels the tests build: one of them has another mass."""

import graded_engine
import numpy as np

from consilience.engine import EngineInfo, Manifest, Method, ModelAnswer, Route
from consilience.mechanism import free_directions, mass_properties


class GradedEngine:
    def info(self):
        return EngineInfo("graded", graded_engine.VERSION, "1.0", "")

    def unsupported(self, mechanism, question):
        return ()

    def methods(self, mechanism, question):
        return (Method("sum", Route.NATIVE),)

    def manifest(self, mechanism):
        return Manifest()

    def model(self, mechanism, state, method):
        mass, com, inertia = mass_properties(mechanism, state)
        return ModelAnswer(
            graded_engine.FACTOR * mass, np.asarray(com), inertia, free_directions(mechanism, state).shape[1]
        )
