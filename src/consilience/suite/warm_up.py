"""Kernels of the reference that are not compiled yet: while it answers, a second process compiles those of motions.

The first run after an installation compiles for minutes, in one process on one core: the engines wait for the
reference. Kernels that one process has compiled all others find in the cache.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from consilience.case import Case
from consilience.compare.judge import REFERENCE
from consilience.engine import Question
from consilience.engine.worker.client import Plan, Request, Worker

_LAST = "integrate.integrate-*.nbi"
"""Index of what is compiled last of a motion."""


def kernels_folder() -> Path:
    """Folder where Numba keeps the compiled kernels of the reference."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    return Path(named) if named else Path(__file__).parents[1] / "reference"


def compiled() -> bool:
    """Whether kernels of motions are in the cache, or nothing is compiled at all."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or next(kernels_folder().rglob(_LAST), None) is not None


@contextmanager
def compiled_beside(cases: Sequence[Case], limit: float, memory: int) -> Iterator[None]:
    """Have a process of its own compile what motions of these cases need, as far as it comes meanwhile."""
    worker = Worker(REFERENCE, limit, memory)
    thread = Thread(target=_compile, args=(worker, cases), name="compiling", daemon=True)
    thread.start()
    try:
        yield
    finally:
        worker.stop()
        thread.join()


def _compile(worker: Worker, cases: Sequence[Case]) -> None:
    """Ask for the first sample of each motion by the first formulation, which takes no time once it is compiled.

    From the last case to the first: in the order of the suite, both processes would compile the same at the same time.
    """
    for case in reversed(cases):
        plan = worker.ask(Request(case.mechanism)).value
        methods = plan.methods.get(Question.TRAJECTORY, ()) if isinstance(plan, Plan) else ()
        for method in methods:
            if method.name.startswith(methods[0].name):
                step, states = method.tolerances[0], (case.initial_state,)
                worker.ask(Request(case.mechanism, Question.TRAJECTORY, method, states, case.times[:1], step))
