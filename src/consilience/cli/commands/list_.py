"""The command ``consilience list``."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence

from consilience.case import Case, shipped_cases
from consilience.case.families import FAMILIES, shown_parameters
from consilience.cli.options import Form, OutputFormat
from consilience.engine import installed, lacks_engine, pip_requirement
from consilience.reference.formulations.registry import FORMULATIONS, SYSTEMS
from consilience.report.statement import WRITERS, Statement

HEADS = ("group", "name", "bodies", "joints", "title")


def joints_of(case: Case) -> str:
    """Name the joint kinds of a case, with the number of joints of each kind."""
    count = Counter(joint.kind for joint in case.mechanism.joints)
    return ", ".join(f"{n} {kind}" if n > 1 else kind for kind, n in count.items())


def list_(form: Form = OutputFormat.TEXT) -> None:
    """List the shipped cases, the families and the installed engines."""
    rows = [(c.group, c.name, str(len(c.mechanism.bodies)), joints_of(c), c.title) for c in shipped_cases()]
    families = {name: shown_parameters(family) for name, family in FAMILIES.items()}
    engines, formulations = list(installed()), [*FORMULATIONS, *SYSTEMS]
    lacking = {name: pip_requirement(point) for name, point in installed().items() if lacks_engine(point)}
    sentences = [
        f"engines: {', '.join(engines)}",
        *(f"{name} is not installed: pip install '{requirement}'" for name, requirement in lacking.items()),
        f"formulations of the reference, as engines reference:NAME: {', '.join(formulations)}",
    ]
    tables: list[tuple[str, Sequence[str], Sequence[Sequence[str]]]] = [
        ("cases", HEADS, rows),
        ("families: FAMILY:PARAMETER=VALUE,...", ("name", "parameters and their defaults"), list(families.items())),
    ]
    data = {
        "cases": [dict(zip(HEADS, row, strict=True)) for row in rows],
        "families": families,
        "engines": engines,
        "formulations": formulations,
    }
    sys.stdout.write(WRITERS[form](Statement(sentences, tables, data)))
