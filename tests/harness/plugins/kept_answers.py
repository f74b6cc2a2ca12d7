"""Answers of the reference solver that are computed once for all processes.

With a folder in CONSILIENCE_TEST_ANSWERS, each answer is kept there, and every other process that is asked the same
reads it: of dozens of workers only those that are asked something new load the reference solver.
"""

import hashlib
import os
import pickle
from functools import cached_property
from pathlib import Path
from unittest.mock import patch

from consilience.engine.worker import codec, wire

FOLDER = "CONSILIENCE_TEST_ANSWERS"


class KeptReference:
    """The reference solver, by its entry point or as what another engine repeats."""

    def __init__(self, formulation=None):
        self._formulation = formulation

    @cached_property
    def _reference(self):
        from consilience.reference.engine import ReferenceEngine

        return ReferenceEngine(self._formulation)

    @staticmethod
    def variants():
        from consilience.reference.engine import ReferenceEngine

        return ReferenceEngine.variants()

    def info(self):
        return self._kept("info")

    def unsupported(self, mechanism, question):
        return self._kept("unsupported", mechanism, question)

    def methods(self, mechanism, question):
        return self._kept("methods", mechanism, question)

    def manifest(self, mechanism):
        return self._kept("manifest", mechanism)

    def model(self, mechanism, state, method):
        return self._kept("model", mechanism, state, method)

    def instant(self, mechanism, states, method):
        return self._kept("instant", mechanism, states, method)

    def trajectory(self, mechanism, state, times, method, step):
        return self._kept("trajectory", mechanism, state, times, method, step)

    def _kept(self, name, *asked):
        file = _file(type(self).__name__, self._formulation, name, *asked)
        if file is not None and file.exists():
            return pickle.loads(file.read_bytes())
        answer = self._computed(name, *asked)
        if file is not None:
            part = file.with_suffix(f".{os.getpid()}")  # other processes never see half a file
            part.write_bytes(pickle.dumps(answer))
            part.replace(file)
        return answer

    def _computed(self, name, *asked):
        return getattr(self._reference, name)(*asked)


class UncheckedReference(KeptReference):
    """The reference with its checks off: an engine with an error does not know that its states violate its joints."""

    def _computed(self, name, *asked):
        from consilience.reference import solver
        from consilience.reference.tree import solver as relative

        checks = {name: lambda *_: None for name in ("check_given", "check_solvable", "check_motion")}
        with (
            patch.multiple(solver, _refuse_unsolved=lambda *_: None, **checks),
            patch.multiple(relative, **{name: check for name, check in checks.items() if hasattr(relative, name)}),
        ):
            return super()._computed(name, *asked)


def _file(*asked):
    """File of the answer, named after a digest of all that is asked; None without a folder."""
    folder = os.environ.get(FOLDER)
    if folder is None:
        return None
    tree, arrays = codec.encode(asked)
    return Path(folder) / hashlib.sha256(wire.pack({"asked": tree}, arrays)).hexdigest()
