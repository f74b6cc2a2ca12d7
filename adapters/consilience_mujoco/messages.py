"""Warnings of MuJoCo, kept off the console and out of MuJoCo's log file in the working directory.

MuJoCo's handler of warnings is global to the process; an adapter runs in a worker of its own.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

_messages: list[str] = []
mujoco.set_mju_user_warning(_messages.append)


class EngineWarningError(RuntimeError):
    """A warning of MuJoCo that makes its numbers unreliable: divergence, singular inertia, failed factorisation."""


@contextmanager
def warnings_raise() -> Iterator[None]:
    """Turn warnings of MuJoCo in the block into an exception.

    Raises
    ------
    EngineWarningError
        At the end of the block, with the texts of MuJoCo.
    """
    _messages.clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # warnings of MuJoCo's compiler are Python warnings
        yield
    if _messages:
        raise EngineWarningError("; ".join(_messages))
