"""The command ``consilience coverage``."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from consilience.cli.options import (
    CaseNames,
    EngineNames,
    Form,
    OutputFormat,
    TablesFile,
    chosen_cases,
    chosen_engines,
    require_place,
    writing,
)


def coverage(
    cases: CaseNames = None,
    engine: EngineNames = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="The first five samples, three levels of each method.")
    ] = False,
    output: TablesFile = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Check that the uncertainty bands of all motions hold, against finer runs of the same engines."""
    from consilience.audit import coverage as campaign
    from consilience.cli.terminal import err, print_tables, write_json
    from consilience.suite import FULL, QUICK

    require_place(output)
    chosen, found = chosen_cases(cases), []
    for name in chosen_engines(engine):
        for one in campaign.trials(chosen, name, QUICK if quick else FULL):
            found.append(one)
            err.print(f"{one.engine}, {one.case}, {one.method}", highlight=False, soft_wrap=True)
    text = campaign.table(found)
    if output is not None:
        with writing(output):
            output.write_text(text, encoding="utf-8")
    if form is OutputFormat.JSON:
        write_json([asdict(one) | {"covered": getattr(one, "covered", None)} for one in found])
    else:
        print_tables(text, form)
    raise typer.Exit(campaign.exit_code(found))
