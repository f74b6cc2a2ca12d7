"""The HTML page: one file that opens offline. Fetches nothing, and forbids itself to."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from consilience.errors import visible
from consilience.report.plots import figures
from consilience.report.record import Record
from consilience.report.view import page
from consilience.report.wording import anchor


def packed(text: str) -> Markup:
    """Text for a script element that the page unpacks itself: a fifth of the size, and no character can end it."""
    return Markup(b64encode(gzip.compress(text.encode(), mtime=0)).decode())


def shown(value: object) -> object:
    """Text with control characters and turns of direction written out; the template escapes it afterwards."""
    return visible(value) if type(value) is str else value


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("consilience.report", "templates"),
        autoescape=True,
        finalize=shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2")


@cache
def _plotly() -> Markup:
    return packed(get_plotlyjs())


def render_html(record: Record) -> str:
    """Self-contained page of a record."""
    return _template().render(
        page=page(record),
        anchor=anchor,
        figures=packed(json.dumps(figures(record), separators=(",", ":"), allow_nan=False)),
        plotly=_plotly(),
    )
