"""What a test says: verdict, numbers, cause, and how to ask again."""

from __future__ import annotations

from collections.abc import Iterator

from consilience.case import Case
from consilience.compare import Comparison
from consilience.engine import Status
from consilience.pytest_plugin.interview import Finding
from consilience.report.wording import CAUSES, CAUSES_BY_VERDICT, digits_text, number, order_text


def evidence(found: Finding, case: Case, again: tuple[str, str]) -> str:
    """Everything that a reader of a failed build needs."""
    worst, info = found.worst, found.info
    lines = [f"{case.name}, {worst.question}: {worst.engine} {info.version}: {worst.verdict}"]
    for comparison in found.comparisons:
        lines += _about(comparison, case)
    lines += [f"  printed  {run.log.strip()}" for run in found.runs if run.status is Status.FAILED and run.log.strip()]
    return "\n".join([*lines, f"  report   {again[0]}", f"  again    {again[1]}"])


def _about(c: Comparison, case: Case) -> Iterator[str]:
    """One method: its verdict, the numbers behind it, and the cause."""
    route = f" ({c.route})" if c.route else ""
    yield f"  method   {c.method or 'none'}{route}: {c.verdict}"
    for q in c.quantities:
        if q.count:
            met = "met" if q.met else "MISSED"
            yield f"  numbers  {q.name}: difference {number(q.difference)}, bar {number(q.bar)}: {met}"
    if c.levels:
        finest = c.levels[-1]
        yield (
            f"  numbers  motion: difference {number(finest.largest)} at step {number(finest.step)}, "
            f"asked {10.0**-case.digits:.0e}, {digits_text(c.digits)} digits; "
            f"order {order_text(c.order)}, declared {c.declared_order or 'none'}, band {number(c.band)}"
        )
    yield f"  why      {c.why}"
    yield f"  cause    {CAUSES[c.rule] if c.rule in CAUSES else CAUSES_BY_VERDICT[c.verdict]}"
