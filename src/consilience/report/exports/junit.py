"""JUnit XML: a suite for each engine, a test for each case and question.

The document is valid against both Ant's schema (windyroad) and Jenkins's (junit-10): it has every attribute that Ant
requires, children in Ant's order, and texts of a test only in its outcome.

The exit code of a verdict decides the outcome of its test: 1 ``failure``, 3 ``error``, unsupported ``skipped``, else
passed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET

from consilience.compare import CODES, Verdict
from consilience.compare.judge import REFERENCE
from consilience.report.exports.digest import QuestionCell, cells, engines
from consilience.report.record import Record
from consilience.report.wording import cause_of, difference_text, digits_text, number

KINDS = {0: "", 1: "failure", 3: "error"}
"""Element of a test by the exit code of its verdict."""

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold; an engine may print them."""


def render(record: Record) -> str:
    """Write the JUnit XML of a record."""
    found = list(cells(record))
    root = ET.Element("testsuites")
    for engine in engines(record, reference=True):
        own = [cell for cell in found if cell.engine == engine]
        if own:
            root.append(_suite(engine, len(root), own, record))
    for engine, reason in record.header["missing"].items():
        root.append(_missing(engine, len(root), reason, record))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _suite(engine: str, number_: int, own: Sequence[QuestionCell], record: Record) -> ET.Element:
    kinds = [_kind(cell.verdict) for cell in own]
    suite = _head(engine, number_, record, kinds, sum(cell.cpu for cell in own))
    for cell, kind in zip(own, kinds, strict=True):
        case = ET.SubElement(
            suite,
            "testcase",
            name=_clean(f"{cell.case}[{cell.question}]"),
            classname=_clean(f"consilience.{engine}"),
            time=f"{cell.cpu:.3f}",
        )
        if kind:
            outcome = ET.SubElement(case, kind, message=_clean(f"{cell.verdict}: {cell.worst['why']}"))
            if kind != "skipped":
                outcome.set("type", str(cell.verdict))
                outcome.text = _clean(evidence(cell))
    _close(suite, "\n".join(_line(cell) for cell in own))
    return suite


def _missing(engine: str, number_: int, reason: str, record: Record) -> ET.Element:
    suite = _head(engine, number_, record, ["error"], 0.0)
    case = ET.SubElement(suite, "testcase", name="starts", classname=_clean(f"consilience.{engine}"), time="0.000")
    ET.SubElement(case, "error", message=_clean(f"the engine does not start: {reason}"), type="missing")
    _close(suite, "")
    return suite


def _head(engine: str, number_: int, record: Record, kinds: Sequence[str], time: float) -> ET.Element:
    """Make a suite with its attributes and properties, without tests.

    Parameters
    ----------
    engine : str
    number_ : int
        Number of the suite in the document.
    record : Record
    kinds : sequence of str
        Element of each test, as in `KINDS`.
    time : float, s
        CPU time of all tests.
    """
    suite = ET.Element(
        "testsuite",
        name=_clean(engine),
        package="consilience",
        id=str(number_),
        timestamp=record.header["written"][:19],
        hostname="localhost",
        tests=str(len(kinds)),
        failures=str(kinds.count("failure")),
        errors=str(kinds.count("error")),
        skipped=str(kinds.count("skipped")),
        time=f"{time:.3f}",
    )
    properties = ET.SubElement(suite, "properties")
    for name, value in _properties(engine, record.header):
        ET.SubElement(properties, "property", name=_clean(name), value=_clean(value))
    return suite


def _properties(engine: str, header: dict[str, Any]) -> list[tuple[str, str]]:
    info = header["engines"].get(engine)
    own = [("engine", f"{info['name']} {info['version']}"), ("adapter", info["adapter"])] if info else []
    return [*own, *header["packages"].items(), ("python", header["python"]), ("platform", header["platform"])]


def _close(suite: ET.Element, text: str) -> None:
    ET.SubElement(suite, "system-out").text = _clean(text)
    ET.SubElement(suite, "system-err").text = ""


def _kind(verdict: Verdict) -> str:
    return "skipped" if verdict is Verdict.UNSUPPORTED else KINDS[CODES[verdict]]


def _line(cell: QuestionCell) -> str:
    """Write a test in one line, with its digits."""
    digits = "" if cell.digits is None else f", {digits_text(cell.digits)} digits"
    return f"{cell.case}, {cell.question}: {cell.verdict}{digits}: {cell.worst['why']}"


def evidence(cell: QuestionCell) -> str:
    """Write the evidence of a cell: methods, numbers, causes, output of the engine, command that asks again."""
    lines = []
    for c in cell.comparisons:
        lines += [
            f"{c['method'] or 'no method'}: {c['verdict']}",
            f"  {c['why']}",
            f"  {cause_of(c['cause'], c['verdict'])}",
        ]
        lines += [
            f"  {q['name']}: difference {difference_text(q['difference'])}, bar {number(q['bar'])}"
            for q in c["quantities"]
            if q["count"] and cell.engine != REFERENCE
        ]
    lines += [f"  printed: {run['log'].strip()}" for run in cell.runs if run["status"] == "failed" and run["log"]]
    return "\n".join([*lines, f"again: {cell.replay}"])


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
