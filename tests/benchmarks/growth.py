"""Growth of the cost of loops, from 10 to 200 loops: one evaluation, one projection, and the size of the factors.

    python tests/benchmarks/growth.py [family]

Prints ratios to the smallest mechanism and the exponents between neighbours, from the least times of several runs.
"""

import sys
import time

import numpy as np

from consilience.case import load_case
from consilience.reference import formulation

COUNTS = (10, 20, 50, 100, 200)
REPEATS = 7


def least(call, count):
    """Return the CPU time of a call in s: the least of the mean times of several runs."""
    found = []
    for _ in range(REPEATS):
        began = time.process_time()
        for _ in range(count):
            call()
        found.append((time.process_time() - began) / count)
    return min(found)


def main():
    """Print the table."""
    family = sys.argv[1] if len(sys.argv) > 1 else "windows:count={}"
    before = None
    print("| loops | entries of the factors | evaluation, us | projection, us | exponents |\n|---|---|---|---|---|")
    for n in COUNTS:
        case = load_case(family.format(n))
        equations = formulation("relative", case.mechanism)
        u = equations.settle(0.0, equations.coordinates(case.initial_state))
        calls = (lambda u=u, e=equations: e.derivative(0.0, u)), (lambda u=u, e=equations: e.settle(0.0, u))
        for call in calls:
            call()
        row = np.array([len(equations._rest.fronts.F), *(1e6 * least(call, max(3, 2000 // n)) for call in calls)])
        steps = np.log(row / before[1]) / np.log(n / before[0]) if before else []
        print(
            f"| {n} | {row[0]:.0f} | {row[1]:.1f} | {row[2]:.1f} | {' '.join(f'{s:.2f}' for s in steps)} |", flush=True
        )
        before = n, row


if __name__ == "__main__":
    main()
