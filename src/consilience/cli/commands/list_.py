"""``consilience list``: the shipped cases, the families and the installed engines."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence

from consilience.case import Case, shipped_cases
from consilience.case.families import FAMILIES, shown_parameters
from consilience.cli.formats import Format, SheetFormat
from consilience.engine import installed, lacks_engine, pip_requirement
from consilience.reference.formulations.registry import FORMULATIONS, SYSTEMS
from consilience.report.history.show import WRITERS, Sheet

Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]
HEADS = ("group", "name", "bodies", "joints", "title")


def joints_of(case: Case) -> str:
    """Joint kinds and how many of each."""
    kinds = Counter(joint.kind for joint in case.mechanism.joints)
    return ", ".join(f"{n} {kind}" if n > 1 else kind for kind, n in kinds.items())


def list_(form: SheetFormat = Format.TEXT) -> None:
    """List the shipped cases, the families and the installed engines."""
    rows = [(c.group, c.name, str(len(c.mechanism.bodies)), joints_of(c), c.title) for c in shipped_cases()]
    families: list[tuple[str, str]] = [(name, shown_parameters(family)) for name, family in FAMILIES.items()]
    engines, formulations = list(installed()), [*FORMULATIONS, *SYSTEMS]
    lacking = {name: pip_requirement(point) for name, point in installed().items() if lacks_engine(point)}
    sentences = [
        f"engines: {', '.join(engines)}",
        *(f"{name} is not installed: pip install '{requirement}'" for name, requirement in lacking.items()),
        f"formulations of the reference, as engines reference:NAME: {', '.join(formulations)}",
    ]
    tables: list[Table] = [
        ("cases", HEADS, rows),
        ("families: FAMILY:PARAMETER=VALUE,...", ("name", "parameters and their defaults"), families),
    ]
    data = {
        "cases": [dict(zip(HEADS, row, strict=True)) for row in rows],
        "families": dict(families),
        "engines": engines,
        "formulations": formulations,
    }
    sys.stdout.write(WRITERS[form](Sheet(sentences, tables, data)))
