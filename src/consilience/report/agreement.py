"""Agreement of engines about one mechanism or a few cases, as users of the library meet it: a table that prints."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from consilience.report.pages import write_pages
from consilience.report.record import Record, read_record, write_record
from consilience.report.summary import legend, matrix
from consilience.suite import Results


@dataclass(frozen=True, eq=False, repr=False)
class Agreement:
    """What engines say about cases, judged; prints as a table of cases and engines.

    Attributes
    ----------
    results : Results
        All runs and comparisons.
    record : Record
        The same as a report has it.
    elapsed : float, s
    """

    results: Results
    record: Record
    elapsed: float

    @classmethod
    def of(cls, results: Results, elapsed: float) -> Agreement:
        """Return the agreement in the results of a suite that took `elapsed` s."""
        with TemporaryDirectory() as folder:
            write_record(results, elapsed, Path(folder))
            return cls(results, read_record(Path(folder)), elapsed)

    def __str__(self) -> str:
        engines, rows = matrix(self.record)
        table = [("case", *engines), *((case, *cells) for case, cells in rows)]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [
            "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in table
        ]
        return "\n".join([lines[0], "-" * max(map(len, lines)), *lines[1:], *legend(self.record)])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        engines, rows = matrix(self.record)
        head = "".join(f"<th>{escape(text)}</th>" for text in ("case", *engines))
        body = "".join(f"<tr>{''.join(f'<td>{escape(t)}</td>' for t in (case, *cells))}</tr>" for case, cells in rows)
        notes = "".join(f"<p>{escape(line)}</p>" for line in legend(self.record))
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{notes}"

    def save(self, folder: str | Path) -> Path:
        """Write the report to a folder; return the path of its page."""
        target = Path(folder)
        write_record(self.results, self.elapsed, target)
        write_pages(target)
        return target / "report.html"
