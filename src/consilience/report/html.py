"""The HTML page: one file that opens offline. Fetches nothing, and forbids itself to."""

from __future__ import annotations

import json

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from consilience.report.plots import figures
from consilience.report.record import Record
from consilience.report.view import page
from consilience.report.wording import anchor


def embedded_json(value: object) -> Markup:
    """JSON for a script element: no character of it can end the element."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def render_html(record: Record) -> str:
    """Self-contained page of a record."""
    environment = Environment(
        loader=PackageLoader("consilience.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        page=page(record),
        anchor=anchor,
        figures=embedded_json(figures(record)),
        plotly=Markup(get_plotlyjs()),
    )
