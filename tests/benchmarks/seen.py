"""Cases whose accuracy can be seen: where no origin moves, as of a top on its tip, positions say nothing of turning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from routes import TIMES

from consilience.case import Case
from consilience.mechanism import Body, Frame
from consilience.reference import simulate
from reframing import in_frames, state_in_frames

STILL = 1e-6
"""An origin that moves less, in m, does not."""


def _aside(body: Body) -> Frame:
    """A frame a radius of gyration from the centre of mass, off the axes of any symmetry."""
    radius = np.sqrt(np.trace(body.inertia) / (2.0 * body.mass))
    return Frame(body.com + radius * np.array([2.0, 3.0, 6.0]) / 7.0, np.eye(3))


def seen(case: Case) -> Case:
    """The case, with other origins on its bodies if none of them moves."""
    p = simulate(case.mechanism, case.initial_state, TIMES, 1e-6, "relative").p_WB
    if np.max(np.abs(p - p[0])) > STILL:
        return case
    frames = [_aside(body) for body in case.mechanism.bodies]
    state = state_in_frames(case.initial_state, frames)
    moved = replace(case, mechanism=in_frames(case.mechanism, frames))
    vars(moved)["initial_state"] = state  # that of the case; its own would be assembled from values of the old frames
    return moved
