"""The Markdown page of a record, for a code host."""

from __future__ import annotations

import re

from consilience.errors import visible
from consilience.report.record import Record
from consilience.report.templating import template_environment
from consilience.report.view import page


def escaped(value: object) -> str:
    """Escape text for Markdown and HTML, on one line, inside and outside tables."""
    text = visible(re.sub(r"\s+", " ", str(value)))
    text = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    text = re.sub(r"([\\`*\[\]|~])", r"\\\1", text)
    # a code host turns these into links and mentions
    text = re.sub(r"://|www\.|@", lambda found: "".join(f"&#{ord(c)};" for c in found.group()), text)
    # an underscore within a word needs no escape
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)


def render_markdown(record: Record) -> str:
    """Render the Markdown page of a record; every inserted value is escaped."""
    environment = template_environment(autoescape=False, finalize=escaped, keep_trailing_newline=True)
    return environment.get_template("report.md.j2").render(page=page(record))
