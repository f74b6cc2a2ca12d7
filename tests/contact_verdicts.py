"""Verdicts on the motions of the contact group as they must be, `contact_verdicts.toml`, compared with those of a run.

python tests/contact_verdicts.py RUN...   folders of `consilience run --tag contact`; exit code 1 if a verdict differs
"""

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

from consilience.report.record import read_record

FILE = Path(__file__).with_suffix(".toml")
STEPS = ("agrees", "differs: discretisation")
ANSWERS = {
    "same": STEPS,
    "soft": (*STEPS, "differs: regularisation"),
    "other": ("differs: model",),
    "unsupported": ("unsupported",),
}
"""Verdicts that say what the table says."""


@dataclass(frozen=True)
class Row:
    """What a method, or all of a profile, must be found to do in a case."""

    case: str
    engine: str
    profile: str
    method: str
    answer: str
    cause: str
    why: str

    def fits(self, comparison):
        """Whether the row is about a comparison of a record."""
        if (comparison["case"], comparison["engine"]) != (self.case, self.engine):
            return False
        refused = comparison["verdict"] == "unsupported" and not comparison["method"]
        if refused:  # for all methods of the engine
            return not self.method and self.profile == "matched"
        return comparison["profile"] == self.profile and self.method in ("", comparison["method"])

    def holds(self, comparison):
        """Whether the verdict of a comparison is that of the row, and its cause, where the row has one."""
        return comparison["verdict"] in ANSWERS[self.answer] and self.cause in ("", comparison["rule"])


def rows(path=FILE):
    """Return the rows of the table, one for each case."""
    for row in tomllib.loads(path.read_text(encoding="utf-8"))["row"]:
        common = [row[name] for name in ("engine", "profile")] + [
            row.get("method", ""),
            row["answer"],
            row.get("cause", ""),
        ]
        yield from (Row(case, *common, row["why"]) for case in row["cases"])


def held_open(path=FILE):
    """Return the methods on which a run cannot yet decide as the table says, by case and engine, with the reason."""
    found = tomllib.loads(path.read_text(encoding="utf-8")).get("open", [])
    return {(case, one["engine"], one["method"]): one["why"] for one in found for case in one["cases"]}


def motions(record):
    """Return the comparisons of a record that are about motions of engines."""
    return [c for c in record.comparisons if c["question"] == "trajectory" and c["engine"] != "reference"]


def differences(record, table):
    """List in words the motions of a record that are not as the table says, and its rows that no motion is about."""
    asked = motions(record)
    for row in table:
        about = [c for c in asked if row.fits(c)]
        wanted = f"{row.answer}{', ' + row.cause if row.cause else ''}"
        where = f"{row.case}, {row.engine}, {row.profile}"
        for c in about:
            if not row.holds(c):
                yield f"{where}, {c['method']}: {wanted}, found {c['verdict']}, {c['rule']} ({c['why']}){_open(c)}"
        if not about and row.case in {c["case"] for c in asked}:
            yield f"{where}: {wanted}, not asked"


def _open(comparison):
    key = comparison["case"], comparison["engine"], comparison["method"]
    return f" [open: {held_open()[key]}]" if key in held_open() else ""


if __name__ == "__main__":
    table, wrong = list(rows()), 0
    for folder in sys.argv[1:]:
        record = read_record(Path(folder))
        told = list(differences(record, table))
        wrong += sum("[open: " not in line for line in told)
        print(f"{folder}: {len(motions(record))} motions, {len(told)} not as in the table", *told, sep="\n")
    sys.exit(bool(wrong))
