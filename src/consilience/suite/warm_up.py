"""Compilation of the reference's kernels for motions in a second process, while the reference answers.

In the first run after an installation the engines wait for the reference, which compiles in one process. Kernels that
one process has compiled are in the cache of all others.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Thread

from consilience.case import Case
from consilience.compare.judge import REFERENCE
from consilience.engine import Question
from consilience.engine.worker.client import Worker
from consilience.engine.worker.requests import Plan, Request
from consilience.reference.kernel.cache import kernels_folder

_LAST = "driver.integrate-*.nbi"
"""Cache file of the kernel of a motion that is compiled last: module, function and line."""


def compiled() -> bool:
    """Whether the kernels of motions are in the cache, or compilation is switched off."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or next(kernels_folder().rglob(_LAST), None) is not None


@contextmanager
def compiled_beside(cases: Sequence[Case], limit: float, memory: int) -> Iterator[None]:
    """Compile the kernels for motions of these cases in a second process, until the end of the block."""
    worker = Worker(REFERENCE, limit, memory)
    thread = Thread(target=_compile, args=(worker, cases), name="compiling", daemon=True)
    thread.start()
    try:
        yield
    finally:
        worker.stop()
        thread.join()


def _compile(worker: Worker, cases: Sequence[Case]) -> None:
    """Ask for the first sample of each motion by the first formulation, which compiles its kernels.

    The last case and the last method come first: in the order of the suite, both processes would wait for the same
    kernels.
    """
    for case in reversed(cases):
        plan = worker.ask(Request(case.mechanism)).value
        methods = plan.methods.get(Question.TRAJECTORY, ()) if isinstance(plan, Plan) else ()
        for method in reversed(methods):
            if method.name.startswith(methods[0].name):
                step, states = method.tolerances[0], (case.initial_state,)
                worker.ask(Request(case.mechanism, Question.TRAJECTORY, method, states, case.times[:1], step))
