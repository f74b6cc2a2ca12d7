"""The HTML page: one file that opens offline, with a policy that forbids to fetch anything.

The matrix is plain HTML and appears at once. The pages behind it are compressed within the file, and are unpacked when
they are first opened.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from consilience.errors import visible
from consilience.mechanism import GROUND
from consilience.report.cells import Cell
from consilience.report.curves import KINDS
from consilience.report.figure import COLOURS
from consilience.report.packs import packed, packed_figures, packed_json, packed_pages
from consilience.report.phase_strips import phase_chart
from consilience.report.picture import drawn
from consilience.report.plots import figures
from consilience.report.plots_replay import replay_figures
from consilience.report.record import Record
from consilience.report.replay import Replay
from consilience.report.scene import figure_of_scene
from consilience.report.templating import template_environment
from consilience.report.view import Page, page
from consilience.report.wording import CAPTIONS, anchor

Replays = Mapping[str, Replay]

OF_CELL = ("difference", "energy")
OF_CASE = ("horizon", "work", "steps", *KINDS, "drift")
OF_CASE_IN_CELL = ("steps", "work", "reactions", "drift")
"""Kinds of figures in the order of the page."""


def shown(value: object) -> object:
    """Write out control characters and changes of text direction; the template escapes the result."""
    return visible(value) if type(value) is str else value


def environment() -> Environment:
    """Return the environment of the HTML templates."""
    made = template_environment(autoescape=True, finalize=shown)
    made.filters["broken"] = broken
    return made


def broken(name: str) -> Markup:
    """Escape a name that may break behind its underscores and hyphens, and nowhere else."""
    return Markup("<wbr>").join(re.split(r"(?<=[_-])", visible(name)))


@cache
def plotly_pack() -> Markup:
    """Return Plotly's script, compressed."""
    return packed(get_plotlyjs())


@cache
def three_pack() -> Markup:
    """Return the script of three.js, compressed."""
    return packed((Path(__file__).parent / "vendor" / "three.min.js").read_text(encoding="utf-8"))


def render_html(record: Record, replays: Replays | None = None) -> str:
    """Render the self-contained page of a record, with the replays of its cases."""
    replays, view = replays or {}, page(record)
    drawings = figures(record) | replay_figures(record, replays)
    packs = [
        ("pages", packed_pages(fragments(view, replays, set(drawings)))),
        ("figures", packed_figures(drawings)),
        ("replays", packed_json(replay_data(view, replays))),
        ("plotly", plotly_pack()),
        ("three", three_pack()),
    ]
    return environment().get_template("report.html.j2").render(page=view, packs=packs)


def fragments(view: Page, replays: Replays, drawings: set[str]) -> Iterator[tuple[str, str]]:
    """Render all pages behind the matrix: anchor and HTML of each."""
    get = environment().get_template
    tables = get("tables.html.j2").module
    yield "findings", tables.findings(view)  # type: ignore[attr-defined]
    yield "choice", tables.choice(view.choice, CAPTIONS)  # type: ignore[attr-defined]
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
        joints = [(j, place) for j in case.line["joints"] if (place := anchor("joint", case.name, j[0])) in drawings]
        about["joint_pages"] = {joint[0]: place for joint, place in joints}
        told = replay["phases"] if replay else {}
        chart, drawing = phase_chart(told, list(engines)), _drawing(case.name, case.title, replay)
        yield case.anchor, case_page.render(c=case, drawing=drawing, plots=plots, phases=chart, **about)
        for joint, place in joints:
            chart = phase_chart(told, list(engines), _in_joint(joint))
            yield place, get("joint.html.j2").render(c=case, joint=joint, place=place, phases=chart, **about)
        for cell in case.cells:
            about |= {"plots": _cell_plots(cell, drawings), "phases": phase_chart(told, [cell.engine])}
            yield cell.anchor, cell_page.render(cell=cell, case=case, engine=engines.get(cell.engine), **about)


def _in_joint(joint: Sequence[str]) -> Callable[[dict[str, Any]], bool]:
    """Tell what acts in a joint, or on a body of the joint: name, kind, predecessor and successor are given."""
    moving = {body for body in joint[2:] if body != GROUND}
    return lambda one: one["joint"] == joint[0] or not moving.isdisjoint(one["bodies"])


def replay_data(view: Page, replays: Replays) -> dict[str, Any]:
    """Collect the data of the script that draws cases in motion: scenes, motions, colours."""
    found = {c.name: {k: replays[c.name][k] for k in ("scene", "motion")} for c in view.cases if c.name in replays}
    engines = [engine.name for engine in view.engines]
    return {"colours": COLOURS, "engines": engines, "cases": found}


def render_replay(name: str, title: str, replay: Replay) -> str:
    """Render the self-contained page of one case in motion."""
    packs = [
        ("replays", packed_json({"colours": COLOURS, "engines": [], "cases": {name: replay}})),
        ("three", three_pack()),
    ]
    how = replay["motion"]["reference"]["how"]
    drawing = _drawing(name, title, replay)
    page_template = environment().get_template("replay.html.j2")
    chart = phase_chart(replay["phases"], [])
    return page_template.render(name=name, title=title, how=how, drawing=drawing, packs=packs, phases=chart)


def _places(kinds: tuple[str, ...], drawings: set[str], *names: str) -> list[tuple[str, str]]:
    return [(kind, place) for kind in kinds if (place := anchor(kind, *names)) in drawings]


def _cell_plots(cell: Cell, drawings: set[str]) -> list[tuple[str, str]]:
    own = _places(OF_CELL, drawings, cell.case, cell.engine)
    return own + (_places(OF_CASE_IN_CELL, drawings, cell.case) if own else [])


def _drawing(name: str, title: str, replay: Replay | None) -> Markup | None:
    """Draw the case in four views."""
    if replay is None:
        return None
    pairs = [joint["between"] for joint in replay["scene"]["joints"]]
    # the template of the picture has escaped all names
    return Markup(drawn(figure_of_scene(replay["scene"]), pairs, f"{name}: {title}"))
