"""How near every engine comes to the motions that slide or roll from end to end, by its best route.

python tests/best_routes.py                     a table in Markdown
python tests/best_routes.py -e mujoco tripod    of one engine, of some cases

The route is the engine's extrapolated method, whose ladder is followed by halves until two levels lead nowhere nearer.
The figure is the largest difference to the reference over the motion, in sizes of the motion or radians: of the best
level, or of the limit of two consecutive levels by the declared order.
"""

import argparse

import numpy as np

from consilience.case import load_cases
from consilience.compare.motion import Scales, difference_over_time
from consilience.compare.uncertainty import richardson
from consilience.engine import Profile, Question, load_engine
from consilience.reference.contact import simulate_with_contacts
from consilience.suite.engine_runs import levels_of

CASES = ("ball_rolls", "ball_slips", "trough_rolls", "trough_slides", "thrown_across_slides", "tripod")
BARS = {"pinocchio": 1e-9, "mujoco": 1e-9, "dart": 1e-8, "exudyn": 1e-9}
MOST_STEPS = 2_500
"""Steps of the coarsest motion of an extrapolated one, above which no finer level is asked."""


def figures(engine, case):
    """Yield what was compared, in words, and its difference to the reference."""
    mechanism, start, times = case.mechanism, case.initial_state, case.times
    if refusals := engine.unsupported(mechanism, Question.TRAJECTORY):
        yield str(refusals[0]), np.inf
        return
    truth = simulate_with_contacts(mechanism, start, times, 1e-12)[0]
    scale = Scales.of(mechanism, truth).size
    matched = [m for m in engine.methods(mechanism, Question.TRAJECTORY) if m.profile is Profile.MATCHED]
    method, before, found = matched[-1], None, []
    step = levels_of(case, Question.TRAJECTORY, method)[0]
    while case.duration / step <= MOST_STEPS and (len(found) < 4 or min(found[-4:]) <= min(found)):
        try:
            answer = engine.trajectory(mechanism, start, times, method, step)
        except ArithmeticError as error:
            yield str(error), np.inf
            return
        compared = {f"{step:.3g} s": answer}
        if before is not None:
            compared[f"{2.0 * step:.3g} s and its half"] = richardson(before, answer, method.order)
        for what, motion in compared.items():
            found.append(float(np.max(difference_over_time(motion, truth, scale))))
            yield what, found[-1]
        before, step = answer, step / 2.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=CASES)
    parser.add_argument("-e", "--engine", choices=BARS, action="append", help="default: all")
    asked = parser.parse_args()
    print("| case | engine | best | at | bar |\n|---|---|---|---|---|")
    for name in asked.cases:
        (case,) = load_cases(name)
        for engine in asked.engine or BARS:
            what, best = min(figures(load_engine(engine), case), key=lambda one: one[1])
            print(f"| {name} | {engine} | {best:.1g} | {what} | {BARS[engine]:.0e} |", flush=True)


if __name__ == "__main__":
    main()
