"""The report in `reports/agreement`, by hand and in CI: ``python tests/agreement.py keep RUN``, ``... check RUN``.

``keep`` puts the pages and the cells of a run there, with the commit that made it. ``check`` compares a run, of some
cases or all, with the cells kept: exit code 1 if a verdict or a digit of a motion has moved, the engine being the same.
"""

import json
import subprocess
import sys
from pathlib import Path

from consilience.report.choice import choice_points
from consilience.report.headline import headline
from consilience.report.record import read_record
from consilience.report.view import page

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "reports" / "agreement"
FIELDS = ("case", "engine", "model", "motion", "digits", "method")

FAR = 1.0
"""Change in digits from which on a motion has moved; rounding alone changes less."""

SURE = 12.0
"""Digits beyond which a difference is rounding, another one on every kind of processor."""

ABOUT = """\
# Agreement

{cases} cases on {engines}, asked {how}: [report.md](report.md), `report.html`.

{headline}

| | |
|---|---|
| commit | `{commit}` |
| written | {written} |
| engines | {versions} |
| command | `just agreement` |

`cells.json` has verdict, digits and method of each cell. CI compares the tour with it. `choice.json` has what the page
"Which engine for my work?" of the documentation is made of.
"""


def kept_of(record, commit):
    """Return what is kept of a record: commit, versions of engines, cells."""
    header = record.header
    engines = {name: about["version"] for name, about in header["engines"].items()}
    cells = [{name: line[name] for name in FIELDS} for line in record.cells]
    about = {"commit": commit, "written": header["written"], "quick": bool(header.get("quick")), "engines": engines}
    return about | {"cells": cells}


def choice_of(record):
    """Return what the page of the documentation "Which engine for my work?" is made of."""
    view = page(record)
    about = {"summary": view.summary, "engines": {c[0]: c[1] for c in view.columns}}
    rows = [[row.engine, row.name, *row.values] for row in view.choice.rows]
    missing = [[row.engine, row.reason, row.count] for row in view.choice.missing]
    return about | {"rows": rows, "missing": missing, "points": choice_points(record)}


def moved(kept, now):
    """List in words the cells that differ, of cases and engines that both have, the engine in one version."""
    before = {(cell["case"], cell["engine"]): cell for cell in kept["cells"]}
    for cell in now["cells"]:
        key = cell["case"], cell["engine"]
        if key not in before or kept["engines"][cell["engine"]] != now["engines"][cell["engine"]]:
            continue
        old = before[key]
        where = f"{cell['case']} on {cell['engine']}"
        yield from (f"{where}, {n}: {old[n]} -> {cell[n]}" for n in ("model", "motion") if old[n] != cell[n])
        if None not in (old["digits"], cell["digits"]):
            then, today = (min(one["digits"], SURE) for one in (old, cell))
            if abs(today - then) >= FAR:
                yield f"{where}, digits: {old['digits']:.1f} -> {cell['digits']:.1f}"


def git(*words):
    return subprocess.check_output(["git", *words], cwd=ROOT, text=True).strip()


def keep(run):
    """Keep a run of the tree as it is committed."""
    if changed := git("status", "--porcelain", "--", "src", "adapters", "cases"):
        raise SystemExit(f"a report is of a commit, and these files are not as committed:\n{changed}")
    record = read_record(run)
    kept = kept_of(record, git("rev-parse", "HEAD"))
    lines = ",\n".join(f"  {json.dumps(cell)}" for cell in kept.pop("cells"))
    text = json.dumps(kept, indent=1).removesuffix("\n}") + f',\n "cells": [\n{lines}\n ]\n}}\n'
    versions = ", ".join(f"{name} {version}" for name, version in kept["engines"].items())
    about = {"cases": len(record.cases), "how": "quickly" if kept["quick"] else "in full", "versions": versions}
    about |= {"engines": f"{len(kept['engines']) - 1} engines", "headline": " ".join(f"{s}." for s in headline(record))}
    for name in ("report.html", "report.md"):
        (FOLDER / name).write_bytes((run / name).read_bytes())
    choice = choice_of(record)
    points = ",\n".join(f"  {json.dumps(point)}" for point in choice.pop("points"))
    told = json.dumps(choice, indent=1).removesuffix("\n}") + f',\n "points": [\n{points}\n ]\n}}\n'
    (FOLDER / "choice.json").write_text(told, encoding="utf-8")
    (FOLDER / "cells.json").write_text(text, encoding="utf-8")
    (FOLDER / "README.md").write_text(ABOUT.format(**(kept | about)), encoding="utf-8")


def check(run):
    """Compare a run with what is kept; return the exit code."""
    path = FOLDER / "cells.json"
    if not path.is_file():
        print("no cells are kept yet: `just agreement` writes them")
        return 0
    kept, now = json.loads(path.read_text(encoding="utf-8")), kept_of(read_record(run), "")
    if kept["quick"] != now["quick"]:
        raise SystemExit("one was asked quickly, the other in full")
    found = list(moved(kept, now))
    told = f"{len(found)} of {len(now['cells'])} cells have moved since commit {kept['commit'][:12]}"
    print("\n".join([told, *found, *["`just agreement` keeps them as they are now, if that is meant"] * bool(found)]))
    return bool(found)


if __name__ == "__main__":
    sys.exit({"keep": keep, "check": check}[sys.argv[1]](Path(sys.argv[2])))
