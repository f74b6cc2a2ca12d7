"""The Markdown page: the matrix and what is behind it, to be read in a code host."""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from consilience.errors import visible
from consilience.report.record import Record
from consilience.report.view import page


def escaped(value: object) -> str:
    """Text that Markdown and HTML take literally, on one line, inside and outside tables."""
    text = visible(re.sub(r"\s+", " ", str(value)))
    text = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    text = re.sub(r"([\\`*\[\]|~])", r"\\\1", text)
    # what a code host makes a link or a mention of by itself
    text = re.sub(r"://|www\.|@", lambda found: "".join(f"&#{ord(c)};" for c in found.group()), text)
    # an underscore within a word is one already
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("consilience.report", "templates"),
        autoescape=False,
        finalize=escaped,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.md.j2")


def render_markdown(record: Record) -> str:
    """Page of a record for a code host. Whatever the template inserts is escaped."""
    return _template().render(page=page(record))
