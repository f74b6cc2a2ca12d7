"""Motions at steps above those of a ladder, which tell the least CPU time for a few digits and are never judged.

Above one step per sample the motion is asked at every second, third, ... sample of the case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from consilience.compare import ReferenceMotion
from consilience.compare.coarser_levels import coarser_levels
from consilience.engine import Method, Profile, Run
from consilience.mechanism import Array, Mechanism

FEW_DIGITS = 3
"""Correct digits of a motion below which no coarser step is asked for."""

AskMotion = Callable[[int, float, Array], Run]
"""Function that asks for a motion at a level, a step in s and sample times in s."""


def coarser_runs(
    ask: AskMotion, mechanism: Mechanism, method: Method, coarsest: Run, motion: ReferenceMotion
) -> Iterator[Run]:
    """Ask for motions at matched settings by steps that double, until a motion fails or has few digits.

    Parameters
    ----------
    ask : callable
    mechanism : Mechanism
    method : Method
    coarsest : Run
        First level of the ladder of the method.
    motion : ReferenceMotion

    Yields
    ------
    Run
        The levels are -1, -2, ...
    """
    if not method.substeps or method.profile is not Profile.MATCHED:
        return
    times, run = motion.answer.time, coarsest
    for n, (stride, substeps) in enumerate(longer_steps(method.substeps[0], len(times) - 1), start=1):
        (level,) = coarser_levels(mechanism, [run], motion)
        if level.largest is None or level.largest > 10.0**-FEW_DIGITS:
            return
        run = ask(-n, float(times[1] - times[0]) * stride / substeps, times[::stride])
        yield run


def longer_steps(substeps: int, intervals: int) -> Iterator[tuple[int, int]]:
    """List longer steps, each at least twice the one before, that end at the last of so many sample intervals.

    Yields
    ------
    stride, substeps : int
        Sample intervals, and the steps of equal length in them; one of both is 1.
    """
    last = 1.0 / substeps
    within = ((1, n) for n in range(substeps - 1, 0, -1))
    beyond = ((n, 1) for n in range(2, intervals + 1) if intervals % n == 0)
    for stride, count in (*within, *beyond):
        if stride / count >= 2.0 * last:
            last = stride / count
            yield stride, count
