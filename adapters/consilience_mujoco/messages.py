"""What MuJoCo warns of: kept off the console and out of the file it would write to the working directory.

The handler is global to the process, as MuJoCo has it; an adapter runs in a worker of its own.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

_messages: list[str] = []
mujoco.set_mju_user_warning(_messages.append)


class EngineWarningError(RuntimeError):
    """MuJoCo warned, so its numbers are not to be trusted: divergence, singular inertia, a failed factorisation."""


@contextmanager
def warnings_raise() -> Iterator[None]:
    """Turn whatever MuJoCo warns of in the block into an exception.

    Raises
    ------
    EngineWarningError
        At the end of the block, with the words of MuJoCo.
    """
    _messages.clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the compiler's own warnings come as Python warnings
        yield
    if _messages:
        raise EngineWarningError("; ".join(_messages))
