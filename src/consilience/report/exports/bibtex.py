"""BibTeX of the literature behind a run: the comparison, the engines and their methods, the sources of the cases.

``literature.toml``, here and beside an adapter, holds the works and the conditions under which each is cited. A source
of a case that matches no work becomes a note of its own, so that no source is lost.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from consilience.engine import adapter_file, installed
from consilience.report.exports.latex import escaped
from consilience.report.record import Record
from consilience.report.selection import grouped

CONDITIONS = ("engine", "question", "method", "source")
_OWN = "All numbers are our own"
"""Beginning of the source of a case whose only source is the case file itself."""


@cache
def literature() -> dict[str, dict[str, str]]:
    """Read the works of all ``literature.toml``, here and beside adapters: type, conditions and fields by key."""
    texts = [files("consilience.report.exports").joinpath("literature.toml").read_text(encoding="utf-8")]
    paths = [adapter_file(point, "literature.toml") for point in installed().values()]
    texts += [path.read_text(encoding="utf-8") for path in paths if path]
    return {key: entry for text in texts for key, entry in tomllib.loads(text).items()}


def render(record: Record) -> str:
    """Write the BibTeX of a record; a line above each entry says what the entry is cited for."""
    version = record.header["packages"]["consilience"]
    own = {
        "type": "misc",
        "title": "{Consilience}",
        "author": "{The Consilience authors}",
        "note": f"Version {version}",
    }
    entries = [_entry("consilience", own, ["the comparison"])]
    entries += [_entry(key, literature()[key], reasons) for key, reasons in cited(record).items()]
    entries += [_entry(key, {"type": "misc", "note": escaped(text)}, reasons) for key, text, reasons in others(record)]
    return "\n".join(entries)


def cited(record: Record) -> dict[str, list[str]]:
    """List the works that a record uses, by key in the order of the table: the engines and cases that use each."""
    asked = {_asked(run) for run in record.runs if run["method"] and run["status"] != "unsupported"}
    found: dict[str, list[str]] = {}
    for key, entry in literature().items():
        reasons = sorted({engine for engine, question, method in asked if _serves(entry, engine, question, method)})
        pattern = entry.get("source")
        reasons += [
            case["name"] for case in record.cases if pattern and any(re.search(pattern, s) for s in case["sources"])
        ]
        if reasons:
            found[key] = reasons
    return found


def _asked(run: Mapping[str, Any]) -> tuple[str, str, str]:
    return run["engine"].partition(":")[0], run["question"], run["method"]["name"]


def _serves(entry: Mapping[str, str], engine: str, question: str, method: str) -> bool:
    """Whether a run meets all conditions of an entry on runs; False for an entry without such conditions."""
    held = []
    if "engine" in entry:
        held.append(entry["engine"] == engine)
    if "question" in entry:
        held.append(entry["question"] == question)
    if "method" in entry:
        held.append(re.search(entry["method"], method) is not None)
    return bool(held) and all(held)


def others(record: Record) -> Iterator[tuple[str, str, list[str]]]:
    """List sources of cases that match no work: key, text, and the cases that name the source."""
    patterns = [entry["source"] for entry in literature().values() if "source" in entry]
    found = grouped(
        (text, case["name"])
        for case in record.cases
        for text in case["sources"]
        if not text.startswith(_OWN) and not any(re.search(pattern, text) for pattern in patterns)
    )
    taken: dict[str, int] = {}
    for text, cases in found.items():
        stem = re.sub(r"[^A-Za-z0-9_-]", "_", cases[0])
        taken[stem] = taken.get(stem, 0) + 1
        yield f"source-{stem}-{taken[stem]}", text, cases


def _entry(key: str, entry: Mapping[str, str], reasons: list[str]) -> str:
    fields = [f"  {name} = {{{value}}}," for name, value in entry.items() if name not in ("type", *CONDITIONS)]
    about = ", ".join(reasons).replace("@", "at")
    return "\n".join([f"% for: {about}", f"@{entry['type']}{{{key},", *fields, "}", ""])
