"""Compare both formulations of motions with contact on random mechanisms (`consilience.audit.formulations.contacts`).

python tests/harness/contacts.py --mechanisms 300
"""

import argparse
import sys

from consilience.audit.formulations.contacts import campaign, summary


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mechanisms", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1, help="of the first mechanism; the others follow")
    parser.add_argument("--limit", type=float, default=120.0, help="of time for one mechanism, s")
    given, found = parser.parse_args(), []
    for one in campaign(range(given.seed, given.seed + given.mechanisms), given.limit):
        found.append(one)
        print(f"{one.seed}: {one.reason or f'{one.difference:.2g} m, band {one.band:.2g} m'} {one.message}", flush=True)
    print(summary(found))
    return 0 if all(one.agrees for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
