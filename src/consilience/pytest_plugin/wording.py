"""Messages of a test: verdict, numbers, cause, and the commands that ask again."""

from __future__ import annotations

from collections.abc import Iterator

from consilience.case import Case
from consilience.compare import Comparison
from consilience.engine import Status
from consilience.pytest_plugin.interview import JudgedQuestion
from consilience.report.wording import cause_of, digits_text, number, order_text


def evidence(found: JudgedQuestion, case: Case, again: tuple[str, str]) -> str:
    """Write verdict, numbers, causes and output of the engine, and the two commands that ask again."""
    worst, info = found.worst, found.info
    lines = [f"{case.name}, {worst.question}: {worst.engine} {info.version}: {worst.verdict}"]
    for comparison in found.comparisons:
        lines += _about(comparison, case)
    lines += [f"  printed  {run.log.strip()}" for run in found.runs if run.status is Status.FAILED and run.log.strip()]
    return "\n".join([*lines, f"  report   {again[0]}", f"  again    {again[1]}"])


def _about(c: Comparison, case: Case) -> Iterator[str]:
    """Write the verdict of one method, its numbers, and the cause."""
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
    yield f"  cause    {cause_of(c.rule, c.verdict)}"
