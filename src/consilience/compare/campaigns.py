"""Exit codes, tables in Markdown, and files of the outcome of campaigns."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from consilience.compare.result import Verdict

CODES: dict[Verdict, int] = {
    Verdict.AGREES: 0,
    Verdict.DISCRETISATION: 0,
    Verdict.REGULARISATION: 0,
    Verdict.UNSUPPORTED: 0,
    Verdict.UNRESOLVED: 3,
    Verdict.MODEL: 1,
    Verdict.FAILED: 3,
}
"""Exit code of a single verdict (docs/verdicts.md)."""


def exit_code(verdicts: Iterable[Verdict], incomplete: bool) -> int:
    """Return the exit code of a campaign: 1 if any model differs, else 3 if anything is missing, else 0.

    A difference that vanishes with the step size or with the softness of constraints is no disagreement; an
    unsupported case is no failure.

    Parameters
    ----------
    verdicts : iterable of Verdict
        Verdicts with matched settings; an engine at its own defaults never changes the exit code.
    incomplete : bool
        Whether an engine is missing, or a mechanism could not be drawn.
    """
    codes = {CODES[verdict] for verdict in verdicts}
    if 1 in codes:
        return 1
    return 3 if incomplete or 3 in codes else 0


def markdown_table(
    heads: Sequence[object],
    rows: Iterable[Sequence[object]],
    align: str = "",
    *,
    spaced: bool = False,
    escape: Callable[[Any], str] = str,
) -> list[str]:
    """Return the lines of a Markdown table.

    Parameters
    ----------
    heads : sequence
        Heads of the columns.
    rows : iterable of sequences
        Cells, row by row.
    align : str
        One letter for each column, ``l`` or ``r``; columns without a letter are aligned to the left.
    spaced : bool
        Whether the rule below the heads is written ``| --- |`` instead of ``|---|``.
    escape : callable
        Text of a head or of a cell.
    """
    rule = ["---:" if letter == "r" else "---" for letter in align.ljust(len(heads), "l")]
    head, *body = (f"| {' | '.join(map(escape, row))} |" for row in (heads, *rows))
    return [head, f"| {' | '.join(rule)} |" if spaced else f"|{'|'.join(rule)}|", *body]


def write_campaign(folder: Path, name: str, data: dict[str, Any], page: str) -> None:
    """Write the outcome of a campaign to a folder, as ``NAME.json`` and ``NAME.md``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.json").write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (folder / f"{name}.md").write_text(page, encoding="utf-8")
