"""The pages of a report folder."""

from __future__ import annotations

from pathlib import Path

from consilience.report.html import render_html
from consilience.report.markdown import render_markdown
from consilience.report.record import read_record, write_atomically
from consilience.report.replayschema import read_replay


def write_pages(folder: Path) -> None:
    """Render ``report.html`` and ``report.md`` from ``report.jsonl`` and ``replay.json`` of a folder.

    Raises
    ------
    InvalidInput
        If there is no complete record in the folder, or ``replay.json`` is invalid.
    """
    record = read_record(folder)
    write_atomically(folder / "report.html", render_html(record, read_replay(folder)))
    write_atomically(folder / "report.md", render_markdown(record))
