"""The command ``consilience crosscheck``."""

from __future__ import annotations

from typing import Annotated

import typer

from consilience.cli.options import CORES, Jobs, TablesFile


def crosscheck(
    mechanisms: Annotated[int, typer.Option(help="Number of random mechanisms.")] = 200,
    states: Annotated[int, typer.Option(help="States of each.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the first mechanism; the others follow.")] = 1,
    jobs: Jobs = CORES,
    output: TablesFile = None,
) -> None:
    """Compare all formulations of the reference with one another on random mechanisms."""
    from consilience.audit.formulations.tables import main as compare_formulations

    compare_formulations(mechanisms, states, seed, None, jobs, output)
