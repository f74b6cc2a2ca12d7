"""The HTML page: one file that opens offline. Fetches nothing, and forbids itself to.

The matrix is plain HTML, so that it is there at once. Whatever opens from it lies packed in the page and is unpacked
when it is first asked for: text of a thousand cells takes a tenth of its size, and no time before it is read.
"""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from consilience.errors import visible
from consilience.report.cells import Cell
from consilience.report.figure import COLOURS
from consilience.report.picture import drawn
from consilience.report.plots import figures
from consilience.report.plots_replay import replay_figures
from consilience.report.record import Record
from consilience.report.replay import Replay
from consilience.report.scene import figure_of_scene
from consilience.report.view import Page, page
from consilience.report.wording import CAPTIONS, anchor

Replays = Mapping[str, Replay]

OF_CELL = ("difference", "energy")
OF_CASE = ("horizon", "work", "steps", "reactions", "drift")
OF_CASE_IN_CELL = ("steps", "work", "reactions", "drift")
"""Kinds of figures in the order of the page."""


def packed(text: str) -> Markup:
    """Text for a script element that the page unpacks itself: a fifth of the size, and no character can end it."""
    return Markup(b64encode(gzip.compress(text.encode(), mtime=0)).decode())


def shown(value: object) -> object:
    """Text with control characters and turns of direction written out; the template escapes it afterwards."""
    return visible(value) if type(value) is str else value


@cache
def environment() -> Environment:
    """Templates of all pages."""
    return Environment(
        loader=PackageLoader("consilience.report", "templates"),
        autoescape=True,
        finalize=shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def plotly_pack() -> Markup:
    """Plotly's script, packed."""
    return packed(get_plotlyjs())


@cache
def three_pack() -> Markup:
    """The script of three.js, packed."""
    return packed((Path(__file__).parent / "vendor" / "three.min.js").read_text(encoding="utf-8"))


def render_html(record: Record, replays: Replays | None = None) -> str:
    """Self-contained page of a record, with the replays of its cases where there are any."""
    replays, view = replays or {}, page(record)
    drawings = figures(record) | replay_figures(record, replays)
    packs = [
        ("pages", packed(_json(dict(fragments(view, replays, set(drawings)))))),
        ("figures", packed(_json(drawings))),
        ("replays", packed(_json(replay_data(view, replays)))),
        ("plotly", plotly_pack()),
        ("three", three_pack()),
    ]
    return environment().get_template("report.html.j2").render(page=view, packs=packs)


def fragments(view: Page, replays: Replays, drawings: set[str]) -> Iterator[tuple[str, str]]:
    """Everything that opens: anchor and HTML, written by templates as the page itself."""
    get = environment().get_template
    tables = get("tables.html.j2").module
    yield "findings", tables.findings(view)  # type: ignore[attr-defined]
    yield "defaults", tables.defaults(view.defaults)  # type: ignore[attr-defined]
    for table in view.tables:
        yield table.anchor, tables.methods(table)  # type: ignore[attr-defined]
    seeds = {name: replay["seed"] for name, replay in replays.items()}
    yield "about", tables.about(view, seeds)  # type: ignore[attr-defined]
    engines = {engine.name: engine for engine in view.engines}
    for engine in view.engines:
        yield engine.anchor, get("engine.html.j2").render(e=engine)
    case_page, cell_page = get("case.html.j2"), get("cell.html.j2")
    for case in view.cases:
        replay = replays.get(case.name)
        about: dict[str, Any] = {"moving": replay is not None, "captions": CAPTIONS}
        plots = _places(OF_CASE, drawings, case.name)
        yield (
            case.anchor,
            case_page.render(c=case, drawing=_drawing(case.name, case.title, replay), plots=plots, **about),
        )
        for cell in case.cells:
            shown_plots = _cell_plots(cell, drawings)
            own = engines.get(cell.engine)
            yield cell.anchor, cell_page.render(cell=cell, case=case, engine=own, plots=shown_plots, **about)


def replay_data(view: Page, replays: Replays) -> dict[str, Any]:
    """What the script needs to draw cases in motion: their scenes and motions, and the colours."""
    found = {c.name: {k: replays[c.name][k] for k in ("scene", "motion")} for c in view.cases if c.name in replays}
    engines = [engine.name for engine in view.engines]
    return {"colours": COLOURS, "engines": engines, "cases": found}


def render_replay(name: str, title: str, replay: Replay) -> str:
    """Self-contained page of one case in motion."""
    packs = [
        ("replays", packed(_json({"colours": COLOURS, "engines": [], "cases": {name: replay}}))),
        ("three", three_pack()),
    ]
    how = replay["motion"]["reference"]["how"]
    drawing = _drawing(name, title, replay)
    page_template = environment().get_template("replay.html.j2")
    return page_template.render(name=name, title=title, how=how, drawing=drawing, packs=packs)


def _places(kinds: tuple[str, ...], drawings: set[str], *names: str) -> list[tuple[str, str]]:
    return [(kind, place) for kind in kinds if (place := anchor(kind, *names)) in drawings]


def _cell_plots(cell: Cell, drawings: set[str]) -> list[tuple[str, str]]:
    own = _places(OF_CELL, drawings, cell.case, cell.engine)
    return own + (_places(OF_CASE_IN_CELL, drawings, cell.case) if own else [])


def _drawing(name: str, title: str, replay: Replay | None) -> Markup | None:
    """The case in four views."""
    if replay is None:
        return None
    pairs = [joint["between"] for joint in replay["scene"]["joints"]]
    # the template of the picture escapes what it is given
    return Markup(drawn(figure_of_scene(replay["scene"]), pairs, f"{name}: {title}"))


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False)
