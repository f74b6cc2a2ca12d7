"""Stated power over the library: errors of 3 or 0.3 times the stated size, planted on the way to each engine.

python tests/harness/power.py [--seed N] [-e ENGINE] [CASE ...]

Method, parameter and factor are drawn for each case, engine and question; spans are ten samples at most, states three
(`consilience.audit.mutate.stated_power` has all of them, for a few cases).
"""

import argparse
import sys
from contextlib import ExitStack

import numpy as np

from consilience.audit.mutate.stated_power import FACTORS, PASSED, RIGHT, JudgedEngine, planted_trial, share, table
from consilience.case import case_files, load_cases
from consilience.compare.judge import FAULTS_OF_A_CASE, REFERENCE, reference_motion
from consilience.compare.power import MEASURED
from consilience.engine import Profile, installed
from consilience.engine.worker.client import InProcessEngine, Worker
from consilience.mechanism import physical_parameters
from consilience.suite import Thoroughness
from consilience.suite.engine_runs import EngineCase, ask_case, open_plan

SHORT, LIMIT = Thoroughness(states=3, samples=10), 60.0


def drawn(rng, choices):
    """One of several choices."""
    return choices[int(rng.integers(len(choices)))]


def drawn_trials(case, workers, rng):
    """Yield one trial for each engine and question of which the correct answer is passed over."""
    runs = list(ask_case(InProcessEngine(REFERENCE), case, MEASURED))
    parameters = {p.of: p for p in physical_parameters(case.mechanism, case.initial_state)}
    for worker in workers:
        plan = open_plan(worker, case)
        if isinstance(plan, str):
            continue
        judged = JudgedEngine(EngineCase(worker, case, plan, reference_motion=reference_motion(case, runs)), runs)
        for question in MEASURED:
            methods = [m for m in plan.methods.get(question, ()) if m.profile is Profile.MATCHED]
            if not methods:
                continue
            method = drawn(rng, methods)
            found = judged.compared(question, method)
            stated = [p for p in found.power if not p.missed] if found and found.verdict in PASSED else []
            if stated:
                power = drawn(rng, stated)
                yield planted_trial(judged, question, method, power, parameters[power.of], drawn(rng, FACTORS))


def main(arguments=None):
    """Plant errors; return the exit code, 1 if too few are caught and passed as stated."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("-e", "--engine", action="append", default=[])
    parser.add_argument("--seed", type=int, default=1)
    given, found = parser.parse_args(arguments), []
    rng = np.random.default_rng(given.seed)
    names = given.names or [path.stem for path in case_files()]
    cases = [case for name in names for case in load_cases(name)]
    with ExitStack() as stack:
        engines = given.engine or sorted(set(installed()) - {REFERENCE})
        workers = [stack.enter_context(Worker(name, LIMIT)) for name in engines]
        for number in rng.permutation(len(cases)):
            case = SHORT.case(cases[number])
            try:
                found += drawn_trials(case, workers, rng)
            except FAULTS_OF_A_CASE as fault:
                print(f"{case.name}: {fault}")
            print(f"{case.name}: {len(found)} planted errors, {sum(t.right for t in found)} as stated", flush=True)
            print(*(t for t in found if not t.right and t.case == case.name), sep="\n", flush=True)
    print(table(found))
    return int(not found or share(found) < RIGHT)


if __name__ == "__main__":
    sys.exit(main())
