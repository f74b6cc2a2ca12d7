"""The files of the site: pages, copies of the reports, badges, and the same as data."""

from __future__ import annotations

import json
import shutil
from base64 import b64encode
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from consilience.case import Edition
from consilience.errors import InvalidInput
from consilience.report.exports.badge import drawn
from consilience.report.html import environment, render_html
from consilience.report.markdown import render_markdown
from consilience.report.record import Record, read_record, write_atomically
from consilience.report.replayschema import read_replay
from consilience.report.site.cellhistory import CellHistory, HistoryEntry, SiteReport, entries_of, histories
from consilience.report.site.views import Front, badges, drawn_history, front, shown_findings

DATA = "site.json"
"""File by which a folder is known as a site."""

FORMAT = 1
"""Format of `DATA`."""


def write_site(folders: Sequence[Path], output: Path, edition: Edition) -> Front:
    """Write the site of all reports in and below some folders.

    Earlier pages stay: an address that was given once holds. The page of a report is written once.

    Raises
    ------
    InvalidInput
        If no report can be read, or the output folder holds anything but a site.
    """
    if output.is_dir() and any(output.iterdir()) and not (output / DATA).is_file():
        raise InvalidInput(str(output), "there is something in it that is no site", "Name a new folder.")
    reports: dict[str, SiteReport] = {}
    entries: list[HistoryEntry] = []
    left_out: dict[str, str] = {}
    for path in _paths(folders):
        if output.resolve() in path.resolve().parents:
            continue
        try:
            record = read_record(path.parent)
        except InvalidInput as error:
            left_out[str(path.parent)] = error.what
            continue
        report = site_report(record, sha256(path.read_bytes()).hexdigest()[:8])
        if report.address not in reports:
            reports[report.address] = report
            entries += entries_of(record, report)
            _write_report(record, path.parent, output / report.address)
    if not reports:
        reasons = "; ".join(f"{name}: {why}" for name, why in left_out.items()) or "there is no report in them"
        raise InvalidInput(", ".join(map(str, folders)), reasons, "Give folders that `consilience run -o` wrote.")
    cells = histories(entries)
    view = front(cells, list(reports.values()), left_out, edition)
    for address, text in site_files(view, cells):
        path = output / address
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text)
    return view


def _paths(folders: Sequence[Path]) -> list[Path]:
    """List the records in and below some folders, each once."""
    return list(dict.fromkeys(path for folder in folders for path in sorted(folder.rglob("report.jsonl"))))


def site_report(record: Record, digest: str) -> SiteReport:
    """Return the report of a record, under its date and the digest of its file."""
    header = record.header
    return SiteReport(
        address=f"report/{header['written'][:10]}-{digest}",
        written=header["written"],
        quick=bool(header.get("quick")),
        cases=len(record.cases),
        engines=header["engines"],
        missing=header["missing"],
        consilience=header["packages"].get("consilience", ""),
    )


def _write_report(record: Record, source: Path, target: Path) -> None:
    """Write the pages of a report and a copy of its record, unless they are there."""
    if (target / "report.jsonl").is_file():
        return
    target.mkdir(parents=True, exist_ok=True)
    write_atomically(target / "report.html", render_html(record, read_replay(source)))
    write_atomically(target / "report.md", render_markdown(record))
    shutil.copyfile(source / "report.jsonl", target / "report.jsonl")


def site_files(view: Front, cells: Sequence[CellHistory]) -> Iterator[tuple[str, str]]:
    """Render all pages, badges and the data: address within the site, and text."""
    get = environment().get_template
    made = badges(view)
    shown = [(name, f"{b.subject}: {b.statement}", _inline(drawn(b))) for name, b in made.items()]
    yield "index.html", get("site_front.html.j2").render(view=view, badges=shown, root="")
    findings = {one.name: one for one in view.findings}
    labels = view.labels
    for cell in cells:
        own = [findings[name] for name in cell.findings]
        about: dict[str, Any] = {"cell": cell, "label": labels[cell.engine], "findings": own, "root": "../../../"}
        yield f"{cell.address}/index.html", get("site_cell.html.j2").render(history=drawn_history(cell), **about)
    for engine in view.engines:
        found = shown_findings(engine.cells)
        page = get("site_engine.html.j2").render(engine=engine, findings=found, root="../../")
        yield f"{engine.address}/index.html", page
    for one in view.findings:
        if one.page:
            page = get("site_finding.html.j2").render(finding=one, labels=labels, root="../../")
            yield f"{one.page.address}/index.html", page
    yield from ((f"badge/{name}", drawn(badge)) for name, badge in made.items())
    yield DATA, json.dumps(_data(view, cells), indent=1, allow_nan=False) + "\n"


def _inline(svg: str) -> str:
    """Return a picture as an address that holds it: a page that opens offline fetches nothing."""
    return f"data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}"


def _data(view: Front, cells: Sequence[CellHistory]) -> dict[str, Any]:
    """Return the site as data: scores, reports, and the history of every cell."""
    return {
        "format": FORMAT,
        "edition": view.edition.name,
        "scores": [
            {"engine": s.engine, "digits": s.digits_agreed, "of": s.of, "left_out": dict(s.left_out)}
            for s in view.scores
        ],
        "reports": [
            {"address": r.address, "written": r.written, "quick": r.quick, "missing": r.missing}
            | {"engines": {name: about["version"] for name, about in r.engines.items()}}
            for r in view.reports
        ],
        "cells": [
            {"case": c.case, "engine": c.engine, "address": c.address, "history": [_point(e) for e in c.entries]}
            for c in cells
        ],
    }


def _point(entry: HistoryEntry) -> dict[str, Any]:
    kept = ("verdict", "cause", "model", "motion", "digits", "method", "findings")
    return {"report": entry.report.address, "version": entry.version} | {name: entry.line[name] for name in kept}
