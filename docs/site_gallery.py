"""Pictures of the site: the gallery of all cases, and the mechanisms on the front page."""

from __future__ import annotations

from html import escape
from itertools import groupby

from consilience.case import Case, load_case, shipped_cases
from consilience.cli.commands.list_ import joints_of
from consilience.report.sketch import sketch

FRONT = (
    *("four_bar", "bricard", "stewart_platform", "double_wishbone"),
    *("flyball_governor", "peaucellier_linkage", "scissor_lift", "spatial_pendulum"),
)
"""Cases on the front page."""


def gallery() -> str:
    """Return the page of all shipped cases, a figure each, by group."""
    about = "Generated from the files; a case is drawn in its initial state. What a case file is: [cases](../cases.md)."
    lines = ["# The cases", "", about, "", "**{0} cases. Parametric [families](../families.md) make more.**", ""]
    cases = sorted(shipped_cases(), key=lambda case: (case.group, case.name))
    for group, members in groupby(cases, key=lambda case: case.group):
        figures = "\n".join(_figure(case, _facts(case)) for case in members)
        lines += [f"## {group}", "", f'<div class="gallery">\n{figures}\n</div>', ""]
    return "\n".join(lines).replace("{0}", str(len(cases)))


def front() -> str:
    """Return the mechanisms on the front page as HTML."""
    figures = "\n".join(_figure(load_case(name), "") for name in FRONT)
    return f'<div class="gallery">\n{figures}\n</div>\n'


def _figure(case: Case, facts: str) -> str:
    """Draw a case with its name and title."""
    drawn = sketch(case.mechanism, [case.initial_state], case.title)
    drawn = "".join(drawn.splitlines())  # a blank line would end the block of HTML
    name = f'<code id="case-{case.name}">{escape(case.name)}</code>'
    return f"<figure>{drawn}<figcaption>{name} {escape(case.title)}{facts}</figcaption></figure>"


def _facts(case: Case) -> str:
    """Say how large and how long a case is, and where it comes from."""
    count = len(case.mechanism.bodies)
    size = f"{count} {'body' if count == 1 else 'bodies'}; joints: {joints_of(case)}"
    sources = escape("; ".join(case.sources))
    asked = f"{case.duration:g} s, {case.digits} digits asked"
    return f"<br><small>{size}<br>{asked}</small><details><summary>Source</summary><small>{sources}</small></details>"
