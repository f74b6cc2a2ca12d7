"""Look for false verdicts on random mechanisms (`consilience.audit.mutate.false_verdicts`).

python tests/harness/false_verdicts.py --mechanisms 500
"""

import argparse
import sys

from consilience.audit.mutate.false_verdicts import random_trials
from consilience.engine import installed

BLOCK = 25
"""Mechanisms between two counts, for which engines are loaded once."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mechanisms", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1, help="of the first mechanism; the others follow")
    given, found = parser.parse_args(), []
    engines = sorted(set(installed()) - {"reference"})
    last = given.seed + given.mechanisms
    for first in range(given.seed, last, BLOCK):
        for trial in random_trials(range(first, min(first + BLOCK, last)), engines):
            found.append(trial)
            if not trial.right:
                print(trial, flush=True)
        planted, wrong = [t for t in found if t.error], [t for t in found if not t.right]
        done = min(first + BLOCK, last) - given.seed
        print(
            f"{done} mechanisms, {len(found)} cells, {len(planted)} with a planted error, {len(wrong)} wrong",
            flush=True,
        )
    return 1 if wrong or not planted else 0


if __name__ == "__main__":
    sys.exit(main())
