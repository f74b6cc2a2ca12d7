"""The command ``consilience coverage``."""

from __future__ import annotations

import typer

from consilience.cli.options import CaseNames, EngineNames, TablesFile, chosen_cases, chosen_engines


def coverage(cases: CaseNames = None, engine: EngineNames = None, output: TablesFile = None) -> None:
    """Check that the uncertainty bands of all motions hold, against far finer runs of the same engines."""
    from consilience.audit import coverage as campaign
    from consilience.cli.terminal import err, say

    chosen, found = chosen_cases(cases), []
    for name in chosen_engines(engine):
        for one in campaign.trials(chosen, name):
            found.append(one)
            err.print(f"{one.engine}, {one.case}, {one.method}", highlight=False, soft_wrap=True)
    text = campaign.table(found)
    if output is not None:
        output.write_text(text, encoding="utf-8")
    say(text)
    raise typer.Exit(campaign.exit_code(found))
