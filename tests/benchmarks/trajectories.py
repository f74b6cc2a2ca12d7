"""Work and precision of trajectories by the reference: evaluations and CPU time for a given accuracy, case by case.

    python tests/benchmarks/trajectories.py [--heyoka PYTHON] [case ...]

For each case of the library, over 5 s in 101 samples: the loosest tolerance at which every body position at every
sample is accurate to 1e-6, 1e-9 and 1e-12 m, the evaluations, and the CPU time of the fastest of several runs of
`simulate`. The true motion is that of another integrator at a tolerance of 1e-14. For Taylor's method, coefficients
count as evaluations. With a Python that has heyoka, its time for the same motion by minimal equations written by hand
is listed too.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from consilience.case import load_case
from consilience.reference import simulate
from oracles import double_pendulum
from oracles.planar import Plane, held

CASES = (
    "physical_pendulum-large",
    "double_pendulum",
    "spatial_pendulum",
    "rotating_end_pendulum",
    "seven_axis_arm",
    "four_bar",
    "slider_crank",
    "andrews-iftomm",
    "n_four_bar_two-short",
)
GOALS = (1e-6, 1e-9, 1e-12)
TOLERANCES = 10.0 ** -np.arange(5.0, 14.0)
SAMPLES, DURATION, REPEATS = 101, 5.0, 5


def times_of(case):
    """Return samples over five seconds, or over the whole motion if that is shorter."""
    return np.linspace(0.0, min(DURATION, case.duration), SAMPLES)


def work(case):
    """Return error, evaluations and CPU time in s for each tolerance."""
    times = times_of(case)
    right = simulate(case.mechanism, case.initial_state, times, 1e-14, "relative", "dop853").p_WB
    for tolerance in TOLERANCES:
        found = []
        for _ in range(REPEATS):
            began = time.process_time()
            motion = simulate(case.mechanism, case.initial_state, times, tolerance, "relative")
            found.append(time.process_time() - began)
        yield np.max(np.abs(motion.p_WB - right)), motion.counters["evaluations"], min(found)


def pair(z):
    return [z.real, z.imag]


def pendulum_constants(case):
    (joint,) = case.mechanism.joints
    plane = Plane(case.mechanism, joint.name)
    (body,) = plane.bodies()
    arm = body.com - plane.pin(joint.name)
    q, r = held(case, joint.name)
    return {
        "gravity": pair(plane.gravity),
        "moment": pair(body.mass * arm),
        "inertia": body.inertia + body.mass * abs(arm) ** 2,
    }, [q, r]


def double_pendulum_constants(case):
    c, start = double_pendulum.pendulum(case)
    return {
        "gravity": pair(c.gravity),
        "link": pair(c.link),
        "arm_2": pair(c.arm_2),
        "mass_2": c.mass_2,
        "moment_1": pair(c.mass_1 * c.arm_1 + c.mass_2 * c.link),
        "A": c.inertia_1 + c.mass_1 * abs(c.arm_1) ** 2 + c.mass_2 * abs(c.link) ** 2,
        "B": c.inertia_2 + c.mass_2 * abs(c.arm_2) ** 2,
    }, start.tolist()


def four_bar_constants(case):
    plane = Plane(case.mechanism, "crank_pivot")
    A, B, C, D = (plane.pin(name) for name in ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot"))
    links, roots = (B - A, C - B, C - D), (A, B, D)
    bodies = [
        {"mass": body.mass, "inertia": body.inertia, "arm": pair((body.com - root) / link)}
        for body, root, link in zip(plane.bodies(), roots, links, strict=True)
    ]
    return {
        "gravity": pair(plane.gravity),
        "A": pair(A),
        "D": pair(D),
        "crank": pair(B - A),
        "coupler2": abs(C - B) ** 2,
        "rocker2": abs(C - D) ** 2,
        "branch": float(np.sign(((C - B) * np.conj(D - B)).imag)),
        "bodies": bodies,
    }, list(held(case, "crank_pivot"))


CONSTANTS = {
    "physical_pendulum-large": pendulum_constants,
    "double_pendulum": double_pendulum_constants,
    "four_bar": four_bar_constants,
}


def limit(python, names):
    """Return the results of `heyoka_limit.py` at a tolerance of 1e-12, for the cases that it supports."""
    jobs = {}
    for name in set(names) & set(CONSTANTS):
        case = load_case(name)
        constants, start = CONSTANTS[name](case)
        times = times_of(case).tolist()
        jobs[name] = {"constants": constants, "start": start, "times": times, "tolerance": 1e-12, "repeats": 20}
    script = Path(__file__).with_name("heyoka_limit.py")
    run = subprocess.run([python, script], input=json.dumps(jobs), capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", default=CASES)
    parser.add_argument("--heyoka", metavar="PYTHON", help="a Python that has heyoka")
    given = parser.parse_args()
    limits = limit(given.heyoka, given.cases) if given.heyoka else {}
    print("| case | " + " | ".join(f"{goal:g} m: evaluations, ms" for goal in GOALS) + " | heyoka, ms | ratio |")
    print("|---" * (len(GOALS) + 3) + "|")
    for name in given.cases:
        found = list(work(load_case(name)))
        cells, best = [], np.nan
        for goal in GOALS:
            reached = [(seconds, evaluations) for error, evaluations, seconds in found if error <= goal]
            best, evaluations = min(reached, default=(np.nan, 0))
            cells.append(f"{evaluations}, {1e3 * best:.2f}" if reached else f"not below {min(f[0] for f in found):.1e}")
        seconds = limits[name]["seconds"] if name in limits else np.nan
        print(f"| {name} | " + " | ".join(cells) + f" | {1e3 * seconds:.3f} | {best / seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main()
