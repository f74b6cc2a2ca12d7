"""Annotate the comparisons of a record, and judge its cells, from verdicts alone.

Pages, exports and other programs read the annotations; a record of an earlier format is annotated when it is read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from consilience.compare import CODES, Verdict
from consilience.compare.result import digits_of
from consilience.engine import Question, Route, Status
from consilience.engine.failures import failure_class
from consilience.report.findings import finding_of
from consilience.report.selection import deciding, grouped, is_matched

WITHOUT_RULE: dict[str, str] = {
    Verdict.AGREES: "bars met",
    Verdict.MODEL: "bar missed",
    Verdict.UNSUPPORTED: "unsupported",
    Verdict.UNRESOLVED: "nothing to judge by",
    Verdict.DISCRETISATION: "steps",
    Verdict.REGULARISATION: "softness",
}
"""Cause of a verdict that no rule decided; a failure has its class."""

_WORST_LAST = {str(verdict): n for n, verdict in enumerate(Verdict)}

Lines = Sequence[dict[str, Any]]


def failure_of(run: Mapping[str, Any]) -> str | None:
    """Return the class of a failed run; None for any other."""
    return str(failure_class(run["reason"])) if run["status"] == Status.FAILED else None


def cause_of(comparison: Mapping[str, Any]) -> str:
    """Return the key of the cause of a verdict: the rule that decided, the class of a failure, or what bars say."""
    if comparison["verdict"] == Verdict.FAILED:
        return str(failure_class(comparison["why"]))
    return comparison["rule"] or WITHOUT_RULE[comparison["verdict"]]


def is_own(comparison: Mapping[str, Any]) -> bool:
    """Whether the engine's own solver or integrator answered."""
    return comparison["route"] is not None and Route(comparison["route"]).is_own


def digits_asked(comparison: dict[str, Any], case: dict[str, Any]) -> float | None:
    """Return the digits that a case asks of a motion, else those of the bar that decides; None without a bar."""
    if Question(comparison["question"]).over_time:
        return float(case["digits"])
    bar = deciding(comparison, case).bar
    return None if bar is None else round(digits_of(bar), 2)


def annotated(comparisons: Lines, cases: Lines) -> Iterator[dict[str, Any]]:
    """Add to each comparison its cause, the digits asked, the known finding, and whether it is the engine's best.

    Best is one matched method for each case, engine and question: an answer before none, one of the engine's own before
    one of the harness, then the best verdict, then the most digits.
    """
    about = {case["name"]: case for case in cases}
    matched = grouped(((c["case"], c["engine"], c["question"]), c) for c in comparisons if is_matched(c))
    best = {id(max(found, key=_merit)) for found in matched.values()}
    for c in comparisons:
        case, cause = about[c["case"]], cause_of(c)
        found = {"cause": cause, "finding": finding_of(c, cause, case)}
        yield c | found | {"best": id(c) in best, "digits_asked": digits_asked(c, case)}


def _merit(comparison: Mapping[str, Any]) -> tuple[bool, bool, int, float]:
    answered = comparison["verdict"] not in (Verdict.FAILED, Verdict.UNSUPPORTED)
    digits = comparison["digits"]
    return answered, is_own(comparison), -_gravity(comparison), -1.0 if digits is None else digits


def counts(comparison: Mapping[str, Any]) -> bool:
    """Whether an answer with matched settings counts for its cell.

    Of the motions of an engine the best counts, and any other that the exit code counts: an engine with more
    integrators must not look worse.
    """
    still = not Question(comparison["question"]).over_time
    return still or bool(comparison["best"]) or CODES[Verdict(comparison["verdict"])] != 0


def cell_lines(comparisons: Lines) -> Iterator[dict[str, Any]]:
    """Judge each cell from its matched, annotated comparisons.

    Yields
    ------
    dict
        ``verdict``: the worst of the answers that count, and ``cause``: its cause. ``model``: the worst verdict where
        nothing is integrated, leaving out refusals. ``motion``: the verdict of the best motion, with its ``digits``,
        ``digits_asked``, ``method`` and whether that method is the engine's ``own``. ``findings``: those that show in
        the cell. Absent values are None.
    """
    for (case, engine), found in grouped(((c["case"], c["engine"]), c) for c in comparisons).items():
        matched = [c for c in found if is_matched(c)]
        if not matched:
            continue
        decisive = max(filter(counts, matched), key=_gravity)
        still = [c for c in matched if not Question(c["question"]).over_time]
        motion = next((c for c in matched if c["best"] and Question(c["question"]).over_time), None)
        yield {
            "record": "cell",
            "case": case,
            "engine": engine,
            "verdict": str(decisive["verdict"]),
            "cause": decisive["cause"],
            "model": str(max(_answered(still), key=_gravity)["verdict"]) if still else None,
            "motion": str(motion["verdict"]) if motion else None,
            "digits": motion["digits"] if motion else None,
            "digits_asked": motion["digits_asked"] if motion else None,
            "method": motion["method"] if motion else None,
            "own": is_own(motion) if motion else None,
            "findings": sorted({c["finding"] for c in found if c["finding"]}),
        }


def _answered(comparisons: Lines) -> Lines:
    """Leave out refusals, unless there is nothing else."""
    return [c for c in comparisons if c["verdict"] != Verdict.UNSUPPORTED] or comparisons


def _gravity(comparison: Mapping[str, Any]) -> int:
    return _WORST_LAST[comparison["verdict"]]
