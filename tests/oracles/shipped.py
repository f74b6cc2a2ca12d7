"""Oracles by the name of the shipped case."""

import functools

from consilience.case import load_case
from oracles import double_pendulum, four_bar, rotating_end_pendulum, simple_pendulum, slider_crank, spatial_pendulum

TRAJECTORIES = {
    "simple_pendulum-small": simple_pendulum.trajectory,
    "simple_pendulum-large": simple_pendulum.trajectory,
    "double_pendulum": double_pendulum.trajectory,
    "spatial_pendulum": spatial_pendulum.trajectory,
    "rotating_end_pendulum": rotating_end_pendulum.trajectory,
    "four_bar": four_bar.trajectory,
    "slider_crank": slider_crank.trajectory,
}


@functools.cache
def answer(name):
    """The case and the oracle's motion on the time grid of the case: p_WB (n_t, n_b, 3) and R_WB (n_t, n_b, 3, 3)."""
    case = load_case(name)
    return case, *TRAJECTORIES[name](case, case.times)
