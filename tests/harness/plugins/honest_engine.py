"""An engine that returns the reference's answers, all correct, under a name of its own.

With a folder in CONSILIENCE_TEST_ANSWERS, each answer is kept there, and every other process that is asked the same
reads it: of dozens of workers only those that are asked something new load the reference solver.
"""

import hashlib
import os
import pickle
from functools import cached_property
from pathlib import Path

from consilience.engine import EngineInfo, Manifest, Method, Question, Route
from consilience.engine.worker import codec, wire

FOLDER = "CONSILIENCE_TEST_ANSWERS"


class HonestEngine:
    @cached_property
    def _reference(self):
        from consilience.reference.engine import ReferenceEngine

        return ReferenceEngine()

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
        return self._answer(Question.MODEL, mechanism, state, method)

    def instant(self, mechanism, states, method):
        return self._answer(Question.INSTANT, mechanism, states, method)

    def trajectory(self, mechanism, state, times, method, step):
        return self._answer(Question.TRAJECTORY, mechanism, state, times, method, step)

    def _answer(self, question, *asked):
        file = _file(question, *asked)
        if file is not None and file.exists():
            return pickle.loads(file.read_bytes())
        answer = getattr(self._reference, question)(*asked)
        if file is not None:
            part = file.with_suffix(f".{os.getpid()}")  # other processes never see half a file
            part.write_bytes(pickle.dumps(answer))
            part.replace(file)
        return answer


def _file(*asked):
    """File of the answer, named after a digest of all that is asked; None without a folder."""
    folder = os.environ.get(FOLDER)
    if folder is None:
        return None
    tree, arrays = codec.encode(asked)
    return Path(folder) / hashlib.sha256(wire.pack({"asked": tree}, arrays)).hexdigest()
