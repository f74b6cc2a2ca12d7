"""Contacts, stops and dry friction at an instant: every engine has the accelerations and forces of closed forms."""

import pytest

from consilience.engine import CannotRepresent, Question
from contact_instants import PROBLEMS, error

BARS = {"dart": (1e-7, 1e-6), "exudyn": (1e-12, 1e-11), "mujoco": (1e-12, 1e-11), "pinocchio": (1e-12, 1e-10),
        "reference": (1e-12, 1e-12)}  # fmt: skip
"""Largest errors in m/s^2, rad/s^2 and N, of what sticks, rolls or is brought to rest, and of all else."""

STICK = ("rolls", "holds", "stays", "pad", "trough", "slide on a floor", "hinge")
"""Parts of the names of the first."""

LOOSE = {("mujoco", "box that tips"): 1e-10, ("mujoco", "box that friction holds"): 1e-10}

REFUSED = {
    ("dart", "box that friction holds"): "NsgsFrictionSolver fails|leave the accelerations open",
    ("dart", "boxes that start to slide"): "leave the accelerations open",
    ("exudyn", "ball that starts to slide"): "'ball' starts to slide",
    ("exudyn", "boxes that start to slide"): "'lower 0' starts to slide",
    ("exudyn", "hinge that starts"): "starts to slide",
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_an_instant_in_closed_form(engine, engine_name, name):
    problem = PROBLEMS[name]()
    if refused := engine.unsupported(problem[0], Question.INSTANT):
        assert [one.feature for one in refused] == ["contact 'rim'"]  # of Euler's disc
    elif words := REFUSED.get((engine_name, name)):
        with pytest.raises((CannotRepresent, ArithmeticError), match=words):
            error(engine, problem)
    else:
        bar = BARS[engine_name][not any(part in name for part in STICK)]
        assert error(engine, problem) < LOOSE.get((engine_name, name), bar)
