"""The command ``consilience report``, and the matrix of verdicts that ends a run."""

from __future__ import annotations

from pathlib import Path

import typer

from consilience.cli.options import ReportFolder


def report(folder: ReportFolder) -> None:
    """Render the pages of a report again from its report.jsonl."""
    from consilience.report.pages import write_pages

    write_pages(folder)
    raise typer.Exit(print_matrix(folder))


def print_matrix(folder: Path) -> int:
    """Print the verdicts of a report, a row for each case and a column for each engine; return the exit code."""
    from rich.markup import escape
    from rich.table import Table

    from consilience.cli.terminal import out, print_missing, say
    from consilience.errors import visible
    from consilience.report.record import read_record
    from consilience.report.summary import legend, matrix

    record = read_record(folder)
    say("worst verdict and least digits over all questions and matched methods")
    table = Table()
    table.add_column("case", no_wrap=True)  # a name that is cut off names no case
    engines, rows = matrix(record)
    for name in engines:
        table.add_column(escape(visible(name)), overflow="fold")
    for case, cells in rows:
        table.add_row(escape(visible(case)), *map(escape, cells))
    out.print(table)
    for line in legend(record):
        say(line)
    print_missing(record.header["missing"])
    say(f"report: {folder / 'report.html'}")
    return int(record.footer["exit_code"])
