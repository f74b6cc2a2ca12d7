"""Motions with contacts, stops and dry friction: every engine follows closed forms, by its steps and extrapolated."""

import pytest

from consilience.engine import Profile, Question, Route
from contact_motions import PROBLEMS

SAMPLES, LEVELS = 10, 2

ONCE = {"box that stops", "box that stops on a slope", "ball that slips, then rolls", "ladder"}
"""Motions with one event."""

OFTEN = {
    name for name in PROBLEMS if any(word in name for word in ("bounces", "spheres", "pendulum", "wheel", "table"))
}
"""Motions with impacts, or with many events; all others are within one mode."""

INSIDE = [name for name in PROBLEMS if name not in ONCE | OFTEN]

BARS = {
    "dart": {"inside": (1e-2, 2e-5), "once": (1e-2, 4e-5), "often": (0.1, 5e-3)},
    "exudyn": {"inside": (4e-3, 3e-8), "once": (1.4e-2, 2e-5), "often": (4e-2,)},
    "mujoco": {"inside": (4e-3, 8e-6), "once": (7e-3, 4e-3), "often": (0.1, 2e-2)},
    "pinocchio": {"inside": (3e-2, 2e-5), "once": (1e-2, 4e-5), "often": (0.15, 5e-3)},
    "reference": {"inside": (1e-11,), "once": (1e-11,), "often": (1e-11,)},
}
"""Largest errors of states at the second level, by steps and extrapolated: twice what the methods attain there."""

BALANCE = {"dart": (1e-3, 4e-2), "exudyn": (4e-3, 8e-3), "mujoco": (8e-3, 1.2), "pinocchio": (5e-4, 3.2e-2),
           "reference": (2e-11, 2e-11)}  # fmt: skip
"""Largest errors of impulses and losses, within one mode and through events: Exudyn and MuJoCo tell forces of single
stages, which where a contact tilts or hits are not the mean that moves the body.
"""

UNSUPPORTED = {
    "dart": {"Euler's disc", "pendulum that bounces to rest", "wheel between stops"},
    "exudyn": {"Euler's disc", "shaken table"},
    "mujoco": {"Euler's disc", "spheres that slip", "spheres that grip"},
}

FALLS = {False: 1.8, True: 4.0}
"""Least ratio of errors of a step and its half, by whether the motion is extrapolated."""

SMALL = 2e-7
"""Error from which on an engine's own tolerance shows in extrapolated motions."""


def kind_of(name):
    return "often" if name in OFTEN else "once" if name in ONCE else "inside"


def answers(engine, name):
    """Return a problem, and the matched methods with their motions at two levels."""
    problem = PROBLEMS[name]()
    methods = [m for m in engine.methods(problem.mechanism, Question.TRAJECTORY) if m.profile is Profile.MATCHED]
    if methods[0].route is Route.REFERENCE:
        return problem, [(methods[0], [problem.answered(engine, methods[0], SAMPLES, None)])]
    return problem, [
        (method, [problem.answered(engine, method, SAMPLES, n) for n in method.substeps[:LEVELS]]) for method in methods
    ]


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_motion_in_closed_form(engine, engine_name, name):
    refused = engine.unsupported(PROBLEMS[name]().mechanism, Question.TRAJECTORY)
    assert bool(refused) == (name in UNSUPPORTED.get(engine_name, ()))
    if refused:
        return
    problem, found = answers(engine, name)
    kind = kind_of(name)
    for n, (method, motions) in enumerate(found):
        assert problem.error(motions[-1]) < BARS[engine_name][kind][n], method.name
        assert problem.balance(motions[-1]) < BALANCE[engine_name][kind != "inside"], method.name
        if "modes" in problem.truth:
            assert list(motions[-1].contact_mode[-1]) == problem.truth["modes"], method.name
        if kind == "inside" and len(motions) > 1:
            coarse, fine = map(problem.error, motions)
            assert fine < SMALL or coarse > FALLS[n > 0] * fine, method.name
