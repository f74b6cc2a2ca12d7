"""``consilience show`` and ``consilience play``: argument parsing, printing, and opening of pages only."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from consilience.case import Case, cases_like, load_cases
from consilience.errors import InvalidInput
from consilience.report.html import render_replay
from consilience.report.pages import write_pages
from consilience.report.picture import picture
from consilience.report.record import read_record
from consilience.report.replay import REFERENCE, motion_alone
from consilience.report.replayschema import read_replay
from consilience.report.summary import describe_case
from consilience.report.wording import anchor
from consilience.suite import simulate_case

LIMIT = 600.0
"""Time limit of the motion that is shown, s."""


def show(
    case: Annotated[
        str, typer.Argument(help="Name, case file, or family such as windows:count=3.", autocompletion=cases_like)
    ],
    drawn: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE.svg", help="Draw it in four views as well.")
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Simulate it by the reference, and open it in motion in the browser.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.html", help="Page of --view; default: CASE.html here."),
    ] = None,
) -> None:
    """Show a case: source, drawing, bodies, joints, freedom, initial state, expected values."""
    cases = load_cases(case)
    out = Console()
    for path, ending in ((drawn, ".svg"), (output, ".html")):
        if path is not None and path.suffix != ending:
            raise InvalidInput(str(path), "it is no name of a picture", f"Let it end with {ending}.")
    if (drawn is not None or view) and len(cases) > 1:
        names = ", ".join(c.name for c in cases)
        raise InvalidInput(f"case '{case}'", f"it has {len(cases)} variants", f"Name one: {names}.")
    if drawn is not None:
        _write(drawn, picture(cases[0].mechanism, cases[0].initial_state, f"{cases[0].name}: {cases[0].title}"))
    if view:
        target = output or Path(f"{cases[0].name}.html")
        _write(target, in_motion(cases[0]))
        _open(out, target)
    for chosen in cases:
        out.print(describe_case(chosen), soft_wrap=True, highlight=False, markup=False)
    if drawn is not None:
        out.print(f"picture: {drawn}", soft_wrap=True, highlight=False, markup=False)


def play(
    run: Annotated[Path, typer.Argument(help="Folder of a report.")],
    case: Annotated[str | None, typer.Argument(help="Case of the report; default: where engines differ most.")] = None,
) -> None:
    """Open the mechanism in motion of a report: engines as ghosts over the reference."""
    record, replays = read_record(run), read_replay(run)
    moving = [name for name, replay in replays.items() if replay["motion"]]
    if not moving:
        raise InvalidInput(str(run), "it has no motions to show", "Run the suite with the question trajectory.")
    if case is not None and case not in moving:
        raise InvalidInput(f"case '{case}'", "the report has no motion of it", f"Cases: {', '.join(moving)}.")
    chosen = case or max(moving, key=lambda name: _farthest(replays[name]["motion"]))
    page = run / "report.html"
    if not page.is_file():
        write_pages(run)
    out = Console()
    out.print(f"{chosen}: {len(record.header['engines'])} engines", soft_wrap=True, highlight=False, markup=False)
    _open(out, page, anchor("case", chosen))


def in_motion(case: Case) -> str:
    """Page of a case in motion, by the reference alone."""
    answer, how = simulate_case(case, REFERENCE, LIMIT)
    return render_replay(case.name, case.title, motion_alone(case, answer, how))


def _farthest(motion: dict[str, Any]) -> float:
    """Largest difference of an engine over the size of the motion."""
    return max((e["away"] / motion["reference"]["size"] for e in motion["engines"].values()), default=0.0)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be written ({error.strerror})", "Choose another place.") from None


def _open(out: Console, path: Path, place: str = "") -> None:
    """Open a page in the user's browser, and say where it is: there may be none."""
    address = path.resolve().as_uri() + (f"#{place}" if place else "")
    opened = webbrowser.open(address)
    out.print(f"{'opened' if opened else 'open'}: {address}", soft_wrap=True, highlight=False, markup=False)
