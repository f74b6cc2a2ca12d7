"""The Markdown page of a record, for a code host."""

from __future__ import annotations

from consilience.report.record import Record
from consilience.report.statement import escaped
from consilience.report.templating import template_environment
from consilience.report.view import page


def render_markdown(record: Record) -> str:
    """Render the Markdown page of a record; every inserted value is escaped."""
    environment = template_environment(autoescape=False, finalize=escaped, keep_trailing_newline=True)
    return environment.get_template("report.md.j2").render(page=page(record))
