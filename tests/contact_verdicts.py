"""Verdicts of the contact group that were checked by hand, `contact_verdicts.toml`, and what a full run differs in.

python tests/contact_verdicts.py RUN    compare a report of `consilience run --tag contact`; exit code 1 if one differs
"""

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

from consilience.report.record import read_record

FILE = Path(__file__).with_suffix(".toml")
AGREES = frozenset({"agreement", ""})
"""Causes of motions that agree: the rule, and none where a question has no rules."""


@dataclass(frozen=True)
class Expected:
    """A method of an engine about a case: cause of its verdict, and the reason in words; none where it agrees."""

    case: str
    engine: str
    method: str
    cause: str
    reason: str


def expected(path=FILE):
    """Return the motions of the table by case, engine and method.

    A cause stands for its rule (`consilience.compare.rules`), or is ``unsupported`` or ``failed``. Its reason is that
    of the case, of the engine's method, or of the cause alone: the first of them that is given.
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    names, reasons, found = table["methods"], table["reasons"], []
    for case, engines in table["cases"].items():
        for engine, causes in engines.items():
            for short, cause in causes.items():
                method = names[engine][short] if short != "all" else ""
                keys = (f"{case} {engine} {cause}", f"{engine} {short} {cause}", f"{engine} {cause}", cause)
                reason = "" if cause in AGREES else next((reasons[key] for key in keys if key in reasons), "")
                found.append(Expected(case, engine, method, cause, reason))
    return found


def cause_of(comparison):
    """Return the cause of a comparison of a record, as in the table."""
    word = comparison["verdict"]
    return word if word in ("unsupported", "failed") else comparison["rule"]


def differences(record, table):
    """List in words the motions of a record that are not as the table has them, and those that it does not have."""
    wanted = {(one.case, one.engine, one.method): one.cause for one in table}
    cases, missing = {one.case for one in table}, set(wanted)
    for c in record.comparisons:
        if c["question"] != "trajectory" or c["engine"] == "reference" or c["case"] not in cases:
            continue
        key = c["case"], c["engine"], c["method"]
        if c["verdict"] == "unsupported" and key not in wanted:
            key = c["case"], c["engine"], ""
        missing.discard(key)
        if (was := wanted.get(key, "not in the table")) != cause_of(c):
            yield f"{' on '.join(key[:2])}, {c['method']}: {was} -> {cause_of(c)} ({c['why']})"
    asked = {case["name"] for case in record.cases}
    yield from (f"{' on '.join(key[:2])}, {key[2]}: {wanted[key]} -> no motion" for key in missing if key[0] in asked)


if __name__ == "__main__":
    told = list(differences(read_record(Path(sys.argv[1])), expected()))
    print("\n".join([f"{len(told)} motions differ from the table", *told]))
    sys.exit(bool(told))
