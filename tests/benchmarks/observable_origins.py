"""Cases with body origins whose motion shows rotation, unlike the tip of a top or the centre of mass of a free body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from consilience.case import Case
from consilience.mechanism import Body, Frame
from consilience.reference import simulate
from reframing import in_frames, state_in_frames

STILL = 1e-6
"""Distance in m within which an origin counts as at rest, or as falling freely."""


def _aside(body: Body) -> Frame:
    """Return a frame one radius of gyration from the centre of mass, off possible axes of symmetry."""
    radius = np.sqrt(np.trace(body.inertia) / (2.0 * body.mass))
    return Frame(body.com + radius * np.array([2.0, 3.0, 6.0]) / 7.0, np.eye(3))


def with_observable_origins(case: Case) -> Case:
    """Return the case; if all body origins rest or fall freely, with other body frames."""
    motion, t = simulate(case.mechanism, case.initial_state, case.times, 1e-6, "relative"), case.times[:, None, None]
    rest = motion.p_WB[0]
    fall = rest + t * motion.v_WB_W[0] + 0.5 * t**2 * case.mechanism.gravity
    if all(np.max(np.abs(motion.p_WB - there)) > STILL for there in (rest, fall)):
        return case
    frames = [_aside(body) for body in case.mechanism.bodies]
    state = state_in_frames(case.initial_state, frames)
    moved = replace(case, mechanism=in_frames(case.mechanism, frames))
    vars(moved)["initial_state"] = state  # otherwise the state is assembled from values for the old frames
    return moved
