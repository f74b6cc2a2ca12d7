"""The command ``consilience site``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from consilience.cli.options import Form, OutputFormat, require_folder, writing


def site(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR", help="Folders of reports, or of folders of reports.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SITE", help="Folder of the site.")],
    edition: Annotated[
        str | None, typer.Option(metavar="NAME", help="Edition of the case list for the score; default: the newest.")
    ] = None,
    form: Form = OutputFormat.TEXT,
) -> None:
    """Write a static site of many reports: an address for every cell, its history, scores and badges.

    Addresses depend on the names of cases and engines alone: the same command with more reports keeps them.
    """
    from consilience.case import chosen_edition
    from consilience.cli.terminal import state
    from consilience.report.site.pages import write_site
    from consilience.report.site.statement import site_statement

    require_folder(output, "site")
    with writing(output):
        view = write_site(folders, output, chosen_edition(edition))
    state(site_statement(view, output), form)
