"""Long campaign of hostile inputs: ``python tests/hostile/campaign.py --inputs 50000 --kind cases --seed 1``.

Prints how many inputs were accepted and refused; an input that is neither is shrunk, written to the folder and shown
with its error, and the exit code is 1.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings

sys.path.insert(0, str(Path(__file__).parents[1]))

from hostile.extremes import extreme_mutants, swallow_extreme, warm_extreme
from hostile.properties import (
    case_mutants,
    read_seed,
    report_mutants,
    report_seed,
    steps,
    swallow_case,
    swallow_report,
    warm,
)
from hostile.wire import swallow_wire, warm_wire, wire_mutants


def main(arguments=None):
    """Run the campaign that the command line asks for; return the exit code, 1 after a finding."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=50_000)
    parser.add_argument("--kind", choices=("cases", "extreme", "reports", "wire"), default="cases")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=None, help="for the inputs; default: a temporary one")
    parser.add_argument("--report", type=Path, default=None, help="folder of the report to mutate; default: a new one")
    asked = parser.parse_args(arguments)
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="hostile"))
    folder.mkdir(parents=True, exist_ok=True)
    if asked.kind == "cases":
        strategy, swallow = case_mutants(), swallow_case
        warm()
    elif asked.kind == "extreme":
        strategy, swallow = extreme_mutants(steps), swallow_extreme
        warm()
        warm_extreme(folder)
    elif asked.kind == "wire":
        strategy, swallow = wire_mutants(steps), swallow_wire
        warm_wire(folder)
    else:
        given_report = report_seed(folder / "seed") if asked.report is None else read_seed(asked.report)
        strategy, swallow = report_mutants(given_report), swallow_report
        warm(given_report[0], asked.report or folder / "seed")
    counts = Counter()
    slowest = [0.0]

    @seed(asked.seed)
    @settings(
        max_examples=asked.inputs,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def campaign(raw):
        start = time.process_time()
        try:
            accepted = swallow(raw, folder)
        except Exception:
            (folder / "finding").write_bytes(raw)
            raise
        counts["accepted" if accepted else "refused"] += 1
        slowest[0] = max(slowest[0], time.process_time() - start)

    start = time.process_time()
    code = 0
    try:
        campaign()
    except Exception as error:  # noqa: BLE001 (every exception is a finding)
        print(f"{type(error).__name__}: {error}\nthe input: {folder / 'finding'}")
        import traceback

        traceback.print_exc()
        code = 1
    spent = time.process_time() - start
    print(f"{asked.kind}: {dict(counts)}, {spent:.0f} s of CPU, slowest {slowest[0]:.2f} s")
    return code


if __name__ == "__main__":
    sys.exit(main())
