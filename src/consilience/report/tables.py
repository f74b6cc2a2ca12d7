"""Tables over all cases, engines and methods: orders, uncertainty of observables, softness."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.report.answers import AnswerView
from consilience.report.cells import Cell
from consilience.report.facts import declared_text
from consilience.report.record import Record
from consilience.report.selection import method_of
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


_Values = Callable[[dict[str, Any], dict[str, Any]], tuple[str, ...]]
"""Function from a comparison and its method to the numbers of a row; empty for no row."""


def method_tables(record: Record, cells: Sequence[Cell]) -> tuple[MethodTable, ...]:
    """Return the tables with a row for each method: orders, uncertainties, softness."""
    compared, quick = list(_compared(record, cells)), bool(record.header.get("quick"))
    names = list(dict.fromkeys(o["name"] for _, _, c, _ in compared for o in c["observables"]))

    def rows(values: _Values) -> tuple[MethodRow, ...]:
        """Return a row for each comparison that has the values of the table."""
        return tuple(
            MethodRow(cell, answer, found)
            for cell, answer, comparison, method in compared
            if (found := values(comparison, method))
        )

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
            rows(lambda comparison, _: _observables(comparison, names)),
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


def _compared(
    record: Record, cells: Sequence[Cell]
) -> Iterator[tuple[Cell, AnswerView, dict[str, Any], dict[str, Any]]]:
    """List every answer of the cells with its comparison and its method."""
    found = {(c["case"], c["engine"], c["question"], c["method"]): c for c in record.comparisons}
    for cell in cells:
        for answer in cell.answers:
            comparison = found[cell.case, cell.engine, answer.question, answer.method]
            yield cell, answer, comparison, method_of(record.runs_of(comparison))


def _orders(c: dict[str, Any], method: dict[str, Any]) -> tuple[str, ...]:
    if not c["levels"] or c["declared_order"] is None:
        return ()
    return (
        declared_text(c, method),
        order_text(c["order"]),
        order_text(c["self_order"]),
        digits_text(c["digits"]),
        digits_text(c["limit_digits"]),
        number(c["band"]),
    )


def _observables(c: dict[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    own = {o["name"]: f"{number(o['band'])} ({order_text(o['order'])})" for o in c["observables"]}
    return tuple(own.get(name, DASH) for name in names) if own else ()


def _softness(c: dict[str, Any], _method: dict[str, Any]) -> tuple[str, ...]:
    soft = c["softness"]
    if not soft:
        return ()
    return c["question"], order_text(soft["order"]), number(soft["shift"]), number(soft["limit"])
