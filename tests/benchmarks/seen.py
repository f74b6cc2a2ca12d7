"""Cases whose accuracy can be seen: the tip of a top and the centre of mass of a free body say nothing of turning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.case import Case
from consilience.mechanism import Body, Frame
from consilience.reference import simulate
from reframing import in_frames, state_in_frames

STILL = 1e-6
"""An origin that is no further, in m, from where it was, or from where it would have fallen to, is there."""


def _aside(body: Body) -> Frame:
    """A frame a radius of gyration from the centre of mass, off the axes of any symmetry."""
    radius = np.sqrt(np.trace(body.inertia) / (2.0 * body.mass))
    return Frame(body.com + radius * np.array([2.0, 3.0, 6.0]) / 7.0, np.eye(3))


def seen(case: Case) -> Case:
    """The case, with other origins on its bodies if all of them rest, or fall as points do."""
    motion, t = simulate(case.mechanism, case.initial_state, case.times, 1e-6, "relative"), case.times[:, None, None]
    rest = motion.p_WB[0]
    fall = rest + t * motion.v_WB_W[0] + 0.5 * t**2 * case.mechanism.gravity
    if all(np.max(np.abs(motion.p_WB - there)) > STILL for there in (rest, fall)):
        return case
    frames = [_aside(body) for body in case.mechanism.bodies]
    state = state_in_frames(case.initial_state, frames)
    moved = replace(case, mechanism=in_frames(case.mechanism, frames))
    vars(moved)["initial_state"] = state  # that of the case; its own would be assembled from values of the old frames
    return moved
