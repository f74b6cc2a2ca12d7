"""Findings as a table of identities by engines, as Markdown, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from consilience.audit.identities.check import CONTACT_IDENTITIES, IDENTITIES, Checks
from consilience.audit.identities.result import Finding, IdentityOutcome, exit_code
from consilience.compare import markdown_table
from consilience.engine import Profile
from consilience.errors import InvalidInput

FORMAT = 1

_HARMLESS = (IdentityOutcome.HOLDS, IdentityOutcome.NOT_APPLICABLE)
_WORST_FIRST = (IdentityOutcome.VIOLATED, IdentityOutcome.NO_ANSWER, *_HARMLESS)

LEGEND = "a number: it holds, and that is the largest residual over cases and methods"


def cell(findings: Sequence[Finding]) -> str:
    """Return the worst outcome of one engine and identity, how often, and the largest residual."""
    for outcome in _WORST_FIRST:
        found = [f for f in findings if f.outcome is outcome]
        if found:
            measured = [f.residual for f in found if f.residual is not None]
            number = f"{max(measured):.0e}" if measured else ""
            if outcome in _HARMLESS:
                return number or str(outcome)
            return f"{outcome} {len(found)} of {len(findings)}" + (f", {number}" if number else "")
    return "-"


def matrix(checks: Checks, profile: Profile) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of the table of a profile: identity, and one cell for each engine."""
    chosen = [f for f in checks.findings if f.profile is profile]
    for identity in (*IDENTITIES, *CONTACT_IDENTITIES):
        of_it = [f for f in chosen if f.identity == identity.name]
        if of_it:
            yield identity.name, [cell([f for f in of_it if f.engine == name]) for name in checks.engines]


def blemishes(checks: Checks) -> Iterator[Finding]:
    """Return the findings that are violated or have no answer."""
    return (f for f in checks.findings if f.outcome not in _HARMLESS)


def sentence(finding: Finding) -> str:
    """Return one finding in words."""
    text = f"{finding.engine}, {finding.case}, {finding.method or finding.question}: {finding.identity}"
    text += f": {finding.outcome}"
    if finding.residual is not None and finding.bar is not None:
        text += f", {finding.residual:.2e} above {finding.bar:.2e}"
    return f"{text} ({finding.remark})"


def markdown(checks: Checks) -> str:
    """Return tables of both profiles, and every finding that is violated or has no answer, as Markdown."""
    lines = ["# Identities", ""]
    for profile in Profile:
        if not any(f.profile is profile for f in checks.findings):
            continue
        lines += [f"## Settings: {profile}", ""]
        rows = [(name, *cells) for name, cells in matrix(checks, profile)]
        lines += markdown_table(("identity", *checks.engines), rows, spaced=True, escape=_escaped)
        lines += ["", f"{LEGEND[0].upper()}{LEGEND[1:]}.", ""]
    found = list(blemishes(checks))
    if found or checks.missing:
        lines += ["## To look at", ""]
        lines += [f"- {name}: not available: {_escaped(reason)}" for name, reason in checks.missing.items()]
        lines += [f"- {_escaped(sentence(finding))}" for finding in found]
        lines.append("")
    return "\n".join(lines)


def _escaped(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def as_json(checks: Checks) -> str:
    """Return all findings as JSON."""
    data = {
        "format": FORMAT,
        "engines": {name: asdict(info) for name, info in checks.engines.items()},
        "missing": checks.missing,
        "identities": [{"name": i.name, "shows": i.shows} for i in (*IDENTITIES, *CONTACT_IDENTITIES)],
        "findings": [asdict(finding) for finding in checks.findings],
        "exit_code": exit_code(checks.findings, len(checks.missing)),
    }
    # `defects` refuses residuals that are not numbers, and JSON has no infinity
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def check_target(path: Path) -> None:
    """Refuse a file whose suffix names no format, or whose folder does not exist.

    Raises
    ------
    InvalidInput
    """
    if path.suffix not in (".json", ".md"):
        raise InvalidInput(str(path), f"'{path.suffix}' names no format", "End it with .json or .md.")
    if not path.resolve().parent.is_dir():
        raise InvalidInput(str(path), "its folder does not exist", "Create the folder first.")


def write(checks: Checks, path: Path) -> None:
    """Write JSON or Markdown, as the suffix of the path says."""
    check_target(path)
    path.write_text(as_json(checks) if path.suffix == ".json" else markdown(checks), encoding="utf-8")
