"""``consilience show``: argument parsing and printing only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from consilience.errors import InvalidInput
from consilience.library import load_cases
from consilience.report.picture import picture
from consilience.report.summary import describe_case


def show(
    case: Annotated[str, typer.Argument(help="Name, case file, or family such as windows:count=3.")],
    drawn: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE.svg", help="Draw it in four views as well.")
    ] = None,
) -> None:
    """Show a case: source, drawing, bodies, joints, freedom, initial state, expected values."""
    cases = load_cases(case)
    out = Console()
    if drawn is not None:
        if drawn.suffix != ".svg":
            raise InvalidInput(str(drawn), "it is no name of a picture", "Let it end with .svg.")
        if len(cases) > 1:
            names = ", ".join(c.name for c in cases)
            raise InvalidInput(f"case '{case}'", f"it has {len(cases)} variants", f"Name one: {names}.")
        text = picture(cases[0].mechanism, cases[0].initial_state, f"{cases[0].name}: {cases[0].title}")
        try:
            drawn.write_text(text, encoding="utf-8")
        except OSError as error:
            raise InvalidInput(
                str(drawn), f"it cannot be written ({error.strerror})", "Choose another place."
            ) from None
    for chosen in cases:
        out.print(describe_case(chosen), soft_wrap=True, highlight=False, markup=False)
    if drawn is not None:
        out.print(f"picture: {drawn}", soft_wrap=True, highlight=False, markup=False)
