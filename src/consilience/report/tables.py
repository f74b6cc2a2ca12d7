"""Tables over all cases, engines and methods: orders, uncertainty of observables, softness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from consilience.report.answers import AnswerView
from consilience.report.cells import Cell
from consilience.report.facts import declared_text
from consilience.report.wording import DASH, digits_text, number, order_text


@dataclass(frozen=True)
class MethodRow:
    """Numbers of one method of one engine on one case."""

    cell: Cell
    answer: AnswerView
    values: tuple[str, ...]


@dataclass(frozen=True)
class MethodTable:
    """A table with a row for each method; `empty` is the text of a table without rows."""

    anchor: str
    title: str
    note: str
    heads: tuple[str, ...]
    rows: tuple[MethodRow, ...]
    empty: str


def method_tables(cells: Sequence[Cell], quick: bool) -> tuple[MethodTable, ...]:
    """Return the tables with a row for each method: orders, uncertainties, softness."""
    compared = [(cell, answer) for cell in cells for answer in cell.answers]
    names = list(dict.fromkeys(o["name"] for _, a in compared for o in a.lines.comparison["observables"]))

    def rows(values: Callable[[AnswerView], tuple[str, ...]]) -> tuple[MethodRow, ...]:
        """Return a row for each answer that has the values of the table."""
        return tuple(MethodRow(cell, answer, found) for cell, answer in compared if (found := values(answer)))

    return (
        MethodTable(
            "orders",
            "Orders of convergence",
            "The order that the method declares, that of its differences to the reference, and that of the changes "
            "among its own levels; digits at the finest level, and of the limit that the levels lead to; band: "
            "uncertainty of the finest level (grid convergence index). A dash: rounding hides the order.",
            ("declared", "to the reference", "among the levels", "finest, digits", "limit, digits", "band"),
            rows(_orders),
            "No motion by a method of declared order was compared.",
        ),
        MethodTable(
            "observables",
            "Uncertainty of each observable",
            "Band of the finest level (grid convergence index), and the observed order in brackets; from the levels "
            "alone, without the reference. Relative to the size, the largest speed and the largest angular velocity of "
            "the motion; angles in rad.",
            tuple(names),
            rows(lambda answer: _observables(answer, names)),
            "No motion has a ladder of steps or tolerances.",
        ),
        MethodTable(
            "softness",
            "Softness of constraints",
            "The same question at several scales of the engine's own softness, each half the one before: the order in "
            "which the answer settles, its last change, and the difference to the reference of the limit without "
            "softness.",
            ("question", "order in softness", "shift", "without softness"),
            rows(_softness),
            "No engine was asked at several softnesses." + " A quick run leaves that out." * quick,
        ),
    )


def _orders(answer: AnswerView) -> tuple[str, ...]:
    c = answer.lines.comparison
    if not c["levels"] or c["declared_order"] is None:
        return ()
    return (
        declared_text(answer.lines),
        order_text(c["order"]),
        order_text(c["self_order"]),
        digits_text(c["digits"]),
        digits_text(c["limit_digits"]),
        number(c["band"]),
    )


def _observables(answer: AnswerView, names: Sequence[str]) -> tuple[str, ...]:
    found = answer.lines.comparison["observables"]
    own = {o["name"]: f"{number(o['band'])} ({order_text(o['order'])})" for o in found}
    return tuple(own.get(name, DASH) for name in names) if own else ()


def _softness(answer: AnswerView) -> tuple[str, ...]:
    soft = answer.lines.comparison["softness"]
    if not soft:
        return ()
    return answer.question, order_text(soft["order"]), number(soft["shift"]), number(soft["limit"])
