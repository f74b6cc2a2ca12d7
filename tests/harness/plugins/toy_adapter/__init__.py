"""An adapter of an engine that exists in two versions, neither of them installed in this environment."""

import sys
from importlib.metadata import version

import numpy as np
import toy_engine

from consilience.engine import EngineInfo, Manifest, Method, ModelAnswer, Route


class ToyEngine:
    def info(self):
        heavy = {"numba", "pydantic", "pinocchio"} & set(sys.modules)
        return EngineInfo("toy", toy_engine.VERSION, f"{version('consilience')}", ",".join(heavy))

    def unsupported(self, mechanism, question):
        return ()

    def methods(self, mechanism, question):
        return (Method("toy", Route.NATIVE),)

    def manifest(self, mechanism):
        return Manifest()

    def model(self, mechanism, state, method):
        """The mass is the second derivative of a cam's profile, whose spline SciPy computes in the harness."""
        bend = mechanism.couplings[0].law.jet(0.3)[2]
        return ModelAnswer(bend, np.zeros(3), np.zeros((3, 3)), 1)
