"""The commands ``consilience show`` and ``consilience play``."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from consilience.case import load_cases
from consilience.cli.commands.validate import examine
from consilience.cli.options import AnyCaseName, Form, OutputFormat, ReportFolder, require_ending, writing
from consilience.cli.terminal import err, say, state, write_json
from consilience.compare.judge import REFERENCE
from consilience.errors import InvalidInput, nearest
from consilience.report.html import render_replay
from consilience.report.pages import write_pages
from consilience.report.picture import as_png, picture
from consilience.report.record import read_record
from consilience.report.replay import motion_alone
from consilience.report.replayschema import read_replay
from consilience.report.statement import Statement
from consilience.report.summary import describe_case
from consilience.report.wording import anchor
from consilience.suite import simulate_case

LIMIT = 600.0
"""Time limit of the motion that is shown, s."""


def show(
    case: AnyCaseName,
    drawn: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Draw it in four views as well: .svg or .png.")
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Simulate it by the reference, and open it in motion in the browser.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.html", help="Page of --view; default: CASE.html here."),
    ] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Show a case: source, drawing, bodies, joints, freedom, initial state, expected values."""
    cases = load_cases(case)
    first = cases[0]
    for path, content, endings in ((drawn, "picture", (".svg", ".png")), (output, "page", (".html",))):
        if path is not None:
            require_ending(path, content, *endings)
    if (drawn is not None or view) and len(cases) > 1:
        names = ", ".join(c.name for c in cases)
        raise InvalidInput(f"case '{case}'", f"it has {len(cases)} variants", f"Name one: {names}.")
    if drawn is not None:
        svg = picture(first.mechanism, first.initial_state, f"{first.name}: {first.title}")
        _write(drawn, as_png(svg) if drawn.suffix == ".png" else svg.encode())
    if view:
        target = output or Path(f"{first.name}.html")
        answer, how = simulate_case(first, REFERENCE, LIMIT)
        _write(target, render_replay(first.name, first.title, motion_alone(first, answer, how)).encode())
        address, opened = _open(target)
        err.print(f"{'opened' if opened else 'open'}: {address}", soft_wrap=True, highlight=False, markup=False)
    if form is OutputFormat.JSON:
        write_json({"cases": [examine(chosen) for chosen in cases], "picture": drawn})
        return
    for chosen in cases:
        text = describe_case(chosen)
        say(f"```text\n{text}```\n" if form is OutputFormat.MARKDOWN else text)
    if drawn is not None:
        say(f"picture: {drawn}")


def play(
    run: ReportFolder,
    case: Annotated[str | None, typer.Argument(help="Case of the report; default: where engines differ most.")] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Open the mechanism in motion of a report: engines as ghosts over the reference."""
    record, replays = read_record(run), read_replay(run)
    moving = [name for name, replay in replays.items() if replay["motion"]]
    if not moving:
        raise InvalidInput(str(run), "it has no motions to show", "Run the suite with the question trajectory.")
    if case is not None and case not in moving:
        raise InvalidInput(f"case '{case}'", "the report has no motion of it", nearest(case, moving, "Cases"))
    chosen = case or max(moving, key=lambda name: _largest_difference(replays[name]["motion"]))
    page = run / "report.html"
    if not page.is_file():
        with writing(page):
            write_pages(run)
    address, opened = _open(page, anchor("case", chosen))
    engines = list(record.header["engines"])
    sentences = [f"{chosen}: {len(engines)} engines", f"{'opened' if opened else 'open'}: {address}"]
    state(Statement(sentences, [], {"case": chosen, "engines": engines, "page": address}), form)


def _largest_difference(motion: dict[str, Any]) -> float:
    """Return the largest difference in position of any engine, relative to the size of the motion."""
    return max((e["away"] / motion["reference"]["size"] for e in motion["engines"].values()), default=0.0)


def _write(path: Path, content: bytes) -> None:
    with writing(path):
        path.write_bytes(content)


def _open(path: Path, place: str = "") -> tuple[str, bool]:
    """Open a page in the browser; return its address, and whether there is a browser."""
    address = path.resolve().as_uri() + (f"#{place}" if place else "")
    return address, webbrowser.open(address)
